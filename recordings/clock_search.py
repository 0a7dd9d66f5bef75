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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from imuscope.protocols.registry import unit_flag
from imuscope.recordings.mcap_writer import RecordingError
from imuscope.recordings.table_clock import (
    COUNTERS,
    DECIMALS,
    ELAPSED,
    FEWEST,
    FINE,
    FINE_DOT_S,
    FINE_S,
    INERTIAL,
    OF_WEEK,
    TIME,
    TIMES,
    UTC_PARTS,
    WEEK,
    AmbiguousTableError,
    Epoch,
    Sure,
    TableClock,
    has_odd_unit,
    is_plain,
    named_unit,
    without_unit,
    words_of,
)
from imuscope.recordings.table_dates import Order, cells_of, is_moment, is_time_of_day, order_of
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
        return any(INERTIAL.search(one.name) for one in self.headings)

    def numbers(self, column: int) -> Floats:
        """Numbers of a column in the sample."""
        values = []
        for cell in cells_of(self.form.sample, column):
            try:
                values.append(float(cell.replace(",", ".") if self.form.decimal == "," else cell))
            except ValueError:
                continue
        matches = np.array(values, np.float64)
        return matches[np.isfinite(matches)]

    def cells(self, column: int) -> list[str]:
        """Cells of a column in the sample."""
        return cells_of(self.form.sample, column)

    def is_text(self, column: int) -> bool:
        """Whether the cells of a column are dates or times of day."""
        cells = self.cells(column)
        return bool(cells) and sum(is_moment(one) and not is_number(one) for one in cells) > len(cells) / 2

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
        options = self.options
        matches = [*self._stamps(), *self._dates(), *self._weeks(), *self._utc_parts()]
        used = {column for one in matches for column in one.columns}
        for column, heading in enumerate(self.headings):
            if column not in used and (one := self._of_name(column, heading)) is not None:
                matches.append(one)
        matches += self._counters()
        if not matches and options.rate:
            matches = [self._rows()]
        return sorted(matches, key=lambda one: (one.rank, one.columns))

    def column_named(self, name: str) -> int:
        """Place of a column by its heading or number from 1.

        Raises:
            RecordingError: there is none.
        """
        for names in ([one.text for one in self.headings], [one.name for one in self.headings]):
            if name in names:
                return names.index(name)
        if name.isdecimal() and 1 <= int(name) <= len(self.headings):
            return int(name) - 1
        there = ", ".join(one.text for one in self.headings)[:300]
        raise RecordingError(f"{self.file} has no column {name!r:.60}.", f"There are: {there}.")

    def _chosen(self, column: int) -> TableClock:
        heading = self.headings[column]
        for one in (*self._stamps(), *self._dates(), *self._weeks()):
            if column in one.columns:
                return replace(one, rank=0)
        matches = self._of_name(column, heading)
        if matches is None:
            counters = [one for one in self._counters() if column in one.columns]
            matches = counters[0] if counters else self._number(column, heading, 0)
        return replace(matches, rank=0, why=f"{matches.why}; chosen from others")

    def _rows(self) -> TableClock:
        if not self.options.rate:
            raise AmbiguousTableError(f"{self.file} has no column of times.", "Name its rate: --rate 100.", "rate")
        rate = self.options.rate
        return TableClock("rows", (), "rows", "samples", (1 / rate,), "start", "stated", f"--rate {rate:g}", rank=9)

    # -- by form -------------------------------------------------------------------------------------------------------

    def _stamps(self) -> list[TableClock]:
        """Pairs of seconds and parts of a second."""
        by_words = {words_of(one.name): column for column, one in enumerate(self.headings)}
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
            len(self.form.sample) >= FEWEST
        )

    def _dates(self) -> list[TableClock]:
        """A column of dates beside one of times of day."""
        texts = [column for column in range(len(self.headings)) if self.is_text(column)]
        days = [one for one in texts if not any(":" in cell for cell in self.cells(one)[:FEWEST])]
        clocks = [one for one in texts if all(map(is_time_of_day, self.cells(one)[:FEWEST]))]
        if not days or not clocks:
            return []
        date, clock = days[0], clocks[0]
        order = self._order(date)
        name = f"{self.headings[date].name} + {self.headings[clock].name}"
        why = "date and time of day in two columns"
        return [TableClock(name, (date, clock), "date+time", "", (1.0,), "1970", "known", why, order, rank=2)]

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
        by_words = {words_of(one.name): column for column, one in enumerate(self.headings)}
        of_week = [(words, column) for words, column in by_words.items() if without_unit(words) in OF_WEEK]
        if not of_week:
            return []
        words, column = of_week[0]
        unit = SPELLINGS.get(self.options.unit, "") or named_unit(self.headings[column])
        unit = unit or ("ms" if words in ("i_tow", "itow") else "")
        sure: Sure = "known" if unit else "inferred"
        values = self.numbers(column)
        if not unit:
            largest = float(values.max()) if len(values) else 0.0
            step = usual_step(values) if len(values) > 1 else 0.0
            is_fine = step < 1 or bool((values != np.round(values)).any())
            unit = ("ms", "s")[largest < WEEK and is_fine]
            if largest < WEEK and not (values != np.round(values)).any() and step >= 1:
                readings = possible_units(values, inertial=self.is_inertial, newest=self.newest, rate=self.options.rate)
                unit = readings[0].unit if len({one.unit for one in readings}) == 1 else ""
        week = next(
            (by_words[one] for one in ("week", "gps_week", "gps_week_number", "week_number") if one in by_words), None
        )
        name = self.headings[column].name
        if not unit:
            readings = possible_units(values, inertial=self.is_inertial, newest=self.newest, rate=self.options.rate)
            return [
                TableClock(name, (column,), "number", "", (), "week", "assumed", "", readings=tuple(readings), rank=2)
            ]
        factor = FACTORS[unit]
        if week is None:
            why = "time of week without the week"
            return [TableClock(name, (column,), "number", unit, (factor,), "week", sure, why, rank=3)]
        name = f"{self.headings[week].name} + {name}"
        why = "GPS week and time of week"
        return [TableClock(name, (week, column), "week", unit, (WEEK, factor), "GPS", sure, why, rank=2)]

    def _utc_parts(self) -> list[TableClock]:
        by_words = {words_of(one.name).removeprefix("utc_"): column for column, one in enumerate(self.headings)}
        if not all(part in by_words for part in UTC_PARTS[:6]):
            return []
        columns = tuple(by_words[part] for part in UTC_PARTS if part in by_words)
        numbers = self.numbers(columns[0])
        if not len(numbers) or numbers[0] < 1990:  # a receiver without a fix
            return []
        why = "year to second in columns of their own"
        return [TableClock("UTC", columns, "utc", "", (1.0,), "1970", "known", why, rank=4)]

    def _counters(self) -> list[TableClock]:
        rate = self.rate
        if not rate:
            return []
        source = "--rate" if self.options.rate else "the head of the file"
        why = f"a counter of samples at {rate:g} Hz, by {source}"
        sure: Sure = "stated"
        return [
            TableClock(one.name, (column,), "counter", "samples", (1 / rate,), "start", sure, why, rank=8)
            for column, one in enumerate(self.headings)
            if words_of(one.name) in COUNTERS and len(self.numbers(column))
        ]

    # -- by name -------------------------------------------------------------------------------------------------------

    def _of_name(self, column: int, heading: ColumnHeading) -> TableClock | None:
        words = words_of(heading.name)
        if heading.name.lower() == "arrival":
            return None
        if words == FINE:
            return self._fine(column, heading)
        is_ros = heading.name.startswith("%") or words.endswith("header_stamp")
        if not (is_ros or TIME.match(words) or ELAPSED.match(words) or words in TIMES):
            return None
        rank = 1 if words.endswith("header_stamp") else 2 if is_plain(heading) or is_ros else 3
        if rank == 1 and not self._advances((column,)):
            return None
        if self.is_text(column):
            return self._text(column, heading, rank)
        if heading.name.startswith("__"):
            why = "PlotJuggler writes __time in s since 1970"
            return TableClock(
                heading.name, (column,), "number", "s", (1.0,), self._epoch(column, 1.0), "known", why, rank=2
            )
        return self._number(column, heading, rank)

    def _fine(self, column: int, heading: ColumnHeading) -> TableClock:
        """SampleTimeFine: its unit depends on the program that wrote the file."""
        if unit := named_unit(heading):
            return self._number(column, heading, 3)
        numbers = self.numbers(column)
        step = usual_step(numbers) if len(numbers) > 1 else 0.0
        is_dot = {"devicetag", "firmwareversion", "outputrate"} & self.form.metadata.keys()
        is_mt = {"update rate", "filter profile", "firmware version", "start time"} & self.form.metadata.keys()
        factor = FINE_DOT_S if is_dot else FINE_S
        program = "a DOT" if is_dot else "MT Manager"
        unit = "µs" if is_dot else "100 µs"
        sure: Sure = "known"
        why = f"{program} writes SampleTimeFine in {unit}"
        if not is_dot and not is_mt and step:
            fits = [one for one in (FINE_S, FINE_DOT_S) if 0.9 <= 1 / (step * one) <= 2100]
            if len(fits) != 1:
                readings = possible_units(numbers, inertial=True, newest=self.newest, rate=self.options.rate)
                return TableClock(
                    heading.name, (column,), "number", "", (), "start", "assumed", "", readings=tuple(readings), rank=3
                )
            factor, sure = fits[0], "inferred"
            unit = "µs" if factor == FINE_DOT_S else "100 µs"
            why = f"in {unit} the samples come at {rate_text(1 / (step * factor))}"
        return TableClock(heading.name, (column,), "number", unit, (factor,), "start", sure, why, rank=3)

    def _text(self, column: int, heading: ColumnHeading, rank: int) -> TableClock:
        cells = self.cells(column)
        if all(map(is_time_of_day, cells[:FEWEST])):
            return TableClock(heading.name, (column,), "text", "", (1.0,), "day", "known", "times of day", rank=rank)
        order = self._order(column)
        return TableClock(
            heading.name, (column,), "text", "", (1.0,), "1970", "known", "dates and times", order, rank=rank
        )

    def _epoch(self, column: int, factor: float) -> Epoch:
        values = self.numbers(column)
        return "1970" if len(values) and is_dated(float(values[0]) * factor, max(self.newest, 1.9e9)) else "start"

    def _number(self, column: int, heading: ColumnHeading, rank: int) -> TableClock:
        """A column of numbers, its unit by the options, its heading, or the numbers."""
        sure: Sure = "stated"
        unit, why = SPELLINGS.get(self.options.unit, ""), "as chosen"
        if not unit and (unit := named_unit(heading)):
            why = "the heading names it"
        if not unit and (heading.name.startswith("%") or heading.name.startswith("field.")):
            unit, sure, why = "ns", "known", "rostopic writes ns"
        if not unit:
            return self._inferred(column, heading, rank)
        factor = FACTORS[unit]
        epoch = self._epoch(column, factor)
        return TableClock(heading.name, (column,), "number", unit, (factor,), epoch, sure, why, rank=rank)

    def _inferred(self, column: int, heading: ColumnHeading, rank: int) -> TableClock:
        values = self.numbers(column)
        name = heading.name
        if not len(values):
            return TableClock(
                name, (column,), "number", "s", (1.0,), "start", "assumed", "there are no numbers", rank=rank
            )
        readings = possible_units(
            values,
            inertial=self.is_inertial,
            newest=self.newest,
            rate=self.options.rate,
            fraction=any(DECIMALS.search(cell) for cell in self.cells(column)),
        )
        chosen = decided(readings, values, inertial=self.is_inertial, newest=self.newest)
        if has_odd_unit(heading):
            return TableClock(
                name, (column,), "number", "", (), "start", "assumed", "", readings=tuple(readings), rank=rank
            )
        sure: Sure = "inferred"
        if chosen is None and len(values) < FEWEST:
            dated = [one for one in readings if one.dated]
            fraction = bool((values != np.round(values)).any())
            if len(dated) == 1 or fraction or len(values) == 1:
                chosen, sure = dated[0] if len(dated) == 1 else UnitReading("s", 0.0, False), "assumed"
        if chosen is None:
            return TableClock(
                name, (column,), "number", "", (), "start", "assumed", "", readings=tuple(readings), rank=rank
            )
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


