"""Layouts: table rows to bytes, and bytes to columns.

A payload is its message's fields, packed, in the order of the table. From the fields follow:

    sizes      size_of, fit       number of bytes; the form of a message for a payload of some size
    one frame  unpack, pack       payload → values by name (Python numbers, text, lists) and back
    many       Layout             frames of one layout, gathered into one array → columns

    frames   [hdr|a a|b b b b|x|cs]  [hdr|a a|b b b b|x|cs] …
    gathered [a a b b b b x]               one row of bytes per frame; a packed numpy dtype is laid over it
             [a a b b b b x]
    columns  a: (n,)   b: (n,)   x: (n,)   native byte order, displayed units, converted on first access

Wire encodings that numpy lacks:

    fp1220   big-endian int32, value × 2^20
    fp1632   48 bits, value × 2^32, sent as its 4 low bytes and then its 2 high bytes, each big-endian:
             b3 b2 b1 b0 b5 b4                    (MT0101P 2020.A, section 5.3.5)
    bytes    opaque; a column of them is uint8 (n, size)
    ascii    one byte a character (read as Latin-1, so that any byte survives); padding is not part of the value;
             with a second dimension a list of texts

Values here are wire values: unscaled numbers, fixed point as the exact float64. Only columns carry displayed units.

Rules for editing: a field whose shape begins with -1 takes the rest of the payload, so it comes last.
"""

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array
from imuscope.protocols.schema.fields import Field

_FP1632 = np.dtype([("low", ">u4"), ("high", ">i2")])
_SPECIAL = {"fp1220": np.dtype(">i4"), "fp1632": _FP1632, "bytes": np.dtype("u1"), "ascii": np.dtype("S1")}
_MIN_PIECED_ROWS = 64  # rows, from which `_FieldReader` copies in pieces
_FIXED_POINT = {"fp1220": (20, 4), "fp1632": (32, 6)}  # fraction bits, bytes


class EncodeError(ValueError):
    """A value that does not fit its field. The text names the field, the given value and the allowed range.

    Args:
        path: of the field within the given value ("outputs.3.output_frequency"), "" if unknown.
    """

    def __init__(self, message: str, path: str = "") -> None:
        super().__init__(message)
        self.path = path


# -- sizes -------------------------------------------------------------------------------------------------------------


def element(field: Field) -> np.dtype[Any]:
    """The packed dtype of one element of `field`, as on the wire."""
    if field.fields:
        return np.dtype([(part.name, element(part), part.shape) for part in field.fields])
    return _SPECIAL.get(field.dtype) or np.dtype(field.dtype)


def size_of(field: Field) -> int:
    """Bytes of `field` on the wire; of one element if its shape begins with -1."""
    return element(field).itemsize * math.prod(n for n in field.shape if n != -1)


def is_open(field: Field) -> bool:
    """Whether the field takes any number of elements."""
    return bool(field.shape) and field.shape[0] == -1


def form_for_size(fields: Sequence[Field], size: int) -> tuple[Field, ...] | None:
    """`fields` with the count of the open one filled in, for a payload of exactly `size` bytes; None if impossible."""
    rest = size - sum(size_of(field) for field in fields if not is_open(field))
    if not fields or not is_open(fields[-1]):
        return tuple(fields) if rest == 0 else None
    last = fields[-1]
    count, over = divmod(rest, size_of(last))
    if over or count < 0:
        return None
    return (*fields[:-1], replace(last, shape=(count, *last.shape[1:])))


# -- one frame ---------------------------------------------------------------------------------------------------------


def unpack(fields: Sequence[Field], payload: bytes, at: int = 0, *, exact: bool = False) -> dict[str, Any]:
    """Wire values by name.

    Args:
        fields: as returned by `form_for_size`; the payload must hold them from `at` on.
        exact: give a float that is not finite as {"f32": hex} or {"f64": hex}, because a NaN has many bit patterns;
            the digits are its bits as a number, highest first, whatever the wire's byte order.
    """
    values = {}
    for field in fields:
        values[field.name] = _read(field, payload, at, exact)
        at += size_of(field)
    return values


