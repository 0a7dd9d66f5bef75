"""Quantities: what an expression computes with. Numbers, signals and vectors of signals, with their unit and times."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import NO_UNIT, Unit
from imuscope.recordings.columns.breaks import GAP_STEPS


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number, a signal, or a vector of signals on one time axis.

    Attributes:
        parts: one array (n,) per column; of a number one array ().
        unit: of all parts.
        time: (n,) unix s, non-decreasing; None for a number. Parts of one channel share this very array.
        names: of the columns ("x", "y", "z"); ("",) if there is one only.
        period: an angle wraps at this value, in its unit; 0: it never wraps.
        is_logical: 0 and 1 stand for false and true.
        is_literal: a number as typed, or computed from such: 0 fits every unit.
        breaks: times at which the clock of its device steps, unix s: nothing is computed across them.
    """

    parts: tuple[Floats, ...]
    unit: Unit = NO_UNIT
    time: Floats | None = None
    names: tuple[str, ...] = ("",)
    period: float = 0.0
    is_logical: bool = False
    is_literal: bool = field(default=False)
    breaks: tuple[float, ...] = ()

    @property
    def is_number(self) -> bool:
        """Whether it has one value at all times."""
        return self.time is None

    @property
    def number(self) -> float:
        return float(self.parts[0])

    @property
    def is_zero(self) -> bool:
        """Whether it is the number 0, which fits every unit."""
        return self.is_number and self.is_literal and self.number == 0.0

    def with_parts(self, parts: Sequence[Floats], unit: Unit | None = None, *, is_logical: bool = False) -> "Quantity":
        """Other values at the same times; angles that wrap become plain numbers."""
        names = self.names if len(parts) == len(self.parts) else ("",)
        unit = self.unit if unit is None else unit
        return Quantity(tuple(parts), unit, self.time, names, 0.0, is_logical, breaks=self.breaks)

    def in_unit(self, unit: Unit) -> "Quantity":
        """The same in another unit that fits."""
        factor = self.unit.to(unit)
        if factor == 1.0:
            return replace(self, unit=unit)
        return replace(self, parts=tuple(part * factor for part in self.parts), unit=unit, period=self.period * factor)


def number(value: float, unit: Unit = NO_UNIT) -> Quantity:
    return Quantity((np.asarray(value, np.float64),), unit, is_literal=True)


def on_one_axis(quantities: Sequence[Quantity]) -> list[Quantity]:
    """The same quantities at the times of the one with the most samples.

    The others are interpolated linearly between their samples, and undefined (NaN) before the first and after the last
    one; a truth value is kept until the next sample. Angles that wrap take the short way round.
    """
    signals = [one for one in quantities if one.time is not None]
    if not signals:
        return list(quantities)
    axis = max(signals, key=lambda one: len(one.time if one.time is not None else ())).time
    assert axis is not None
    return [one if one.time is None or one.time is axis else _moved(one, axis) for one in quantities]


def _moved(quantity: Quantity, axis: Floats) -> Quantity:
    own = quantity.time
    assert own is not None
    if len(own) == len(axis) and np.array_equal(own, axis):
        return replace(quantity, time=axis)
    return at_times(quantity, axis)


def at_times(quantity: Quantity, axis: Floats) -> Quantity:
    """A signal interpolated at other times, (n,) non-decreasing; see on_one_axis."""
    return replace(quantity, time=axis, parts=tuple(_interpolated(quantity, part, axis) for part in quantity.parts))


def _interpolated(quantity: Quantity, values: Floats, axis: Floats) -> Floats:
    own = quantity.time
    assert own is not None
    if not len(own):
        return np.full(len(axis), np.nan)
    if quantity.is_logical:
        at = np.searchsorted(own, axis, "right") - 1
        held: Floats = np.where((at >= 0) & (axis <= own[-1]), values[np.maximum(at, 0)], np.nan)
        return held
    if quantity.period:
        turned = np.interp(axis, own, np.unwrap(values, period=quantity.period), np.nan, np.nan)
        half = quantity.period / 2
        wrapped: Floats = (turned + half) % quantity.period - half
        return wrapped
    result: Floats = np.interp(axis, own, values, np.nan, np.nan)
    return result


def in_runs(quantity: Quantity, work: Callable[[Floats, Floats], Floats], gap: float = GAP_STEPS) -> Quantity:
    """Each part computed run by run: stretches of finite values without a gap; NaN elsewhere.

    Args:
        work: takes times and values of a run, and returns as many values.
        gap: a step longer than this many usual ones ends a run.
    """
    assert quantity.time is not None
    breaks = np.array(quantity.breaks)
    return quantity.with_parts([_part_in_runs(quantity.time, part, work, gap, breaks) for part in quantity.parts])


def _part_in_runs(
    time: Floats, values: Floats, work: Callable[[Floats, Floats], Floats], gap: float, breaks: Floats
) -> Floats:
    finite = np.flatnonzero(np.isfinite(values))
    result = np.full(len(values), np.nan)
    if not len(finite):
        return result
    whole = len(finite) == len(values)
    t, v = (time, values) if whole else (time[finite], values[finite])
    steps = np.diff(t)
    usual = float(np.median(steps)) if len(steps) else 0.0
    edges = [0, *(np.flatnonzero(steps > gap * usual) + 1).tolist(), len(t)] if usual > 0 else [0, len(t)]
    if len(breaks):
        edges = sorted({*edges, *np.searchsorted(t, breaks).tolist()})
    for begin, end in itertools.pairwise(edges):
        at = slice(begin, end) if whole else finite[begin:end]
        result[at] = work(t[begin:end], v[begin:end])
    return result
