"""Offset in time between two recordings of one motion, by cross-correlation, and how uncertain it is.

    search    normalised cross-correlation of both on one grid, at all offsets with enough overlap (by FFT). Samples in
              gaps have no weight. The best offset must stand out of what unrelated signals of these spectra reach by
              chance.
    refine    Gauss-Newton steps between the points of the grid, on both signals smoothed alike. Of several widths of
              the smoothing, the one with the least uncertainty is used: it passes the motion and holds back the noise.

At the best offset the residual r = a − c − g b is uncorrelated with the derivative b'. The uncertainty follows from
what the sum of r b' is by chance,

    Var(offset) = g² Σ_f P_r(f) |B'(f)|² / (g Σ a' b')²

with the density P_r of the residual from the data (Welch), so that coloured noise counts as what it is; it is enlarged
if the residual is larger where the signals move. The noise of both sides is in r, and cancels in Σ a' b'. Where both
halves of the overlap have offsets of their own, the clocks drift apart, and the interval reaches to those at its ends.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.signals.sampling import sampling_of, unwrapped
from imuscope.server.extensions.analysis.signals.signals import Signal

MAX_GRID = 1 << 17  # points of a grid; an hour has a step of 27 ms then
MIN_POINTS = 32  # of the overlap
MIN_SHARE = 0.25  # of the shorter signal that has to overlap
MAX_STEPS = 12  # of the refinement
INTERVAL_SIGMAS = 2.2  # standard deviations: 1.96 for 95 %, and what choosing among the smoothings conceals
CHANCE_SIGMAS = 1.0  # standard deviations above the largest value that is expected by chance
ALIKE_CORRELATION, ALIKE_PART = 0.97, 0.6  # signals resemble each other over this part of the shorter one
MIN_PEAK_WIDTHS = 10  # widths of the maximum among the other offsets, for a spread of theirs
SPREAD_FACTOR = 1.2  # times the spread at other offsets: they are not quite independent
DISTINCT_SIGMAS = 2.8  # standard deviations between two maxima of which the lower one is excluded
MIN_SLOPE_SIGMAS = 5.0  # standard deviations of Σ a' b' below which it determines no offset
MAX_UNCERTAINTY_RATIO = 3.0  # times the least uncertainty: wider smoothing is not tried
MAX_OTHERS = 5
DRIFT_SIGMAS = 5.0  # between the offsets of both halves


@dataclass(frozen=True, slots=True)
class TimeAlignment:
    """An offset in time between two sides A and B.

    Attributes:
        offset: s to add to the times of B.
        uncertainty: half of its 95 % interval, s.
        correlation: of the overlapping parts at this offset, -1 to 1.
        overlap: length of these parts, s.
        others: offsets that fit nearly as well, s, the best one first: of a periodic motion.
        drift: of the clock of B against that of A, s per s; 0 if there is none for sure.
    """

    offset: float
    uncertainty: float
    correlation: float
    overlap: float
    others: tuple[float, ...] = ()
    drift: float = 0.0

    @property
    def notes(self) -> list[str]:
        """Sentences for a user."""
        words = []
        if self.others:
            distances = ", ".join(f"{other - self.offset:+.4g} s" for other in self.others)
            words.append(f"The motion repeats itself: offsets at a distance of {distances} fit nearly as well.")
        if self.drift:
            change = f"{1e6 * self.drift:+.3g} ppm, {self.drift * self.overlap:+.3g} s from begin to end"
            words.append(
                f"The offset changes by {change}: the clocks differ in rate. The offset is that of the middle."
            )
        return words


@dataclass(frozen=True, slots=True)
class _Samples:
    """Samples of one signal: times, unwrapped values, and ends (first, last time) of its runs without a gap."""

    time: Floats
    values: Floats
    runs: Floats


@dataclass(frozen=True, slots=True)
class _Grid:
    """A signal at even times; `weight` 0 where it has a gap."""

    begin: float
    step: float
    values: Floats
    weight: Floats


def align(pairs: Sequence[tuple[Signal, Signal]], low: float = -math.inf, high: float = math.inf) -> TimeAlignment:
    """The offset at which signals of B fit those of A best; all pairs have the same offset.

    Args:
        pairs: a signal of A and the one of B that measures the same, in the same unit if there are several pairs.
        low, high: offsets that are searched, s.

    Raises:
        DomainError: "no-result": the signals do not determine an offset.
    """
    step = _step_of(pairs)
    samples = [(_samples(a, step), _samples(b, step)) for a, b in pairs]
    begins = [min(float(pair[side].time[0]) for pair in samples) for side in (0, 1)]
    grids = [(_grid(a, begins[0], step), _grid(b, begins[1], step)) for a, b in samples]
    origin = begins[0] - begins[1]
    lags, correlation, overlap = _correlations(grids)
    offsets = origin + step * lags
    allowed = (offsets >= low - step / 2) & (offsets <= high + step / 2) & np.isfinite(correlation)
    if not allowed.any():
        hint = "Choose ranges that overlap at one of the searched offsets, and signals that move."
        raise DomainError("no-result", "There is no offset at which both have enough samples.", hint)
    score = np.where(allowed, correlation * np.sqrt(overlap), -np.inf)
    best = int(np.argmax(score))
    height = math.atanh(min(float(correlation[best]), 1 - 1e-12))
    lobe = _lobe(correlation, best)
    tried = max(2.0, np.count_nonzero(allowed) / max(lobe, 1))
    independent = _independent(grids, int(lags[best]))
    spread = 1 / math.sqrt(max(independent - 3, 1))
    if correlation[best] >= ALIKE_CORRELATION and overlap[best] >= ALIKE_PART * _shorter(grids):
        spread = min(spread, _spread_elsewhere(np.where(allowed, correlation, np.nan), best))
    needed = spread * (math.sqrt(2 * math.log(tried)) + CHANCE_SIGMAS)
    if height < needed:
        reached = f"with a correlation of {correlation[best]:.3f}, where chance reaches {math.tanh(needed):.3f}"
        message = f"No offset stands out: the best is {offsets[best]:.4g} s, {reached} with so few separate movements."
        hint = "Choose a longer range in which both move, or a signal that does not depend on the mounting: norm(…)."
        raise DomainError("no-result", message, hint)
    offset, sigma, width = _refined(samples, grids[0][0], float(offsets[best]))
    seconds = float(overlap[best]) / len(pairs) * step
    drift = _drift(samples, grids[0][0], offset, width) / seconds
    others = _others(np.where(allowed, correlation, -1.0), best, height - DISTINCT_SIGMAS * spread)
    return TimeAlignment(
        offset,
        INTERVAL_SIGMAS * sigma + abs(drift) * seconds / 2,
        float(correlation[best]),
        seconds,
        tuple(offset + float(step * (one - best)) for one in others),
        drift,
    )


def _step_of(pairs: Iterable[tuple[Signal, Signal]]) -> float:
    """The step of the grids, s: the shortest of the samples, as far as the longest signal fits."""
    every = [one for pair in pairs for one in pair]
    longest = max(float(one.time[-1] - one.time[0]) for one in every if len(one.time))
    return max(min(1 / sampling_of(one, MIN_POINTS).rate for one in every), longest / MAX_GRID)


def _samples(signal: Signal, step: float) -> _Samples:
    """The samples; where several share a step, their means."""
    sampling = sampling_of(signal, MIN_POINTS)
    time, values = signal.time, unwrapped(signal)
    runs = np.array([(time[run.start], time[run.stop - 1]) for run in sampling.runs])
    if step * sampling.rate > 1.5:
        places = ((time - time[0]) / step).astype(np.int64)
        firsts = np.flatnonzero(np.diff(places, prepend=-1))
        counts = np.diff(firsts, append=len(time))
        begin = time[0]
        time, values = begin + np.add.reduceat(time - begin, firsts) / counts, np.add.reduceat(values, firsts) / counts
    return _Samples(time, values, runs)


def _grid(signal: _Samples, begin: float, step: float) -> _Grid:
    """The signal without its linear trend at begin + k step."""
    last = float(signal.time[-1])
    n = int((last - begin) / step + 1e-6) + 1
    times = begin + step * np.arange(n, dtype=np.float64)
    values, weight = resampled(signal, times, step)
    weighted = weight.sum()
    if weighted:
        x = times - np.dot(times, weight) / weighted
        centred = (values - np.dot(values, weight) / weighted) * weight
        square = float(np.dot(x * weight, x))
        values = centred - (x * weight * (np.dot(x, centred) / square) if square > 0 else 0.0)
    return _Grid(begin, step, values, weight)


def resampled(signal: _Samples, times: Floats, step: float) -> tuple[Floats, Floats]:
    """Values at even times, linear between samples, and weights: 0 in gaps and outside.

    Args:
        times: (n,) s, `step` apart.
    """
    weight = np.zeros(len(times))
    slack = 1e-6 * step
    ends = np.searchsorted(times, signal.runs + np.array([-slack, slack]))
    for lo, hi in ends.tolist():
        weight[lo:hi] = 1.0
    return np.interp(times, signal.time, signal.values) * weight, weight


def _correlations(grids: Sequence[tuple[_Grid, _Grid]]) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Lags of B in steps, the normalised correlation at each (NaN: too little overlap), and the pairs of samples."""
    from scipy.fft import irfft, next_fast_len, rfft

    a_length, b_length = (max(len(pair[side].values) for pair in grids) for side in (0, 1))
    size = next_fast_len(a_length + b_length, real=True)
    lags = np.arange(-(b_length - 1), a_length, dtype=np.int64)
    products, power_a, power_b, overlap, least = (np.zeros(len(lags)) for _ in range(5))
    for a, b in grids:
        first = [rfft(part, size) for part in (a.values, np.square(a.values), a.weight)]
        second = [np.conj(rfft(part, size)) for part in (b.values, np.square(b.values), b.weight)]

        def at_lags(one: Floats, other: Floats) -> Floats:
            products: Floats = irfft(one * other, size)
            return np.roll(products, b_length - 1)[: len(lags)]

        n = np.round(at_lags(first[2], second[2]))
        divisor = np.maximum(n, 1)
        sum_a, sum_b = at_lags(first[0], second[2]), at_lags(first[2], second[0])
        products += at_lags(first[0], second[0]) - sum_a * sum_b / divisor
        power_a += np.maximum(at_lags(first[1], second[2]) - np.square(sum_a) / divisor, 0)
        power_b += np.maximum(at_lags(first[2], second[1]) - np.square(sum_b) / divisor, 0)
        overlap += n
        least += max(MIN_POINTS, MIN_SHARE * min(a.weight.sum(), b.weight.sum()))
    # rounding leaves a rest where a side is constant
    floors = [1e-9 * sum(float(np.square(pair[side].values).sum()) for pair in grids) for side in (0, 1)]
    valid = (overlap >= least) & (power_a > floors[0]) & (power_b > floors[1])
    correlation = np.full(len(lags), np.nan)
    correlation[valid] = products[valid] / np.sqrt(power_a[valid] * power_b[valid])
    return lags, correlation.clip(-1, 1), overlap