def _read(field: Field, payload: bytes, at: int, exact: bool) -> Any:
    size = size_of(field)
    raw = payload[at : at + size]
    if field.dtype == "bytes":
        return raw
    if field.dtype == "ascii" and len(field.shape) == 2:
        step = field.shape[1]
        return [_text(field, raw[i : i + step]) for i in range(0, size, step)]
    if field.dtype == "ascii":
        return _text(field, raw)
    if field.fields:
        step = element(field).itemsize
        records = [unpack(field.fields, payload, at + i, exact=exact) for i in range(0, size, step)]
        return records if field.shape else records[0]
    numbers = _numbers(field, raw)
    if exact and field.dtype[1:2] == "f":
        width = len(raw) // max(len(numbers), 1)
        for i, number in enumerate(numbers):
            if not math.isfinite(number):
                spelled = raw[i * width : (i + 1) * width][:: _order(field)]
                numbers[i] = {f"f{8 * width}": spelled.hex()}
    return numbers if field.shape else numbers[0]


def _order(field: Field) -> int:
    """The step that puts the bytes of a number highest first, or back."""
    return -1 if field.dtype.startswith("<") else 1


def _numbers(field: Field, raw: bytes) -> list[Any]:
    if field.dtype == "fp1220":
        return [float(v) / 2**20 for (v,) in struct.iter_unpack(">i", raw)]
    if field.dtype == "fp1632":
        return [float(high << 32 | low) / 2**32 for low, high in struct.iter_unpack(">Ih", raw)]
    numbers: list[Any] = np.frombuffer(raw, field.dtype).tolist()
    return numbers


def _text(field: Field, raw: bytes) -> str:
    """The text without its padding."""
    return (raw.rstrip(bytes([field.pad])) if field.pad >= 0 else raw).decode("latin-1")


def pack(fields: Sequence[Field], values: Mapping[str, Any]) -> bytes:
    """Payload bytes of wire values; the inverse of `unpack`.

    Raises:
        EncodeError: a value is missing, unknown, of the wrong count or out of its range.
    """
    unknown = [name for name in values if name not in {field.name for field in fields}]
    if unknown:
        names = ", ".join(field.name for field in fields) or "none"
        raise EncodeError(f"no field is called {unknown[0]!r}; there are: {names}")
    return b"".join(_write(field, values) for field in fields)


def _write(field: Field, values: Mapping[str, Any]) -> bytes:
    if field.name not in values:
        raise EncodeError(f"{field.name} is missing")
    value = values[field.name]
    if field.dtype == "bytes":
        return _write_bytes(field, value)
    if field.dtype == "ascii" and len(field.shape) == 2:
        return _write_texts(field, value)
    if field.dtype == "ascii":
        return _write_text(field, value)
    elements: Any = value if field.shape else [value]
    if not isinstance(elements, (list, tuple)):
        raise EncodeError(f"{field.name} is a list, given {value!r}")
    if field.shape and not is_open(field) and len(elements) != math.prod(field.shape):
        raise EncodeError(f"{field.name} has {math.prod(field.shape)} values, given {len(elements)}")
    if field.fields:
        return b"".join(pack(field.fields, _record(field, record)) for record in elements)
    return b"".join(_write_number(field, number) for number in elements)


