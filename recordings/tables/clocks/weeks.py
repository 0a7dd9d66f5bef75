"""Clocks of a table that GPS counts: weeks and times of week, and times since 1980."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from imuscope.recordings.tables.clock import Sure, TableClock
from imuscope.recordings.tables.clocks import names
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.dates import GPS_EPOCH, WEEK
from imuscope.recordings.tables.time_units import FACTORS, SPELLINGS, usual_step


def week_clocks(sample: TableSample) -> list[TableClock]:
    """Time of week, beside the GPS week if there is one."""
    by_words = {names.words_of(one.name): column for column, one in enumerate(sample.headings)}
    of_week = [
        (words, column)
        for words, column in by_words.items()
        if _is_of_week(sample, words, column)
        and (len(sample.numbers(column)) or len(sample.form.sample) < names.FEWEST)
    ]
    if not of_week:
        return []
    words, column = of_week[0]
    unit = SPELLINGS.get(sample.options.unit, "") or names.named_unit(sample.headings[column])
    unit = unit or ("ms" if words in ("i_tow", "itow") else "")
    sure: Sure = "known" if unit else "inferred"
    values = sample.numbers(column)
    if not unit:
        largest = float(values.max()) if len(values) else 0.0
        step = usual_step(values) if len(values) > 1 else 0.0
        is_fine = step < 1 or bool((values != np.round(values)).any())
        unit = ("ms", "s")[largest < WEEK and is_fine]
        if largest < WEEK and not (values != np.round(values)).any() and step >= 1:
            units = {one.unit for one in sample.readings(column)}
            unit = units.pop() if len(units) == 1 else ""
    week = next((by_words[one] for one in names.WEEK_NAMES if one in by_words), None)
    name = sample.headings[column].name
    if not unit:
        return [sample.open_clock(column, 2, "week")]
    factor = FACTORS[unit]
    weeks = sample.numbers(week) if week is not None else np.zeros(0)
    if week is None or (len(weeks) and float(weeks.max()) == 0):
        why = "time of week without the week"
        return [TableClock(name, (column,), "number", unit, (factor,), "week", sure, why, rank=3)]
    name = f"{sample.headings[week].name} + {name}"
    why = "GPS week and time of week"
    columns: tuple[int, ...] = (week, column)
    factors: tuple[float, ...] = (WEEK, factor)
    cycle = next((by_words[one] for one in names.CYCLE_NAMES if one in by_words), None)
    zero = 0.0
    if len(weeks) and weeks.max() < names.WEEK_BITS and cycle is not None:
        name = f"{sample.headings[cycle].name} + {name}"
        columns, factors = (cycle, *columns), (names.WEEK_BITS * WEEK, *factors)
    elif len(weeks) and weeks.max() < names.WEEK_BITS:
        newest = (sample.newest - GPS_EPOCH) / WEEK
        zero = float((newest - weeks.max()) // names.WEEK_BITS) * names.WEEK_BITS
        sure, why = "assumed", f"a GPS week of ten bits, of the {zero + names.WEEK_BITS:.0f} weeks before the file"
    zero *= WEEK
    return [TableClock(name, columns, "week", unit, factors, "GPS", sure, why, rank=2, zero_s=zero)]


def _is_of_week(sample: TableSample, words: str, column: int) -> bool:
    values = sample.numbers(column)
    named = (words in names.GPS_TIME or names.without_unit(words) in names.GPS_TIME) and len(values) > 0
    return names.without_unit(words) in names.OF_WEEK or (named and values.min() >= 0 and values.max() < WEEK)


def of_gps(sample: TableSample, clock: TableClock) -> TableClock:
    """The clock, counted from 1980 if its heading names GPS and it is then no later than the file."""
    text = " ".join(sample.headings[column].text.lower() for column in clock.columns)
    if clock.kind != "number" or clock.epoch != "1970" or "gps" not in text or re.search("unix|utc|1970", text):
        return clock
    if sample.options.unit or sample.numbers(clock.columns[0])[0] * clock.factors[0] + GPS_EPOCH > sample.newest:
        return clock
    why = "the heading names GPS, whose times count from 1980"
    return replace(clock, kind="week", epoch="GPS", sure="assumed", why=why)