def _independent(grids: Sequence[tuple[_Grid, _Grid]], lag: int) -> float:
    """Effective number of independent pairs of samples at a lag: autocorrelation makes it less than their number."""
    total = 0.0
    for a, b in grids:
        begin, end = max(lag, 0), min(len(a.values), lag + len(b.values))
        x, y = a.values[begin:end], b.values[begin - lag : end - lag]
        size = _even_fast_length(2 * len(x))
        powers = [_power(one - one.mean(), size) for one in (x, y)]
        both = 2 * float(np.dot(powers[0], powers[1]))
        if both > 0:
            total += len(x) * float(powers[0].sum()) * float(powers[1].sum()) * 4 / both / size
    return total / len(grids)


def _power(values: Floats, size: int) -> Floats:
    """Squared magnitudes of the transform of values that are followed by zeros, `size` in all."""
    from scipy.fft import rfft

    power: Floats = np.square(np.abs(rfft(values, size)))
    return power


def _even_fast_length(least: int) -> int:
    """Length of a transform: with a large prime factor it would take several times as long."""
    from scipy.fft import next_fast_len

    return 2 * int(next_fast_len((least + 1) // 2, real=True))


def _lobe(correlation: Floats, best: int) -> int:
    """Steps from the maximum to where less than half of it is left."""
    low = np.flatnonzero(~(correlation[best:] > correlation[best] / 2))
    return int(low[0]) if len(low) else len(correlation) - best


def _shorter(grids: Sequence[tuple[_Grid, _Grid]]) -> float:
    """Samples of the shorter side of each pair, in sum."""
    return float(sum(min(a.weight.sum(), b.weight.sum()) for a, b in grids))


def _spread_elsewhere(correlation: Floats, best: int) -> float:
    """Spread that the correlation has by chance, from the other offsets; infinite if they are too few.

    It is in the measure of atanh. That of the independent samples at the best offset is far too large for slow signals
    that agree there: their spectra agree as well.
    """
    lobe = _lobe(correlation, best)
    others = np.concatenate([correlation[: max(0, best - 2 * lobe)], correlation[best + 2 * lobe :]])
    others = others[np.isfinite(others)]
    if len(others) < MIN_PEAK_WIDTHS * lobe:
        return math.inf
    heights = np.arctanh(np.clip(others, -1 + 1e-12, 1 - 1e-12))
    return SPREAD_FACTOR * math.sqrt(float(np.square(heights).mean()))


def _others(correlation: Floats, best: int, least: float) -> list[int]:
    """Further local maxima whose height is at least `least`, the highest first."""
    limit = math.tanh(least)
    inner = correlation[1:-1]
    peaks = np.flatnonzero((inner >= correlation[:-2]) & (inner > correlation[2:]) & (inner >= limit)) + 1
    lags: list[int] = []
    width = _lobe(correlation, best)
    for peak in peaks[np.argsort(-correlation[peaks], kind="stable")]:
        if all(abs(int(peak) - one) > width for one in (best, *lags)):
            lags.append(int(peak))
        if len(lags) == MAX_OTHERS:
            break
    return lags


def _drift(pairs: Sequence[tuple[_Samples, _Samples]], grid: _Grid, offset: float, width: float) -> float:
    """Change of the offset over the overlap, s, from those of its halves; 0 if it can be by chance."""
    times = grid.begin + grid.step * np.arange(len(grid.values), dtype=np.float64)
    begin = max(times[0], max(b.time[0] for _, b in pairs) + offset)
    middle = (begin + min(times[-1], min(b.time[-1] for _, b in pairs) + offset)) / 2
    halves = [_step(pairs, some, grid.step, offset, width) for some in (times[times < middle], times[times >= middle])]
    if halves[0] is None or halves[1] is None:
        return 0.0
    change, sigma = halves[1][0] - halves[0][0], math.hypot(halves[0][1], halves[1][1])
    return 2 * change if abs(change) > DRIFT_SIGMAS * sigma else 0.0


def _refined(pairs: Sequence[tuple[_Samples, _Samples]], grid: _Grid, offset: float) -> tuple[float, float, float]:
    """Offset between the points of the grid, its standard deviation, and the smoothing that determines it best."""
    best = (offset, math.inf, 0.0)
    n, step = len(grid.values), grid.step
    times = grid.begin + step * np.arange(n, dtype=np.float64)
    width = 0.0
    while width <= max(n / 40, 1):
        estimate = _newton(pairs, times, step, offset, width)
        if estimate is not None and estimate[1] < best[1]:
            best = (*estimate, width)
        elif estimate is not None and estimate[1] > MAX_UNCERTAINTY_RATIO * best[1]:
            break
        width = 2 * width or 1.0
    if not math.isfinite(best[1]):
        hint = "Choose a range with more motion, or set the offset by hand."
        raise DomainError("no-result", "The offset cannot be determined from these signals.", hint)
    return best


def _newton(
    pairs: Sequence[tuple[_Samples, _Samples]], times: Floats, step: float, offset: float, width: float
) -> tuple[float, float] | None:
    """Offset and standard deviation with a smoothing of `width` steps; None if the steps lead away."""
    estimate, first = _step(pairs, times, step, offset, width), offset
    finest = max(1e-9, float(np.spacing(np.abs(times[[0, -1]]).max())))  # no time is more exact than its number
    for _ in range(MAX_STEPS):
        if estimate is None:
            return None
        correction, sigma = estimate
        offset += max(-step, min(step, correction))
        if abs(offset - first) > (2 + width) * step:
            return None
        if abs(correction) < max(1e-3 * sigma, finest):
            break
        estimate = _step(pairs, times, step, offset, width)
    return None if estimate is None else (offset, max(estimate[1], 1e-9))


def _step(
    pairs: Sequence[tuple[_Samples, _Samples]], times: Floats, step: float, offset: float, width: float
) -> tuple[float, float] | None:
    """Correction of the offset, s, and its standard deviation."""
    force, stiffness, variance, doubt = 0.0, 0.0, 0.0, 0.0
    for a, b in pairs:
        x, weight_a = resampled(a, times, step)
        y, weight_b = resampled(b, times - offset, step)
        weight = weight_a * weight_b
        used = np.flatnonzero(weight)
        if len(used) < MIN_POINTS:
            return None
        part = slice(int(used[0]), int(used[-1]) + 1)
        weight = weight[part]
        raw = [_centred(one[part], weight) for one in (x, y)]
        x, y = (_centred(one, weight) for one in _smoothed(raw, weight, width))
        dx, dy = (np.gradient(one, step) * weight for one in (x, y))
        edges = np.flatnonzero(np.diff(weight, prepend=0.0, append=0.0))  # no derivative across them
        for edge in edges:
            dx[max(edge - 1, 0) : edge + 1] = 0
            dy[max(edge - 1, 0) : edge + 1] = 0
        power_x, power_y = float(np.dot(x, x)), float(np.dot(y, y))
        if not (power_x > 0 and power_y > 0):
            continue
        gain = math.sqrt(power_x / power_y)
        residual = x - gain * y
        square = float(np.dot(residual, residual))
        share = gain / max(square, 1e-24 * power_x)
        force += share * float(np.dot(residual, dy))
        stiffness += share * float(np.dot(dx, dy))
        variance += share**2 * _variance(raw[0] - gain * raw[1], residual, dy, weight, width)
        doubt += share**2 * _chance(np.gradient(residual, step) * weight, dy)
    if not stiffness > MIN_SLOPE_SIGMAS * math.sqrt(doubt):  # noise, not motion, would determine the offset
        return None
    return -force / stiffness, math.sqrt(variance) / stiffness


def _chance(x: Floats, y: Floats) -> float:
    """Variance of Σ x y for signals of these spectra that have nothing to do with each other."""
    size = _even_fast_length(2 * len(x))
    power = _power(x, size) * _power(y, size)
    return 2 * float(power.sum()) / size / len(x)


def _smoothed(signals: Sequence[Floats], weight: Floats, width: float) -> Sequence[Floats]:
    """Signals smoothed by a Gaussian of `width` steps; nothing of a gap gets in."""
    if not width:
        return signals
    from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

    size = next_fast_len(len(weight) + int(10 * width), real=True)
    gauss = np.exp(-2 * np.square(np.pi * width * rfftfreq(size)))
    every = np.stack([*(one * weight for one in signals), weight])
    *smooth, share = irfft(rfft(every, size) * gauss, size)[:, : len(weight)]
    return [one / np.maximum(share, 1e-6) for one in smooth]


def _centred(values: Floats, weight: Floats) -> Floats:
    """Values without their mean; 0 where there is no weight."""
    weighted: Floats = (values - np.dot(values, weight) / weight.sum()) * weight
    return weighted


def _variance(raw: Floats, residual: Floats, derivative: Floats, weight: Floats, width: float) -> float:
    """Variance of Σ residual · derivative, for a residual that is independent of the derivative.

    Args:
        raw: the residual before it was smoothed: its density is smoother than that of the smoothed one.
    """
    n = len(raw)
    frequency, density = _density(raw, min(n, max(MIN_POINTS, n // 16)))
    density /= weight.sum() / n  # of the samples that are there
    density[:2] = density[:3].max()  # the mean was taken out, and the gain fitted
    size = _even_fast_length(2 * n)
    power = _power(derivative, size)
    power[1:-1] *= 2
    grid = np.arange(len(power)) / size
    smoothed = np.interp(grid, frequency, density) * np.exp(-4 * np.square(np.pi * width * grid))
    stationary = float(np.dot(power, smoothed)) / size
    there = weight > 0
    even = float(np.square(residual[there]).mean()) * float(np.square(derivative).sum())
    uneven = float(np.dot(np.square(residual), np.square(derivative)))
    return stationary * max(1.0, uneven / even if even > 0 else 1.0)


def _density(values: Floats, length: int) -> tuple[Floats, Floats]:
    """Frequencies in cycles per sample and the two-sided density of values by Welch's method: Hann windows of `length`
    that overlap by half, all transformed at once.
    """
    from scipy.fft import rfft, rfftfreq

    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)
    segments = sliding_window_view(values, length)[:: length - length // 2]
    density: Floats = np.square(np.abs(rfft(segments * window))).mean(axis=0) / float(np.square(window).sum())
    return rfftfreq(length), density
