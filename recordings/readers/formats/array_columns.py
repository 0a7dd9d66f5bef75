"""Named arrays of a file (NumPy, MATLAB, HDF5) as the columns of one table: those that have as many rows as most."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, TypeGuard

import numpy as np

from imuscope.protocols.arrays import Array
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats.arrow_table import BATCH_ROWS, ArrowColumns
from imuscope.recordings.tables.format import MAX_COLUMNS
from imuscope.recordings.tables.table_source import is_rate_name

if TYPE_CHECKING:
    import pyarrow as pa

MIN_ROWS = 2
AXES = ("x", "y", "z")


def columns_of(
    file: str, arrays: Mapping[str, Array], left_out: list[str], units: Mapping[str, str] = {}
) -> ArrowColumns:
    """The table of some arrays.

    Args:
        arrays: by name; "" for one without.
        left_out: sentences on others.
        units: of arrays, where the file names them.

    Raises:
        RecordingError: none has rows of numbers.
    """
    usable = {name: array for name, array in arrays.items() if _is_table(array)}
    if not usable:
        raise RecordingError(f"{file} has no arrays with rows of numbers.", "Save an array with a row for each sample.")
    counts = Counter(size for array in usable.values() for size in {*array.shape} if size >= MIN_ROWS)
    rows = max(counts, key=lambda size: (counts[size], size))
    columns: dict[str, Array] = {}
    others: list[str] = []
    rates = {name: array for name, array in arrays.items() if array.size == 1 and is_rate_name(_last(name))}
    if len(usable) == 1 and _begins_with_time(matrix := _matrix(next(iter(usable.values())), rows)):
        arrays, usable = {"": matrix}, {"": matrix}  # a whole table, whose name says nothing on its columns
    for name, array in arrays.items():
        if name in rates:
            continue
        matrix = _matrix(array, rows) if name in usable else None
        if matrix is None:
            others.append(f"{name} {'x'.join(map(str, array.shape)) or 'single value'}")
            continue
        unit = f" ({units[name]})" if units.get(name) else ""
        columns |= {f"{title}{unit}": one for title, one in _named(name, matrix).items()}
    if others:
        left_out = [*left_out, f"Arrays without {rows} rows of numbers are left out: {', '.join(others[:10])}."]
    names = list(columns)[:MAX_COLUMNS]

    def batches() -> "Iterator[pa.RecordBatch]":
        import pyarrow as pa

        for begin in range(0, rows, BATCH_ROWS):
            some = [np.ascontiguousarray(columns[name][begin : begin + BATCH_ROWS]) for name in names]
            native = [one.astype(one.dtype.newbyteorder("="), copy=False) for one in some]
            yield pa.RecordBatch.from_arrays([_arrow(one) for one in native], names=list(map(str, range(len(names)))))

    headings = names if any(not name.isdigit() for name in names) else [""] * len(names)
    metadata = {_last(name): str(array.reshape(-1)[0]) for name, array in rates.items()}
    return ArrowColumns(headings, batches, left_out, metadata)


def _last(name: str) -> str:
    """The name of a field, in lower case."""
    return name.rpartition(".")[2].lower()


def _begins_with_time(matrix: Array | None) -> TypeGuard[Array]:
    """Whether the first of several columns rises in every row."""
    if matrix is None or matrix.dtype.names or matrix.ndim < 2 or matrix.shape[1] < 2:
        return False
    return matrix.dtype.kind in "fiu" and bool((np.diff(matrix[:, 0].astype(np.float64)) > 0).all())


def _is_table(array: Array) -> bool:
    if array.dtype.names:
        return array.ndim == 1 and len(array) >= MIN_ROWS
    is_filled = array.size > 0 and max(array.shape, default=0) >= MIN_ROWS  # one of (10¹², 0) has rows without end
    return array.dtype.kind in "fiubMm" and 1 <= array.ndim <= 2 and is_filled


def _matrix(array: Array, rows: int) -> Array | None:
    """An array with so many rows; one that has its samples side by side is turned."""
    if array.ndim == 1 or array.dtype.names:
        return array if len(array) == rows else None
    if array.shape[0] == rows:
        return array
    return array.T if array.shape[1] == rows else None


def _named(name: str, matrix: Array) -> dict[str, Array]:
    if matrix.dtype.names:
        prefix = f"{name}." if name else ""
        inner = [(f"{prefix}{field}", matrix[field]) for field in matrix.dtype.names]
        usable = [(title, one) for title, one in inner if one.dtype.kind in "fiubMm" and one.ndim <= 2]
        return {title: one for text, many in usable for title, one in _named(text, many).items()}
    if matrix.dtype.kind in "Mm":
        name, matrix = f"{name or 'time'} [ns]", matrix.astype(f"{matrix.dtype.kind}8[ns]").astype(np.int64)
    if matrix.ndim == 1:
        return {name or "0": matrix}
    width = matrix.shape[1]
    if width == 1:
        return _named(name, matrix[:, 0])
    suffixes = AXES if width == len(AXES) and name else tuple(map(str, range(width)))
    prefix = f"{name}." if name else ""
    return {f"{prefix}{suffix}": matrix[:, place] for place, suffix in enumerate(suffixes)}


def _arrow(array: Array) -> "pa.Array":
    import pyarrow as pa

    if array.dtype.kind == "f" and array.dtype.itemsize not in (4, 8):
        array = array.astype(np.float64)
    return pa.array(array)
