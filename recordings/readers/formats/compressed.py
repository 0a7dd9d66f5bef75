"""Files that hold other files: zip, gzip, Zstandard, and text in UTF-16, as Windows and its PowerShell write it, which
is opened as the same text in UTF-8. One file is opened; of a zip, all tables, or the one recording.

    .csv.gz .db3.zst …    the file inside, by its name without the last suffix
    .zip                  a ROS 2 bag (metadata.yaml), several tables (each a message), or one recording

An archive in an archive is refused. What the files claim about their sizes is not trusted: decompressing.py counts.
"""

from __future__ import annotations

import codecs
import functools
import os
import re
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.file_names import clean_name
from imuscope.recordings.readers.file_suffixes import suffixes
from imuscope.recordings.readers.folders import (
    METADATA,
    PACKETS,
    SENSOR,
    SENSOR_DATA,
    TIMES,
    packet_folder,
    sensor_folders,
)
from imuscope.recordings.readers.formats.decompressing import UnpackedFolder, decompressed
from imuscope.recordings.readers.formats.numpy_arrays import is_npz, open_npz
from imuscope.recordings.readers.registry import FileReader, OpenRequest, register_reader
from imuscope.recordings.sources import add_outer_damage, remark
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.tables.options import TableOptions

if TYPE_CHECKING:
    from imuscope.recordings.sources import Source

MOST_ZERO = 0.8  # of every other byte, in text with few letters beyond ASCII
UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
MOST_ENTRIES = 10_000
MOST_TABLES = 64
MAX_NAMED = 5
SPREADSHEET = "xl/workbook.xml"
OFFICE = {
    SPREADSHEET: ("an Excel workbook", "Save it as CSV."),
    "word/document.xml": ("a Word document", "Give the numbers themselves, as a CSV file."),
    "ppt/presentation.xml": ("a presentation", "Give the numbers themselves, as a CSV file."),
    "META-INF/MANIFEST.MF": ("a Java program", "Give the file with the samples of the sensor."),
    "AndroidManifest.xml": ("an Android program", "Give the file with the samples of the sensor."),
    "META-INF/manifest.xml": ("an OpenDocument file", "Save it as CSV."),
}
"""Programs' own formats that are zip files, by an entry that they have."""


def _open_one(request: OpenRequest, codec: str) -> Source:
    path = request.path
    name = clean_name(path.stem if path.suffix.lower() in (".gz", ".zst", ".zstd") else path.name, suffixes())
    unpacked = UnpackedFolder(path)
    return temporary_source(unpacked, request, lambda: [decompressed(path, unpacked, name, codec)])


def is_utf16(head: bytes) -> bool:
    """Whether these are the first bytes of such a text: its mark, and characters of which half the bytes are zero."""
    high = head[3::2] if head.startswith(UTF16_MARKS[0]) else head[2::2]
    return head.startswith(UTF16_MARKS) and high.count(0) > MOST_ZERO * len(high)


def _open_utf16(request: OpenRequest) -> Source:
    unpacked = UnpackedFolder(request.path)
    with open_regular(request.path) as file:
        text = codecs.EncodedFile(file, "utf-8", "utf-16", "replace")
        return temporary_source(unpacked, request, lambda: [unpacked.write(request.path.name, text)])


def _open_zip(request: OpenRequest) -> Source:
    path = request.path
    if is_npz(path):
        return open_npz(request)
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            entries = _entries(path, archive)
            unpacked = UnpackedFolder(path)
            return temporary_source(unpacked, request, lambda: _extracted(archive, entries, unpacked))
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError) as error:
        hint = "Pack it again." if "password" not in str(error) else "Pack it without a password."
        raise RecordingError(f"{path.name} cannot be unpacked: {str(error)[:100].lower()}.", hint) from None


