"""Faults of single samples that pass for low or high noise: clipped, stuck, coarsely rounded, repeated values; spikes.

They are seen in the samples themselves, whatever the sensor measures; the first of these that is found hides the
others, as a clipped signal repeats its extremes:

    clipped     more samples at the very extreme than at the value beside it, at several times
    stuck       the same value for a long time, where the others change from sample to sample
    coarse      the step between two possible values is larger than the noise
    repeated    pairs of equal neighbours, though the values have a fine resolution
    spikes      single samples far from those around them (spikes.py), if the noise is larger with them
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.plural import counted
from imuscope.protocols.schema.units import rounded
from imuscope.server.extensions.analysis.signals.spikes import noise_level, spikes_in

MAX_RESOLUTION_SAMPLES = 100_000  # samples that determine the resolution
STUCK_S = 0.5
MIN_WINDOW = 25  # samples: a smaller window's variance scatters too much
QUIET_SHARE = 0.01  # of the noise of the loud windows: noise by chance is never so low
CHANCE_PROBABILITY = 1e-9  # probability of a stretch of equal values as long by chance
REPEATED_SHARE = 0.03  # part of equal neighbours beyond what rounding explains
SMALL_STEP_SHARE = 0.05  # part of the distances between values
COARSE_SIGMAS = 1.0  # standard deviations in a step of the resolution
MIN_CLIPPED_SAMPLES, MIN_CLIPPED_SHARE = 5, 5e-4  # samples at an extreme, at least
LARGE_STEP_SIGMAS = 9.0  # a smaller step is that of noise, or of a spike that changes its level only in large numbers
MIN_EXCESS_SHARE = 0.5  # of what the variance is above that of the noise: else they are the tops of bursts
MAX_SPIKE_SHARE = 0.005  # of the variance: less changes the noise by a quarter of a per cent
Fault = tuple[str, str, str]
"""Name of a check, its finding, and the remedy."""


@dataclass(frozen=True, slots=True)
class Steps:
    """Steps from each sample of a stretch to the next, computed once for all checks.

    Attributes:
        values: (n,) the samples.
        steps: (n - 1,).
        equal: number of steps of 0.
        squares: sum of the squares of the steps.
    """

    values: Floats
    steps: Floats
    equal: int
    squares: float

    @classmethod
    def of(cls, values: Floats) -> "Steps":
        """The steps of samples, (n,), at least two."""
        steps = np.diff(values)
        return cls(values, steps, len(steps) - int(np.count_nonzero(steps)), float(np.einsum("i,i", steps, steps)))

    def longest_equal(self) -> tuple[int, float]:
        """Number of samples of the longest stretch of one value, and that value."""
        if not self.equal:
            return 1, float(self.values[0])
        still = np.flatnonzero(self.steps == 0)  # few, if the sensor is sound
        begins = np.flatnonzero(np.diff(still, prepend=still[0] - 2) > 1)
        lengths = np.diff(begins, append=len(still))
        at = int(lengths.argmax())
        return int(lengths[at]) + 1, float(self.values[still[begins[at]]])


def sample_faults(values: Floats, runs: Sequence[slice], rate: float, unit: str) -> list[Fault]:
    """Faults of the samples of a signal; the first one found hides the others.

    Args:
        values: as they came: (n,).
        runs: stretches that are judged; no gap lies within one.
        rate: Hz.
        unit: of the values.
    """
    parts = [Steps.of(values[run]) for run in runs if run.stop - run.start > 1]
    if not parts:
        return []
    (finest, step), scatter, equal = resolution([part.values for part in parts]), _scatter(parts), _equal(parts)
    is_coarse = finest > COARSE_SIGMAS * scatter
    if fault := _stuck(parts, rate, unit) if is_coarse else _clipped_or_stuck(parts, rate, unit):
        return fault
    if quiet := _quiet(parts, rate):
        return [("stuck", f"Stuck: {rounded(quiet / rate)} s with hardly any noise.", _CHECK_SENSOR)]
    if is_coarse:
        words = f"Coarse resolution: a step of {_with(finest, unit, 3)} is larger than the noise."
        return [("resolution", words, "Set the device to an output format with a finer resolution, and record again.")]
    by_rounding = step / (2 * math.sqrt(math.pi) * scatter)
    if equal > 1.5 * by_rounding + REPEATED_SHARE:
        return [("repeated", f"Repeated samples: {100 * equal:.0f} % equal the one before.", _lower_rate(equal, rate))]
    return _spikes(parts, unit)


def stuck_or_clipped(values: Floats, rate: float, unit: str) -> list[Fault]:
    """Those faults that make samples useless whatever the sensor does: at rest or in motion, (n,)."""
    return _clipped_or_stuck([Steps.of(values)], rate, unit) if len(values) > 1 else []


def _equal(parts: Sequence[Steps]) -> float:
    """Part of the samples that equal the one before."""
    return sum(part.equal for part in parts) / sum(len(part.steps) for part in parts)


def _clipped_or_stuck(parts: Sequence[Steps], rate: float, unit: str) -> list[Fault]:
    stuck = _stuck(parts, rate, unit)
    # a value that is held once may be the extreme, too
    return _clipped([part.values for part in parts], unit, 2 if stuck else 1) or stuck


def _stuck(parts: Sequence[Steps], rate: float, unit: str) -> list[Fault]:
    n = sum(len(part.values) for part in parts)
    first = parts[0].values[0]
    if all(part.equal == len(part.steps) and part.values[0] == first for part in parts):
        return [("stuck", f"Stuck: all {counted(n, 'sample')} are {_with(first, unit)}.", _CHECK_SENSOR)]
    longest, at_value = max((part.longest_equal() for part in parts), key=lambda pair: pair[0])
    others = max(_equal(parts) - longest / n, 0.0)
    if longest >= max(STUCK_S * rate, 10) and n * others ** (longest - 1) < CHANCE_PROBABILITY:
        words = f"Stuck: {rounded(longest / rate)} s without a change, at {_with(at_value, unit)}."
        return [("stuck", words, _CHECK_SENSOR)]
    return []


_CHECK_SENSOR = "A sensor that measures always shows noise: restart the device, and look at its settings and self-test."


def _lower_rate(equal: float, rate: float) -> str:
    return f"Set the output rate to what the sensor measures, about {(1 - equal) * rate:.3g} Hz, and record again."


def resolution(parts: Sequence[Floats]) -> tuple[float, float]:
    """A small and the usual distance of neighbouring values among all that occur; those of a fine resolution are tiny.

    Only where the small one is large, too, the values lie on a coarse grid: those of a steady swing are few, but the
    ones near its ends are close to each other.
    """
    values = np.unique(np.concatenate(parts)[:MAX_RESOLUTION_SAMPLES])
    if len(values) < 2:
        return 0.0, 0.0
    small, usual = np.quantile(np.diff(values), (SMALL_STEP_SHARE, 0.5))
    return float(small), float(usual)


def _with(value: float, unit: str, digits: int = 6) -> str:
    return f"{rounded(value, digits)} {unit}".rstrip()


def _quiet(parts: Sequence[Steps], rate: float) -> int:
    """Samples in windows with hardly any noise, if the others have some: an average or a held value, no measurement."""
    length = max(MIN_WINDOW, round(rate * STUCK_S))
    intervals = []
    for part in parts:
        count = len(part.steps) // length
        windows = part.steps[: count * length].reshape(count, length)[:, :-1]  # the last step leads to the next window
        intervals.append(np.einsum("ij,ij->i", windows, windows))
        if len(part.steps) - count * length == length - 1:
            intervals.append(np.square(part.steps[count * length :]).sum(keepdims=True))
    noise = np.concatenate(intervals)
    if len(noise) < 4:
        return 0
    count = int(np.count_nonzero(noise < QUIET_SHARE * float(np.quantile(noise, 0.75))))
    return count * length if count >= 2 and count < 0.75 * len(noise) else 0


def _scatter(parts: Sequence[Steps]) -> float:
    """Standard deviation of the white noise, from neighbouring samples that differ."""
    some = np.concatenate([part.steps[: 2 * MAX_RESOLUTION_SAMPLES] for part in parts])
    changed = some[some != 0][:MAX_RESOLUTION_SAMPLES]
    # with all steps for a coarse resolution, of which most are 0; with those that differ if samples are repeated
    fine = len(np.unique(np.abs(changed))) > 50
    count = sum(len(part.steps) - (part.equal if fine else 0) for part in parts)
    return math.sqrt(sum(part.squares for part in parts) / count / 2) if count else 0.0


def _spikes(parts: Sequence[Steps], unit: str) -> list[Fault]:
    large = LARGE_STEP_SIGMAS * _scatter(parts)
    if all(max(part.steps.max(), -part.steps.min()) <= large for part in parts):
        return []
    heights = [part.values[at] - around for part in parts for at, around in [spikes_in(part.values)]]
    sizes = np.abs(np.concatenate(heights))
    n, squares = sum(len(part.values) for part in parts), float(np.square(sizes).sum())
    variance = sum(part.squares for part in parts) / n / 2  # of white noise, with the spikes: two steps each
    excess = n * (variance - min(noise_level(part.steps) for part in parts) ** 2)
    if squares <= max(MAX_SPIKE_SHARE * n * variance, MIN_EXCESS_SHARE * excess):
        return []
    words = f"Spikes: {counted(len(sizes), 'single sample')} of up to {_with(float(sizes.max()), unit, 3)}"
    hint = "Look for bit errors of the link, or for a converter near its limit, and record again."
    return [("spikes", f"{words} stand out of the noise.", hint)]


def _clipped(parts: Sequence[Floats], unit: str, times: int) -> list[Fault]:
    """Clipped samples, at an extreme that is reached at least so many times."""
    n = sum(map(len, parts))
    extremes = max(float(part.max()) for part in parts), min(float(part.min()) for part in parts)
    for extreme, word in zip(extremes, ("highest", "lowest"), strict=True):
        count = sum(int(np.count_nonzero(part == extreme)) for part in parts)
        if count < max(MIN_CLIPPED_SAMPLES, MIN_CLIPPED_SHARE * n):
            continue
        begins = (np.diff(part == extreme, prepend=False) & (part == extreme) for part in parts)
        if times > 1 and sum(int(np.count_nonzero(one)) for one in begins) < times:
            continue
        rest = np.concatenate([part[part != extreme] for part in parts])
        if not len(rest):
            return []
        beside = float(rest.max() if word == "highest" else rest.min())
        if count > 2 * int(np.count_nonzero(rest == beside)):
            words = f"Clipped: {counted(count, 'sample')} are at the {word} value, {_with(extreme, unit)}."
            return [("clipped", words, "Set a larger range of the sensor, or remove what drives it to its limit.")]
    return []
