"""Conversion of batches into channels: one channel for each quantity, one column for each number.

    Batch MTData2  PacketCounter (n,)      ─> channel PacketCounter   value
                   Quaternion    (n, 4)    ─> channel Quaternion      q0 q1 q2 q3
                   StatusWord    (n,)      ─> channel StatusWord      value, with its bits
                   GnssPvtData   (n,) rec  ─> channel GnssPvtData     itow year month … (one column per element)
                   GnssSatInfo   (n,) rec  ─> channel GnssSatInfo     one *row* per satellite, all at one time

A message whose fields are separate quantities (`channel_per_field`) gives a channel per field; any other message is one
channel with a column per element, plus a channel for each separate field (`separate_channels`: message.field). Names,
colours and descriptions of columns come from the rows of the protocol's table (protocols/schema/fields.py); the dtype
is that of the array. The division of a batch is computed once per message layout and stored as a plan, because the same
layouts occur thousands of times.

The page shows °/s for rad/s, µT for T and metres for millimetres: `SHOWN` is the only place where wire units are
converted to page units, for every family. Files and `inspect` use wire units; so do the rows made here, which the store
of a recording and the ring buffers hold, and convert as they are read (recordings/columns/units.py).

Unknown payloads are not numbers; they are shown as bytes (server/streaming/unknown_payloads.py).

A device with outputs at different rates sends frames of several layouts, and one drain then has several batches that
share channels. `channel_per_field` restores the stream order of the pieces of each channel.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, cast

import numpy as np

from imuscope.protocols.arrays import Array, Floats, Ints
from imuscope.protocols.clocks.unix_time import seconds
from imuscope.protocols.events import Batch
from imuscope.protocols.schema.fields import Bits, Field, Message
from imuscope.protocols.schema.layouts import LazyColumns
from imuscope.server.streaming.channel_rows import (
    ChannelRows,
    ColumnPlan,
    WireRows,
    copies_of,
    numbers_of,
    rows_per_sample,
    table_of,
    values_of,
)
from imuscope.server.streaming.unknown_payloads import described, is_opaque
from imuscope.server.wire import BitsInfo, ChannelInfo, ColumnInfo, Dtype

log = logging.getLogger("imuscope.channels")

Advertise = Callable[[ChannelInfo], int]
Kind = Literal["vector", "quaternion", "matrix", "euler", "status", "scalar", "record", "table", "counter"]
Axis = Literal["", "x", "y", "z", "w"]

_XYZ: tuple[Axis, ...] = ("x", "y", "z")
# Labels of three-vectors whose elements lie along axes, lower case; their colours follow the position.
_AXIS_LABELS = {"xyz", "rollpitchyaw", "enu", "ned", "nwu", "eastnorthup", "northeastdown", "northwestup"}
# Unit of a protocol's table → unit on the page, factor, number of decimals less.
SHOWN: Mapping[str, tuple[str, float, int]] = {
    "rad/s": ("°/s", 180 / np.pi, 2),
    "T": ("µT", 1e6, 6),
    "mm": ("m", 1e-3, -3),
    "mm/s": ("m/s", 1e-3, -3),
}
_FACTORS = {sent: factor for sent, (_, factor, _) in SHOWN.items()} | dict.fromkeys(("rad", "rad/s/°C"), 180 / np.pi)
_MAX_PLANS = 256  # a healthy device has a handful; noise that passes the checksum must not fill memory
MAX_CHANNELS = 1000  # of one device; a vendor's tables give at most some 300


class ChannelRegistry:
    """The channels of one device.

    Args:
        device: DeviceInfo.id.
        advertise: called once for each new channel with its description (id 0); returns the id.

    Attributes:
        is_full: `MAX_CHANNELS` is reached; further channels are not created.
    """

    def __init__(self, device: str, advertise: Advertise) -> None:
        self.device = device
        self._advertise = advertise
        self._plans: dict[tuple[int, bool], tuple[Message, list[ColumnPlan]]] = {}
        self._ids: dict[str, int] = {}
        self.is_full = False

    def split(self, batches: Sequence[tuple[Batch, Floats, Ints]]) -> list[ChannelRows | WireRows]:
        """The samples of one drain by channel.

        Args:
            batches: each with its device time mapped to host time, (n,) unix s, NaN where unknown, and the same in ns.
        """
        by_channel: dict[int, list[tuple[Batch, Floats, Ints, ColumnPlan]]] = {}
        for batch, time, time_ns in batches:
            for cut in self._plan(batch):
                by_channel.setdefault(cut.channel, []).append((batch, time, time_ns, cut))
        return [self._rows(parts) for parts in by_channel.values()]

    def _rows(self, parts: Sequence[tuple[Batch, Floats, Ints, ColumnPlan]]) -> ChannelRows | WireRows:
        """The samples of one channel, from some batches."""
        batch, time, time_ns, plan = parts[0]
        lazy = batch.columns
        if len(parts) == 1 and plan.copies is not None and isinstance(lazy, LazyColumns):
            contiguous = batch.arrival_ns.flags.c_contiguous and time.flags.c_contiguous
            if contiguous and lazy.layout is plan.copies[0]:
                return WireRows(batch, lazy, plan, plan.copies, time, time_ns)
        pieces = []
        for batch, time, time_ns, cut in parts:
            clocks = [batch.arrival_ns, time_ns, seconds(batch.arrival_ns), time]
            offset, values = batch.offset, values_of(batch, cut)
            if cut.per_sample != 1:
                offset, *clocks = (np.repeat(one, cut.per_sample) for one in (offset, *clocks))
            pieces.append((offset, [*clocks, *values]))
        (arrival_ns, time_ns, *columns), place = _merged(pieces)
        return ChannelRows(plan.channel, columns, place, (arrival_ns, time_ns))

    def _plan(self, batch: Batch) -> list[ColumnPlan]:
        key = (id(batch.message), batch.verified)
        known = self._plans.get(key)
        if known is not None and known[0] is batch.message:
            return known[1]
        if len(self._plans) >= _MAX_PLANS:
            self._plans.clear()
        cuts = self._cuts(batch)
        self._plans[key] = (batch.message, cuts)
        return cuts

    def _cuts(self, batch: Batch) -> list[ColumnPlan]:
        message = batch.message
        last = described(batch.columns, message.fields)  # the others go to server/streaming/unknown_payloads.py
        if not last:
            return []
        if message.channel_per_field:
            groups = [(field.name, [field]) for field in last.values()]
        else:
            groups = [(f"{message.name}.{name}", [last[name]]) for name in message.separate_channels if name in last]
            rest = [field for field in last.values() if field.name not in message.separate_channels]
            if not clock_alone(message, last):
                groups.append((_name_beside_bytes(message, rest) or message.name, rest))
        cuts = []
        for name, fields in groups:
            info = _describe(self.device, message, name, fields, batch.columns)
            if info is not None:
                used = tuple(field.name for field in fields)
                _in_shown_units(info)
                if not batch.verified:  # verified and unverified samples must not share a trace
                    info.name = f"{info.name}?"  # separate name; the title is the same, and `verified` marks it
                    info.verified = False
                plan = ColumnPlan(0, used, rows_per_sample(batch.columns[used[0]]))
                if self._fits(batch, plan, info) and (number := self._identify(info)):
                    cuts.append(replace(plan, channel=number, copies=copies_of(batch.columns, plan, info)))
        return cuts

    def _fits(self, batch: Batch, plan: ColumnPlan, info: ChannelInfo) -> bool:
        """Whether the values have the described columns. Otherwise this channel is left out, and no other suffers."""
        columns = values_of(batch, plan)
        rows = len(batch) * plan.per_sample
        if len(columns) == len(info.columns) and all(len(column) == rows for column in columns):
            return True
        log.error(
            "%s of %s has no channel: %d columns, %d described",
            info.name,
            info.message,
            len(columns),
            len(info.columns),
        )
        return False

    def _identify(self, info: ChannelInfo) -> int:
        """The id of this description; a changed unit, frame or dtype is a new channel. 0 above the maximum number."""
        key = repr(info)
        if key not in self._ids:
            if len(self._ids) >= MAX_CHANNELS:
                self.is_full = True
                return 0
            self._ids[key] = self._advertise(info)
        return self._ids[key]


def clock_alone(message: Message, fields: Mapping[str, Field]) -> bool:
    """Whether the clock of a message is its only remaining quantity; then it is the time axis, not a quantity.

    Args:
        fields: described fields of the message, by name.
    """
    if message.channel_per_field or not any(name in fields for name in message.separate_channels):
        return False
    return all(name in message.separate_channels or name == message.time for name in fields)


def _name_beside_bytes(message: Message, rest: Sequence[Field]) -> str:
    """Name of the only described field of a payload, since the message's name is used for its bytes; "" otherwise."""
    if len(rest) != 1 or not any(map(is_opaque, message.fields)):
        return ""
    name = rest[0].name
    return name if name.startswith(message.name) else f"{message.name}.{name}"


