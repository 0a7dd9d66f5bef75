"""Sampling of a signal: rate, gaps and jitter, and its runs, the stretches without a gap.

Spectra and Allan deviations need evenly spaced samples. Nothing is resampled for them: a run is taken as evenly
spaced, and the result states how far its sample times are from that.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.plural import counted
from imuscope.protocols.schema.units import rounded
from imuscope.recordings.columns.breaks import gaps_in
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.signals.signals import Signal

MAX_JITTER_STEPS = 0.1  # of a step: larger jitter is noted
MAX_MEDIAN_STEPS, MEDIAN_STRETCHES = 1 << 18, 64  # steps for a median, from so many stretches


@dataclass(frozen=True, slots=True)
class Sampling:
    """Sampling of one signal.

    Attributes:
        rate: of the samples within runs, Hz.
        runs: slices of the signal without a gap, in order; none is empty.
        gaps: number of gaps.
        missing: time within the gaps beyond one step each, s.
        jitter: standard deviation of the steps within runs, s.
        clock_steps: number of steps of the device's clock, each of which ends a run as well.
    """

    rate: float
    runs: Sequence[slice]
    gaps: int
    missing: float
    jitter: float
    clock_steps: int = 0

    @property
    def longest(self) -> int:
        """Number of samples of the longest run."""
        return max(int(run.stop - run.start) for run in self.runs)

    def notes(self) -> list[str]:
        """Sentences for a user who has to trust a result that assumes even spacing."""
        remarks = []
        if self.clock_steps:
            remarks.append(f"{counted(self.clock_steps, 'step')} of the clock: nothing is computed across one.")
        if self.gaps:
            remarks.append(
                f"{counted(self.gaps, 'gap')}, {rounded(self.missing)} s in sum: nothing is computed across a gap."
            )
        if self.jitter > MAX_JITTER_STEPS / self.rate:
            percent = 100 * self.jitter * self.rate
            remarks.append(f"The sample times have a jitter of {percent:.0f} % of a step; even spacing is assumed.")
        return remarks


def sampling_of(signal: Signal, least: int) -> Sampling:
    """Sampling of a signal.

    Args:
        least: number of samples that the analysis needs at least.

    Raises:
        DomainError: "no-result": too few samples, or all at the same time.
    """
    n = len(signal.time)
    if n < least:
        hint = f"Request a longer range; at least {least} samples are needed."
        raise DomainError("no-result", f"{signal.name} has only {counted(n, 'sample')} in that range.", hint)
    steps = np.diff(signal.time)
    if not np.median(_stretches(steps)) > 0:
        hint = "Use the time of the device instead of arrival."
        raise DomainError("no-result", f"Most samples of {signal.name} share the time of another one.", hint)
    begins = signal.begins
    at = np.setdiff1d(gaps_in(signal.time), begins, assume_unique=True)
    edges = sorted({0, *at.tolist(), *begins.tolist(), n})
    within = np.delete(steps, np.concatenate((at, begins)) - 1) if len(edges) > 2 else steps
    mean = float(within.mean())
    return Sampling(
        rate=1 / mean,
        runs=[slice(begin, end) for begin, end in itertools.pairwise(edges)],
        gaps=len(at),
        missing=float(steps[at - 1].sum() - len(at) * mean),
        jitter=float(within.std()),
        clock_steps=len(begins),
    )


def _stretches(steps: Floats) -> Floats:
    """Steps of stretches all over the signal, enough for their median; stretches, as steps may come in patterns."""
    length = MAX_MEDIAN_STEPS // MEDIAN_STRETCHES
    if len(steps) <= 2 * MAX_MEDIAN_STEPS:
        return steps
    begins = np.linspace(0, len(steps) - length, MEDIAN_STRETCHES).astype(np.int64)
    return np.concatenate([steps[begin : begin + length] for begin in begins.tolist()])


def unwrapped(signal: Signal) -> Floats:
    """Values of the signal; those of an angle that wraps are continued beyond its period."""
    return np.unwrap(signal.values, period=signal.period) if signal.period else signal.values
