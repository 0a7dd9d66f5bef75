"""First records of a file: whether imuscope recorded it, and whether it was compacted since.

Only heads of records are examined, a few bytes each, so this is safe in the server's process for any file.
"""

import os
import struct
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode

from imuscope.recordings.mcap.records import MAGIC
from imuscope.recordings.mcap.writer import PROFILE
from imuscope.recordings.system import file_lock
from imuscope.recordings.system.regular_file import open_regular

MOST_RECORDS = 10_000  # before the first message: definitions and metadata
TEMPORARY_SUFFIX = ".packing"  # of what a compaction writes, beside the recording
_HEAD = struct.Struct("<BQ")  # opcode, length
_PROFILE_AT = len(MAGIC) + _HEAD.size + 4  # after the header's own head, and the length of the string


def is_ours(path: Path) -> bool:
    """Whether imuscope recorded the file, by its first bytes, which are written before anything else."""
    try:
        with open_regular(path) as file:
            return _has_profile(file)
    except OSError:
        return False


def is_uncompacted(path: Path) -> bool:
    """Whether this is a finished recording with messages that are not in chunks (recordings/mcap/compaction.py)."""
    if file_lock.is_written(path):
        return False
    try:
        with open_regular(path) as file:
            return _has_profile(file) and _first_data(file) == Opcode.MESSAGE
    except OSError:
        return False


def _has_profile(file: BinaryIO) -> bool:
    head = file.read(_PROFILE_AT + len(PROFILE))
    return head.startswith(MAGIC) and head[_PROFILE_AT:] == PROFILE.encode()


def _first_data(file: BinaryIO) -> int | None:
    """Opcode of the first whole message or chunk; None if there is none."""
    at, size = len(MAGIC), os.fstat(file.fileno()).st_size
    for _ in range(MOST_RECORDS):
        file.seek(at)
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        opcode, length = _HEAD.unpack(head)
        at += _HEAD.size + length
        if at > size:
            return None
        if opcode in (Opcode.MESSAGE, Opcode.CHUNK, Opcode.DATA_END):
            return int(opcode)
    return None
