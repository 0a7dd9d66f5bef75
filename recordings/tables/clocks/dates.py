"""Clocks of a table that are dates: texts, days beside times of day, year to second, seconds beside nanoseconds."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from imuscope.recordings.tables.cells import leap_seconds
from imuscope.recordings.tables.clock import AmbiguousTableError, Epoch, TableClock
from imuscope.recordings.tables.clocks import names
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.dates import Order, is_duration, is_of_hour, is_time_of_day, order_of, unix_seconds
from imuscope.recordings.tables.time_units import SPELLINGS, UNITS, is_dated


def stamp_clocks(sample: TableSample) -> list[TableClock]:
    """Pairs of seconds and parts of a second: stamp.secs and stamp.nsecs, stamp_sec_imu and stamp_nanosec_imu."""
    by_words = {names.words_of(one.name): column for column, one in enumerate(sample.headings)}
    matches = []
    for words, column in by_words.items():
        for stem, unit, part in _parts_of(words):
            other = by_words.get(part)
            if other is not None and _is_fraction(sample, other, unit):
                name = f"{sample.headings[column].name} + {sample.headings[other].name}"
                seconds = sample.numbers(column)
                epoch: Epoch = "1970" if len(seconds) and is_dated(float(seconds[0]), sample.newest) else "start"
                rank = 1 if "stamp" in stem else 2
                factors, why = (1.0, UNITS[unit]), f"seconds and {unit} in two columns"
                matches.append(TableClock(name, (column, other), "parts", "s", factors, epoch, "known", why, rank=rank))
                break
    return [one for one in matches if sample.advances(one.columns)]


def unnamed_stamps(sample: TableSample) -> list[TableClock]:
    """Two columns without names that are seconds and parts of one, as ros2 topic echo --csv writes a stamp."""
    for column in range(len(sample.headings) - 1):
        seconds, parts = sample.numbers(column), sample.numbers(column + 1)
        rows = len(sample.form.sample)
        if not len(seconds) == len(parts) == rows or rows < names.FEWEST or (np.diff(seconds) < 0).any():
            continue
        is_whole = all(bool((one == np.round(one)).all()) for one in (seconds, parts))
        unit = next((one for one in ("ms", "µs", "ns") if float(parts.max()) * UNITS[one] < 1), "")
        if not is_whole or not unit or parts.min() < 0 or not np.ptp(parts):
            continue
        steps = np.diff(seconds + parts * UNITS[unit])
        wraps = np.diff(parts) < 0
        is_stamp = bool((steps > 0).all()) and bool((np.diff(seconds)[wraps] > 0).all()) and bool(wraps.any())
        if (
            is_stamp
            and float(parts.max()) * UNITS[unit] > 0.5
            and np.quantile(steps, 0.9) < 2 * np.quantile(steps, 0.1)
        ):
            epoch: Epoch = "1970" if is_dated(float(np.median(seconds)), sample.newest) else "start"
            name = f"column {column + 1} + column {column + 2}"
            why = f"they rise together, as seconds and {unit} do"
            factors = (1.0, UNITS[unit])
            return [TableClock(name, (column, column + 1), "parts", "s", factors, epoch, "inferred", why, rank=5)]
    return []


def _parts_of(words: str) -> Iterator[tuple[str, str, str]]:
    """Of a heading in seconds: the words before the unit, the unit of a part, and the heading of that part."""
    parts = words.split("_")
    for place in reversed(range(len(parts))):
        if SPELLINGS.get(parts[place]) == "s":
            for spelling, unit in SPELLINGS.items():
                if unit != "s":
                    yield "_".join(parts[:place]), unit, "_".join((*parts[:place], spelling, *parts[place + 1 :]))


def _is_fraction(sample: TableSample, column: int, unit: str) -> bool:
    values = sample.numbers(column)
    return bool(len(values)) and bool((values >= 0).all()) and float(values.max()) * UNITS[unit] < 1


def date_clocks(sample: TableSample) -> list[TableClock]:
    """A column of dates beside one of times of day."""
    texts = [column for column in range(len(sample.headings)) if sample.is_text(column)]
    clocks = [one for one in texts if all(map(is_time_of_day, sample.cells(one)[: names.FEWEST]))]
    days = [one for one in texts if one not in clocks and ":" not in "".join(sample.cells(one)[: names.FEWEST])]
    if not days or not clocks:
        return []
    date, clock = days[0], clocks[0]
    order = _order(sample, date)
    name = f"{sample.headings[date].name} + {sample.headings[clock].name}"
    zone, words = _named_zone(sample, date)
    why = f"date and time of day in two columns{words}"
    return [TableClock(name, (date, clock), "date+time", "", (1.0,), "1970", "known", why, order, rank=2, zone=zone)]


def part_clocks(sample: TableSample) -> list[TableClock]:
    words = (names.words_of(one.name).removeprefix("utc_") for one in sample.headings)
    by_words = {one.removesuffix("s"): column for column, one in enumerate(words)}  # hours, minutes, seconds
    if not all(part in by_words for part in names.UTC_PARTS[:6]):
        return []
    columns = tuple(by_words[part] for part in names.UTC_PARTS if part in by_words)
    numbers = sample.numbers(columns[0])
    if not len(numbers) or numbers[0] < 1990:  # a receiver without a fix
        return []
    why = "year to second in columns of their own"
    return [TableClock("UTC", columns, "utc", "", (1.0,), "1970", "known", why, rank=4)]


def text_clock(sample: TableSample, column: int, rank: int) -> TableClock:
    name, is_day = sample.name(column), all(map(is_time_of_day, sample.cells(column)[: names.FEWEST]))
    if is_day and all(map(is_of_hour, sample.cells(column))):
        why = "minutes and seconds, without the hour"
        return TableClock(name, (column,), "text", "", (1.0,), "start", "known", why, rank=rank)
    if is_day and all(map(is_duration, sample.cells(column))):
        why = "days and times since the start"
        return TableClock(name, (column,), "text", "", (1.0,), "start", "known", why, rank=rank)
    if is_day:
        return TableClock(name, (column,), "text", "", (1.0,), "day", "known", "times of day", rank=rank)
    order, zone = _order(sample, column), names.ZONE.match(sample.headings[column].unit)
    seconds, words = _named_zone(sample, column)
    why = f"dates and times{words}"
    if zone is not None and not re.search(r"Z$|[+-]\d\d:?\d\d$", sample.cells(column)[0][10:]):
        seconds = float(f"{zone['sign']}1") * (int(zone["hours"]) * 3600 + int(zone["minutes"] or 0) * 60)
        why = f"dates and times, of {zone[0]} by the heading"
    return TableClock(name, (column,), "text", "", (1.0,), "1970", "known", why, order, rank=rank, zone=seconds)


def _named_zone(sample: TableSample, column: int) -> tuple[float, str]:
    """Seconds by which dates under a heading GPST or JST, of RTKLIB, are ahead of UTC, and words on it."""
    words = names.words_of(sample.headings[column].name)
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