def axis_of_table(search: ClockSearch) -> tuple[TableClock, list[TableClock]]:
    """The clock that is the axis, and the others.

    Raises:
        RecordingError: there is none, or its unit is open.
    """
    clocks = search.clocks()
    if not clocks:
        there = ", ".join(one.text for one in search.headings)[:300]
        if search.form.headings:
            hint = f"Name one time, with its unit: time (s), or give --time-column or --rate. There are: {there}."
        else:
            hint = "It has no heading either: name its sampling rate with --rate, and the columns with --columns."
        raise AmbiguousTableError(f"{search.file} has no column of times.", hint, "time")
    axis, *others = clocks
    if axis.is_open:
        axis = _by_another(search, axis, others) or axis
    if axis.is_open and not search.options.time_column:
        for one in others:
            if not one.is_open and one.rank <= 3:
                return one, [axis, *(other for other in others if other is not one)]
    if axis.is_open:
        raise _open_unit(search.file, axis)
    if search.options.rate and axis.kind in ("number", "parts"):
        _check_rate(search, axis)
    return axis, others


def _by_another(search: ClockSearch, axis: TableClock, others: Sequence[TableClock]) -> TableClock | None:
    """The axis with the unit in which it runs like another clock."""
    values = search.numbers(axis.columns[0])
    for other in others:
        if other.is_open or other.kind not in ("number", "counter") or len(values) < FEWEST:
            continue
        theirs = search.numbers(other.columns[0])
        if len(theirs) != len(values) or not np.ptp(values):
            continue
        ratio = float(np.ptp(theirs)) * other.factors[0] / float(np.ptp(values))
        fitting = [unit for unit, factor in UNITS.items() if abs(ratio / factor - 1) < CLOSE]
        if fitting:
            unit = fitting[0]
            epoch: Epoch = "1970" if is_dated(float(values[0]) * UNITS[unit], search.newest) else "start"
            why = f"so it runs like {other.name}"
            return replace(axis, unit=unit, factors=(UNITS[unit],), epoch=epoch, sure="inferred", why=why, readings=())
    return None


