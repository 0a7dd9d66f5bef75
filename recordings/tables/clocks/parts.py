"""Parts of a second in a column of their own, beside times in whole seconds; and the digits of a clock.

time                  ms
2026-01-01 10:30:25   990
2026-01-01 10:30:26   0
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imuscope.recordings.tables.cells import times_of
from imuscope.recordings.tables.clock import TableClock
from imuscope.recordings.tables.clocks import names
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.time_units import SPELLINGS, UNITS


def complete_clock(sample: TableSample, clock: TableClock) -> TableClock:
    """A clock with the digits of its numbers, and with the column of its parts of a second."""
    if clock.kind == "number" and len(clock.columns) == 1 and sample.is_hexadecimal(clock.columns[0]):
        return replace(clock, base=16, why=f"{clock.why}; its digits are hexadecimal")
    if clock.kind not in ("text", "date+time", "utc") and (clock.kind, clock.unit) != ("number", "s"):
        return clock
    for column in range(len(sample.headings)):
        unit = _unit_of_part(sample, column)
        if unit and column not in clock.columns and _completes(sample, clock, column, UNITS[unit]):
            name = f"{clock.name} + {sample.headings[column].name}"
            factors = (*clock.factors, UNITS[unit])
            why = f"{clock.why}, with {unit} in a column of their own"
            return replace(
                clock, name=name, columns=(*clock.columns, column), factors=factors, why=why, part=UNITS[unit]
            )
    return clock


def _unit_of_part(sample: TableSample, column: int) -> str:
    """The unit that a heading names by its last word, if it is less than a second; "" if it is not."""
    heading = sample.headings[column]
    words = names.words_of(heading.name).rpartition("_")[2] or heading.unit.strip().lower()
    unit = SPELLINGS.get(words, "") or SPELLINGS.get(heading.unit.strip().lower(), "")
    return unit if unit != "s" else ""


def _completes(sample: TableSample, clock: TableClock, column: int, factor: float) -> bool:
    """Whether times in whole seconds, several of which are equal, rise in every row with these parts."""
    import pyarrow as pa

    rows = sample.form.sample
    parts = sample.numbers(column)
    if len(rows) < names.FEWEST or len(parts) != len(rows) or parts.min() < 0 or parts.max() * factor >= 1:
        return False
    columns = [pa.array([row[one] for row in rows], pa.string()) for one in clock.columns]
    seconds = times_of(clock, columns, sample.form.decimal).values
    if not np.isfinite(seconds).all() or (seconds != np.floor(seconds)).any() or (parts != np.floor(parts)).any():
        return False
    steps = np.diff(seconds)
    is_same = steps == 0
    return bool(is_same.any()) and bool((np.diff(seconds + parts * factor) > 0).mean() > names.RISING)
