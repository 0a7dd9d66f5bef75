"""First rows of a table, in which its clocks are searched: cells and numbers of a column, and their possible units."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.tables.cells import are_hexadecimal, hexadecimal_number
from imuscope.recordings.tables.clock import Epoch, TableClock
from imuscope.recordings.tables.clocks import names
from imuscope.recordings.tables.dates import GPS_EPOCH, WEEK_S, are_dates, are_packed, cells_of, is_moment
from imuscope.recordings.tables.format import TableFormat, is_number
from imuscope.recordings.tables.headings import ColumnHeading
from imuscope.recordings.tables.options import TableOptions
from imuscope.recordings.tables.time_units import UnitReading, is_dated, possible_units


@dataclass(frozen=True)
class TableSample:
    """First rows of one table, and other information on its times.

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
        cells = cells_of(self.form.sample, column)
        if are_hexadecimal(cells):
            return np.array([hexadecimal_number(cell) for cell in cells], np.float64)
        plain = [cell.replace(",", ".") if self.form.decimal == "," else cell for cell in cells]
        matches = np.array([float(cell) for cell in plain if "," not in cell and is_number(cell)], np.float64)
        return matches[np.isfinite(matches)]

    def cells(self, column: int) -> list[str]:
        return cells_of(self.form.sample, column)

    def is_text(self, column: int) -> bool:
        """Whether the cells of a column are dates or times of day."""
        cells = self.cells(column)
        if len(cells) and all(map(is_number, cells[: names.MIN_ROWS])):
            words = self.words(column)
            if words == "date":  # 140214 is a day, not 14:02:14
                return are_dates(cells)
            named = "utc" in words or any(names.IS_GNSS.match(names.words_of(one.name)) for one in self.headings)
            is_named = not words or any(one.match(words) for one in (names.TIME, names.TIMES))
            return is_named and are_packed(cells, self.newest, named=named)
        return bool(cells) and sum(map(is_moment, cells)) > len(cells) / 2

    def is_common(self, clock: TableClock) -> bool:
        """Whether a clock is the common time of an export: `time` beside `arrival`, or `__time` of PlotJuggler."""
        is_ours = any(one.name.lower() == "arrival" for one in self.headings)
        return is_ours or any(self.headings[column].name.startswith("__") for column in clock.columns)

    def rises(self, column: int) -> bool:
        """Whether the numbers of a column rise, and hardly any row lacks one."""
        values, rows = self.numbers(column), len(self.form.sample)
        return len(values) >= max(names.MIN_ROWS, names.MIN_RISING * rows) and bool((np.diff(values) > 0).all())

    def advances(self, columns: Sequence[int]) -> bool:
        """Whether the numbers of a stamp are more than zeros."""
        return any(len(values := self.numbers(column)) and bool(np.ptp(values)) for column in columns) or not (
            len(self.form.sample) >= names.MIN_ROWS
        )

    def is_gps_week(self, values: Floats) -> bool:
        """Whether numbers can be that of the GPS week: one, or it and the next."""
        weeks = {*values.tolist()}
        newest = (self.newest - GPS_EPOCH) / WEEK_S
        return len(weeks) <= 2 and all(one == round(one) and names.FIRST_WEEK <= one <= newest for one in weeks)

    def name(self, *columns: int) -> str:
        return " + ".join(self.headings[column].name or f"column {column + 1}" for column in columns)

    def words(self, column: int) -> str:
        """Its heading in lower case with _ between the words."""
        return names.words_of(self.headings[column].name)

    def by_words(self) -> dict[str, int]:
        """Columns by the words of their headings."""
        return {self.words(column): column for column in range(len(self.headings))}

    def epoch(self, seconds: float) -> Epoch:
        """Zero of times in s: the epoch if one of them, `seconds`, is a date that the file can hold."""
        return "1970" if is_dated(seconds, self.newest) else "start"

    def readings(self, column: int) -> list[UnitReading]:
        values, has_decimals = self.numbers(column), any(map(names.DECIMALS.search, self.cells(column)))
        readings = possible_units(
            values, inertial=self.is_inertial, newest=self.newest, rate=self.options.rate, fraction=has_decimals
        )
        is_date = names.UNIX.search(self.words(column)) is not None
        return [one for one in readings if one.dated or not is_date] or readings

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
        named = ", ".join(one.text for one in self.headings if one.text)[:300]
        hint = f"There are: {named}." if named else f"They are numbered from 1 to {len(self.headings)}."
        raise RecordingError(f"{self.file} has no column {name!r:.60}.", hint)

    def open_clock(self, column: int, rank: int, epoch: Epoch = "start") -> TableClock:
        """A clock whose unit is open."""
        readings = tuple(self.readings(column))
        return TableClock(
            self.name(column), (column,), "number", "", (), epoch, "assumed", readings=readings, rank=rank
        )
