"""Clocks of a table that are numbers in a unit, counters of samples, and the count of its rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from imuscope.recordings.tables.clock import AmbiguousTableError, Epoch, Sure, TableClock
from imuscope.recordings.tables.clocks import names
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.headings import ColumnHeading
from imuscope.recordings.tables.time_units import (
    CLOSE,
    FACTORS,
    FASTEST,
    RECENT,
    SPELLINGS,
    UNITS,
    Floats,
    UnitReading,
    decided,
    is_dated,
    mean_step,
    rate_text,
    usual_step,
)

LONGEST_STEP_S = 1.0  # of two or three numbers with decimals, which are then seconds


def number_clock(sample: TableSample, column: int, rank: int) -> TableClock:
    """A column of numbers, its unit by the options, its heading, or the numbers."""
    heading = sample.headings[column]
    sure: Sure = "stated"
    unit, why = SPELLINGS.get(sample.options.unit, ""), "as chosen"
    if not unit and (unit := names.named_unit(heading)):
        why = "the heading names it"
    if not unit and (heading.name.startswith("%") or heading.name.startswith("field.")):
        unit, sure, why = "ns", "known", "rostopic writes ns"
    if not unit and heading.name.startswith("__"):
        unit, sure, why = "s", "known", "PlotJuggler writes __time in s since 1970"
    if not unit:
        return inferred_clock(sample, column, rank)
    if unit == "d" and (serial := _serial_days(sample, column, rank)) is not None:
        return serial
    factor = FACTORS[unit]
    epoch = "day" if is_of_day(heading) else _epoch(sample, column, factor)
    return TableClock(sample.name(column), (column,), "number", unit, (factor,), epoch, sure, why, rank=rank)


def is_of_day(heading: ColumnHeading) -> bool:
    """Whether a heading says that its numbers are since midnight: ms_of_day, sod."""
    words = names.words_of(heading.name)
    return any(one in names.OF_DAY for one in (words, names.without_unit(words), words.removeprefix("ms_")))


def _epoch(sample: TableSample, column: int, factor: float) -> Epoch:
    values = sample.numbers(column)
    usual = float(np.median(values)) if len(values) else 0.0  # the first may be of before the clock was set
    return "1970" if is_dated(usual * factor, max(sample.newest, 1.9e9)) else "start"


def _serial_days(sample: TableSample, column: int, rank: int) -> TableClock | None:
    """Days since the zero of a program, if they are a date that the file can hold; None if they are not."""
    for name, zero in names.SERIAL_DAYS.items():
        if any(is_dated(float(one) * FACTORS["d"] + zero, sample.newest) for one in sample.numbers(column)[:1]):
            clock = TableClock(sample.name(column), (column,), "number", "d", (FACTORS["d"],), "1970", "inferred", "")
            return replace(clock, why=f"as days of {name}, they are dates", rank=rank, zero_s=zero)
    return None


def _of_another_zero(sample: TableSample, column: int, rank: int) -> TableClock | None:
    """Numbers that are recent dates only by the zero and the unit of one program; None for others."""
    values = sample.numbers(column)
    usual, step = float(np.median(values)), mean_step(values)
    for name, (unit, factor, zero) in names.ZEROS.items():
        date = usual * factor + zero
        is_recent = is_dated(date, sample.newest) and date > sample.newest - RECENT
        if is_recent and step and FACTORS["h"] > step * factor > 1 / FASTEST:
            why = f"as {unit} of {name}, they are dates"
            clock = TableClock(sample.name(column), (column,), "number", unit, (factor,), "1970", "assumed", why)
            return replace(clock, rank=rank, zero_s=zero)
    return None


def inferred_clock(sample: TableSample, column: int, rank: int) -> TableClock:
    values, name = sample.numbers(column), sample.name(column)
    if not len(values):
        why = "there are no numbers"
        return TableClock(name, (column,), "number", "s", (1.0,), "start", "assumed", why, rank=rank)
    readings = sample.readings(column)
    is_date = names.words_of(sample.headings[column].name) in ("date", *names.DAYS)
    if (not readings or is_date) and (serial := _serial_days(sample, column, rank)) is not None:
        usual = float(np.median(values)) * FACTORS["d"] + serial.zero_s
        may_be_seconds = mean_step(values) * FASTEST >= 1 and (sample.is_inertial or usual < sample.newest - RECENT)
        return sample.open_clock(column, rank) if may_be_seconds and not is_date else serial
    if not readings and (counted := _of_another_zero(sample, column, rank)) is not None:
        return counted
    is_running = names.RUNNING.search(names.words_of(sample.headings[column].name)) is not None
    is_odd = is_running and len(readings) > 1  # not to be decided by a date
    chosen = None if is_odd else decided(readings, values, inertial=sample.is_inertial, newest=sample.newest)
    sure: Sure = "inferred"
    by_head = [one for one in readings if sample.rate and abs(one.rate - sample.rate) <= CLOSE * sample.rate]
    if chosen is None and len(by_head) == 1:
        [chosen] = readings = by_head
    if chosen is None and len(values) < names.FEWEST:
        is_usual = bool((values != np.round(values)).any()) and 0 < np.ptp(values) <= LONGEST_STEP_S
        likely = [one for one in readings if (one.dated if len(values) == 1 else is_usual and one.unit == "s")]
        if len(likely) == 1 or len(values) == 1:
            chosen, sure = likely[0] if len(likely) == 1 else UnitReading("s", 0.0, False), "assumed"
    distinct = np.unique(values)
    is_one_jump = len(distinct) == 2 < len(values) and distinct[1] > 1000 * abs(distinct[0]) > 0
    if chosen is None or is_one_jump or names.has_odd_unit(sample.headings[column]):
        return sample.open_clock(column, rank)
    why = _reason(values, chosen, readings)
    epoch: Epoch = "1970" if chosen.dated else "day" if is_of_day(sample.headings[column]) else "start"
    return TableClock(name, (column,), "number", chosen.unit, (chosen.factor,), epoch, sure, why, rank=rank)


def _reason(values: Floats, chosen: UnitReading, readings: Sequence[UnitReading]) -> str:
    if len(readings) > 1 and chosen.dated:
        return "as that the times are dates"
    step = usual_step(values) if len(values) > 1 else 0.0
    if not step:
        return "nothing else is known"
    others: Mapping[str, float] = {unit: 1 / (step * factor) for unit, factor in UNITS.items() if unit != chosen.unit}
    listed = ", ".join(f"{unit} {rate_text(rate)}" for unit, rate in others.items())
    return f"a step of {step:.4g} is {rate_text(chosen.rate)}; it would be in {listed}"


def fine_clock(sample: TableSample, column: int) -> TableClock:
    """SampleTimeFine: its unit depends on the program that wrote the file."""
    if unit := names.named_unit(sample.headings[column]):
        return number_clock(sample, column, 3)
    numbers = sample.numbers(column)
    step = usual_step(numbers) if len(numbers) > 1 else 0.0
    is_dot = {"devicetag", "firmwareversion", "outputrate"} & sample.form.metadata.keys()
    is_mt = {"update rate", "filter profile", "firmware version", "start time"} & sample.form.metadata.keys()
    factor = names.FINE_DOT_S if is_dot else names.FINE_S
    program = "a DOT" if is_dot else "MT Manager"
    unit = "µs" if is_dot else "100 µs"
    sure: Sure = "known"
    why = f"{program} writes SampleTimeFine in {unit}"
    fits = [one for one in (names.FINE_S, names.FINE_DOT_S) if step and 0.9 <= 1 / (step * one) <= 2100]
    is_converted = len(fits) == 1 and factor not in fits  # a table of one program with the head of the other
    if step and (is_converted or not (is_dot or is_mt)):
        if len(fits) != 1:
            return sample.open_clock(column, 3)
        factor, sure = fits[0], "inferred"
        unit = "µs" if factor == names.FINE_DOT_S else "100 µs"
        why = f"in {unit} the samples come at {rate_text(1 / (step * factor))}"
    return TableClock(sample.name(column), (column,), "number", unit, (factor,), "start", sure, why, rank=3)


def counter_clocks(sample: TableSample) -> list[TableClock]:
    why = (
        f"a counter of samples at {sample.rate:g} Hz, by {'--rate' if sample.options.rate else 'the head of the file'}"
    )
    return [
        TableClock(one.name, (column,), "counter", "samples", (1 / sample.rate,), "start", "stated", why, rank=8)
        for column, one in enumerate(sample.headings)
        if sample.rate and names.COUNTERS.match(names.words_of(one.name)) and len(sample.numbers(column))
    ]


def unnamed_clocks(sample: TableSample) -> list[TableClock]:
    """A column of numbers that rise in every row, where no heading names a time: dates, else the first column."""
    rising: dict[int, TableClock] = {}
    for column in range(len(sample.headings)):
        values = sample.numbers(column)
        if len(values) >= max(names.FEWEST, len(sample.form.sample)) and (np.diff(values) >= 0).mean() > names.RISING:
            is_stated = sample.options.unit or sample.headings[column].unit
            one = number_clock(sample, column, 5) if is_stated else inferred_clock(sample, column, 5)
            rising |= {column: one} if one.epoch == "1970" or (np.diff(values) > 0).all() else {}
    clock = next((one for one in rising.values() if one.epoch == "1970"), None)
    if clock is None and rising and sample.form.headings:
        named = (one for i, one in rising.items() if _is_of_time(sample, i))
        clock = next((one for one in named if not one.is_open), None)
    elif clock is None and rising and len(sample.headings) > names.FEWEST:
        clock = rising.get(next(i for i in range(len(sample.headings)) if len(sample.numbers(i))))
    return [] if clock is None else [replace(clock, why=f"it rises from row to row, and {clock.why}")]


def _is_of_time(sample: TableSample, column: int) -> bool:
    """Whether a heading sounds like a time, or has the unit of one: X[s]."""
    heading = sample.headings[column]
    return bool(names.TIMELIKE.search(heading.name.lower())) or heading.unit.strip().lower() in SPELLINGS


def row_clock(sample: TableSample) -> TableClock:
    if not sample.rate:
        raise AmbiguousTableError(f"{sample.file} has no column of times.", "Name its rate: --rate 100.", "rate")
    why = f"--rate {sample.rate:g}" if sample.options.rate else "the head of the file names the rate"
    return TableClock("rows", (), "rows", "samples", (1 / sample.rate,), "start", "stated", why, rank=9)
