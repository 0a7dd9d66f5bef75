"""MATLAB files up to version 7 (save -v7): arrays, and the fields of structures, as one table.

Version 7.3 is HDF5 (hdf5.py). Objects (timetable, table) are left out: MATLAB keeps their form to itself.
"""

import math
import warnings
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Array
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats.array_columns import columns_of
from imuscope.recordings.readers.formats.arrow_table import ArrowSource, first_line
from imuscope.recordings.readers.formats.decompressing import is_bomb
from imuscope.recordings.readers.known_files import is_plain_text
from imuscope.recordings.readers.registry import HEAD_BYTES, FileReader, OpenRequest, register_reader
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.tables.table_source import CsvSource, TableSource

MAX_VARIABLE_BYTES = 1 << 30  # bytes of all variables
MAX_DEPTH = 4
NUMBERS = {"double", "single", "logical", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"}
RESAVE = "Save it again with save(..., '-v7')."


def _open(request: OpenRequest) -> TableSource:
    from scipy.io import loadmat, whosmat

    path = request.path
    with open_regular(path) as file:
        is_text = is_plain_text(file.read(HEAD_BYTES))
    if is_text:  # save -ascii
        return CsvSource(path, request.table)
    try:
        with open_regular(path) as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.filterwarnings("error", message=".*corrupt")
            listed = whosmat(file)
            chosen, left_out = _chosen(listed, path.stat().st_size)
            file.seek(0)
            loaded: dict[str, Any] = loadmat(file, variable_names=chosen, struct_as_record=True, squeeze_me=False)
    except TypeError:  # by scipy, for a variable of a class without a name
        words = f"{path.name} holds an object of MATLAB, such as a table or timetable, which cannot be read."
        raise RecordingError(words, "Save its columns as arrays, or as CSV with writetable.") from None
    except Exception as error:  # whatever scipy raises for data from outside
        raise RecordingError(f"{path.name} is a damaged MATLAB file: {first_line(error)}.", RESAVE) from None
    arrays: dict[str, Array] = {}
    for name in chosen:
        if isinstance(loaded.get(name), np.ndarray):
            _flatten(name, loaded[name], arrays, 0)
    return ArrowSource(path, columns_of(path.name, arrays, left_out), "mat", request.table)


def _chosen(listed: list[tuple[str, tuple[int, ...], str]], stored: int) -> tuple[list[str], list[str]]:
    """Variables that are loaded, and sentences on the others."""
    chosen, others, total = [], [], 0
    for name, shape, kind in listed:
        size = 8 * math.prod(max(int(length), 0) for length in shape)
        if kind not in (*NUMBERS, "struct") or total + size > MAX_VARIABLE_BYTES or is_bomb(total + size, stored):
            others.append(f"{name} ({kind})")
            continue
        total += size
        chosen.append(name)
    return chosen, [
        f"Variables without numbers, or too large, are left out: {', '.join(others[:10])}."
    ] if others else []


def _flatten(name: str, array: Array, arrays: dict[str, Array], depth: int) -> None:
    """Add an array, or the fields of a structure."""
    if array.dtype.names is None:
        if array.dtype.kind in "fiub":
            arrays[name] = array
        return
    if array.size != 1 or depth >= MAX_DEPTH:
        return
    record = array.reshape(-1)[0]
    for field in array.dtype.names:
        if isinstance(record[field], np.ndarray):
            _flatten(f"{name}.{field}", record[field], arrays, depth + 1)


register_reader(FileReader("mat", "MATLAB", (".mat",), _open, {0: (b"MATLAB 5.0 MAT-file",)}, order=52))
register_reader(FileReader("mat4", "MATLAB 4", (".mat",), _open, order=53))
