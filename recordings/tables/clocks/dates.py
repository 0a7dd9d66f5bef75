"""Clocks of a table that are dates: texts, days beside times of day, year to second, weeks and seconds of GPS, and
seconds beside parts of them.
"""

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from imuscope.recordings.tables.cells import leap_seconds
from imuscope.recordings.tables.clock import AmbiguousTableError, Sure, TableClock
from imuscope.recordings.tables.clocks import names
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.dates import (
    GPS_EPOCH,
    WEEK_S,
    Order,
    is_duration,
    is_of_hour,
    is_time_of_day,
    order_of,
    unix_seconds,
)
from imuscope.recordings.tables.time_units import FACTORS, SPELLINGS, UNITS, usual_step

OLDEST_YEAR = 1990  # of a receiver: without a fix it writes the year 0, or that of its own zero
MAX_STEP_RATIO = 2.0  # longest of nearly all steps, in shortest ones


def stamp_clocks(sample: TableSample) -> list[TableClock]:
    """Pairs of seconds and parts of a second: stamp.secs and stamp.nsecs, stamp_sec_imu and stamp_nanosec_imu."""
    by_words = sample.by_words()
    matches = []
    for words, column in by_words.items():
        for stem, unit, part in _parts_of(words):
            other = by_words.get(part)
            parts = np.zeros(0) if other is None else sample.numbers(other)
            if other is not None and len(parts) and parts.min() >= 0 and parts.max() * UNITS[unit] < 1:
                seconds = sample.numbers(column)
                epoch = sample.epoch(float(seconds[0]) if len(seconds) else 0.0)
                rank, why = 1 if "stamp" in stem else 2, f"seconds and {unit} in two columns"
                pair, factors = (column, other), (1.0, UNITS[unit])
                matches.append(TableClock(sample.name(*pair), pair, "parts", "s", factors, epoch, why=why, rank=rank))
                break
    return [one for one in matches if sample.advances(one.columns)]


def unnamed_stamps(sample: TableSample) -> list[TableClock]:
    """Two columns without names that are seconds and parts of one, as ros2 topic echo --csv writes a stamp."""
    for column in range(len(sample.headings) - 1):
        seconds, parts = sample.numbers(column), sample.numbers(column + 1)
        rows = len(sample.form.sample)
        if not len(seconds) == len(parts) == rows or rows < names.MIN_ROWS or (np.diff(seconds) < 0).any():
            continue
        is_whole = all(bool((one == np.round(one)).all()) for one in (seconds, parts))
        unit = next((one for one in ("ms", "µs", "ns") if float(parts.max()) * UNITS[one] < 1), "")
        if not is_whole or not unit or parts.min() < 0 or parts.max() * UNITS[unit] <= 0.5:
            continue
        steps, wraps = np.diff(seconds + parts * UNITS[unit]), np.diff(parts) < 0
        rises = bool((steps > 0).all()) and bool((np.diff(seconds)[wraps] > 0).all()) and bool(wraps.any())
        if rises and np.quantile(steps, 0.9) < MAX_STEP_RATIO * np.quantile(steps, 0.1):
            epoch, why = sample.epoch(float(np.median(seconds))), f"they rise together, as seconds and {unit} do"
            pair, factors = (column, column + 1), (1.0, UNITS[unit])
            return [TableClock(sample.name(*pair), pair, "parts", "s", factors, epoch, "inferred", why)]
    return []


def _parts_of(words: str) -> Iterator[tuple[str, str, str]]:
    """Parts of a heading in seconds: the words before the unit, the unit of a part, and the heading of that part."""
    parts = words.split("_")
    for place in reversed(range(len(parts))):
        if SPELLINGS.get(parts[place]) == "s":
            for spelling, unit in SPELLINGS.items():
                if unit != "s":
                    yield "_".join(parts[:place]), unit, "_".join((*parts[:place], spelling, *parts[place + 1 :]))


def date_clocks(sample: TableSample) -> list[TableClock]:
    """A column of dates beside one of times of day."""
    texts = [column for column in range(len(sample.headings)) if sample.is_text(column)]
    clocks = [one for one in texts if all(map(is_time_of_day, sample.cells(one)[: names.MIN_ROWS]))]
    days = [one for one in texts if one not in clocks and ":" not in "".join(sample.cells(one)[: names.MIN_ROWS])]
    if not days or not clocks:
        return []
    pair = days[0], clocks[0]
    zone, words = _named_zone(sample, days[0])
    why, order = f"date and time of day in two columns{words}", _order(sample, days[0])
    return [TableClock(sample.name(*pair), pair, "date+time", why=why, order=order, rank=2, zone=zone)]


def part_clocks(sample: TableSample) -> list[TableClock]:
    """Year to second in columns of their own."""
    by_words = {words.removeprefix("utc_").removesuffix("s"): at for words, at in sample.by_words().items()}
    if not all(part in by_words for part in names.UTC_PARTS[:6]):
        return []
    columns = tuple(by_words[part] for part in names.UTC_PARTS if part in by_words)
    years = sample.numbers(columns[0])
    why = "year to second in columns of their own"
    return [TableClock("UTC", columns, "utc", why=why, rank=4)] if len(years) and years[0] >= OLDEST_YEAR else []