def _merged(parts: list[tuple[Array, list[Array]]]) -> tuple[list[Array], Array]:
    """The pieces of one channel in the order of the stream, and their offsets; rows of one frame keep their order."""
    if len(parts) == 1:
        return parts[0][1], parts[0][0]
    offset = np.concatenate([offset for offset, _ in parts])
    order = np.argsort(offset, kind="stable")
    columns = zip(*(columns for _, columns in parts), strict=True)
    return [np.concatenate(column)[order] for column in columns], offset[order]


def factors_of(info: ChannelInfo) -> tuple[float, ...]:
    """Factors from the columns as sent to those in the page's units; () if all are 1."""
    factors = tuple(_FACTORS[column.sent_unit] if column.sent_unit else 1.0 for column in info.columns)
    return factors if {*factors} != {1.0} else ()


def _in_shown_units(info: ChannelInfo) -> None:
    """Change the description to the page's units."""
    for column in info.columns:
        if column.unit in SHOWN:
            column.sent_unit = column.unit
            column.unit, _, fewer = SHOWN[column.unit]
            column.dtype = column.dtype if column.dtype in ("f4", "f8") else "f8"
            if column.decimals >= 0 or fewer < 0:
                column.decimals = max(0, max(column.decimals, 0) - fewer)
    info.unit = SHOWN[info.unit][0] if info.unit in SHOWN else info.unit


