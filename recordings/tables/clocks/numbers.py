"""Clocks of a table that are numbers in a unit, counters of samples, and the count of its rows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.recordings.tables.clock import AmbiguousTableError, Epoch, Sure, TableClock
from imuscope.recordings.tables.clocks import names
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.headings import ColumnHeading
from imuscope.recordings.tables.time_units import (
    FACTORS,
    MAX_HZ,
    RATE_TOLERANCE,
    RECENT_S,
    SPELLINGS,
    UNITS,
    UnitReading,
    decided,
    is_dated,
    mean_step,
    rate_text,
    usual_step,
)

LATEST_UNIX_S = 1.9e9  # 2030: a copy of a file may be dated before its samples
LONGEST_STEP_S = 1.0  # of two or three numbers with decimals, which are then seconds


def number_clock(sample: TableSample, column: int, rank: int) -> TableClock:
    """A column of numbers, its unit by the options, its heading, or the numbers."""
    heading = sample.headings[column]
    sure: Sure = "stated"
    scale, _ = sample.form.scale(heading.name)
    if scale != 1.0 and not sample.options.unit:
        why = f"the head of the file names {scale:g} s as the unit of {heading.name}"
        return TableClock(
            sample.name(column), (column,), "number", f"{scale:g} s", (scale,), "start", sure, why, rank=rank
        )
    if unit := SPELLINGS.get(sample.options.unit, ""):
        why = "as chosen"
    elif unit := names.named_unit(heading):
        why = "the heading names it"
    elif heading.name.startswith(("%", "field.")):
        unit, sure, why = "ns", "known", "rostopic writes ns"
    elif heading.name.startswith("__"):
        unit, sure, why = "s", "known", "PlotJuggler writes __time in s since 1970"
    else:
        return inferred_clock(sample, column, rank)
    if unit == "d" and (serial := _serial_days(sample, column, rank)) is not None:
        return serial
    factor, values = FACTORS[unit], sample.numbers(column)
    usual = float(np.median(values)) if len(values) else 0.0  # not the first: the clock may be set later
    is_date = is_dated(usual * factor, max(sample.newest, LATEST_UNIX_S))
    epoch: Epoch = "day" if is_of_day(heading) else "1970" if is_date else "start"
    return TableClock(sample.name(column), (column,), "number", unit, (factor,), epoch, sure, why, rank=rank)


def is_of_day(heading: ColumnHeading) -> bool:
    """Whether a heading says that its numbers are since midnight: ms_of_day, sod."""
    words = names.words_of(heading.name)
    return any(one in names.OF_DAY for one in (words, names.without_unit(words), words.removeprefix("ms_")))


def _serial_days(sample: TableSample, column: int, rank: int) -> TableClock | None:
    """Days since the zero of a program, if they are a date that the file can hold; None if they are not."""
    for name, zero in names.SERIAL_DAYS.items():
        if any(is_dated(float(one) * FACTORS["d"] + zero, sample.newest) for one in sample.numbers(column)[:1]):
            why, factors = f"as days of {name}, they are dates", (FACTORS["d"],)
            clock = TableClock(sample.name(column), (column,), "number", "d", factors, "1970", "inferred", why)
            return replace(clock, rank=rank, zero_s=zero)
    return None


def _of_another_zero(sample: TableSample, column: int, rank: int) -> TableClock | None:
    """Numbers that are recent dates only by the zero and the unit of one program; None for others."""
    values = sample.numbers(column)
    usual, step = float(np.median(values)), mean_step(values)
    for name, (unit, factor, zero) in names.ZEROS.items():
        date = usual * factor + zero
        is_recent = is_dated(date, sample.newest) and date > sample.newest - RECENT_S
        if is_recent and step and FACTORS["h"] > step * factor > 1 / MAX_HZ:
            why = f"as {unit} of {name}, they are dates"
            clock = TableClock(sample.name(column), (column,), "number", unit, (factor,), "1970", "assumed", why)
            return replace(clock, rank=rank, zero_s=zero)
    return None


def inferred_clock(sample: TableSample, column: int, rank: int) -> TableClock:
    """A column of numbers, its unit by the numbers themselves; open if more than one remains."""
    values, heading = sample.numbers(column), sample.headings[column]
    clock = TableClock(sample.name(column), (column,), "number", "s", (1.0,), "start", "assumed", rank=rank)
    if not len(values):
        return replace(clock, why="there are no numbers")
    readings = sample.readings(column)
    is_date = sample.words(column) in ("date", *names.DAYS)
    if (not readings or is_date) and (serial := _serial_days(sample, column, rank)) is not None:
        usual = float(np.median(values)) * FACTORS["d"] + serial.zero_s
        may_be_seconds = mean_step(values) * MAX_HZ >= 1 and (sample.is_inertial or usual < sample.newest - RECENT_S)
        return sample.open_clock(column, rank) if may_be_seconds and not is_date else serial
    if not readings and (counted := _of_another_zero(sample, column, rank)) is not None:
        return counted
    is_odd = names.RUNNING.search(sample.words(column)) is not None and len(readings) > 1  # no date decides it
    chosen = None if is_odd else decided(readings, values, inertial=sample.is_inertial, newest=sample.newest)
    sure: Sure = "inferred"
    by_head = [one for one in readings if sample.rate and abs(one.rate - sample.rate) <= RATE_TOLERANCE * sample.rate]
    if chosen is None and len(by_head) == 1:
        [chosen] = readings = by_head
    if chosen is None and len(values) < names.MIN_ROWS:
        is_usual = bool((values != np.round(values)).any()) and 0 < np.ptp(values) <= LONGEST_STEP_S
        likely = [one for one in readings if (one.dated if len(values) == 1 else is_usual and one.unit == "s")]
        if len(likely) == 1 or len(values) == 1:
            chosen, sure = likely[0] if len(likely) == 1 else UnitReading("s", 0.0, False), "assumed"
    distinct = np.unique(values)
    is_one_jump = len(distinct) == 2 < len(values) and distinct[1] > 1000 * abs(distinct[0]) > 0
    if chosen is None or is_one_jump or names.has_odd_unit(heading):
        return sample.open_clock(column, rank)
    epoch: Epoch = "1970" if chosen.dated else "day" if is_of_day(heading) else "start"
    why = _reason(values, chosen, readings)
    return replace(clock, unit=chosen.unit, factors=(chosen.factor,), epoch=epoch, sure=sure, why=why)


def _reason(values: Floats, chosen: UnitReading, readings: Sequence[UnitReading]) -> str:
    if len(readings) > 1 and chosen.dated:
        return "as that the times are dates"
    step = usual_step(values)
    if not step:
        return "nothing else is known"
    others = [f"{unit} {rate_text(1 / (step * factor))}" for unit, factor in UNITS.items() if unit != chosen.unit]
    return f"a step of {step:.4g} is {rate_text(chosen.rate)}; it would be in {', '.join(others)}"


def fine_clock(sample: TableSample, column: int) -> TableClock:
    """SampleTimeFine: its unit depends on the program that wrote the file."""
    if names.named_unit(sample.headings[column]):
        return number_clock(sample, column, 3)
    step = usual_step(sample.numbers(column))
    is_dot = {"devicetag", "firmwareversion", "outputrate"} & sample.form.metadata.keys()
    is_mt = {"update rate", "filter profile", "firmware version", "start time"} & sample.form.metadata.keys()
    unit, program = ("µs", "a DOT") if is_dot else ("100 µs", "MT Manager")
    sure: Sure = "known"
    why = f"{program} writes SampleTimeFine in {unit}"
    rates = {one: 1 / (step * factor) if step else 0.0 for one, factor in names.FINE_UNITS.items()}
    fits = [one for one, rate in rates.items() if names.FINE_SLOWEST <= rate <= names.FINE_FASTEST]
    is_converted = len(fits) == 1 and unit not in fits  # a table of one program with the head of the other
    if step and (is_converted or not (is_dot or is_mt)):
        if len(fits) != 1:
            return sample.open_clock(column, 3)
        [unit], sure = fits, "inferred"
        why = f"in {unit} the samples come at {rate_text(rates[unit])}"
    factors = (names.FINE_UNITS[unit],)
    return TableClock(sample.name(column), (column,), "number", unit, factors, "start", sure, why, rank=3)


def counter_clocks(sample: TableSample) -> list[TableClock]:
    by = "--rate" if sample.options.rate else "the head of the file"
    why, factors = f"a counter of samples at {sample.rate:g} Hz, by {by}", (1 / sample.rate if sample.rate else 0.0,)
    return [
        TableClock(one.name, (column,), "counter", "samples", factors, "start", "stated", why, rank=8)
        for column, one in enumerate(sample.headings)
        if sample.rate and names.COUNTERS.match(sample.words(column)) and len(sample.numbers(column))
    ]


def unnamed_clocks(sample: TableSample) -> list[TableClock]:
    """A column of numbers that rise in every row, where no heading names a time: dates, else the first column."""
    rising: dict[int, TableClock] = {}
    for column in range(len(sample.headings)):
        values = sample.numbers(column)
        share = (np.diff(values) >= 0).mean() if len(values) >= max(names.MIN_ROWS, len(sample.form.sample)) else 0.0
        if share > names.MIN_RISING:
            is_stated = sample.options.unit or sample.headings[column].unit
            one = number_clock(sample, column, 5) if is_stated else inferred_clock(sample, column, 5)
            rising |= {column: one} if one.epoch == "1970" or (np.diff(values) > 0).all() else {}
    clock = next((one for one in rising.values() if one.epoch == "1970"), None)
    if clock is None and rising and sample.form.headings:
        named = (one for i, one in rising.items() if _is_of_time(sample, i))
        clock = next((one for one in named if not one.is_open), None)
    elif clock is None and rising and len(sample.headings) > names.MIN_ROWS:
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