def text_clock(sample: TableSample, column: int, rank: int) -> TableClock:
    clock, cells = TableClock(sample.name(column), (column,), "text", rank=rank), sample.cells(column)
    if all(map(is_time_of_day, cells[: names.MIN_ROWS])):
        if all(map(is_of_hour, cells)):
            return replace(clock, epoch="start", why="minutes and seconds, without the hour")
        if all(map(is_duration, cells)):
            return replace(clock, epoch="start", why="days and times since the start")
        return replace(clock, epoch="day", why="times of day")
    order, zone = _order(sample, column), names.ZONE.match(sample.headings[column].unit)
    seconds, words = _named_zone(sample, column)
    if zone is not None and not re.search(r"Z$|[+-]\d\d:?\d\d$", cells[0][10:]):
        seconds = float(f"{zone['sign']}1") * (int(zone["hours"]) * 3600 + int(zone["minutes"] or 0) * 60)
        words = f", of {zone[0]} by the heading"
    return replace(clock, why=f"dates and times{words}", order=order, zone=seconds)


def _named_zone(sample: TableSample, column: int) -> tuple[float, str]:
    """Seconds by which dates under a heading GPST or JST, of RTKLIB, are ahead of UTC, and words on it."""
    words = sample.words(column)
    if words in names.ZONES:
        return names.ZONES[words], f", of {words.upper()} by the heading"
    at = unix_seconds(sample.cells(column)[0]) if words == "gpst" else None
    return (leap_seconds(at), ", of GPS time by the heading") if at is not None else (0.0, "")


def _order(sample: TableSample, column: int) -> Order:
    if sample.options.date_order is not None:
        return sample.options.date_order
    order, matters = order_of(sample.cells(column), sample.newest)
    if order is None and matters:
        example = sample.cells(column)[0][:30]
        raise AmbiguousTableError(
            f"{sample.file}: {sample.headings[column].text} is {example}, which has the day or the month first.",
            "Name the order: --date-order dmy or --date-order mdy.",
            "order",
        )
    return order or "dmy"


# -- GPS ---------------------------------------------------------------------------------------------------------------


def week_clocks(sample: TableSample) -> list[TableClock]:
    """Time of week, beside the GPS week if there is one."""
    by_words = sample.by_words()
    few = len(sample.form.sample) < names.MIN_ROWS
    of_week = (
        at for words, at in by_words.items() if _is_of_week(sample, words, at) and (few or len(sample.numbers(at)))
    )
    if (column := next(of_week, None)) is None:
        return []
    unit, sure = _unit_of_week(sample, column)
    if not unit:
        return [sample.open_clock(column, 2, "week")]
    week = next((by_words[one] for one in names.WEEK_NAMES if one in by_words), None)
    weeks = sample.numbers(week) if week is not None else np.zeros(0)
    factors: tuple[float, ...] = (FACTORS[unit],)
    if week is None or (len(weeks) and not weeks.max()):
        why = "time of week without the week"
        return [TableClock(sample.name(column), (column,), "number", unit, factors, "week", sure, why, rank=3)]
    columns: tuple[int, ...] = (week, column)
    factors, zero, why = (WEEK_S, *factors), 0.0, "GPS week and time of week"
    cycle = next((by_words[one] for one in names.CYCLE_NAMES if one in by_words), None)
    if len(weeks) and weeks.max() < names.WEEK_BITS and cycle is not None:
        columns, factors = (cycle, *columns), (names.WEEK_BITS * WEEK_S, *factors)
    elif len(weeks) and weeks.max() < names.WEEK_BITS:
        newest = (sample.newest - GPS_EPOCH) / WEEK_S
        zero = float((newest - weeks.max()) // names.WEEK_BITS) * names.WEEK_BITS
        sure, why = "assumed", f"a GPS week of ten bits, of the {zero + names.WEEK_BITS:.0f} weeks before the file"
    name = sample.name(*columns)
    return [TableClock(name, columns, "week", unit, factors, "GPS", sure, why, rank=2, zero_s=zero * WEEK_S)]


def _is_of_week(sample: TableSample, words: str, column: int) -> bool:
    stem = names.without_unit(words)
    values = sample.numbers(column) if {words, stem} & {*names.GPS_TIME} else np.zeros(0)
    return stem in names.OF_WEEK or (len(values) > 0 and values.min() >= 0 and values.max() < WEEK_S)


def _unit_of_week(sample: TableSample, column: int) -> tuple[str, Sure]:
    """Unit of a time of week, "" if it is open, by the options, its heading, its name, or its numbers."""
    unit = SPELLINGS.get(sample.options.unit, "") or names.named_unit(sample.headings[column])
    unit = unit or ("ms" if sample.words(column) in ("i_tow", "itow") else "")
    if unit:
        return unit, "known"
    values = sample.numbers(column)
    if len(values) and values.max() >= WEEK_S:
        return "ms", "inferred"
    if (len(values) > 1 and usual_step(values) >= 1) and not (values != np.round(values)).any():
        units = {one.unit for one in sample.readings(column)}
        return units.pop() if len(units) == 1 else "", "inferred"
    return "s", "inferred"


def of_gps(sample: TableSample, clock: TableClock) -> TableClock:
    """The clock, counted from 1980 if its heading names GPS and it is then no later than the file."""
    text = " ".join(sample.headings[column].text.lower() for column in clock.columns)
    if clock.kind != "number" or clock.epoch != "1970" or "gps" not in text or re.search("unix|utc|1970", text):
        return clock
    if sample.options.unit or sample.numbers(clock.columns[0])[0] * clock.factors[0] + GPS_EPOCH > sample.newest:
        return clock
    why = "the heading names GPS, whose times count from 1980"
    return replace(clock, kind="week", epoch="GPS", sure="assumed", why=why)
