"""Content of a file: what makes two files the same recording, and the recording that is stored for it.

a recording (.mcap)     stored as it is; the same if it holds the same messages in the same order, so that one that was
                        compacted, or got a title, in the meantime is not a second one
captures, vendors' logs imported: the bytes as chunks with their times, as the library opens them
tables (.csv)           imported: the numbers as messages
"""

import hashlib
from itertools import pairwise
from pathlib import Path

import numpy as np

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.exporters import ExportRequest, export
from imuscope.recordings.importers.open_file import CaptureSource
from imuscope.recordings.importers.wrapped_capture import wrap_capture
from imuscope.recordings.mcap.chunked import HEAD
from imuscope.recordings.mcap.reader import DATA, LENGTH, McapReader
from imuscope.recordings.mcap.source import McapSource
from imuscope.recordings.readers.message_source import MessageSource
from imuscope.recordings.sidecar import Edits
from imuscope.recordings.sources import Source
from imuscope.recordings.tables.table_source import TableSource

PIECE_BYTES = 1 << 20
ID_LENGTH = 24  # hexadecimal digits of an identifier: 96 bits


def recording_id(path: Path, source: Source, robot: str) -> str:
    """Identifier of a file's content as a recording of that robot."""
    digest = hashlib.sha256(f"imuscope {robot}\0".encode())
    if not is_mcap(source) or not _add_messages(path, digest):
        for file in files_of(source):
            with file.open("rb") as data:
                while piece := data.read(PIECE_BYTES):
                    digest.update(piece)
    return digest.hexdigest()[:ID_LENGTH]


def is_mcap(source: Source) -> bool:
    """Whether the file is a recording already, of imuscope or of another program."""
    return isinstance(source, McapSource | MessageSource)


def files_of(source: Source) -> list[Path]:
    """The files of a source: several for a split log, and for the folder of a bag."""
    if source.path.is_dir():
        return sorted(path for path in source.path.iterdir() if path.is_file())
    return source.files if isinstance(source, CaptureSource) else [source.path]


def _add_messages(path: Path, digest: "hashlib._Hash") -> bool:
    """Add the messages of a recording; False if it has none."""
    has_messages = False
    with McapReader(path) as recording:
        for block in recording.blocks():
            rows = block.table
            apart = np.flatnonzero(rows[DATA, 1:] - HEAD != rows[DATA, :-1] + rows[LENGTH, :-1]) + 1
            for start, stop in pairwise([0, *apart.tolist(), rows.shape[1]]):
                if stop > start:
                    has_messages = True
                    digest.update(
                        block.data[int(rows[DATA, start]) - HEAD : int(rows[DATA, stop - 1] + rows[LENGTH, stop - 1])]
                    )
    return has_messages


def checksum_of(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def as_recording(source: Source, store: ColumnStore, folder: Path, title: str, edits: Edits) -> Path:
    """The recording (MCAP) of a file: the file itself, or one that is made in `folder`.

    Raises:
        RecordingError, OSError: it cannot be written.
    """
    if is_mcap(source):
        return source.path
    made = folder / "recording.mcap"
    if isinstance(source, TableSource):
        export("mcap", ExportRequest(store, source.path, source.path.name, -np.inf, np.inf), made)
        return made
    with made.open("wb") as out:
        wrap_capture(source, title, edits, out)
    return made
