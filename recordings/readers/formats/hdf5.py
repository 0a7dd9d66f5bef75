"""HDF5 files, and MATLAB files of version 7.3, which are HDF5: their data sets of numbers as one table.

    a file ─ pyfive ─> groups, data sets, places of their chunks ─ here ─> arrays ─> columns_of

pyfive, in Python alone, reads the structure. The numbers are read here: those that lie together are mapped into memory,
chunks are decompressed into no more than their own size. So a damaged file costs neither memory nor time without limit.

MATLAB gives each variable its class as an attribute, stores matrices turned, structures as groups, texts as numbers.
A variable of NetCDF 4 counts its time from a date that its unit names.

Source: HDF5 File Format Specification 3.0, IV.A.2.l (filters); CF Conventions 1.11, 4.4 (units of time); for LZF, the
format that the decompressor of liblzf 3.6 reads (lzf_d.c).
"""

import io
import math
import re
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from imuscope.protocols.arrays import Array
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats.array_columns import columns_of
from imuscope.recordings.readers.formats.arrow_table import ArrowSource, first_line
from imuscope.recordings.readers.formats.decompressing import is_bomb
from imuscope.recordings.readers.formats.matlab import NUMBERS
from imuscope.recordings.readers.registry import FileReader, OpenRequest, register_reader
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.tables.table_source import is_rate_name
from imuscope.recordings.tables.time_units import FACTORS, LONG_SPELLINGS, SPELLINGS

MAGIC = b"\x89HDF\r\n\x1a\n"
MATLAB = b"MATLAB 7.3 MAT-file"
MAX_CHUNKED_BYTES = 1 << 30  # bytes of all data sets in chunks
LARGEST_CHUNK = 1 << 28
MAX_DEPTH = 6
MOST_SETS = 1000
MOST_READS = 300_000  # of the structure: a damaged one can lead back to itself
DEFLATE, SHUFFLE, CHECKSUM, LZF = 1, 2, 3, 32_000
LITERAL, FAR_LENGTH = 32, 7  # of LZF: control bytes below are of literals; a length that goes on in the next byte
UNREAD = "in a form that is not read"
NEWER = "in chunks as HDF5 1.10 keeps them; write it without libver"
RESAVE = "Save its arrays as .npz, Parquet or CSV; in MATLAB with save(..., '-v7')."
UNIT_NAMES = {**SPELLINGS, **LONG_SPELLINGS}
SINCE = re.compile(rf"({'|'.join(sorted(UNIT_NAMES))})\s+since\s+(.+)", re.I)


class EndlessError(ValueError):
    """A structure with more parts than any file has."""