def _record(field: Field, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise EncodeError(f"{field.name} is a record of {', '.join(f.name for f in field.fields)}, given {value!r}")
    return value


def _write_bytes(field: Field, value: Any) -> bytes:
    if not isinstance(value, (bytes, bytearray)):
        raise EncodeError(f"{field.name} is bytes, given {value!r}")
    size = None if is_open(field) else size_of(field)
    if size is not None and len(value) != size:
        raise EncodeError(f"{field.name} has {size} bytes, given {len(value)}")
    return bytes(value)


def _write_texts(field: Field, value: Any) -> bytes:
    count, size = field.shape
    if not isinstance(value, (list, tuple)) or len(value) != count:
        raise EncodeError(f"{field.name} has {count} texts, given {value!r:.80}")
    return b"".join(_write_text(replace(field, shape=(size,)), one) for one in value)


def _write_text(field: Field, value: Any) -> bytes:
    try:
        raw = str(value).encode("latin-1")
    except UnicodeEncodeError:
        raise EncodeError(f"{field.name} is ASCII text, given {value!r}") from None
    if is_open(field):
        return raw
    if len(raw) > size_of(field):
        raise EncodeError(f"{field.name} has at most {size_of(field)} characters, given {len(raw)}")
    return raw.ljust(size_of(field), bytes([max(field.pad, 0)]))


def _write_number(field: Field, value: Any) -> bytes:
    if isinstance(value, Mapping):
        return _write_spelled(field, value)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise EncodeError(f"{field.name} is a number, given {value!r}")
    if field.dtype in _FIXED_POINT:
        return _write_fixed(field, float(value))
    dtype = np.dtype(field.dtype)
    if dtype.kind == "f":
        try:
            return struct.pack(">d" if dtype.itemsize == 8 else ">f", value)[:: _order(field)]
        except OverflowError:
            raise EncodeError(f"{field.name} is beyond a {8 * dtype.itemsize}-bit float, given {value!r}") from None
    limits = np.iinfo(dtype)
    if not limits.min <= value <= limits.max or int(value) != value:  # NaN is in no range
        raise EncodeError(f"{field.name} is a whole number from {limits.min} to {limits.max}, given {value!r}")
    return int(value).to_bytes(
        dtype.itemsize, "little" if field.dtype.startswith("<") else "big", signed=limits.min < 0
    )


def _write_spelled(field: Field, value: Mapping[str, Any]) -> bytes:
    """A float given as its bits: {"f32": "7fc00000"}."""
    size = size_of(replace(field, shape=()))
    try:
        raw = bytes.fromhex(value[f"f{8 * size}"])
    except (KeyError, TypeError, ValueError):
        raw = b""
    if np.dtype(field.dtype if field.dtype not in _SPECIAL else "u1").kind != "f" or len(raw) != size:
        raise EncodeError(f"{field.name} is a number, given {dict(value)!r}")
    return raw[:: _order(field)]


def _write_fixed(field: Field, value: float) -> bytes:
    fraction, size = _FIXED_POINT[field.dtype]
    limit = 2.0 ** (8 * size - 1 - fraction)
    number = round(value * 2**fraction) if math.isfinite(value) else None
    if number is None or not -limit * 2**fraction <= number < limit * 2**fraction:
        raise EncodeError(f"{field.name} lies in [{-limit:g}, {limit:g}), given {value!r}")
    if size == 4:
        return struct.pack(">i", number)
    return struct.pack(">Ih", number & 0xFFFFFFFF, number >> 32)


# -- many frames -------------------------------------------------------------------------------------------------------

Place = tuple[Field, tuple[tuple[int, int], ...]]
"""A field and the pieces (offset, size) of a gathered row that hold it: several if it was sent in parts."""


class Layout:
    """Offsets of the fields of a message in a gathered row, and conversion of rows to columns.

    Args:
        places: the fields, with their shapes in this layout, and their positions.
        size: bytes of a row.
    """

    def __init__(self, places: Sequence[Place], size: int) -> None:
        self.size = size
        self.readers = {field.name: _FieldReader(field, pieces, size) for field, pieces in places}

    @classmethod
    def of(cls, fields: Sequence[Field]) -> "Layout":
        """The layout of consecutive fields; their shapes are closed (see `form_for_size`)."""
        places: list[Place] = []
        at = 0
        for field in fields:
            places.append((field, ((at, size_of(field)),)))
            at += size_of(field)
        return cls(places, at)

    def columns(self, rows: NDArray[np.uint8]) -> "LazyColumns":
        """Columns of gathered frames, (n, size) uint8, contiguous."""
        return LazyColumns(self, rows)


class _FieldReader:
    """One field's bytes in gathered rows → its column. Row-independent values are computed once."""

    __slots__ = ("_at", "_block", "_conversion", "_empty", "_opaque", "_pieces", "_shape", "_strides", "_wire")

    def __init__(self, field: Field, pieces: tuple[tuple[int, int], ...], stride: int) -> None:
        self._conversion = _Conversion(field)
        self._pieces = pieces
        self._at = pieces[0][0]
        self._opaque = field.dtype == "bytes"
        self._wire = element(field)
        self._shape = field.shape
        self._empty = not stride or 0 in field.shape
        inner = (self._wire.itemsize * math.prod(field.shape[i + 1 :]) for i in range(len(field.shape)))
        self._strides = (stride, *inner)
        self._block = np.dtype((np.void, self._wire.itemsize * math.prod(field.shape)))

    @property
    def numbers(self) -> tuple[int, np.dtype[Any], int] | None:
        """The place of its numbers in a row, their dtype on the wire, and how many there are; None if a column has
        something else than these numbers.
        """
        is_whole = not (self._opaque or self._empty or len(self._pieces) > 1)
        if not self._conversion.is_plain or not is_whole or self._wire.kind not in "fiu":
            return None
        return self._at, self._wire, math.prod(self._shape)

    def column(self, rows: NDArray[np.uint8]) -> Array:
        """The field of n rows."""
        if self._opaque:
            parts = [rows[:, at : at + size] for at, size in self._pieces]
            return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
        shape = (len(rows), *self._shape)
        if self._empty or not shape[0]:
            return np.empty(shape, self._conversion.native)
        direct = not self._wire.fields and (not self._shape or len(rows) < _MIN_PIECED_ROWS)
        if direct:
            wire: Array = np.ndarray(shape, self._wire, rows.data, self._at, self._strides)
        else:  # what lies together in a row is copied in one piece: numpy would copy many rows number by number
            wire = np.empty(shape, self._wire)
            pieces: Array = np.ndarray(shape[:1], self._block, rows.data, self._at, self._strides[:1])
            np.ndarray(shape[:1], self._block, wire.data)[:] = pieces
        if self._conversion.is_plain:
            return wire.astype(self._conversion.native, copy=direct)
        with np.errstate(invalid="ignore", over="ignore"):  # a device may send any float, even a signalling NaN
            return self._conversion.apply(wire)


class LazyColumns(Mapping[str, Array]):
    """Field name → array of n rows, made on first access (see events.Batch)."""

    __slots__ = ("_done", "layout", "rows")

    def __init__(self, layout: Layout, rows: NDArray[np.uint8]) -> None:
        self.layout = layout
        self.rows = rows
        self._done: dict[str, Array] = {}

    def __getitem__(self, name: str) -> Array:
        column = self._done.get(name)
        if column is None:
            column = self._done[name] = self.layout.readers[name].column(self.rows)
        return column

    @property
    def row_size(self) -> int:
        """Bytes of one frame's payload, as received."""
        return self.layout.size

    def __iter__(self) -> Iterator[str]:
        return iter(self.layout.readers)

    def __len__(self) -> int:
        return len(self.layout.readers)


def to_native_order(field: Field) -> np.dtype[Any]:
    """The dtype of one element of a column: native byte order; float64 if the displayed value is not the wire's."""
    if field.fields:
        return np.dtype([(part.name, to_native_order(part), part.shape) for part in field.fields])
    if field.dtype == "ascii":
        return np.dtype("S1")
    if field.dtype in _FIXED_POINT or _column_scale(field) != 1 or field.bias != 0:
        return np.dtype(np.float64)
    return element(field).newbyteorder("=")


def _column_scale(field: Field) -> float:
    """Factor from the wire to the column: 1 where it stays as sent."""
    return 1.0 if field.sent_unit else field.scale


class _Conversion:
    """Conversion of the numbers of a field on the wire to those of its column.

    Attributes:
        native: dtype of one element of the column.
        is_plain: whether they are the same numbers, but for the order of their bytes.
    """

    __slots__ = ("_field", "_parts", "is_plain", "native")

    def __init__(self, field: Field) -> None:
        self._field = field
        self._parts = [(part.name, _Conversion(part)) for part in field.fields]
        self.native = to_native_order(field)
        is_number = field.dtype not in _FIXED_POINT and _column_scale(field) == 1 and field.bias == 0
        self.is_plain: bool = is_number and not field.column_major and all(part.is_plain for _, part in self._parts)

    def apply(self, wire: Array) -> Array:
        """Wire values, any shape of elements, in native order and displayed units."""
        field = self._field
        if self._parts:
            out = np.empty(wire.shape, self.native)
            for name, part in self._parts:
                out[name] = wire[name] if part.is_plain else part.apply(wire[name])
            return out
        if field.dtype == "fp1632":
            value = wire["high"].astype(np.float64)
            value += wire["low"].astype(np.float64) * 2.0**-32
        elif field.dtype == "fp1220":
            value = wire.astype(np.float64) * 2.0**-20
        else:
            value = wire.astype(self.native)
        if _column_scale(field) != 1:
            parts = round(1 / field.scale) if 0 < field.scale < 1 else 0
            if parts and abs(parts * field.scale - 1) < 1e-12:
                value /= parts  # 9999 hundredths are 99.99; times 0.01 gives 99.99000000000001
            else:
                value *= field.scale
        if field.bias != 0:
            value += field.bias
        if field.column_major:
            value = np.ascontiguousarray(value.swapaxes(-1, -2))
        return value


def bytes_of_hex(name: str, value: Any) -> bytes:
    """The bytes of a field that is given as hex digits.

    Raises:
        EncodeError: it is anything else.
    """
    try:
        return bytes.fromhex(value)
    except (TypeError, ValueError):
        raise EncodeError(f"{name} is hex, given {value!r}") from None
