"""Differences between two sides A and B: of a signal, and of an attitude as one angle.

    time of A      ·    ·    ·    ·    ·    ·
    B + offset   |----|----|--------|            gap          interpolated between its samples
    B − A          ·    ·    ·                                only where B has samples on both sides, without a gap

A is the reference, so a difference is B − A, at the times of A. An angle differs by the shorter way round.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.protocols.rotations import angle_of, conjugate, mean_rotation, product, slerp
from imuscope.protocols.schema.plural import counted
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.signals.sampling import sampling_of, unwrapped
from imuscope.server.extensions.analysis.signals.signals import Signal

NAN = float("nan")
OUTSIDE_PERCENT = 2.5  # per cent of the differences beyond each limit
Figures = dict[str, float]


@dataclass(frozen=True, slots=True)
class SignalDifference:
    """B − A at times of A.

    Attributes:
        time: (n,) unix s, of A.
        values: (n,) in the unit of the signals; °, not negative, of an attitude.
        left_out: samples of A within the range of B that have no difference, because of a gap.
    """

    time: Floats
    values: Floats
    left_out: int

    @property
    def notes(self) -> list[str]:
        """Sentences for a user: omitted parts."""
        if not self.left_out:
            return []
        return [f"{counted(self.left_out, 'sample')} of A in a gap of B: nothing is compared across a gap."]


@dataclass(frozen=True, slots=True)
class Neighbours:
    """Places of times between samples.

    Attributes:
        inside: (m,) of the times, those between two samples without a gap, or at a sample.
        before: (k,) index of the sample before each of these.
        part: (k,) way to the next sample, 0 to 1.
        left_out: number of times in gaps.
    """

    inside: NDArray[np.bool_]
    before: NDArray[np.int64]
    part: Floats
    left_out: int


def neighbours(signal: Signal, times: Floats) -> Neighbours:
    """Neighbours of the times among the samples of a signal."""
    own = signal.time
    begins = np.zeros(len(own), bool)
    for run in sampling_of(signal, 2).runs:
        begins[run.start] = True
    within = (times >= own[0]) & (times <= own[-1])
    after = np.clip(np.searchsorted(own, times, "left"), 1, len(own) - 1)
    exact = own[np.minimum(np.searchsorted(own, times, "left"), len(own) - 1)] == times
    inside = within & (~begins[after] | exact)
    before = after[inside] - 1
    step = own[before + 1] - own[before]
    part = np.where(step > 0, (times[inside] - own[before]) / np.where(step > 0, step, 1), 1.0)
    return Neighbours(inside, before, part, int(np.count_nonzero(within & ~inside)))


def difference(a: Signal, b: Signal, offset: float) -> SignalDifference:
    """B − A at the times of A.

    Args:
        offset: s to add to the times of B.

    Raises:
        DomainError: "not-alike": their units differ; "no-result": they do not overlap.
    """
    if a.unit != b.unit or a.period != b.period:
        hint = "Choose a signal of the same quantity."
        units = f"{a.unit or 'no unit'} and {b.unit or 'no unit'}"
        raise DomainError("not-alike", f"{a.name} and {b.name} have different units: {units}.", hint)
    near = neighbours(b, a.time - offset)
    values = unwrapped(b)
    shifted = values[near.before] + near.part * (values[near.before + 1] - values[near.before])
    result = shifted - a.values[near.inside]
    if a.period:
        result = result - a.period * np.round(result / a.period)
    return _checked(SignalDifference(a.time[near.inside], result, near.left_out), a.name)


def attitude_difference(
    a: tuple[Floats, Floats], b: tuple[Floats, Floats], offset: float
) -> tuple[SignalDifference, Figures]:
    """Angle between two attitudes at the times of A, and its remainder without a constant rotation of the sensor.

    Args:
        a, b: times (n,), non-decreasing, and unit quaternions (n, 4), scalar first.
        offset: s to add to the times of B.

    Returns:
        The angle, °, and figures: `mounting`, the angle of the mean rotation between the two sensors, °; `remaining`,
        rms of the angle without it, °.

    Raises:
        DomainError: "no-result": they do not overlap.
    """
    near = neighbours(Signal("Attitude", "", 0.0, b[0], b[1][:, 0]), a[0] - offset)
    first = a[1][near.inside]
    second = slerp(b[1][near.before], b[1][near.before + 1], near.part)
    between = product(conjugate(first), second)
    result = _checked(SignalDifference(a[0][near.inside], angle_of(between), near.left_out), "Attitude")
    mean = mean_rotation(between)
    rest = angle_of(product(between, conjugate(mean)))
    return result, {"mounting": float(angle_of(mean[np.newaxis])[0]), "remaining": _rms(rest)}


def _checked(result: SignalDifference, name: str) -> SignalDifference:
    if not len(result.time):
        hint = "Change the offset or the ranges."
        raise DomainError("no-result", f"The samples of {name} do not overlap at this offset.", hint)
    return result


def difference_figures(values: Floats) -> Figures:
    """Statistics of differences; 95 % of them lie between `low` and `high`."""
    low, high = np.percentile(values, [OUTSIDE_PERCENT, 100 - OUTSIDE_PERCENT])
    return {
        "n": float(len(values)),
        "mean": float(values.mean()),
        "sigma": float(values.std(ddof=1)) if len(values) > 1 else NAN,
        "rms": _rms(values),
        "min": float(values.min()),
        "max": float(values.max()),
        "low": float(low),
        "high": float(high),
    }


def _rms(values: Floats) -> float:
    return math.sqrt(float(np.square(values).mean()))


def outline(signal: Signal, columns: int) -> dict[str, list[float | None]]:
    """At most about `columns` points of a signal for a plot: least and greatest value of each part of the time.

    Returns:
        `time`, `low` and `high`; None stands where a gap is.
    """
    n = len(signal.time)
    breaks = np.zeros(n, bool)
    if n > 2 and signal.time[-1] > signal.time[0]:
        for run in sampling_of(signal, 2).runs[1:]:
            breaks[run.start] = True
    if n <= columns:
        firsts = np.arange(n)
    else:
        edges = np.linspace(signal.time[0], signal.time[-1], columns + 1)[:-1]
        firsts = np.unique(np.searchsorted(signal.time, edges, "left"))
        firsts = np.unique(np.concatenate([firsts, np.flatnonzero(breaks)]))
        firsts = firsts[firsts < n]
    lasts = np.append(firsts[1:], n) - 1
    time = (signal.time[firsts] + signal.time[lasts]) / 2
    low, high = (each.reduceat(signal.values, firsts) for each in (np.minimum, np.maximum))
    at = np.flatnonzero(breaks[firsts])
    return {
        name: [None if math.isnan(one) else one for one in np.insert(values, at, NAN).tolist()]
        for name, values in (("time", time), ("low", low), ("high", high))
    }
