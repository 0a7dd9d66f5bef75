"""Conditions on samples, compiled for the channels of one device.

A comparison `left > right` is evaluated as a signal `left` with a limit, so that an alarm can have a limit of its own
to clear, and can report the value that raised it. Any other truth value (`a > 3 g and b < 2 g`) is its own limit.

All samples of all signals named are evaluated: where channels have different times, at the times of all of them, the
others interpolated between their samples, but never across a gap. A moving window gives no value until it is full. Of
a vector every column is compared: one beyond the limit suffices, and all have to be within the limit to clear.

Filters, moving windows, derivatives and integrals are causal and keep their state from batch to batch (along_time.py):
the same samples give the same codes however they were divided.
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import NO_UNIT, Unit
from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms.along_time import AlongTime, is_along_time
from imuscope.server.extensions.alarms.definitions import ExpressionCondition, FlagCondition
from imuscope.server.extensions.alarms.machine import BETWEEN, BEYOND, UNKNOWN, WITHIN, Codes
from imuscope.server.extensions.analysis.expressions.expression_functions import Context, euler_angles
from imuscope.server.extensions.analysis.expressions.expression_syntax import Call, ExpressionError, Name, Node, parse
from imuscope.server.extensions.analysis.expressions.expressions import columns_of, evaluate, names_in
from imuscope.server.extensions.analysis.signals.quantities import Quantity, at_times
from imuscope.server.extensions.analysis.signals.signals import ANGLES, EULER_ANGLES, SignalColumn, columns_named
from imuscope.server.wire import ChannelInfo, DeviceInfo

MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
MAX_WAITING = 20_000  # samples of one channel that wait for those of another
MAX_SHIFTED = 200_000  # samples of a part along time, which a shift puts far ahead of the others
_LEFT = "\0left"  # not a name that a user can type
_LIVE = Context(zero_phase=False)

Rows = Mapping[int, Sequence[NDArray[Any]]]
"""New samples by channel: arrival, time, then its columns."""
Judged = tuple[Floats, Codes, Floats]
"""Time (unix s), code and value of samples."""

_NOTHING: Judged = np.empty(0), np.empty(0, np.int8), np.empty(0)


class SampleCondition(Protocol):
    """A condition compiled for the channels of a device.

    Attributes:
        channels: ids of those whose samples it needs.
        columns: the columns that it needs.
        signals: what it needs as the plots name it: "Acceleration.x", "EulerAngles.yaw".
        direction: 1 if greater values are worse, -1 if smaller ones are.
        unit: of its values.
        limit: the limit, in that unit; NaN if it is not a number.
        subject: the left side, or the compared value.
    """

    channels: frozenset[int]
    columns: Sequence[SignalColumn]
    signals: Sequence[str]
    direction: int
    unit: str
    limit: float
    subject: str

    @property
    def obstacle(self) -> str:
        """Obstacle to a verdict while all samples are UNKNOWN, and what to do."""

    def judge(self, rows: Rows) -> Judged:
        """Judge new samples; those that wait for another channel are judged later."""


def sample_times(columns: Sequence[NDArray[Any]]) -> Floats:
    """Times of samples: the device's, mapped to host time, or their arrival."""
    time = np.where(np.isnan(columns[1]), columns[0], columns[1])
    ordered: Floats = np.maximum.accumulate(time)
    return ordered