class _Counted(io.RawIOBase):
    """A file that ends the search of a structure that never ends. It has no descriptor, so pyfive maps nothing."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._reads = 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = 0, /) -> int:
        return self._file.seek(offset, whence)

    def read(self, size: int | None = -1, /) -> bytes:
        self._reads += 1
        if self._reads > MOST_READS:
            raise EndlessError("its structure leads back to itself, or is too large")
        return self._file.read(-1 if size is None else size)


@dataclass(slots=True)
class _Content:
    """Arrays of a file and their units by name, and names of its other data sets."""

    path: Path
    size: int
    base: int = 0  # of all addresses: what MATLAB writes ahead
    is_matlab: bool = False
    total: int = 0
    arrays: dict[str, Array] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    others: list[str] = field(default_factory=list)
    rates: dict[str, str] = field(default_factory=dict)  # attributes that are a sampling rate


def _open(request: OpenRequest) -> ArrowSource:
    from pyfive import File

    path = request.path
    try:
        with open_regular(path) as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content = _Content(path, path.stat().st_size)
            content.is_matlab = file.read(len(MATLAB)) == MATLAB
            file.seek(0)
            whole = File(_Counted(file))
            content.base = int(whole.userblock_size)
            _note_rates(content, whole.attrs)
            for name, item, problem in _items(whole, "", 0, {_place(whole)}):
                _add(content, name, item, problem, file)
    except Exception as error:  # whatever pyfive raises for data from outside
        words = first_line(error) if isinstance(error, ValueError) else "its structure is not understood"
        raise RecordingError(f"{path.name} is a damaged HDF5 file: {words}.", RESAVE) from None
    left_out = [f"Left out: {', '.join(content.others[:10])}."] if content.others else []
    if not content.arrays:
        raise RecordingError(" ".join([f"{path.name} has no arrays of numbers.", *left_out]), RESAVE)
    columns = columns_of(path.name, content.arrays, left_out, content.units)
    columns = replace(columns, metadata={**columns.metadata, **content.rates})
    return ArrowSource(path, columns, "hdf5", request.table)


def _note_rates(content: _Content, attributes: Mapping[str, Any]) -> None:
    """Note attributes of the file or of an array that are a sampling rate."""
    for name in attributes:
        if is_rate_name(name.lower()):
            value = np.asarray(attributes[name])
            is_number = value.dtype.kind in "fiu" and value.size == 1
            content.rates[name.lower()] = str(float(value.reshape(-1)[0])) if is_number else _text(attributes[name])


def _items(group: Any, prefix: str, depth: int, visited: set[int]) -> Iterator[tuple[str, Any, str]]:
    """All data sets below a group: name, data set, and why it cannot be read. No group is read twice."""
    from pyfive import Group

    for count, key in enumerate(group):
        name = f"{prefix}{key}"
        if key.startswith("#") or count >= MOST_SETS:
            continue  # MATLAB keeps cells and objects in groups of these names
        try:
            item = group.get_lazy_view(key)
            if isinstance(item, Group):
                place = _place(item)
                if depth < MAX_DEPTH and place not in visited and "MATLAB_sparse" not in item.attrs:
                    visited.add(place)
                    yield from _items(item, f"{name}.", depth + 1, visited)
                continue
        except EndlessError:
            raise
        except Exception as error:  # whatever pyfive raises for what it does not read
            yield name, None, _unread(error)
            continue
        if item is not None:  # a link to nothing
            yield name, item, ""


def _place(group: Any) -> int:
    """The address of a group, the same by whatever link leads to it."""
    return int(group._dataobjects.offset)  # noqa: SLF001 - pyfive has no other word for it


def _add(content: _Content, name: str, item: Any, problem: str, file: BinaryIO) -> None:
    """Add a data set, or name it."""
    if problem or len(content.arrays) >= MOST_SETS:
        content.others.append(f"{name} ({problem or 'too many'})")
        return
    try:
        attributes: Mapping[str, Any] = item.attrs
        _note_rates(content, attributes)
        kind = _text(attributes.get("MATLAB_class", b""))
        if "MATLAB_empty" in attributes or (content.is_matlab and kind not in NUMBERS):
            content.others.append(f"{name} ({'empty' if kind in NUMBERS else kind or 'object'})")
            return
        if (
            "MATLAB_object_decode" in attributes
            or not (item.dtype.names or item.dtype.kind in "fiub")
            or not item.shape
        ):
            content.others.append(f"{name} ({'single value' if not item.shape else 'no numbers'})")
            return
        array = _array(content, item, file)
        unit = _text(attributes.get("units", attributes.get("unit", b"")))
        content.arrays[name] = _dated(array, unit)
        if unit and content.arrays[name] is array and SINCE.fullmatch(unit) is None:
            content.units[name] = unit
    except MemoryError:
        content.others.append(f"{name} (too large)")
    except EndlessError:
        raise
    except IndexError:
        content.others.append(f"{name} (damaged)")
    except (ValueError, zlib.error) as error:
        content.others.append(f"{name} ({first_line(error)})")
    except Exception as error:  # whatever else pyfive raises for data from outside
        content.others.append(f"{name} ({_unread(error)})")


def _unread(error: Exception) -> str:
    """Words on a data set that pyfive does not read."""
    return NEWER if "layout class 4" in str(error) else UNREAD


def _array(content: _Content, item: Any, file: BinaryIO) -> Array:
    """The numbers of a data set.

    Raises:
        ValueError: they are damaged, too large or compressed in another way.
    """
    shape, kind, place = tuple(map(int, item.shape)), np.dtype(item.dtype), item.id
    size = kind.itemsize * math.prod(shape)
    if place.layout_class == 1:
        begin = content.base + place.data_offset
        if begin + size > content.size:
            raise ValueError("without values, or cut")
        return np.memmap(content.path, kind, "r", begin, shape)
    if content.total + size > MAX_CHUNKED_BYTES or is_bomb(content.total + size, content.size):
        raise ValueError("too large")
    content.total += size
    if place.layout_class == 0:
        return np.asarray(item[()]).reshape(shape)
    return _of_chunks(content.base, place, shape, kind, file)


def _of_chunks(base: int, place: Any, shape: tuple[int, ...], kind: np.dtype[Any], file: BinaryIO) -> Array:
    """An array that is stored in chunks; those that are not stored hold 0, or NaN."""
    chunk = tuple(map(int, place.chunks))
    size = kind.itemsize * int(np.prod(chunk, dtype=object))
    if not 0 < size <= LARGEST_CHUNK or len(chunk) != len(shape):
        raise ValueError("damaged")
    count = place.get_num_chunks()
    if count == 0:
        raise ValueError("without values")
    array = np.full(shape, np.nan if kind.kind == "f" else 0, kind)
    for number in range(count):
        stored = place.get_chunk_info(number)
        begin = tuple(map(int, stored.chunk_offset))
        if any(at >= length for at, length in zip(begin, shape, strict=True)):
            continue  # it was made smaller
        if stored.size > 2 * size + 64:
            raise ValueError("damaged")
        file.seek(base + stored.byte_offset)
        data = _unpacked(file.read(stored.size), stored.filter_mask, place.filter_pipeline or (), kind.itemsize, size)
        values = np.frombuffer(data, kind).reshape(chunk)
        there = tuple(slice(at, at + length) for at, length in zip(begin, chunk, strict=True))
        fits = tuple(slice(0, min(length, whole - at)) for at, length, whole in zip(begin, chunk, shape, strict=True))
        array[there] = values[fits]
    return array


def _unpacked(data: bytes, skipped: int, filters: Any, width: int, size: int) -> bytes:
    """A chunk as it was before its filters, which are undone from the last to the first."""
    for number in range(len(filters) - 1, -1, -1):
        name = filters[number]["filter_id"]
        if skipped >> number & 1:
            continue
        if (undo := UNDO.get(name)) is None:
            raise ValueError(f"compressed by filter {name} of HDF5, not by gzip or lzf")
        data = undo(data, width, size)
    if len(data) != size:
        raise ValueError("damaged")
    return data


def _inflate(data: bytes, width: int, size: int) -> bytes:
    return zlib.decompressobj().decompress(data, size + 64)


def _lzf(data: bytes, width: int, size: int) -> bytes:
    """Literal runs, and copies of earlier bytes."""
    out, at = bytearray(), 0
    while at < len(data) and len(out) <= size:
        control = data[at]
        at += 1
        if control < LITERAL:
            out += data[at : at + control + 1]
            at += control + 1
            continue
        length, back = control >> 5, (control & 31) << 8
        if length == FAR_LENGTH:
            length += data[at]
            at += 1
        begin = len(out) - back - data[at] - 1
        at += 1
        if begin < 0:
            raise ValueError("damaged")
        piece = bytes(out[begin : begin + length + 2])
        out += (piece * ((length + 2) // len(piece) + 1))[: length + 2]  # a copy may go on into itself
    return bytes(out)


def _unshuffle(data: bytes, width: int, size: int) -> bytes:
    count = len(data) // width
    whole = np.frombuffer(data, np.uint8, count * width).reshape(width, count)
    return whole.T.tobytes() + data[count * width :]


def _checked(data: bytes, width: int, size: int) -> bytes:
    """The bytes ahead of their Fletcher-32 checksum."""
    body = data[:-4]
    words = np.frombuffer(body + b"\0" * (len(body) % 2), ">u2").astype(np.uint64)
    first = int(words.sum()) % 65535
    second = int((words * (np.arange(len(words), 0, -1, dtype=np.uint64) % 65535)).sum()) % 65535
    if int.from_bytes(data[-4:], "little") not in _spellings(second << 16 | first):
        raise ValueError("a checksum is wrong")
    return body


def _spellings(checksum: int) -> set[int]:
    """A checksum, and as libraries before HDF5 1.6.3 wrote it; 0 and 65535 are the same sum."""
    sums = {checksum, *(checksum | mask for mask in (0xFFFF, 0xFFFF0000) if checksum & mask == 0)}
    return sums | {(one & 0x00FF00FF) << 8 | (one & 0xFF00FF00) >> 8 for one in sums}


UNDO: Mapping[int, Callable[[bytes, int, int], bytes]] = {
    DEFLATE: _inflate,
    SHUFFLE: _unshuffle,
    CHECKSUM: _checked,
    LZF: _lzf,
}


def _text(value: Any) -> str:
    """The text of an attribute; "" for one that is something else."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    text = value.decode(errors="replace") if isinstance(value, bytes) else value
    return text.strip() if isinstance(text, str) and len(text) < 100 else ""


