"""Streams: the nodes of an expression that is evaluated batch by batch, each with the state that its next batch needs.

    SourceStream ── Pointwise ── Runs (filters, moving windows, integral, unwrap)   each step takes and gives new ones
                      └ Alignment: at the times of the fastest argument

A stream gives the samples that the evaluation of everything at once (expressions.py, without looking ahead) would give,
some of them later: a derivative waits for the next sample, and an interpolation for the slower signal, but no longer
than `WAIT_S`. What depends on all samples there, the usual step, is given here as the rate.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.breaks import GAP_STEPS
from imuscope.server.extensions.analysis.signals.quantities import Quantity, at_times

WAIT_S = 2.0  # a signal that lags behind the others by more counts as interrupted
MAX_IN_GAP = 1000  # undefined samples of a gap
HELD_S = 30.0  # samples are kept as long for another signal, which may be interrupted, too


@dataclass(frozen=True, slots=True)
class Piece:
    """New samples of a stream: times (n,) and one array (n,) per column."""

    time: Floats
    parts: tuple[Floats, ...]

    def __len__(self) -> int:
        return len(self.time)

    def rows(self, begin: int, end: int | None = None) -> Piece:
        """Some of them."""
        return Piece(self.time[begin:end], tuple(part[begin:end] for part in self.parts))

    def then(self, other: Piece) -> Piece:
        """These and the other ones."""
        if not len(self):
            return other
        if not len(other):
            return self
        parts = (np.concatenate(pair) for pair in zip(self.parts, other.parts, strict=True))
        return Piece(np.concatenate((self.time, other.time)), tuple(parts))


def no_samples(columns: int) -> Piece:
    """A piece without samples."""
    return Piece(np.empty(0), tuple(np.empty(0) for _ in range(columns)))


class Stream(ABC):
    """A node of an expression.

    Attributes:
        probe: what the node gives for some made-up samples: its unit, columns and period.
        rate: of its samples, Hz.
        axis: streams with the same axis have the same sample times.
    """

    def __init__(self, probe: Quantity, rate: float, axis: Hashable) -> None:
        self.probe, self.rate, self.axis = probe, rate, axis

    @abstractmethod
    def step(self, fresh: Mapping[str, Piece], *, final: bool) -> Piece:
        """Its new samples. `fresh`: those of the signals, by name; `final`: no more will follow."""

    def quantity(self, piece: Piece) -> Quantity:
        """Samples with the unit and columns of this stream."""
        return replace(self.probe, time=piece.time, parts=piece.parts)


class SourceStream(Stream):
    """A signal, or a channel with all its columns."""

    def __init__(self, name: str, probe: Quantity, rate: float, axis: Hashable) -> None:
        super().__init__(probe, rate, axis)
        self._name = name

    def step(self, fresh: Mapping[str, Piece], *, final: bool) -> Piece:
        return fresh.get(self._name) or no_samples(len(self.probe.parts))


class Pointwise(Stream):
    """A value of one moment, of arguments at that moment."""

    def __init__(
        self, probe: Quantity, arguments: Sequence[Stream | Quantity], work: Callable[[list[Quantity]], Quantity]
    ):
        streams = [one for one in arguments if isinstance(one, Stream)]
        fastest = max(streams, key=lambda one: one.rate)
        super().__init__(probe, fastest.rate, fastest.axis)
        self._arguments, self._work = arguments, work
        self._alignment = Alignment(streams, streams.index(fastest))

    def step(self, fresh: Mapping[str, Piece], *, final: bool) -> Piece:
        piece = self._alignment.step(fresh, final=final)
        if not len(piece[0].time if piece[0].time is not None else ()):
            return no_samples(len(self.probe.parts))
        aligned = iter(piece)
        value = self._work([next(aligned) if isinstance(one, Stream) else one for one in self._arguments])
        assert value.time is not None
        return Piece(value.time, value.parts)


class Alignment:
    """Several streams at the times of one of them, by linear interpolation as in quantities.py.

    Args:
        at: index of the one that gives the times.
    """

    def __init__(self, streams: Sequence[Stream], at: int) -> None:
        self._streams, self._at = streams, at
        self._held = [no_samples(len(one.probe.parts)) for one in streams]

    def step(self, fresh: Mapping[str, Piece], *, final: bool) -> list[Quantity]:
        """The streams at new times; each shares the array of the times."""
        self._held = [
            held.then(one.step(fresh, final=final)) for held, one in zip(self._held, self._streams, strict=True)
        ]
        time = self._held[self._at].time
        count = min((self._known(k, time, final=final) for k in range(len(self._held))), default=0)
        axis = time[:count]
        return [self._aligned_rows(k, axis) for k in range(len(self._held))]

    def _is_alike(self, k: int) -> bool:
        return self._streams[k].axis == self._streams[self._at].axis

    def _known(self, k: int, time: Floats, *, final: bool) -> int:
        """Number of times at which a stream is known."""
        own = self._held[k]
        if self._is_alike(k):
            return len(own)
        if final:
            return len(time)
        newest = max(own.time[-1] if len(own) else -np.inf, time[-1] - WAIT_S if len(time) else -np.inf)
        return int(np.searchsorted(time, newest, "right"))

    def _aligned_rows(self, k: int, axis: Floats) -> Quantity:
        stream, own = self._streams[k], self._held[k]
        if self._is_alike(k):
            self._held[k] = own.rows(len(axis))
            return replace(stream.quantity(own.rows(0, len(axis))), time=axis)
        if len(own):  # the sample before the next time is needed again
            past = max(axis[-1] if len(axis) else -np.inf, own.time[-1] - HELD_S)
            self._held[k] = own.rows(max(0, int(np.searchsorted(own.time, past, "right")) - 1))
        return at_times(stream.quantity(own), axis)


class RunState(ABC):
    """Memory of a function along time, of one column."""

    @abstractmethod
    def begin(self, t: float, v: float) -> None:
        """A run begins with this sample."""

    @abstractmethod
    def extend(self, t: Floats, v: Floats) -> Floats:
        """The values at further samples of the run, the first one included."""


class Runs(Stream):
    """A function along time, run by run: stretches of finite values without a gap; NaN elsewhere.

    Args:
        states: one for each column.
        gap: a step longer than this many usual ones ends a run.
    """

    def __init__(self, probe: Quantity, argument: Stream, states: Sequence[RunState], gap: float = GAP_STEPS) -> None:
        super().__init__(probe, argument.rate, argument.axis)
        self._argument, self._states = argument, states
        self._longest = gap / argument.rate
        self._last = [-np.inf] * len(states)  # time of the newest finite sample

    def step(self, fresh: Mapping[str, Piece], *, final: bool) -> Piece:
        piece = self._argument.step(fresh, final=final)
        return Piece(piece.time, tuple(self._column(k, piece.time, part) for k, part in enumerate(piece.parts)))

    def _column(self, k: int, time: Floats, values: Floats) -> Floats:
        column = np.full(len(values), np.nan)
        finite = np.flatnonzero(np.isfinite(values))
        if not len(finite):
            return column
        t, v, state = time[finite], values[finite], self._states[k]
        breaks = np.flatnonzero(np.diff(t, prepend=self._last[k]) > self._longest)
        if np.isinf(self._last[k]):
            breaks = np.union1d(0, breaks)
        for begin, end in itertools.pairwise(sorted({0, *breaks.tolist(), len(t)})):
            if begin in breaks:
                state.begin(float(t[begin]), float(v[begin]))
            column[finite[begin:end]] = state.extend(t[begin:end], v[begin:end])
        self._last[k] = float(t[-1])
        return column


class Filtered(RunState):
    """A filter of second-order sections."""

    def __init__(self, sections: Any) -> None:
        from scipy import signal

        self._sections, self._sosfilt = sections, signal.sosfilt
        self._rest = signal.sosfilt_zi(sections)
        self._state = self._rest

    def begin(self, t: float, v: float) -> None:
        self._state = self._rest * v

    def extend(self, t: Floats, v: Floats) -> Floats:
        filtered, self._state = self._sosfilt(self._sections, v, zi=self._state)
        result: Floats = filtered
        return result


class Moving(RunState):
    """A figure of the last `size` samples.

    Args:
        measure: takes samples, the size, the number of earlier samples in a window, and times
            (expression_functions.py).
        whole: without a value until there are `size` samples.
    """

    def __init__(
        self, size: int, measure: Callable[[Floats, int, int, Floats], Floats], *, whole: bool = False
    ) -> None:
        self._size, self._measure, self._whole = size, measure, whole
        self._tail = np.empty(0)

    def begin(self, t: float, v: float) -> None:
        self._tail = np.empty(0)

    def extend(self, t: Floats, v: Floats) -> Floats:
        both = np.concatenate((self._tail, v))
        size = min(self._size, len(both))
        values = self._measure(both, size, size - 1, both)[len(self._tail) :]
        if self._whole:
            values[: max(0, self._size - 1 - len(self._tail))] = np.nan
        self._tail = both[max(0, len(both) - self._size + 1) :]
        return values


class Integrated(RunState):
    """The integral from the first sample on, by the trapezoidal rule."""

    def __init__(self) -> None:
        self._t, self._v, self._sum = 0.0, 0.0, 0.0

    def begin(self, t: float, v: float) -> None:
        self._t, self._v, self._sum = t, v, 0.0

    def extend(self, t: Floats, v: Floats) -> Floats:
        before = np.concatenate(([self._v], v[:-1]))
        sums = self._sum + np.cumsum(np.diff(t, prepend=self._t) * (v + before) / 2)
        self._t, self._v, self._sum = float(t[-1]), float(v[-1]), float(sums[-1])
        return sums


class Unwrapped(RunState):
    """An angle without its jumps."""

    def __init__(self, period: float) -> None:
        self._period, self._last = period, 0.0

    def begin(self, t: float, v: float) -> None:
        self._last = v

    def extend(self, t: Floats, v: Floats) -> Floats:
        unwrapped: Floats = np.unwrap(np.concatenate(([self._last], v)), period=self._period)[1:]
        self._last = float(unwrapped[-1])
        return unwrapped


class Derivative(Stream):
    """The rate of change: central differences, so each sample waits for the next one of its run."""

    def __init__(self, probe: Quantity, argument: Stream) -> None:
        super().__init__(probe, argument.rate, argument.axis)
        self._argument = argument
        self._longest = GAP_STEPS / argument.rate
        self._held = no_samples(len(probe.parts))
        self._done = 0  # the first of these were given: they are the neighbours of the next ones

    def step(self, fresh: Mapping[str, Piece], *, final: bool) -> Piece:
        held = self._held.then(self._argument.step(fresh, final=final))
        end = len(held) if final else min((self._settled(held.time, part) for part in held.parts), default=0)
        end = max(end, self._done)
        parts = tuple(self._column(held.time, part)[self._done : end] for part in held.parts)
        piece = Piece(held.time[self._done : end], parts)
        keep = min((self._neighbour(held.time, part, end) for part in held.parts), default=end)
        self._held, self._done = held.rows(keep), end - keep
        return piece

    def _settled(self, time: Floats, values: Floats) -> int:
        """Number of samples whose derivative no later sample changes."""
        finite = np.flatnonzero(np.isfinite(values))
        if not len(finite) or time[-1] - time[finite[-1]] > self._longest:
            return len(time)
        first = np.searchsorted(time[finite], time[finite[-1]], "left")  # of several at one time the first counts
        return int(finite[first])

    def _neighbour(self, time: Floats, values: Floats, end: int) -> int:
        finite = np.flatnonzero(np.isfinite(values[:end]))
        if not len(finite):
            return end
        first = np.searchsorted(time[finite], time[finite[-1]], "left")
        return int(finite[first]) if time[end - 1] - time[finite[-1]] <= self._longest else end

    def _column(self, time: Floats, values: Floats) -> Floats:
        slopes = np.full(len(values), np.nan)
        finite = np.flatnonzero(np.isfinite(values))
        finite = finite[np.diff(time[finite], prepend=-np.inf) > 0]
        edges = np.flatnonzero(np.diff(time[finite]) > self._longest) + 1
        for begin, end in itertools.pairwise([0, *edges.tolist(), len(finite)]):
            run = finite[begin:end]
            if len(run) > 1:
                slopes[run] = np.gradient(values[run], time[run])
        return slopes


class Shifted(Stream):
    """The same values later by a time."""

    def __init__(self, probe: Quantity, argument: Stream, by: float) -> None:
        super().__init__(probe, argument.rate, (argument.axis, "shift", by))
        self._argument, self._by = argument, by

    def step(self, fresh: Mapping[str, Piece], *, final: bool) -> Piece:
        piece = self._argument.step(fresh, final=final)
        return Piece(piece.time + self._by, piece.parts)


class Resampled(Stream):
    """Linear interpolation at even times from the first sample on; NaN in gaps."""

    def __init__(self, probe: Quantity, argument: Stream, rate: float) -> None:
        super().__init__(probe, rate, (argument.axis, "resample", rate))
        self._argument = argument
        self._longest = GAP_STEPS / argument.rate
        self._held = no_samples(len(probe.parts))
        self._first: float | None = None
        self._count = 0

    def step(self, fresh: Mapping[str, Piece], *, final: bool) -> Piece:
        held = self._held.then(self._argument.step(fresh, final=final))
        if not len(held):
            return held
        if self._first is None:
            self._first = float(held.time[0])
        end = self._first_after(held.time[-1])
        axis = self._first + self._indices(held.time, end) / self.rate
        if not len(axis):
            self._held = held
            return no_samples(len(held.parts))
        moved = at_times(self._argument.quantity(held), np.minimum(axis, held.time[-1]))
        before = np.maximum(np.searchsorted(held.time, axis, "right") - 1, 0)
        steps = np.diff(held.time, append=held.time[-1])
        in_gap = (steps[before] > self._longest) & (held.time[before] < axis)
        self._count = end
        self._held = held.rows(int(before[-1]))
        return Piece(axis, tuple(np.where(in_gap, np.nan, part) for part in moved.parts))

    def _first_after(self, time: float) -> int:
        """Number of the first even time after a time."""
        assert self._first is not None
        return int(np.floor((time - self._first) * self.rate + 1e-9)) + 1

    def _indices(self, times: Floats, end: int) -> Floats:
        """Numbers of the even times that are due. In a long gap only the first few: a clock may jump by years."""
        parts, begin = [], self._count
        steps = np.diff(times)
        for at in np.flatnonzero((steps > self._longest) & (steps * self.rate > MAX_IN_GAP)):
            stop = self._first_after(times[at]) + MAX_IN_GAP
            parts.append(np.arange(begin, max(begin, stop)))
            begin = max(begin, self._first_after(times[at + 1]) - 1)
        return np.concatenate([*parts, np.arange(begin, max(begin, end))]).astype(np.float64)