class ExpressionJudge:
    """A condition on signals, for one device.

    Args:
        missing_s: a longer step between two samples is a gap.
        rates: usual rates of the channels, Hz, by id; needed for what depends on earlier samples.

    Raises:
        RateUnknownError: such a rate is not known yet.
        ExpressionError: a mistake in `condition.expression`, and where it is.
        DomainError: a mistake in `condition.clear`.
    """

    def __init__(
        self,
        condition: ExpressionCondition,
        infos: Sequence[ChannelInfo],
        missing_s: float,
        rates: Mapping[int, float] | None = None,
    ) -> None:
        self._missing_s = missing_s
        node = checked(condition)
        by_name = [columns_of(infos, name) for name in names_in(node)]
        every = {column.name: column for columns, _ in by_name for column in columns}
        self.columns: Sequence[SignalColumn] = list(every.values())
        self.signals: Sequence[str] = list(
            dict.fromkeys(one for columns, angle in by_name for one in _names(columns, angle))
        )
        self.channels = frozenset(column.info.id for column in self.columns)
        known: Mapping[int, float] = {} if rates is None else rates
        self._along = AlongTime(node, infos, known)
        self.rates = {number: known[number] for one in self._along.parts.values() for number in one.channels}
        node = self._along.node
        self._named: dict[str, _Source] = {}
        for name in names_in(node):
            if name.name not in self._named:
                part = self._along.parts.get(name.name)
                self._named[name.name] = (
                    _source(*columns_of(infos, name)) if part is None else _Source(name.name, part.probe)
                )
        self._sources = frozenset(one.key for one in self._named.values())
        self._buffers: dict[Hashable, list[NDArray[Any]]] = {}
        self._done = -math.inf  # samples up to here are judged, if there are several channels
        self._left: Node | None = None
        self._node = node
        self._clear: Node | None = None
        self.direction = 1
        self.subject, self.unit, self.limit = condition.expression, "", math.nan
        if isinstance(node, Call) and node.name in MIRRORED:
            node = _signal_first(node)
            left, right = node.arguments
            self._left = left
            self._node = Call(node.name, (Name(_LEFT, left.begin, left.end), right), node.begin, node.end)
            self.direction = 1 if node.name in (">", ">=") else -1
            self.subject = condition.expression[left.begin : left.end].strip()
        self._judge({name: one.empty() for name, one in self._named.items()})
        self._describe(condition)

    def _describe(self, condition: ExpressionCondition) -> None:
        """Unit and limits, of an expression whose units fit."""
        if self._left is None:
            return
        empty = {name: one.empty() for name, one in self._named.items()}
        left = evaluate(self._left, lambda name: empty[name], _LIVE)
        assert isinstance(self._node, Call)
        right = self._node.arguments[1]
        self.unit = str(left.unit)
        if next(names_in(right), None) is None:
            self.limit = _number(evaluate(right, lambda name: empty[name], _LIVE), left.unit)
        if not condition.clear:
            return
        clear = clear_limit(condition, left.unit, self.limit, self.direction)
        self._clear = Call(self._node.name, (self._node.arguments[0], clear), 0, len(condition.clear))

    @property
    def obstacle(self) -> str:
        """Obstacle to a verdict while no sample can be judged."""
        if any(part.window for part in self._along.parts.values()):
            return "A moving window is not full yet; it restarts after a gap. Wait until it is."
        return "The samples hold no values that can be compared. Check what the device sends for the signals."

    def judge(self, rows: Rows) -> Judged:
        every: dict[Hashable, Sequence[NDArray[Any]]] = dict(rows.items())
        every.update(self._along.feed(rows).items())
        axis, quantities = self._aligned(every)
        if not len(axis):
            return _NOTHING
        return self._judge(quantities, axis)

    def _judge(self, quantities: Mapping[str, Quantity], axis: Floats | None = None) -> Judged:
        known = dict(quantities)
        values = None
        if self._left is not None:
            left = evaluate(self._left, lambda name: quantities[name], _LIVE)
            if left.is_number:
                begin, end = self._left.begin, self._left.end
                raise ExpressionError("A signal is needed here, not a number.", begin, end, "Name a signal in it.")
            known[_LEFT] = left
            values = left.parts
        truth = evaluate(self._node, lambda name: known[name], _LIVE)
        if not truth.is_logical:
            hint = "Compare it with a limit, for example > 3 g."
            raise ExpressionError("This is a value, not a condition.", self._node.begin, self._node.end, hint)
        time = truth.time if axis is None else axis
        assert time is not None
        codes = _codes(truth.parts, truth.parts)
        if self._clear is not None:
            codes = _codes(truth.parts, evaluate(self._clear, lambda name: known[name], _LIVE).parts)
        return time, codes, _worst(values, self.direction) if values is not None else truth.parts[0] * math.nan

    # ── samples of several channels ──────────────────────────────────────────────────────────────────────────────────

    def _aligned(self, rows: Mapping[Hashable, Sequence[NDArray[Any]]]) -> tuple[Floats, dict[str, Quantity]]:
        """The signals named at one set of times, all of them after those given before."""
        if len(self._sources) == 1:
            [source] = self._sources
            if source not in rows:
                return np.empty(0), {}
            axis = sample_times(rows[source])
            return axis, {name: one.quantity(rows[source], axis) for name, one in self._named.items()}
        for source in self._sources & rows.keys():
            self._wait(source, rows[source])
        if len(self._buffers) < len(self._sources):
            return np.empty(0), {}
        horizon = min(float(buffer[1][-1]) for buffer in self._buffers.values())
        times = [buffer[1][(buffer[1] > self._done) & (buffer[1] <= horizon)] for buffer in self._buffers.values()]
        axis = times[0]
        if any(len(other) != len(axis) or not np.array_equal(other, axis) for other in times):
            axis = np.unique(np.concatenate(times))
        if not len(axis):
            return axis, {}
        aligned = {}
        for name, one in self._named.items():
            buffer = self._buffers[one.key]
            aligned[name] = _at(one.quantity(buffer, buffer[1]), axis, self._missing_s)
        self._done = horizon
        for source, buffer in self._buffers.items():
            begin = max(0, int(np.searchsorted(buffer[1], horizon, "right")) - 1)
            self._buffers[source] = [column[begin:] for column in buffer]
        return axis, aligned

    def _wait(self, source: Hashable, columns: Sequence[NDArray[Any]]) -> None:
        time = sample_times(columns)
        new = [columns[0], time, *columns[2:]]
        before = self._buffers.get(source)
        if before is not None:
            new[1] = np.maximum(time, before[1][-1])
            most = MAX_SHIFTED if self._along.parts else MAX_WAITING
            new = [np.concatenate(pair)[-most:] for pair in zip(before, new, strict=True)]
        self._buffers[source] = new