def _dated(array: Array, unit: str) -> Array:
    """Times that count from a date ("seconds since 2026-01-01"), as dates; other arrays as they are."""
    numbers: Array
    counted = SINCE.fullmatch(unit)
    if counted is None or array.ndim != 1 or array.dtype.kind not in "fiu":
        return array
    try:
        text = counted[2].strip().removesuffix("UTC").strip().removesuffix("Z")
        begin = int(np.datetime64(text.removesuffix("+00:00").strip(), "ns").astype(np.int64))
    except ValueError:
        return array
    step = round(FACTORS[UNIT_NAMES[counted[1].lower()]] * 1e9)
    if array.dtype.kind == "f":
        whole, part = np.divmod(array.astype(np.float64), 1.0)
        if not np.isfinite(whole).all() or np.abs(whole).max(initial=0) > 2**62 / step:
            return array
        numbers = whole.astype(np.int64) * step + np.rint(part * step).astype(np.int64)
    else:
        numbers = array.astype(np.int64) * step
    dates: Array = (begin + numbers).view("M8[ns]")
    return dates


register_reader(FileReader("mat73", "MATLAB 7.3", (".mat",), _open, {0: (MATLAB,)}, order=54))
register_reader(FileReader("hdf5", "HDF5", (".h5", ".hdf5", ".nc"), _open, {0: (MAGIC,)}, order=55))