def _entries(path: Path, archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    """The files in a zip that may be recordings."""
    names = set(archive.namelist())
    for entry, (kind, remedy) in OFFICE.items():
        if entry in names:
            raise RecordingError(f"{path.name} is {kind}, which imuscope does not read.", remedy)
    entries = [one for one in archive.infolist() if not one.is_dir() and not _is_hidden(one.filename)]
    if not entries:
        raise RecordingError(f"{path.name} holds no files.", "Give an archive with a recording.")
    entries = _of_sensors(entries) or _of_packets(entries) or entries
    if len(entries) > MOST_ENTRIES:
        raise RecordingError(f"{path.name} holds {len(entries)} files.", "Unpack it, and give a file of it.")
    return entries


def _is_hidden(name: str) -> bool:
    """Whether a file belongs to the system that packed it."""
    parts = (part for part in name.split("/") if part not in (".", ".."))
    return any(part.startswith((".", "__MACOSX")) for part in parts)


def _extracted(archive: zipfile.ZipFile, entries: list[zipfile.ZipInfo], unpacked: UnpackedFolder) -> list[Path]:
    unpacked.check(sum(entry.file_size for entry in entries))
    files = []
    is_euroc, is_oxts = bool(_of_sensors(entries)), bool(_of_packets(entries))
    for entry in entries:
        name = entry.filename.rsplit("/", 1)[-1]
        name = name if name == METADATA else _flat_name(name)
        if is_euroc:
            folder = clean_name(f"{_sensor(entry)}.csv", suffixes()).removesuffix(".csv")
            (unpacked.path / folder).mkdir(exist_ok=True)
            name = f"{folder}/{name}"
        elif is_oxts and name != TIMES:
            (unpacked.path / PACKETS).mkdir(exist_ok=True)
            name = f"{PACKETS}/{name}"
        elif (unpacked.path / name).exists():
            name = clean_name(entry.filename.replace("/", "-"), suffixes())
        if (unpacked.path / name).exists():
            continue
        with archive.open(entry) as content:
            files.append(unpacked.write(name, content))
    return files


def _of_sensors(entries: list[zipfile.ZipInfo]) -> list[zipfile.ZipInfo]:
    """The tables of an EuRoC folder and their descriptions, without its pictures; none if it is not one."""
    named = [one for one in entries if one.filename.rsplit("/", 1)[-1] in (SENSOR_DATA, SENSOR)]
    named = [one for one in named if _sensor(one) and not _sensor(one).startswith("cam")]
    is_imu = any(_sensor(one).startswith("imu") and one.filename.endswith(SENSOR_DATA) for one in named)
    return named if is_imu else []


def _of_packets(entries: list[zipfile.ZipInfo]) -> list[zipfile.ZipInfo]:
    """The times and the packets of an OXTS receiver in one drive of KITTI; none if there are not both."""
    times = [one.filename for one in entries if f"/{one.filename}".endswith(f"/oxts/{TIMES}")]
    folder = times[0].removesuffix(TIMES) if len(times) == 1 else ""
    packets = [one for one in entries if folder and re.fullmatch(rf"{PACKETS}/\d+\.txt", one.filename[len(folder) :])]
    packets = [one for one in packets if one.filename.startswith(folder)][: MOST_ENTRIES - 1]
    return [*packets, *(one for one in entries if one.filename in times)] if packets else []


def _sensor(entry: zipfile.ZipInfo) -> str:
    """Name of the folder that a file of a zip is in; "" without one."""
    return "".join(entry.filename.split("/")[-2:-1])


def _flat_name(name: str) -> str:
    """A safe name with the suffix that it has, if that is one."""
    stem, suffix = os.path.splitext(name)
    cleaned = clean_name(name, suffixes())
    known = cleaned.lower().endswith(suffix.lower())
    return cleaned if known or not suffix[1:].isalnum() else f"{clean_name(stem + '.bin', suffixes())[:-4]}{suffix}"


def temporary_source(unpacked: UnpackedFolder, request: OpenRequest, extract: Callable[[], list[Path]]) -> Source:
    """The source of unpacked files, which are removed with it."""
    return unpacked.source(lambda: _opened(extract(), request, unpacked.path))


def _opened(files: list[Path], request: OpenRequest, folder: Path) -> Source:
    """The content of an archive as one source."""
    from imuscope.recordings.readers.formats.table_set import TableSet
    from imuscope.recordings.tables.table_source import TableSource

    if any(file.name == METADATA for file in files) and len(files) > 1:
        return request.open_packed(folder, "", TableOptions())
    if sensor_folders(folder) or packet_folder(folder) is not None:
        return request.open_packed(folder, "", request.table)
    sources: list[Source] = []
    errors: dict[str, RecordingError] = {}
    for file in files:
        try:
            sources.append(request.open_packed(file, request.protocol, request.table))
        except RecordingError as error:
            errors[file.name] = error
        if len(sources) > MOST_TABLES:
            break
    tables = [one for one in sources if isinstance(one, TableSource)]
    if not sources:
        first = next(iter(errors.values()))
        if len(files) == 1:
            raise first
        raise RecordingError(
            f"{request.path.name} holds no file that can be opened. First: {first.message}", first.hint
        )
    if len(sources) == 1:
        source = sources[0]
    elif len(tables) == len(sources):
        source = TableSet(request.path, tables)
    else:
        named = ", ".join(one.path.name for one in sources[:MAX_NAMED])
        words = f"{request.path.name} holds several recordings: {named}{' …' if len(sources) > MAX_NAMED else ''}."
        raise RecordingError(words, "Unpack it, and give one of them.")
    if errors and len(files) > 1:
        named = ", ".join(list(errors)[:MAX_NAMED])
        add_outer_damage(source, [remark(f"Of {request.path.name} these are left out: {named}.")])
    return source


register_reader(
    FileReader("zip", "Zip", (".zip",), _open_zip, {0: (b"PK\x03\x04", b"PK\x05\x06")}, order=80, is_container=True)
)
for _name, _title, _suffixes, _mark, _codec in (
    ("gzip", "Gzip", (".gz",), b"\x1f\x8b\x08", "gzip"),
    ("zstd", "Zstandard", (".zst", ".zstd"), b"\x28\xb5\x2f\xfd", "zstd"),
):
    register_reader(
        FileReader(
            _name,
            _title,
            _suffixes,
            functools.partial(_open_one, codec=_codec),
            {0: (_mark,)},
            order=81,
            is_container=True,
        )
    )
register_reader(FileReader("utf16", "Text in UTF-16", (), _open_utf16, order=85, recognises=is_utf16))
