"""Choice between the clocks of one table by their steps: the finest and evenest is that of the sensor, and the axis.

Phone timestamp    |||||||     |||||||     |||||||      of the program that wrote the log: a packet at once
sensor timestamp   | | | | | | | | | | | | | | | |      of the sensor; dated by the other
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.recordings.tables.cells import sample_times
from imuscope.recordings.tables.clock import TableClock
from imuscope.recordings.tables.clocks import names
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.time_units import GAP_STEPS, MIN_MEDIAN_STEPS, RATE_TOLERANCE

MIN_UNEVENNESS = 0.05  # of steps, in mean steps: less is that of any clock
WHOLE = 0.01  # of a count, by which times may differ from whole ones
EVENER = 4.0  # times as even is the clock that becomes the axis instead


def evenest(sample: TableSample, axis: TableClock, others: Sequence[TableClock]) -> tuple[TableClock, list[TableClock]]:
    """The axis, and the other clocks: one of these becomes it that runs as far, but far more evenly. The common
    time of an export stays it.
    """
    for one in () if axis.kind == "rows" or axis.rank <= 1 or sample.is_common(axis) else others:
        is_host = any(names.OF_HOST.match(sample.words(column)) for column in one.columns)
        if one.is_open or one.kind in ("counter", "rows") or is_host or not _is_evener(sample, one, axis):
            continue
        why = f"{one.why}; it is finer and more even than {axis.name}"
        return replace(one, why=why), [axis, *(other for other in others if other is not one)]
    return axis, [*others]


def _is_evener(sample: TableSample, clock: TableClock, axis: TableClock) -> bool:
    rows = sample.form.sample
    fine, coarse = (sample_times(one, rows, sample.form.decimal) for one in (clock, axis))
    known = np.isfinite(fine) & np.isfinite(coarse)
    fine, coarse = np.diff(fine[known]), np.diff(coarse[known])
    if len(fine) < MIN_MEDIAN_STEPS or (fine > 0).mean() < names.MIN_RISING or (fine < 0).any():
        return False
    runs_as_far = abs(fine.sum() - coarse.sum()) <= RATE_TOLERANCE * fine.sum() + np.abs(coarse).max()
    inside = fine <= GAP_STEPS * np.median(fine)
    rough, even = _unevenness(coarse[inside]), _unevenness(fine[inside])
    return bool(runs_as_far) and rough > max(MIN_UNEVENNESS, EVENER * even)


def _unevenness(steps: Floats) -> float:
    """Mean difference of steps from their median, in mean steps."""
    mean = float(steps.mean())
    return float(np.abs(steps - np.median(steps)).mean()) / mean if mean > 0 else 0.0


def offset_between(fine: Floats, coarse: Floats) -> float:
    """Offset of a clock to another, from their times in the same rows, s: that of the row which was stamped soonest
    after its sample, or where the other counts in steps, of the one that began a step last. Clocks that do not run
    alike agree in the first row only.
    """
    known = np.isfinite(fine) & np.isfinite(coarse)
    fine, difference, steps = fine[known], (coarse - fine)[known], np.diff(coarse[known])
    if not len(difference) or abs(np.ptp(difference)) > RATE_TOLERANCE * np.ptp(fine) + np.abs(steps).max(initial=0.0):
        return float(difference[0]) if len(difference) else 0.0
    count = steps[steps > 0].min(initial=np.inf)
    counts = coarse[known] / float(f"{count:.3g}")
    is_counted = np.ptp(difference) < (1 + WHOLE) * count and np.abs(counts - np.round(counts)).max() < WHOLE
    return float(difference.max() if is_counted else difference.min())