# ── descriptions ─────────────────────────────────────────────────────────────────────────────────────────────────────


def _describe(
    device: str, message: Message, name: str, fields: list[Field], columns: Mapping[str, Array]
) -> ChannelInfo | None:
    """The channel (id 0) of these fields, None if none of them is a number."""
    alone = fields[0] if len(fields) == 1 else None
    infos: list[ColumnInfo] = []
    for field in fields:
        array = np.asarray(columns[field.name])
        table = table_of(array)
        prefix = "" if alone else field.name
        infos.extend(_column_infos(field, array, prefix) if table is None else _table_infos(field, array, table))
    if not infos:
        return None
    words = alone or Field(name, title=message.title or name, doc=message.doc, source=message.source)
    kind = _kind(alone, np.asarray(columns[alone.name]), message) if alone else "record"
    if kind in ("scalar", "counter", "status") and len(infos) == 1 and not infos[0].label:
        infos[0].label = words.title or words.name
    return ChannelInfo(
        id=0,
        device=device,
        message=message.name,
        name=name,
        title=words.title or words.name,
        kind=kind,
        unit="" if "," in words.unit else words.unit,  # each column has its own
        frame=words.frame,
        columns=_unique(infos),
        doc=words.doc,
        source=words.source,
        group="" if message.channel_per_field else message.title or message.name,
    )


def _kind(field: Field, array: Array, message: Message) -> Kind:
    if array.dtype.names:
        return "table" if table_of(array) is not None else "record"
    if array.dtype.kind in "SV":
        return "record"
    shape = array.shape[1:]
    if not shape:
        if field.bits:
            return "status"
        counts = "Counter" in field.name or field.name == message.time or field.name.startswith("SampleTime")
        return "counter" if counts and array.dtype.kind in "ui" else "scalar"
    if shape == (3, 3) or (shape == (9,) and "Matrix" in field.name):
        return "matrix"
    if shape == (3,) and _joined(field.axes) == "rollpitchyaw":
        return "euler"
    return "quaternion" if shape == (4,) and is_quaternion(field) else "vector"


def is_quaternion(field: Field) -> bool:
    """Whether four elements of this name, axes and frame are a rotation."""
    return "Quaternion" in field.name or (_joined(field.axes) == "wxyz" and " from " in field.frame)


