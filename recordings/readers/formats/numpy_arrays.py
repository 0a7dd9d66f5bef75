"""Arrays of NumPy: .npy, mapped into memory, and .npz.

A structured array has named columns. Objects are never loaded: they can run programs.
"""

import io
import math
import zipfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from imuscope.protocols.arrays import Array
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats.array_columns import columns_of
from imuscope.recordings.readers.formats.arrow_table import ArrowSource, first_line
from imuscope.recordings.readers.formats.decompressing import is_bomb
from imuscope.recordings.readers.registry import FileReader, OpenRequest, register_reader
from imuscope.recordings.system.regular_file import open_regular

MAGIC = b"\x93NUMPY"
MAX_ARCHIVE_BYTES = 1 << 30  # bytes of all arrays of an archive
MOST_ARRAYS = 1000
HEADER_BYTES = 1 << 16
OBJECTS = "Save its numbers as an array with numpy.save, or as a CSV file."
DAMAGED = "Save it again with numpy.save or numpy.savez."


def _open_npy(request: OpenRequest) -> ArrowSource:
    path = request.path
    with open_regular(path):
        pass
    try:
        array: Array = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # whatever numpy raises for a header from outside
        if "Python objects" in str(error):
            raise RecordingError(f"{path.name} has objects, which can run programs, or is damaged.", OBJECTS) from None
        raise RecordingError(f"{path.name} is a damaged NumPy array: {first_line(error)}.", DAMAGED) from None
    return ArrowSource(path, columns_of(path.name, {"": array}, []), "npy", request.table)


def open_npz(request: OpenRequest) -> ArrowSource:
    """The arrays of an archive as a table."""
    path = request.path
    arrays: dict[str, Array] = {}
    left_out: list[str] = []
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            total = 0
            for entry in archive.infolist()[:MOST_ARRAYS]:
                name = entry.filename.removesuffix(".npy")
                with archive.open(entry) as content:
                    size = _claimed(content)
                total += max(size, 0)
                is_large = total > MAX_ARCHIVE_BYTES or is_bomb(total, path.stat().st_size)
                if size < 0 or size > entry.file_size or is_large:
                    left_out.append(f"{name} is left out: it holds objects, is damaged, or is too large.")
                    continue
                with archive.open(entry) as content:
                    data = content.read(size + HEADER_BYTES)
                arrays[name] = np.load(io.BytesIO(data), allow_pickle=False)
    except Exception as error:  # whatever zipfile and numpy raise for data from outside
        raise RecordingError(f"{path.name} is a damaged NumPy archive: {first_line(error)}.", DAMAGED) from None
    return ArrowSource(path, columns_of(path.name, arrays, left_out), "npz", request.table)


def is_npz(path: Path) -> bool:
    """Whether all files in a zip are arrays."""
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            names = archive.namelist()
    except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError):
        return False
    return bool(names) and all(name.endswith(".npy") for name in names)


def _claimed(content: BinaryIO | Any) -> int:
    """Bytes of an array by its header; -1 for objects and for other files."""
    try:
        version = np.lib.format.read_magic(content)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(content)
    except Exception:  # whatever numpy raises for a header from outside
        return -1
    if dtype.hasobject:
        return -1
    return int(dtype.itemsize * math.prod(map(int, shape)))


register_reader(FileReader("npy", "NumPy array", (".npy",), _open_npy, {0: (MAGIC,)}, order=50))
register_reader(FileReader("npz", "NumPy archive", (".npz",), open_npz, order=51))
