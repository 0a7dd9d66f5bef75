"""Numbers of ROS messages, many messages at once.

    [0][kind u8][options u16] field field ···      ROS 2 (CDR): each number aligned to its size, from the fourth byte on
    field field ···                                ROS 1: without alignment, little-endian

Where a field lies depends only on the lengths of the strings and sequences before it, which are the same from message
to message (a frame id, an empty list). So a message is walked field by field only if these lengths are new; its layout
is then kept, and messages of one layout are read as columns, without a step for each.

Messages come from outside. A length that the message has no bytes for, a missing end or more steps than `MOST_STEPS`
is a ValueError; nothing else is raised.

Source: OMG DDSI-RTPS 2.5, 10.2 (encapsulation); OMG DDS-XTYPES 1.3, 7.4 (plain CDR, versions 1 and 2); ROS 1 wiki,
"msg" (field types and their serialization).
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.messages.message_table import MessagePayloads
from imuscope.protocols.messages.ros2msg import StructField, StructType

LONGEST_ARRAY = 16  # of a longer one no element is a column
MOST_COLUMNS = 500
MOST_STEPS = 4096
MAX_LAYOUTS = 32
_HEAD = 4
_ENCAPSULATIONS = {0: (">", 8), 1: ("<", 8), 6: (">", 4), 7: ("<", 4)}  # byte order, strictest alignment


@dataclass(frozen=True, slots=True)
class _Layout:
    """Places of the numbers in a message.

    Args:
        probes: (offset, bytes) of each length: a message with all of them has this layout.
        size: bytes of a whole message.
        numbers: (path, offset, dtype).
        times: (path, offset) of each pair of seconds and nanoseconds.
    """

    probes: tuple[tuple[int, bytes], ...]
    size: int
    dtype: np.dtype[Any]
    numbers: tuple[str, ...]
    times: tuple[str, ...]

    def fits(self, data: bytes) -> bool:
        return len(data) >= self.size and all(data[at : at + len(text)] == text for at, text in self.probes)


@dataclass(frozen=True, slots=True)
class CdrColumns:
    """Messages of one layout.

    Args:
        rows: (n,) their indexes among the messages given.
        numbers: path → (n,) in native byte order.
        times: path → (n,) int64 ns.
    """

    rows: NDArray[np.int64]
    numbers: dict[str, Array]
    times: dict[str, NDArray[np.int64]]


@dataclass(slots=True)
class CdrReader:
    """Reader of the messages of one type.

    Args:
        is_ros1: whether the messages are those of ROS 1.
    """

    root: StructType
    is_ros1: bool = False
    _layouts: list[_Layout] = field(default_factory=list)  # the last used first

    def columns(self, messages: Sequence[bytes]) -> tuple[list[CdrColumns], list[tuple[int, str]]]:
        """The numbers of these messages by layout, and (index, reason) of each that cannot be read."""
        parts: list[CdrColumns] = []
        refused: list[tuple[int, str]] = []
        left = np.arange(len(messages))
        while len(left) and len(parts) < MAX_LAYOUTS:  # messages of one layout at a time
            try:
                layout = self._layout(messages[int(left[0])])
            except ValueError as error:
                refused.append((int(left[0]), str(error)))
                left = left[1:]
                continue
            rows, table = _fitting(layout, left, messages)
            parts.append(_read(layout, rows, table))
            left = np.setdiff1d(left, rows, assume_unique=True)
        more, others = self._one_by_one(left.tolist(), messages)
        return [*parts, *more], [*refused, *others]

    def _one_by_one(
        self, indexes: Sequence[int], messages: Sequence[bytes]
    ) -> tuple[list[CdrColumns], list[tuple[int, str]]]:
        """As `columns`, for messages of many layouts."""
        groups: dict[int, tuple[_Layout, list[int]]] = {}
        refused: list[tuple[int, str]] = []
        for index in indexes:
            try:
                layout = self._layout(messages[index])
            except ValueError as error:
                refused.append((index, str(error)))
                continue
            groups.setdefault(id(layout), (layout, []))[1].append(index)
        each = ((layout, np.array(rows)) for layout, rows in groups.values())
        return [_read(layout, *_fitting(layout, rows, messages)) for layout, rows in each], refused

    def _layout(self, data: bytes) -> _Layout:
        layouts = self._layouts
        for place, layout in enumerate(layouts):
            if layout.fits(data):
                if place:
                    layouts.insert(0, layouts.pop(place))
                return layout
        layout = _Walk(data, is_ros1=self.is_ros1).layout(self.root)
        layouts.insert(0, layout)
        del layouts[MAX_LAYOUTS:]
        return layout


def _fitting(layout: _Layout, rows: Ints, messages: Sequence[bytes]) -> tuple[Ints, NDArray[np.uint8]]:
    """The rows whose messages have this layout, and their bytes: (n, size)."""
    if isinstance(messages, MessagePayloads):
        rows = rows[messages.lengths[rows] >= layout.size]
        table = messages.rows(rows, layout.size)
    else:
        rows = np.array([row for row in rows.tolist() if len(messages[row]) >= layout.size], np.int64)
        joined = b"".join([messages[row][: layout.size] for row in rows.tolist()])
        table = np.frombuffer(joined, np.uint8).reshape(len(rows), layout.size)
    fits = np.ones(len(rows), bool)
    for at, text in layout.probes:
        fits &= (table[:, at : at + len(text)] == np.frombuffer(text, np.uint8)).all(axis=1)
    return (rows, table) if fits.all() else (rows[fits], table[fits])


def _read(layout: _Layout, rows: Ints, bytes_of: NDArray[np.uint8]) -> CdrColumns:
    table = np.ascontiguousarray(bytes_of).reshape(-1).view(layout.dtype)
    names = layout.dtype.names or ()
    numbers = {
        path: table[name].astype(table[name].dtype.newbyteorder("="))
        for path, name in zip(layout.numbers, names, strict=False)
    }
    times = {}
    for path, name in zip(layout.times, names[len(layout.numbers) :], strict=True):
        pair = table[name]
        times[path] = pair["sec"].astype(np.int64) * 1_000_000_000 + pair["nanosec"].astype(np.int64)
    return CdrColumns(rows, numbers, times)


class _Walk:
    """A walk over one message, field by field."""

    def __init__(self, data: bytes, *, is_ros1: bool = False) -> None:
        self._data = data
        self._probes: list[tuple[int, bytes]] = []
        if is_ros1:
            self._order, self._strictest, self._at = "<", 1, 0
        elif len(data) < _HEAD or data[0] != 0 or data[1] not in _ENCAPSULATIONS:
            raise ValueError("not CDR")
        else:
            self._order, self._strictest = _ENCAPSULATIONS[data[1]]
            self._at = _HEAD
            self._probes.append((0, data[:2]))
        self._length = struct.Struct(f"{self._order}I")
        self._steps = 0
        self._numbers: list[tuple[str, int, str]] = []
        self._times: list[tuple[str, int]] = []

    def layout(self, root: StructType) -> _Layout:
        """The layout of the message; ValueError if it is not a whole message of this type."""
        self._struct(root, "", shown=True)
        numbers = self._numbers[:MOST_COLUMNS]
        pair = np.dtype([("sec", f"{self._order}i4"), ("nanosec", f"{self._order}u4")])
        spec = {
            "names": [f"n{i}" for i in range(len(numbers))] + [f"t{i}" for i in range(len(self._times))],
            "formats": [f"{self._order}{code}" for _, _, code in numbers] + [pair] * len(self._times),
            "offsets": [at for _, at, _ in numbers] + [at for _, at in self._times],
            "itemsize": self._at,
        }
        paths = tuple(path for path, _, _ in numbers)
        dtype = np.dtype(spec)  # type: ignore[call-overload]
        return _Layout(tuple(self._probes), self._at, dtype, paths, tuple(path for path, _ in self._times))

    def _struct(self, kind: StructType, path: str, *, shown: bool) -> None:
        for one in kind.fields:
            self._field(one, f"{path}.{one.name}" if path else one.name, shown=shown)

    def _field(self, one: StructField, path: str, *, shown: bool) -> None:
        if not one.is_array:
            self._value(one, path, shown=shown)
            return
        count = self._count() if one.count < 0 else one.count
        shown = shown and count <= LONGEST_ARRAY
        if one.kind not in ("string", "struct", "time") and not shown:
            size = int(one.kind[1])
            if count:
                self._align(size)
                self._skip(size * count)
            return
        if one.kind == "struct" and one.struct is not None and not one.struct.fields:
            return  # elements without bytes, however many
        for number in range(count):
            self._value(one, f"{path}.{number}", shown=shown)

    def _value(self, one: StructField, path: str, *, shown: bool) -> None:
        self._steps += 1
        if self._steps > MOST_STEPS:
            raise ValueError("too many elements")
        if one.kind == "struct":
            assert one.struct is not None
            self._struct(one.struct, path, shown=shown)
        elif one.kind == "string":
            self._skip(self._count())
        elif one.kind == "time":
            self._align(4)
            if shown:
                self._times.append((path, self._at))
            self._skip(8)
        else:
            size = int(one.kind[1])
            self._align(size)
            if shown:
                self._numbers.append((path, self._at, one.kind))
            self._skip(size)

    def _count(self) -> int:
        """A length word; it is part of the layout."""
        self._align(4)
        at = self._at
        self._skip(4)
        self._probes.append((at, self._data[at : at + 4]))
        return int(self._length.unpack_from(self._data, at)[0])

    def _align(self, size: int) -> None:
        self._at += -(self._at - _HEAD) % min(size, self._strictest)

    def _skip(self, size: int) -> None:
        self._at += size
        if self._at > len(self._data):
            raise ValueError("the message is shorter than its type")
