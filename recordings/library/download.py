"""Export of a whole recording for another imuscope, and of the bytes of one device as received.

a recording of imuscope   compacted again, with the user's changes in its metadata `edit`
a capture, a log          wrapped: its bytes as chunks with the times derived for them
another program's MCAP    unchanged, with metadata `edit` after its messages
CSV                       unchanged, after a comment line with the same
what a reader opens       unchanged (recordings/readers/)

Recordings without changes are passed on byte for byte.
"""

import json
import shutil
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import DataEnd, Footer, Metadata, MetadataIndex

from imuscope.recordings import sidecar
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.importers.wrapped_capture import wrap_capture
from imuscope.recordings.library.recording_probe import CAPTURE_FORMATS
from imuscope.recordings.mcap.compaction import write_compacted
from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.mcap.records import MAGIC, bytes_of
from imuscope.recordings.mcap.writer import EDIT
from imuscope.recordings.system.regular_file import open_regular

BOM = b"\xef\xbb\xbf"
_RECORD_HEAD = 9  # opcode, length
_DATA_END = _RECORD_HEAD + 4
_FOOTER = _RECORD_HEAD + 20
_METADATA_COUNT = _RECORD_HEAD + 8 + 2 + 4 + 4  # its offset in a statistics record


def full_recording(path: Path, title: str, edits: sidecar.Edits, format_name: str, out: BinaryIO) -> None:
    """Write everything of a recording.

    Args:
        title, edits: as in the library.
        format_name: as found when its metadata was read.

    Raises:
        RecordingError, OSError: it cannot be read.
    """
    if format_name == "mcap":
        with McapReader(path) as recording:
            if recording.is_ours:
                write_compacted(recording, out, edit=edits.as_metadata())
                return
    if format_name not in CAPTURE_FORMATS:
        with open_regular(path) as file:
            _with_edits(file, edits, format_name, out)
        return
    wrap_capture(open_file(path), title, edits, out)


def original_bytes(path: Path, device: str, out: BinaryIO) -> None:
    """Write the bytes that came from one device. Raises as `full_recording` does."""
    for part in open_file(path).parts():
        if part.direction == "rx" and part.device == device:
            out.write(part.data)


def _with_edits(file: BinaryIO, edits: sidecar.Edits, format_name: str, out: BinaryIO) -> None:
    """Copy a file of another program with the user's changes."""
    values = edits.as_metadata()
    if values and format_name == "csv":
        first = file.readline(sidecar.MAX_BYTES)
        mark = BOM if first.startswith(BOM) else b""
        line = f"{sidecar.CSV_EDIT}{json.dumps(values, ensure_ascii=False)}\n".encode()
        out.write(mark + line)
        if sidecar.from_csv(first) == sidecar.Edits():  # else its own line has older edits
            out.write(first.removeprefix(BOM))
    if not (values and format_name == "mcap" and _with_metadata(file, Metadata(name=EDIT, metadata=values), out)):
        shutil.copyfileobj(file, out, 1 << 20)


def _with_metadata(file: BinaryIO, metadata: Metadata, out: BinaryIO) -> bool:
    """Copy an MCAP file with metadata after its messages; False, and nothing written, if its end is not found.

    All data keeps its place, so the index of its messages stays valid; only the summary moves.
    """
    size = file.seek(0, 2)
    file.seek(max(0, size - _FOOTER - len(MAGIC)))
    end = file.read()
    if len(end) < _FOOTER + len(MAGIC) or end[0] != Opcode.FOOTER or not end.endswith(MAGIC):
        file.seek(0)
        return False
    (start,) = struct.unpack_from("<Q", end, _RECORD_HEAD)
    file.seek(max(0, start - _DATA_END))
    tail = file.read(size - start + _DATA_END - _FOOTER - len(MAGIC)) if start >= _DATA_END else b""
    file.seek(0)
    if tail[:1] != bytes([Opcode.DATA_END]):
        return False
    left = start - _DATA_END
    while left and (piece := file.read(min(left, 1 << 20))):
        out.write(piece)
        left -= len(piece)
    record = bytes_of(metadata)
    index = MetadataIndex(offset=start - _DATA_END, length=len(record), name=metadata.name)
    out.write(record + bytes_of(DataEnd(data_section_crc=0)))
    out.write(b"".join(_summary(tail[_DATA_END:])) + bytes_of(index))
    out.write(bytes_of(Footer(summary_start=start + len(record), summary_offset_start=0, summary_crc=0)) + MAGIC)
    file.seek(0, 2)
    return True


def _summary(records: bytes) -> Iterator[bytes]:
    """The records of a summary with one more metadata counted, without its summary offsets."""
    at = 0
    while at + _RECORD_HEAD <= len(records):
        opcode, length = struct.unpack_from("<BQ", records, at)
        record = bytearray(records[at : at + _RECORD_HEAD + length])
        at += _RECORD_HEAD + length
        if opcode == Opcode.STATISTICS and len(record) >= _METADATA_COUNT + 4:
            (count,) = struct.unpack_from("<I", record, _METADATA_COUNT)
            struct.pack_into("<I", record, _METADATA_COUNT, count + 1)
        if opcode != Opcode.SUMMARY_OFFSET:
            yield bytes(record)