def _open_unit(file: str, axis: TableClock) -> AmbiguousTableError:
    units = [one.unit for one in axis.readings]
    if not units:
        words = f"{file}: the times in {axis.name} fit no unit."
        hint = f"Name it with {unit_flag()} s, ms, us or ns, or another column with --time-column."
        return AmbiguousTableError(words, hint, "unit", axis)
    listed = " or ".join(one.words() for one in axis.readings)
    flags = " or ".join(f"{unit_flag()} {'us' if unit == 'µs' else unit}" for unit in units)
    hint = f"Name it: {flags}, or --rate, or in the heading: {axis.name} ({units[0]})."
    return AmbiguousTableError(f"{file}: the unit of {axis.name} can be {listed}.", hint, "unit", axis)


def _check_rate(search: ClockSearch, axis: TableClock) -> None:
    values = sum(
        (search.numbers(column) * factor for column, factor in zip(axis.columns, axis.factors, strict=True)),
        start=np.zeros(len(search.numbers(axis.columns[0]))),
    )
    step = usual_step(values) if len(values) > 1 else 0.0
    if step and abs(1 / step - search.options.rate) > CLOSE * search.options.rate:
        words = f"{search.file}: {axis.name} in {axis.unit} has {rate_text(1 / step)}, not {search.options.rate:g} Hz."
        hint = f"Leave --rate out, or give --time-column {NO_COLUMN} to count the rows instead."
        raise AmbiguousTableError(words, hint, "rate")
