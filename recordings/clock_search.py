"""Search for the clocks of a table: columns that hold a time, and the one that becomes its axis.

    heading or form                         clock
    header.stamp, stamp.secs + .nsecs       stamp of a message, before all others
    time, timestamp, t, date, utc, …        with a unit, or read by time_units.py
    %time, field.header.stamp               ROS: ns since 1970;  __time: PlotJuggler, s since 1970
    Date + Time                             two columns of text
    week + timeOfWeek                       GPS week and time of week
    SampleTimeFine                          100 µs (MT Manager), µs (Xsens DOT)
    TimeUS, seconds_elapsed, millis, …      their names say the unit
    UTC_Year … UTC_Nano                     parts of a date
    PacketCounter + a known rate            samples
    --rate alone                            rows

The first row of this list that fits is the axis; within a row, the first column. A unit that is inferred is
reported with the reason; one that remains open is an error that names the options.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imuscope.recordings import table_names as names
from imuscope.recordings.mcap_writer import RecordingError
from imuscope.recordings.table_cells import leap_seconds
from imuscope.recordings.table_clock import AmbiguousTableError, Epoch, Sure, TableClock
from imuscope.recordings.table_dates import (
    Order,
    are_dates,
    are_packed,
    cells_of,
    is_moment,
    is_time_of_day,
    order_of,
    unix_seconds,
)
from imuscope.recordings.table_format import TableFormat, is_number
from imuscope.recordings.table_headings import ColumnHeading
from imuscope.recordings.table_options import NO_COLUMN, TableOptions
from imuscope.recordings.time_units import (
    CLOSE,
    FACTORS,
    SPELLINGS,
    UNITS,
    Floats,
    UnitReading,
    decided,
    is_dated,
    possible_units,
    rate_text,
    usual_step,
)


@dataclass(frozen=True)
class ClockSearch:
    """Search for the clocks of one table.

    Args:
        newest: no sample is later than that, unix s.
        rate: of --rate, else of the head, Hz; 0 if unknown.
    """

    file: str
    form: TableFormat
    headings: Sequence[ColumnHeading]
    options: TableOptions
    newest: float
    rate: float = 0.0

    @property
    def is_inertial(self) -> bool:
        return any(map(names.INERTIAL.search, (self.file, *(one.name for one in self.headings))))

    def numbers(self, column: int) -> Floats:
        """Numbers of a column in the sample."""
        cells = cells_of(self.form.sample, column)
        plain = [cell.replace(",", ".") if self.form.decimal == "," else cell for cell in cells]
        matches = np.array([float(cell) for cell in plain if "," not in cell and is_number(cell)], np.float64)
        return matches[np.isfinite(matches)]

    def cells(self, column: int) -> list[str]:
        """Cells of a column in the sample."""
        return cells_of(self.form.sample, column)

    def is_text(self, column: int) -> bool:
        """Whether the cells of a column are dates or times of day."""
        cells = self.cells(column)
        if len(cells) and all(map(is_number, cells[: names.FEWEST])):
            words = names.words_of(self.headings[column].name)
            if words == "date":  # 140214 is a day, not 14:02:14
                return are_dates(cells)
            named = "utc" in words or any(names.IS_GNSS.match(names.words_of(one.name)) for one in self.headings)
            is_named = not words or any(one.match(words) for one in (names.TIME, names.TIMES))
            return is_named and are_packed(cells, named=named)
        return bool(cells) and sum(map(is_moment, cells)) > len(cells) / 2

    def rises(self, column: int) -> bool:
        """Whether the numbers of a column rise in every row."""
        values = self.numbers(column)
        return len(values) >= max(names.FEWEST, len(self.form.sample)) and bool((np.diff(values) > 0).all())

    def is_gps_week(self, values: Floats) -> bool:
        """Whether numbers can be that of the GPS week: one, or it and the next."""
        weeks = {*values.tolist()}
        newest = (self.newest - names.GPS_EPOCH) / names.WEEK
        return len(weeks) <= 2 and all(one == round(one) and names.FIRST_WEEK <= one <= newest for one in weeks)

    # -- all clocks ----------------------------------------------------------------------------------------------------

    def clocks(self) -> list[TableClock]:
        """All clocks, the best first."""
        options = self.options
        if options.time_column == NO_COLUMN:
            return [self._rows()]
        if options.time_column:
            chosen = self._chosen(self.column_named(options.time_column))
            return [chosen, *self._others(chosen)]
        return self._all()

    def _others(self, chosen: TableClock) -> list[TableClock]:
        """Clocks besides one that was named; none if one of them would need a further option."""
        try:
            return [one for one in self._all() if not {*one.columns} & {*chosen.columns}]
        except RecordingError:
            return []

    def _all(self) -> list[TableClock]:
        """All clocks by form and name, the best first."""
        matches = [*self._stamps(), *self._dates(), *self._weeks(), *self._utc_parts()]
        used = {column for one in matches for column in one.columns}
        left = [column for column in range(len(self.headings)) if column not in used]
        matches += [one for column in left if (one := self._of_name(column)) is not None]
        used |= {column for one in matches for column in one.columns}
        for column in left:
            if column not in used and self.is_text(column) and len(cells := {*self.cells(column)}) > 1:
                matches += [self._text(column, 4)] if order_of(cells, self.newest)[0] or not matches else []
        matches += self._counters()
        matches = matches or self._unnamed()
        if not matches and self.rate:
            matches = [self._rows()]
        return sorted(map(self._of_gps, matches), key=lambda one: (self._stands(one), one.rank, one.columns))

    def _stands(self, clock: TableClock) -> bool:
        """Whether most rows repeat the time of the row before, in a clock of whole seconds."""
        rows = ["\t".join(row[column] for column in clock.columns) for row in self.form.sample]
        is_coarse = clock.unit in ("", "s") and not any(map(names.DECIMALS.search, rows))
        return is_coarse and len(rows) >= names.FEWEST and len(set(rows)) < len(rows) / 2

    def _name(self, column: int) -> str:
        return self.headings[column].name or f"column {column + 1}"

    def _readings(self, column: int) -> list[UnitReading]:
        values, has_decimals = self.numbers(column), any(map(names.DECIMALS.search, self.cells(column)))
        rate = self.options.rate
        return possible_units(values, inertial=self.is_inertial, newest=self.newest, rate=rate, fraction=has_decimals)

    def _open(self, column: int, rank: int, epoch: Epoch = "start") -> TableClock:
        """A clock whose unit is open."""
        readings = tuple(self._readings(column))
        return TableClock(
            self._name(column), (column,), "number", "", (), epoch, "assumed", "", readings=readings, rank=rank
        )

    def _unnamed(self) -> list[TableClock]:
        """A column of numbers that rise in every row, where no heading names a time: dates, else the first column."""
        rising: dict[int, TableClock] = {}
        for column in range(len(self.headings)):
            values = self.numbers(column)
            if len(values) >= max(names.FEWEST, len(self.form.sample)) and (np.diff(values) >= 0).mean() > names.RISING:
                one = self._number(column, 5) if self.options.unit else self._inferred(column, 5)
                rising |= {column: one} if one.epoch == "1970" or (np.diff(values) > 0).all() else {}
        clock = next((one for one in rising.values() if one.epoch == "1970"), None)
        if clock is None and rising and self.form.headings:
            named = (one for i, one in rising.items() if names.TIMELIKE.search(self.headings[i].name.lower()))
            clock = next((one for one in named if not one.is_open), None)
        elif clock is None and rising and len(self.headings) > names.FEWEST:
            clock = rising.get(next(i for i in range(len(self.headings)) if len(self.numbers(i))))
        return [] if clock is None else [replace(clock, why=f"it rises from row to row, and {clock.why}")]

    def column_named(self, name: str) -> int:
        """Place of a column by its heading or number from 1.

        Raises:
            RecordingError: there is none.
        """
        for there in ([one.text for one in self.headings], [one.name for one in self.headings]):
            if name in there:
                return there.index(name)
        if name.isdecimal() and 1 <= int(name) <= len(self.headings):
            return int(name) - 1
        hint = f"There are: {', '.join(one.text for one in self.headings)[:300]}."
        raise RecordingError(f"{self.file} has no column {name!r:.60}.", hint)

    def _chosen(self, column: int) -> TableClock:
        for one in (*self._stamps(), *self._dates(), *self._weeks()):
            if column in one.columns:
                return replace(one, rank=0)
        matches = self._of_name(column)
        if matches is None:
            counters = [one for one in self._counters() if column in one.columns]
            matches = counters[0] if counters else self._number(column, 0)
        return replace(matches, rank=0, why=f"{matches.why}; chosen from others")

    def _rows(self) -> TableClock:
        if not self.rate:
            raise AmbiguousTableError(f"{self.file} has no column of times.", "Name its rate: --rate 100.", "rate")
        why = f"--rate {self.rate:g}" if self.options.rate else "the head of the file names the rate"
        return TableClock("rows", (), "rows", "samples", (1 / self.rate,), "start", "stated", why, rank=9)

    # -- by form -------------------------------------------------------------------------------------------------------

    def _stamps(self) -> list[TableClock]:
        """Pairs of seconds and parts of a second."""
        by_words = {names.words_of(one.name): column for column, one in enumerate(self.headings)}
        matches = []
        for words, column in by_words.items():
            stem, _, last = words.rpartition("_")
            if SPELLINGS.get(last) != "s":
                continue
            for part, other in by_words.items():
                head, _, tail = part.rpartition("_")
                unit = SPELLINGS.get(tail, "s")
                if head == stem and unit != "s" and self._is_fraction(other, unit):
                    name = f"{self.headings[column].name} + {self.headings[other].name}"
                    seconds = self.numbers(column)
                    epoch: Epoch = "1970" if len(seconds) and is_dated(float(seconds[0]), self.newest) else "start"
                    rank = 1 if "stamp" in stem else 2
                    factors, why = (1.0, UNITS[unit]), f"seconds and {unit} in two columns"
                    matches.append(
                        TableClock(name, (column, other), "parts", "s", factors, epoch, "known", why, rank=rank)
                    )
                    break
        return [one for one in matches if self._advances(one.columns)]

    def _is_fraction(self, column: int, unit: str) -> bool:
        values = self.numbers(column)
        return bool(len(values)) and bool((values >= 0).all()) and float(values.max()) * UNITS[unit] < 1

    def _advances(self, columns: Sequence[int]) -> bool:
        """Whether the numbers of a stamp are more than zeros."""
        return any(len(values := self.numbers(column)) and bool(np.ptp(values)) for column in columns) or not (
            len(self.form.sample) >= names.FEWEST
        )

    def _dates(self) -> list[TableClock]:
        """A column of dates beside one of times of day."""
        texts = [column for column in range(len(self.headings)) if self.is_text(column)]
        clocks = [one for one in texts if all(map(is_time_of_day, self.cells(one)[: names.FEWEST]))]
        days = [one for one in texts if one not in clocks and ":" not in "".join(self.cells(one)[: names.FEWEST])]
        if not days or not clocks:
            return []
        date, clock = days[0], clocks[0]
        order = self._order(date)
        name = f"{self.headings[date].name} + {self.headings[clock].name}"
        zone, words = self._named_zone(date)
        why = f"date and time of day in two columns{words}"
        return [
            TableClock(name, (date, clock), "date+time", "", (1.0,), "1970", "known", why, order, rank=2, zone=zone)
        ]

    def _named_zone(self, column: int) -> tuple[float, str]:
        """Seconds by which dates under a heading GPST or JST, of RTKLIB, are ahead of UTC, and words on it."""
        words = names.words_of(self.headings[column].name)
        if words in names.ZONES:
            return names.ZONES[words], f", of {words.upper()} by the heading"
        at = unix_seconds(self.cells(column)[0]) if words == "gpst" else None
        return (leap_seconds(at), ", of GPS time by the heading") if at is not None else (0.0, "")

    def _order(self, column: int) -> Order:
        if self.options.date_order is not None:
            return self.options.date_order
        order, matters = order_of(self.cells(column), self.newest)
        if order is None and matters:
            example = self.cells(column)[0][:30]
            raise AmbiguousTableError(
                f"{self.file}: {self.headings[column].text} is {example}, which has the day or the month first.",
                "Name the order: --date-order dmy or --date-order mdy.",
                "order",
            )
        return order or "dmy"

    def _weeks(self) -> list[TableClock]:
        """Time of week, beside the GPS week if there is one."""
        by_words = {names.words_of(one.name): column for column, one in enumerate(self.headings)}
        of_week = [
            (words, column)
            for words, column in by_words.items()
            if self._is_of_week(words, column) and (len(self.numbers(column)) or len(self.form.sample) < names.FEWEST)
        ]
        if not of_week:
            return []
        words, column = of_week[0]
        unit = SPELLINGS.get(self.options.unit, "") or names.named_unit(self.headings[column])
        unit = unit or ("ms" if words in ("i_tow", "itow") else "")
        sure: Sure = "known" if unit else "inferred"
        values = self.numbers(column)
        if not unit:
            largest = float(values.max()) if len(values) else 0.0
            step = usual_step(values) if len(values) > 1 else 0.0
            is_fine = step < 1 or bool((values != np.round(values)).any())
            unit = ("ms", "s")[largest < names.WEEK and is_fine]
            if largest < names.WEEK and not (values != np.round(values)).any() and step >= 1:
                units = {one.unit for one in self._readings(column)}
                unit = units.pop() if len(units) == 1 else ""
        week = next((by_words[one] for one in names.WEEK_NAMES if one in by_words), None)
        name = self.headings[column].name
        if not unit:
            return [self._open(column, 2, "week")]
        factor = FACTORS[unit]
        weeks = self.numbers(week) if week is not None else np.zeros(0)
        if week is None or (len(weeks) and float(weeks.max()) == 0):
            why = "time of week without the week"
            return [TableClock(name, (column,), "number", unit, (factor,), "week", sure, why, rank=3)]
        name = f"{self.headings[week].name} + {name}"
        why = "GPS week and time of week"
        columns: tuple[int, ...] = (week, column)
        factors: tuple[float, ...] = (names.WEEK, factor)
        cycle = next((by_words[one] for one in names.CYCLE_NAMES if one in by_words), None)
        zero = 0.0
        if len(weeks) and weeks.max() < names.WEEK_BITS and cycle is not None:
            name = f"{self.headings[cycle].name} + {name}"
            columns, factors = (cycle, *columns), (names.WEEK_BITS * names.WEEK, *factors)
        elif len(weeks) and weeks.max() < names.WEEK_BITS:
            newest = (self.newest - names.GPS_EPOCH) / names.WEEK
            zero = float((newest - weeks.max()) // names.WEEK_BITS) * names.WEEK_BITS
            sure, why = "assumed", f"a GPS week of ten bits, of the {zero + names.WEEK_BITS:.0f} weeks before the file"
        zero *= names.WEEK
        return [TableClock(name, columns, "week", unit, factors, "GPS", sure, why, rank=2, zero_s=zero)]

    def _is_of_week(self, words: str, column: int) -> bool:
        values = self.numbers(column)
        named = (words in names.GPS_TIME or names.without_unit(words) in names.GPS_TIME) and len(values) > 0
        return names.without_unit(words) in names.OF_WEEK or (named and values.min() >= 0 and values.max() < names.WEEK)

    def _utc_parts(self) -> list[TableClock]:
        words = (names.words_of(one.name).removeprefix("utc_") for one in self.headings)
        by_words = {one.removesuffix("s"): column for column, one in enumerate(words)}  # hours, minutes, seconds
        if not all(part in by_words for part in names.UTC_PARTS[:6]):
            return []
        columns = tuple(by_words[part] for part in names.UTC_PARTS if part in by_words)
        numbers = self.numbers(columns[0])
        if not len(numbers) or numbers[0] < 1990:  # a receiver without a fix
            return []
        why = "year to second in columns of their own"
        return [TableClock("UTC", columns, "utc", "", (1.0,), "1970", "known", why, rank=4)]

    def _counters(self) -> list[TableClock]:
        why = (
            f"a counter of samples at {self.rate:g} Hz, by {'--rate' if self.options.rate else 'the head of the file'}"
        )
        return [
            TableClock(one.name, (column,), "counter", "samples", (1 / self.rate,), "start", "stated", why, rank=8)
            for column, one in enumerate(self.headings)
            if self.rate and names.COUNTERS.match(names.words_of(one.name)) and len(self.numbers(column))
        ]

    # -- by name -------------------------------------------------------------------------------------------------------

    def _of_name(self, column: int) -> TableClock | None:
        heading = self.headings[column]
        words = names.words_of(heading.name)
        if words == names.FINE and self.cells(column):
            return self._fine(column)
        is_ros = heading.name.startswith("%") or words.endswith("header_stamp")
        last = names.words_of(heading.name.rpartition(".")[2])  # of a structure: ref.t
        is_inner = "." in heading.name and names.TIMES.match(last) is not None and self.rises(column)
        is_named = (
            is_ros or is_inner or names.TIME.match(words) or names.ELAPSED.match(words) or names.TIMES.match(words)
        )
        if not is_named or (words == "t" and names.has_odd_unit(heading)):  # a temperature
            return None
        rank = 1 if words.endswith("header_stamp") else 2 if names.is_plain(heading) or is_ros else 3
        rank += bool(names.OF_HOST.match(words))
        if heading.name.lower() == "arrival" or (rank == 1 and not self._advances((column,))):
            return None
        if not self.cells(column) and len(self.form.sample) >= names.FEWEST:  # the program had no time to write
            return None
        return self._text(column, rank) if self.is_text(column) else self._number(column, rank)

    def _fine(self, column: int) -> TableClock:
        """SampleTimeFine: its unit depends on the program that wrote the file."""
        if unit := names.named_unit(self.headings[column]):
            return self._number(column, 3)
        numbers = self.numbers(column)
        step = usual_step(numbers) if len(numbers) > 1 else 0.0
        is_dot = {"devicetag", "firmwareversion", "outputrate"} & self.form.metadata.keys()
        is_mt = {"update rate", "filter profile", "firmware version", "start time"} & self.form.metadata.keys()
        factor = names.FINE_DOT_S if is_dot else names.FINE_S
        program = "a DOT" if is_dot else "MT Manager"
        unit = "µs" if is_dot else "100 µs"
        sure: Sure = "known"
        why = f"{program} writes SampleTimeFine in {unit}"
        fits = [one for one in (names.FINE_S, names.FINE_DOT_S) if step and 0.9 <= 1 / (step * one) <= 2100]
        is_converted = len(fits) == 1 and factor not in fits  # a table of one program with the head of the other
        if step and (is_converted or not (is_dot or is_mt)):
            if len(fits) != 1:
                return self._open(column, 3)
            factor, sure = fits[0], "inferred"
            unit = "µs" if factor == names.FINE_DOT_S else "100 µs"
            why = f"in {unit} the samples come at {rate_text(1 / (step * factor))}"
        return TableClock(self._name(column), (column,), "number", unit, (factor,), "start", sure, why, rank=3)

    def _text(self, column: int, rank: int) -> TableClock:
        name, is_day = self._name(column), all(map(is_time_of_day, self.cells(column)[: names.FEWEST]))
        if is_day:
            return TableClock(name, (column,), "text", "", (1.0,), "day", "known", "times of day", rank=rank)
        order, zone = self._order(column), names.ZONE.match(self.headings[column].unit)
        seconds, words = self._named_zone(column)
        why = f"dates and times{words}"
        if zone is not None and not re.search(r"Z$|[+-]\d\d:?\d\d$", self.cells(column)[0][10:]):
            seconds = float(f"{zone['sign']}1") * (int(zone["hours"]) * 3600 + int(zone["minutes"] or 0) * 60)
            why = f"dates and times, of {zone[0]} by the heading"
        return TableClock(name, (column,), "text", "", (1.0,), "1970", "known", why, order, rank=rank, zone=seconds)

    def _of_gps(self, clock: TableClock) -> TableClock:
        """The clock, counted from 1980 if its heading names GPS and it is then no later than the file."""
        text = " ".join(self.headings[column].text.lower() for column in clock.columns)
        if clock.kind != "number" or clock.epoch != "1970" or "gps" not in text or re.search("unix|utc|1970", text):
            return clock
        if self.options.unit or self.numbers(clock.columns[0])[0] * clock.factors[0] + names.GPS_EPOCH > self.newest:
            return clock
        why = "the heading names GPS, whose times count from 1980"
        return replace(clock, kind="week", epoch="GPS", sure="assumed", why=why)

    def _epoch(self, column: int, factor: float) -> Epoch:
        values = self.numbers(column)
        return "1970" if len(values) and is_dated(float(values[0]) * factor, max(self.newest, 1.9e9)) else "start"

    def _number(self, column: int, rank: int) -> TableClock:
        """A column of numbers, its unit by the options, its heading, or the numbers."""
        heading = self.headings[column]
        sure: Sure = "stated"
        unit, why = SPELLINGS.get(self.options.unit, ""), "as chosen"
        if not unit and (unit := names.named_unit(heading)):
            why = "the heading names it"
        if not unit and (heading.name.startswith("%") or heading.name.startswith("field.")):
            unit, sure, why = "ns", "known", "rostopic writes ns"
        if not unit and heading.name.startswith("__"):
            unit, sure, why = "s", "known", "PlotJuggler writes __time in s since 1970"
        if not unit:
            return self._inferred(column, rank)
        if unit == "d" and (serial := self._serial_days(column, rank)) is not None:
            return serial
        factor = FACTORS[unit]
        epoch = self._epoch(column, factor)
        return TableClock(self._name(column), (column,), "number", unit, (factor,), epoch, sure, why, rank=rank)

    def _serial_days(self, column: int, rank: int) -> TableClock | None:
        """Days since the zero of a program, if they are a date that the file can hold; None if they are not."""
        for name, zero in names.SERIAL_DAYS.items():
            if any(is_dated(float(one) * FACTORS["d"] + zero, self.newest) for one in self.numbers(column)[:1]):
                clock = TableClock(
                    self._name(column), (column,), "number", "d", (FACTORS["d"],), "1970", "inferred", ""
                )
                return replace(clock, why=f"as days of {name}, they are dates", rank=rank, zero_s=zero)
        return None

    def _inferred(self, column: int, rank: int) -> TableClock:
        values, name = self.numbers(column), self._name(column)
        if not len(values):
            why = "there are no numbers"
            return TableClock(name, (column,), "number", "s", (1.0,), "start", "assumed", why, rank=rank)
        readings = self._readings(column)
        is_date = names.words_of(self.headings[column].name) in ("date", *names.DAYS)
        if (not readings or is_date) and (serial := self._serial_days(column, rank)) is not None:
            return serial
        chosen = decided(readings, values, inertial=self.is_inertial, newest=self.newest)
        sure: Sure = "inferred"
        by_head = [one for one in readings if self.rate and abs(one.rate - self.rate) <= CLOSE * self.rate]
        if chosen is None and len(by_head) == 1:
            [chosen] = readings = by_head
        if chosen is None and len(values) < names.FEWEST:
            dated = [one for one in readings if one.dated]
            fraction = bool((values != np.round(values)).any())
            if len(dated) == 1 or fraction or len(values) == 1:
                chosen, sure = dated[0] if len(dated) == 1 else UnitReading("s", 0.0, False), "assumed"
        if chosen is None or names.has_odd_unit(self.headings[column]):
            return self._open(column, rank)
        why = _reason(values, chosen, readings)
        epoch: Epoch = "1970" if chosen.dated else "start"
        return TableClock(name, (column,), "number", chosen.unit, (chosen.factor,), epoch, sure, why, rank=rank)


def _reason(values: Floats, chosen: UnitReading, readings: Sequence[UnitReading]) -> str:
    """Why a unit was taken."""
    if len(readings) > 1 and chosen.dated:
        return "as that the times are dates"
    step = usual_step(values) if len(values) > 1 else 0.0
    if not step:
        return "nothing else is known"
    others: Mapping[str, float] = {unit: 1 / (step * factor) for unit, factor in UNITS.items() if unit != chosen.unit}
    listed = ", ".join(f"{unit} {rate_text(rate)}" for unit, rate in others.items())
    return f"a step of {step:.4g} is {rate_text(chosen.rate)}; it would be in {listed}"
