"""Choice of the axis among the clocks of a table. Another clock settles a unit that is open, or the user does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imuscope.protocols.registry.families import unit_flag
from imuscope.recordings.tables.clock import AmbiguousTableError, Epoch, TableClock
from imuscope.recordings.tables.clocks.names import FEWEST, is_plain
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.clocks.search import clocks_of
from imuscope.recordings.tables.dates import WEEK
from imuscope.recordings.tables.options import NO_COLUMN
from imuscope.recordings.tables.time_units import CLOSE, UNITS, is_dated, rate_text, usual_step

MOST_NAMED = 4
EVEN = 1.5  # longest of nearly all steps, in shortest ones


def _hint_without_heading(sample: TableSample) -> str:
    """The remedy for a table without names, by what its columns look like."""
    width = len(sample.headings)
    rising = [column for column in range(width) if sample.rises(column)]
    for week in (column - 1 for column in rising):
        numbers, seconds = sample.numbers(week) if week >= 0 else np.zeros(0), sample.numbers(week + 1)
        if len(numbers) and sample.is_gps_week(numbers) and seconds.min() >= 0 and seconds.max() < WEEK:
            names = f'"{week + 1} = week" and "{week + 2} = tow (s)"'
            likeness = f"columns {week + 1} and {week + 2} look like a GPS week and the seconds of it"
            return (
                f"{likeness}. If they are, give --columns FILE, with the lines {names}; else --time-column or --rate."
            )
    if rising:
        columns = ", ".join(str(column + 1) for column in rising[:MOST_NAMED])
        what = f"rising from row to row: column {columns}"
        return f"{what}. If that is the time, give --time-column {rising[0] + 1}; else --rate."
    return "name its sampling rate with --rate, and the columns with --columns."


def axis_of_table(sample: TableSample) -> tuple[TableClock, list[TableClock]]:
    """The clock that is the axis, and the others.

    Raises:
        RecordingError: there is none, or its unit is open.
    """
    clocks = clocks_of(sample)
    if not clocks:
        there = ", ".join(one.text for one in sample.headings)[:300]
        empty = [one.text for place, one in enumerate(sample.headings) if is_plain(one) and not sample.cells(place)]
        if empty:
            hint = f"{empty[0]} is empty in all rows. Give --rate, or another column with --time-column."
        elif sample.form.headings:
            hint = f"Name one time, with its unit: time (s), or give --time-column or --rate. There are: {there}."
        else:
            hint = f"It has no heading either: {_hint_without_heading(sample)}"
        raise AmbiguousTableError(f"{sample.file} has no column of times.", hint, "time")
    axis, *others = clocks
    if axis.is_open:
        axis = _by_another(sample, axis, others) or axis
    if axis.is_open and not sample.options.time_column:
        for one in others:
            if not one.is_open and one.rank <= 3:
                return one, [axis, *(other for other in others if other is not one)]
    if axis.is_open:
        width = () if sample.form.headings else range(len(sample.headings))
        also = [str(one + 1) for one in width if one not in axis.columns and _runs_evenly(sample, one)]
        raise _open_unit(sample.file, axis, f"column {', '.join(also[:MOST_NAMED])}" if also else "")
    if sample.options.rate and axis.kind in ("number", "parts"):
        _check_rate(sample, axis)
    return axis, others


def _runs_evenly(sample: TableSample, column: int) -> bool:
    """Whether the numbers of a column rise in nearly equal steps."""
    steps = np.diff(sample.numbers(column)) if sample.rises(column) else np.zeros(0)
    return len(steps) > 0 and float(np.quantile(steps, 0.9)) < EVEN * float(np.quantile(steps, 0.1))


def _by_another(sample: TableSample, axis: TableClock, others: Sequence[TableClock]) -> TableClock | None:
    """The axis with the unit in which it runs like another clock."""
    values = sample.numbers(axis.columns[0])
    for other in others:
        if other.is_open or other.kind not in ("number", "counter") or len(values) < FEWEST:
            continue
        theirs = sample.numbers(other.columns[0])
        if len(theirs) != len(values) or not np.ptp(values):
            continue
        ratio = float(np.ptp(theirs)) * other.factors[0] / float(np.ptp(values))
        fitting = [unit for unit, factor in UNITS.items() if abs(ratio / factor - 1) < CLOSE]
        if fitting:
            unit = fitting[0]
            epoch: Epoch = "1970" if is_dated(float(values[0]) * UNITS[unit], sample.newest) else "start"
            why = f"so it runs like {other.name}"
            return replace(axis, unit=unit, factors=(UNITS[unit],), epoch=epoch, sure="inferred", why=why, readings=())
    return None


def _open_unit(file: str, axis: TableClock, also: str) -> AmbiguousTableError:
    units = [one.unit for one in axis.readings]
    if not units:
        words = f"{file}: the times in {axis.name} fit no unit."
        hint = f"Name it with {unit_flag()} s, ms, us or ns, or another column with --time-column."
        return AmbiguousTableError(words, hint, "unit", axis)
    listed = " or ".join(one.words() for one in axis.readings)
    flags = " or ".join(f"{unit_flag()} {'us' if unit == 'µs' else unit}" for unit in units)
    hint = f"Name it: {flags}, or --rate, or in the heading: {axis.name} ({units[0]})."
    if also:
        hint += f" Rising from row to row, too: {also}, with --time-column."
    return AmbiguousTableError(f"{file}: the unit of {axis.name} can be {listed}.", hint, "unit", axis)


def _check_rate(sample: TableSample, axis: TableClock) -> None:
    values = sum(
        (sample.numbers(column) * factor for column, factor in zip(axis.columns, axis.factors, strict=True)),
        start=np.zeros(len(sample.numbers(axis.columns[0]))),
    )
    step = usual_step(values) if len(values) > 1 else 0.0
    if step and abs(1 / step - sample.options.rate) > CLOSE * sample.options.rate:
        words = f"{sample.file}: {axis.name} in {axis.unit} has {rate_text(1 / step)}, not {sample.options.rate:g} Hz."
        hint = f"Leave --rate out, or give --time-column {NO_COLUMN} to count the rows instead."
        raise AmbiguousTableError(words, hint, "rate")