@dataclass(frozen=True, slots=True)
class _Source:
    """The meaning of a name in a condition: columns of a channel, or a part along time.

    Attributes:
        key: of its rows.
        probe: its unit, names and period.
        at: its columns among those of the rows; None: all of them.
        angle: of Euler angles that are computed from a quaternion: which, "" for all; None for any other signal.
    """

    key: Hashable
    probe: Quantity
    at: tuple[int, ...] | None = None
    angle: str | None = None

    def quantity(self, rows: Sequence[NDArray[Any]], axis: Floats) -> Quantity:
        columns = rows[2:] if self.at is None else [rows[2 + at] for at in self.at]
        parts = tuple(column.astype(np.float64) for column in columns)
        if self.angle is not None:
            return euler_angles(Quantity(parts, NO_UNIT, axis, tuple("wxyz")), self.angle)
        return replace(self.probe, time=axis, parts=parts)

    def empty(self) -> Quantity:
        return replace(self.probe, time=np.empty(0), parts=tuple(np.empty(0) for _ in self.probe.parts))


def _source(columns: Sequence[SignalColumn], angle: str | None) -> _Source:
    info = columns[0].info
    own = [info.columns[column.at] for column in columns]
    names = tuple(one.name for one in own) if len(own) > 1 else ("",)
    probe = Quantity(tuple(np.empty(0) for _ in own), Unit.parse(own[0].unit), np.empty(0), names, own[0].period)
    if angle is not None:
        probe = euler_angles(probe, angle)
    return _Source(info.id, probe, tuple(column.at for column in columns), angle)


class FlagJudge:
    """A flag of a status word, for one device.

    Raises:
        DomainError: the device has no such channel or flag.
    """

    unit, limit, direction, obstacle = "", math.nan, 1, ""

    def __init__(
        self, condition: FlagCondition, infos: Sequence[ChannelInfo], device: DeviceInfo | None = None
    ) -> None:
        flags = [
            (column, bits)
            for column in columns_named(infos, [condition.signal])
            for bits in column.info.columns[column.at].bits
        ]
        fitting = [(column, bits) for column, bits in flags if bits.name == condition.flag]
        if not fitting:
            names = ", ".join(bits.name for _, bits in flags)
            hint = f"It has: {names:.400}." if names else "Choose a status word."
            raise DomainError("not-found", f"{condition.signal:.60} has no flag {condition.flag:.60}.", hint)
        if device is not None and condition.flag in device.absent:
            message = (
                f"{device.product:.60} does not have the flag {condition.flag:.60}: it is clear, whatever happens."
            )
            raise DomainError("not-found", message, "Choose another flag.")
        column, self._bits = fitting[0]
        self.columns: Sequence[SignalColumn] = [column]
        self.signals: Sequence[str] = [column.name]
        self.channels = frozenset({column.info.id})
        self.subject = condition.flag
        self._at = 2 + column.at
        self._is_set = condition.is_set

    def judge(self, rows: Rows) -> Judged:
        [channel] = self.channels
        if channel not in rows:
            return _NOTHING
        columns = rows[channel]
        word = columns[self._at].astype(np.int64)
        value = (word >> self._bits.low) & ((1 << self._bits.width) - 1)
        beyond = (value != 0) == self._is_set
        return sample_times(columns), np.where(beyond, BEYOND, WITHIN).astype(np.int8), value.astype(np.float64)


def checked(condition: ExpressionCondition) -> Node:
    """The tree of an expression; what depends on the signals of a device is not checked.

    Raises:
        ExpressionError: a mistake, and where it is.
    """
    node = parse(condition.expression)
    if next(names_in(node), None) is None:
        raise ExpressionError("No signal is named.", node.begin, node.end, "For example norm(Acceleration) > 3 g.")
    if condition.clear:
        if not (isinstance(node, Call) and node.name in MIRRORED):
            message = "A limit to clear needs a single comparison with <, <=, > or >=."
            raise DomainError("bad-value", message, "Leave the limit to clear empty, or compare one signal.")
        clear_node(condition)
    return node