def _joined(axes: Sequence[str]) -> str:
    return "".join(axes).lower()


def _column_infos(field: Field, array: Array, prefix: str) -> list[ColumnInfo]:
    """One ColumnInfo per array of `numbers_of`, in the same order."""
    if array.dtype.names:
        rows = {sub.name: sub for sub in field.fields}
        subs = [(rows.get(name, Field(name)), array[name]) for name in array.dtype.names]
        return [info for sub, part in subs for info in _column_infos(sub, part, _join(prefix, sub.name))]
    flat = numbers_of(array)
    if not flat:
        return []  # text
    dtype = _dtype(flat[0])
    if array.ndim == 1 and array.dtype.kind not in "SV":
        return [_column(field, prefix or "value", dtype, _suffix_axis(prefix))]
    names = _element_names(field, array.shape[1:], len(flat))
    axes = _axis_colours(field, len(flat))
    units = field.unit.split(",") if "," in field.unit else [field.unit] * len(flat)
    if len(units) != len(flat):
        units = [""] * len(flat)  # units of groups of elements (m²,rad²): which has which is not known here
    return [
        _column(replace(field, unit=unit), _join(prefix, name) if prefix else name, dtype, axis)
        for name, axis, unit in zip(names, axes, units, strict=True)
    ]


def _table_infos(field: Field, array: Array, table: tuple[str, Array]) -> list[ColumnInfo]:
    """One ColumnInfo per array of `_rows`, in the same order."""
    name, records = table
    rows = {sub.name: sub for sub in field.fields}
    out: list[ColumnInfo] = []
    for other in array.dtype.names or ():
        if name and other != name:
            out += _column_infos(rows.get(other, Field(other)), array[other], other)
    return out + _column_infos(rows.get(name, field) if name else field, records.reshape(-1), "")


def _join(prefix: str, name: str) -> str:
    return f"{prefix}_{name}" if prefix else name


def _element_names(field: Field, shape: tuple[int, ...], count: int) -> list[str]:
    if len(field.axes) == count:
        return list(field.axes)
    if len(shape) == 2:
        return [f"m{i + 1}{j + 1}" for i in range(shape[0]) for j in range(shape[1])]
    return [str(i) for i in range(count)]


def _axis_colours(field: Field, count: int) -> list[Axis]:
    if count == 3 and (_joined(field.axes) in _AXIS_LABELS):
        return list(_XYZ)
    if count == 4 and _joined(field.axes) in ("q0q1q2q3", "wxyz"):
        return ["w", *_XYZ]
    return [""] * count


def _suffix_axis(name: str) -> Axis:
    """Axis of a record's element (accX, accY, accZ), for its colour."""
    if len(name) > 1 and name[-1] in "XYZ" and name[-2].islower():
        return cast(Axis, name[-1].lower())
    return name if name in _XYZ else ""


def _column(field: Field, name: str, dtype: Dtype, axis: Axis) -> ColumnInfo:
    return ColumnInfo(
        name=name,
        dtype=dtype,
        unit=field.unit,
        sent_unit=field.sent_unit,
        label=field.title if name in (field.name, "value") else "",
        axis=axis,
        choices={str(value): meaning for value, meaning in field.choices.items()},
        bits=[_bits(bit) for bit in field.bits],
        decimals=field.decimals,
        period=field.period,
        doc=field.doc,
    )


def _bits(bit: Bits) -> BitsInfo:
    choices = {str(value): meaning for value, meaning in bit.choices.items()}
    return BitsInfo(bit.name, bit.low, bit.width, choices, bit.severity, bit.normal_set, bit.doc)


def _dtype(array: Array) -> Dtype:
    kind, size = array.dtype.kind, array.dtype.itemsize
    if kind == "b":
        return "u1"
    if kind == "f":
        return "f8" if size >= 8 else "f4"
    return cast(Dtype, f"{kind}{size}")


def _unique(columns: list[ColumnInfo]) -> list[ColumnInfo]:
    """Unique column names, by which a page finds them: repeated names get a number."""
    counts: dict[str, int] = {}
    for column in columns:
        counts[column.name] = counts.get(column.name, 0) + 1
        if counts[column.name] > 1:
            column.name = f"{column.name}{counts[column.name]}"
    return columns
