"""Expressions over live signals, evaluated batch by batch as samples arrive.

    LiveExpression(infos, "norm(Acceleration) > 3 g", rates)
        .feed({channel: [arrival, time, *columns]})  ─>  Piece of new samples, of the unit and columns of `probe`

It is computed in the event loop of the server, so its cost is bounded when it is made: `MAX_RESAMPLED_HZ`,
`MAX_WINDOW` and `MAX_OPERATIONS`.

All is causal, and published samples are never changed: the samples are those that evaluating everything at once without
looking ahead would give (expressions.py), however they are cut into batches. A derivative comes one sample later, and a
combination of channels when the slower one has arrived.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import Unit
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.expression_functions import (
    FUNCTIONS,
    HERTZ,
    MEASURES,
    SECOND,
    Context,
    euler_angles,
)
from imuscope.server.extensions.analysis.expressions.expression_operators import OPERATORS, operate
from imuscope.server.extensions.analysis.expressions.expression_syntax import (
    Call,
    ExpressionError,
    Name,
    Node,
    Number,
    parse,
)
from imuscope.server.extensions.analysis.expressions.expressions import columns_of, evaluate, names_in
from imuscope.server.extensions.analysis.expressions.live_streams import (
    Derivative,
    Filtered,
    Integrated,
    Moving,
    Piece,
    Pointwise,
    Resampled,
    Runs,
    RunState,
    Shifted,
    SourceStream,
    Stream,
    Unwrapped,
)
from imuscope.server.extensions.analysis.signals.quantities import Quantity, number
from imuscope.server.extensions.analysis.signals.signals import SignalColumn, grouped, meant
from imuscope.server.wire import ChannelInfo

LIVE = Context(zero_phase=False)
PROBE_SAMPLES = 64  # made-up samples that show what a node gives
MAX_WINDOW = 200_000  # samples of all moving windows together; each batch needs all of them
MAX_RESAMPLED_HZ = (
    20_000.0  # values of all columns; a device sends a few thousand per second, and each browser gets all
)
MAX_OPERATIONS = 200  # operators and functions; each takes some 10 µs per batch
_FILTERS = ("lowpass", "highpass", "bandpass")


class RateUnknownError(ExpressionError):
    """A channel has sent too few samples to determine its rate."""


class LiveExpression:
    """An expression over live channels.

    Args:
        infos: channels that may be named.
        expression: its text, or a tree of one.
        rates: usual rates of these, Hz, by id; see `usual_rate`.
        others: channels of other devices, named with their device: `2/Acceleration`.
        whole_windows: as in Context.

    Attributes:
        channels: ids of the channels it uses.
        probe: what it gives, for made-up samples: unit, names of the columns, period.
        rate: of its samples, Hz.
        window: samples of all its moving windows.
        source: the channel whose sample times it has; None if they are its own (`resample`, `shift`).

    Raises:
        RateUnknownError: a rate is unknown.
        ExpressionError: something does not fit; says where.
        DomainError: it names no signal.
    """

    def __init__(
        self,
        infos: Iterable[ChannelInfo],
        expression: str | Node,
        rates: Mapping[int, float],
        others: Iterable[ChannelInfo] = (),
        *,
        whole_windows: bool = False,
    ) -> None:
        node = parse(expression) if isinstance(expression, str) else expression
        known, distant = list(infos), list(others)
        self._columns: dict[str, list[SignalColumn]] = {}
        angles: dict[str, str] = {}
        for name in names_in(node):
            if name.name not in self._columns:
                self._columns[name.name], angle = columns_of(meant(known, distant, name.name), name)
                if angle is not None:
                    angles[name.name] = angle
        if not self._columns:
            message = f"{expression:.80} names no signal." if isinstance(expression, str) else "No signal is named."
            raise DomainError("bad-expression", message, "Name a signal in it.")
        self.channels = frozenset(columns[0].info.id for columns in self._columns.values())
        self._newest = dict.fromkeys(self.channels, -np.inf)
        builder = _Builder(self._columns, angles, rates, whole_windows=whole_windows)
        stream = builder.build(node)
        self.window = builder.window
        assert isinstance(stream, Stream)  # it names a signal
        self._stream = stream
        self.probe, self.rate = stream.probe, stream.rate
        self.source = stream.axis if isinstance(stream.axis, int) else None

    @property
    def unit(self) -> str:
        return str(self.probe.unit)

    def feed(self, rows: Mapping[int, Sequence[NDArray[Any]]]) -> Piece:
        """New samples of the expression.

        Args:
            rows: new samples of channels: `arrival`, `time` (unix s; NaN: as arrival) and the channel's columns.
        """
        return self._step(rows, final=False)

    def finish(self) -> Piece:
        """The samples that waited for others; nothing is fed afterwards."""
        return self._step({}, final=True)

    def _step(self, rows: Mapping[int, Sequence[NDArray[Any]]], *, final: bool) -> Piece:
        times = {
            channel: self._times(channel, columns) for channel, columns in rows.items() if channel in self.channels
        }
        fresh = {
            name: Piece(times[info.id], tuple(rows[info.id][2 + one.at].astype(np.float64) for one in columns))
            for name, columns in self._columns.items()
            if (info := columns[0].info).id in times
        }
        with np.errstate(all="ignore"):
            return self._stream.step(fresh, final=final)

    def _times(self, channel: int, columns: Sequence[NDArray[Any]]) -> Floats:
        """Times of new samples, never before earlier ones."""
        arrival, time = columns[0], columns[1]
        plain = np.where(np.isnan(time), arrival, time)
        times: Floats = np.maximum(np.maximum.accumulate(plain), self._newest[channel]) if len(plain) else plain
        if len(times):
            self._newest[channel] = float(times[-1])
        return times


def usual_rate(times: Floats) -> float:
    """Rate of samples without gaps, Hz; 0 if there are too few."""
    steps = np.diff(times)
    steps = steps[steps > 0]
    if len(steps) < PROBE_SAMPLES // 4:
        return 0.0
    return 1 / float(steps[steps <= 1.5 * np.median(steps)].mean())


class _Builder:
    """Makes the streams of a tree. Units, arguments and limits are checked by computing some made-up samples."""

    def __init__(
        self,
        columns: Mapping[str, Sequence[SignalColumn]],
        angles: Mapping[str, str],
        rates: Mapping[int, float],
        *,
        whole_windows: bool,
    ) -> None:
        self._whole_windows = whole_windows
        self._columns, self._angles, self._rates = columns, angles, rates
        self._times: dict[object, Floats] = {}
        self._operations = self.window = 0

    def build(self, node: Node) -> Stream | Quantity:
        """The stream of a node, or its value if it is a number."""
        if isinstance(node, Number):
            return number(node.value, node.unit)
        if isinstance(node, Name):
            return self._source(node)
        if node.name not in OPERATORS and node.name not in FUNCTIONS:
            evaluate(Call(node.name, (), node.begin, node.end), _nothing, LIVE)  # says what it could be
        arguments = [self.build(one) for one in node.arguments]
        self._operations += 1
        if self._operations > MAX_OPERATIONS:
            message = f"More than {MAX_OPERATIONS} operators and functions are too many for live data."
            raise ExpressionError(message, node.begin, node.end, "Divide the expression into several signals.")
        if node.name == "resample":
            _check_rate(node, arguments)
        probe = _apply(node, [one.probe if isinstance(one, Stream) else one for one in arguments])
        if not any(isinstance(one, Stream) for one in arguments):
            return probe
        first = arguments[0]
        if isinstance(first, Stream) and (along := self._along(node, probe, first, arguments[1:])) is not None:
            return along
        return Pointwise(probe, arguments, lambda values: _apply(node, values))

    def _source(self, node: Name) -> Stream:
        columns = self._columns[node.name]
        info = columns[0].info
        own = [info.columns[column.at] for column in columns]
        rate = self._rates.get(info.id, 0.0)
        if rate <= 0:
            message = f"The rate of {info.name} is not known yet."
            raise RateUnknownError(message, node.begin, node.end, "Wait until it has sent some samples.")
        time = self._times.setdefault(info.id, np.arange(PROBE_SAMPLES) / rate)
        names = tuple(one.name for one in own) if len(own) > 1 else ("",)
        parts = tuple(np.ones(PROBE_SAMPLES) for _ in own)
        probe = Quantity(parts, Unit.parse(own[0].unit), time, names, own[0].period)
        source = SourceStream(node.name, probe, rate, info.id)
        if node.name not in self._angles:
            return source
        angle = self._angles[node.name]
        return Pointwise(euler_angles(probe, angle), [source], lambda values: euler_angles(values[0], angle))

    def _along(self, node: Call, probe: Quantity, first: Stream, rest: Sequence[Stream | Quantity]) -> Stream | None:
        """The stream of a function along time; None for one of a moment."""
        name, columns = node.name, len(first.probe.parts)
        constants = [one for one in rest if isinstance(one, Quantity)]
        continued = _continued(first) if first.probe.period else first
        if name == "derivative":
            return Derivative(probe, continued)
        if name == "integral":
            return Runs(probe, first, [Integrated() for _ in range(columns)], gap=np.inf)
        if name == "unwrap":
            period = Unit.parse("°").to(first.probe.unit) * 360
            return Runs(probe, first, [Unwrapped(period) for _ in range(columns)], gap=np.inf)
        if name in _FILTERS:
            sections = _sections(name, first.rate, constants)
            return Runs(probe, continued, [Filtered(sections) for _ in range(columns)])
        if name == "shift":
            return Shifted(probe, first, constants[0].in_unit(SECOND).number)
        if name == "resample":
            return Resampled(probe, first, constants[0].in_unit(HERTZ).number)
        if name not in MEASURES:
            return None
        size = max(1, round(constants[0].in_unit(SECOND).number * first.rate))
        self.window += size * columns
        check_window(self.window, node.arguments[1])
        states: list[RunState] = [Moving(size, MEASURES[name], whole=self._whole_windows) for _ in range(columns)]
        return Runs(probe, first, states)


def check_window(samples: int, place: Node) -> None:
    """Raise ExpressionError if moving windows have more samples, of all columns, than live data may have."""
    if samples > MAX_WINDOW:
        message = f"Moving windows of {grouped(samples)} samples are too long for live data."
        hint = f"At most {grouped(MAX_WINDOW)} samples, of all windows and columns of an expression."
        raise ExpressionError(message, place.begin, place.end, hint)


def _check_rate(node: Call, arguments: Sequence[Stream | Quantity]) -> None:
    """Raise ExpressionError if `resample` makes more values than live data may have."""
    if len(arguments) != 2:
        return
    signal, limit = arguments
    if not isinstance(signal, Stream) or isinstance(limit, Stream) or not limit.unit.fits(HERTZ):
        return  # the function itself reports it
    columns, rate = len(signal.probe.parts), limit.in_unit(HERTZ).number
    if rate * columns > MAX_RESAMPLED_HZ:
        place = node.arguments[1]
        each = f" of {columns} columns" if columns > 1 else ""
        message = f"{rate:.6g} samples per second{each} are too many for live data."
        hint = f"At most {MAX_RESAMPLED_HZ / columns:.6g} Hz; an analysis of a recording may have more."
        raise ExpressionError(message, place.begin, place.end, hint)


def _apply(node: Call, arguments: list[Quantity]) -> Quantity:
    with np.errstate(all="ignore"):
        if node.name in OPERATORS:
            return operate(node, arguments)
        return FUNCTIONS[node.name].apply(arguments, node, LIVE)


def _continued(angle: Stream) -> Stream:
    probe = angle.probe
    states = [Unwrapped(probe.period) for _ in probe.parts]
    return Runs(probe.with_parts(probe.parts), angle, states, gap=np.inf)


def _sections(name: str, rate: float, constants: Sequence[Quantity]) -> Any:
    from scipy import signal

    edges = 2 if name == "bandpass" else 1
    cut = [one.in_unit(HERTZ).number for one in constants[:edges]]
    order = round(constants[edges].number) if len(constants) > edges else 2
    return signal.butter(max(1, order), cut if edges == 2 else cut[0], name, fs=rate, output="sos")


def _nothing(name: str) -> Quantity:
    raise AssertionError(name)
