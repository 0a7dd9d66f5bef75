"""Gaps of a series: the rows before which samples are missing, by one rule for analyses, plots and exports.

    steps ──┬── 63 at the end of each block of 1024 rows ──> usual step, its spread ──> longest step of the block
            └── longer than the longest one of its block and of its neighbours ──> a gap

The rate may change within a series, therefore each block has its own usual step, and a step must be too long for both
neighbours as well: the slower half of a change from 200 to 100 Hz has no gaps. web/src/data/line-breaks.ts follows the
same rule for samples as they arrive. Steps of a clock do not count: they come with the events of a device.
"""

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats

GAP_STEPS = 1.5  # one lost sample leaves twice the usual step
GAP_SIGMAS = 6.0  # and jitter leaves no gap
USUAL_SHARE = 0.7  # of the steps: a device that skips every third slot has no gaps
BURST_STEPS, BURST_S = 2.5, 0.05  # a USB adapter delivers every 16 ms, and a busy host sometimes skips one delivery
BLOCK_ROWS, USUAL_STEPS, MIN_STEPS = 1024, 63, 3
BURST_RATIO = 16  # mean to median step from which samples arrive in bursts
SIGMAS_PER_MAD = 1.4826


def gaps_in(time: Floats) -> NDArray[np.int64]:
    """Rows before which samples are missing.

    Args:
        time: (n,) s, non-decreasing; where most samples share the time of another one they arrived in bursts.
    """
    steps = np.diff(time)
    n = len(steps)
    if n < MIN_STEPS:
        return np.empty(0, np.int64)
    ends = np.minimum(np.arange(BLOCK_ROWS, n + BLOCK_ROWS, BLOCK_ROWS), n)
    count = min(USUAL_STEPS, n)
    longest = _longest(steps[ends[:, None] - np.arange(count, 0, -1)])
    around = np.concatenate((longest[:1], longest, longest[-1:]))
    allowed = np.maximum(np.maximum(around[:-2], longest), around[2:])
    least = float(allowed.min())
    at = np.flatnonzero(steps > least)
    return at[steps[at] > allowed[at // BLOCK_ROWS]] + 1


def _longest(steps: Floats) -> Floats:
    """Longest steps without a gap: (blocks,) from (blocks, steps)."""
    count = steps.shape[1]
    steps = np.sort(steps, axis=1)
    median, usual = steps[:, count // 2], steps[:, int(USUAL_SHARE * (count - 1))]
    spread = SIGMAS_PER_MAD * np.sort(np.abs(steps - median[:, None]), axis=1)[:, count // 2]
    mean = steps.mean(axis=1)
    in_bursts = median <= (mean - steps[:, -1] / count) / BURST_RATIO  # one outage does not make a burst
    longest: Floats = np.where(in_bursts, BURST_STEPS * mean + BURST_S, GAP_STEPS * usual + GAP_SIGMAS * spread)
    return longest