def clear_node(condition: ExpressionCondition) -> Node:
    """The tree of a limit to clear.

    Raises:
        DomainError: it is not a constant.
    """
    try:
        node = parse(condition.clear)
    except ExpressionError as error:
        raise DomainError("bad-value", f"Limit to clear: {error.message}", error.hint) from None
    if next(names_in(node), None) is not None or is_along_time(node):
        raise DomainError("bad-value", "The limit to clear has to be a constant.", "For example 2.5 g.")
    return node


def clear_limit(condition: ExpressionCondition, unit: Unit, limit: float, direction: int) -> Node:
    """The tree of a limit to clear that fits the limit.

    Raises:
        DomainError: its unit or its value does not fit.
    """
    node = clear_node(condition)
    try:
        quantity = evaluate(node, lambda name: Quantity((np.empty(0),)), _LIVE)
    except ExpressionError as error:
        raise DomainError("bad-value", f"Limit to clear: {error.message}", error.hint) from None
    if not quantity.is_zero and not quantity.unit.fits(unit):
        message = f"The limit to clear is in {quantity.unit or 'no unit'}, the signal in {unit or 'no unit'}."
        raise DomainError("bad-value", message.replace("in no unit", "without a unit"), "Give it in a unit that fits.")
    if math.isnan(limit):
        raise DomainError("bad-value", "A limit to clear needs a constant limit.", "Compare with a number.")
    if (_number(quantity, unit) - limit) * direction > 0:
        side = "above" if direction > 0 else "below"
        raise DomainError("bad-value", f"The limit to clear is {side} the limit.", "Choose one on the side that is ok.")
    return node


def _number(quantity: Quantity, unit: Unit) -> float:
    return 0.0 if quantity.is_zero else quantity.in_unit(unit).number


def _signal_first(node: Call) -> Call:
    """The comparison with its signal on the left."""
    left, right = node.arguments
    if next(names_in(left), None) is None:
        return Call(MIRRORED[node.name], (right, left), node.begin, node.end)
    return node


def _names(columns: Sequence[SignalColumn], angle: str | None) -> list[str]:
    """Columns as the plots name them."""
    if angle is None:
        return [column.name for column in columns]
    return [f"{EULER_ANGLES}.{one}" for one in ((angle,) if angle else ANGLES)]


def _at(quantity: Quantity, axis: Floats, missing_s: float) -> Quantity:
    """A signal at other times; undefined in gaps."""
    own = quantity.time
    assert own is not None
    begin = int(np.searchsorted(own, axis[0]))
    if len(own) - begin >= len(axis) and np.array_equal(own[begin : begin + len(axis)], axis):
        return replace(quantity, time=axis, parts=tuple(part[begin : begin + len(axis)] for part in quantity.parts))
    moved = at_times(quantity, axis)
    before = np.clip(np.searchsorted(own, axis, "right") - 1, 0, len(own) - 1)
    after = np.minimum(before + 1, len(own) - 1)
    in_gap = (own[after] - own[before] > missing_s) & (own[before] < axis)
    if not in_gap.any():
        return replace(moved, time=axis)
    return replace(moved, time=axis, parts=tuple(np.where(in_gap, np.nan, part) for part in moved.parts))


def _codes(beyond: Sequence[Floats], still: Sequence[Floats]) -> Codes:
    """Codes of truth values: of the condition, and of the condition with the limit to clear."""
    is_beyond, is_still = _any(beyond), _any(still)
    codes = np.where(is_beyond == 1, BEYOND, np.where(is_still == 1, BETWEEN, WITHIN))
    codes[np.isnan(is_beyond) | (is_beyond != 1) & np.isnan(is_still)] = UNKNOWN
    return codes.astype(np.int8)


def _any(parts: Sequence[Floats]) -> Floats:
    """1 where a part is true, NaN where none is and one is not known."""
    if len(parts) == 1:
        return parts[0]
    total = parts[0] + sum(parts[1:])
    if np.isnan(total).any():
        true = np.any([part == 1 for part in parts], axis=0)
        total = np.where(true, 1.0, total)
    return np.minimum(total, 1.0)


def _worst(parts: Sequence[Floats], direction: int) -> Floats:
    if len(parts) == 1:
        return parts[0]
    worst: Floats = np.fmax.reduce(parts) if direction > 0 else np.fmin.reduce(parts)
    return worst
