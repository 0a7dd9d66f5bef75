"""Numbers decoded by other programs: text tables with a time column.

    CSV     time (s),Acceleration.x (m/s²),Acceleration.y (m/s²),Temperature [°C]
            1760000000.00,0.1,0.2,24.5

    format.py           where the table begins, separator, decimal sign
    headings.py         names, units, vectors
    clocks/search.py    the column of times and its unit (dates, weeks, numbers); the others stay
    clocks/steps.py     a first pass over the times: steps, repeats, wraps

Times that are not since 1970 are counted from the date in the file's name, else from when it was last written. A column
`arrival` beside them is taken as the arrival time. A cell that is not a number is empty, and reported.
"""

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from imuscope.protocols.arrays import Floats, Ints
from imuscope.protocols.clocks.unix_time import nanoseconds
from imuscope.protocols.schema.plural import counted, plural
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.sources import ChunkBlock, FileDamage, SourceDevice, remark
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.tables.cells import are_hexadecimal, digits, numbers, sample_times, times_of
from imuscope.recordings.tables.clock import FEWEST_ROWS, MOST_TIMES, TableClock, few_times
from imuscope.recordings.tables.clocks.axis import TimeAxis, order_words, origin_of, step_limits
from imuscope.recordings.tables.clocks.evenness import offset_between
from imuscope.recordings.tables.clocks.packets import PacketSpread, spread_of
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.clocks.search import axis_of_table
from imuscope.recordings.tables.clocks.steps import ClockWatch, periods_of
from imuscope.recordings.tables.dates import cells_of
from imuscope.recordings.tables.format import TableFormat, format_of, is_number, renamed
from imuscope.recordings.tables.headings import ColumnHeading, unique
from imuscope.recordings.tables.number_blocks import BLOCK_BYTES, HELD_BYTES, FirstPass, is_fast, lines_of, numbers_in
from imuscope.recordings.tables.options import TableOptions
from imuscope.recordings.tables.table_rows import TableRows, in_order_of_time
from imuscope.recordings.tables.time_units import SPELLINGS, UNITS
from imuscope.recordings.tables.unreadable_cells import UnreadableCells
from imuscope.recordings.tables.utf8 import Utf8

if TYPE_CHECKING:  # imported where a CSV file is read, so that a server starts sooner
    import pyarrow as pa


DEVICE = "1"
SEGMENT = "segment"
SORTED_BYTES = 64 << 20  # of a table whose rows are sorted by their times
NOW_S = 86_400.0  # by which a file's clock may be behind the times in it
_RATE = re.compile(r"^\s*(\d+(?:\.\d+)?)\s*(Hz|ms|sps)?\s*$", re.IGNORECASE)
_INTERVAL = re.compile(r"^\s*(\d+(?:\.\d+)?(?:e-?\d+)?)\s*(s|sec|seconds|ms|us|µs)\s*$", re.IGNORECASE)
_INTERVAL_NAME = re.compile(r"^(sampl(e|ing)|data|log(ging)?|measurement)[ _]?(interval|period|time)$|^dt$|^interval$")
_RATE_NAME = re.compile(
    r"^((update|output|sampl(e|ing)|data|log(ging)?|measurement|acquisition)[ _]?)?(rate|frequency|freq)$|^fs$|^odr$|"
    r"^samples?[ _]per[ _]second$"
)
_UNIT_OF_NAME = re.compile(r"^(.*?)\s*[(\[]\s*(hz|sps|s|sec|ms|us|µs)\s*[)\]]$")


class TableSource:
    """A file of numbers, without bytes of a device. As recordings/sources.Source, with `rows` in place of parts.

    Attributes:
        axis: the clock behind the times; None if the format says it.
        is_export: whether this program wrote the file: an empty row of a quantity is none of its samples.
        members: the tables of an archive.
    """

    timed = True
    axis: TimeAxis | None = None
    is_export: bool = False
    members: Sequence["TableSource"] = ()

    def __init__(self, path: Path, format_name: str) -> None:
        self.path, self.format = path, format_name
        self.header: Mapping[str, str] = {}
        self.devices = {DEVICE: SourceDevice(DEVICE, "", {"source": path.name, "name": path.stem})}
        self.damage: list[FileDamage] = []

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        """Nothing: the file has no bytes of a device."""
        return iter(())

    def metadata(self) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """Metadata stored beside the numbers: none."""
        return iter(())

    def rows(self) -> Iterator[TableRows]:
        """All rows, in blocks of each table."""
        raise NotImplementedError

    def last(self) -> float:
        """Time of the last row, as far as known before all are read, unix s; 0 if unknown."""
        return 0.0

    def unreadable(self) -> str:
        """A sentence on unreadable cells, by column and row; "" if there are none."""
        return ""

    def texts(self) -> Mapping[str, str]:
        """The first text of each column that has nothing but texts."""
        return {}


class CsvSource(TableSource):
    """One text table.

    Args:
        options: information from the user.

    Attributes:
        form: separator, decimal sign, headings and first rows.
        headings, names: of the columns, as renamed by the user; unique names.
        left_out: columns that the user leaves out.
        arrival_column: that of the arrival times; None without one.
        refusal: why the rows cannot be read; None if they can.

    Raises:
        RecordingError: it has no column of times. A unit that is open is an error when the rows are read.
    """

    def __init__(self, path: Path, options: TableOptions | None = None) -> None:
        super().__init__(path, "csv")
        self._options = options = options or TableOptions()
        self.form = self._form_of_file()
        texts, self.left_out = renamed(path.name, self.form, options)
        self.headings = [ColumnHeading.of(text) for text in texts]
        by_name = {one.name.lower(): i for i, one in reversed([*enumerate(self.headings)])}
        if {"time", "arrival"} <= by_name.keys() and not any(row[by_name["time"]] for row in self.form.sample):
            pair = by_name["time"], by_name["arrival"]  # of a message without a clock: the arrival is its time
            self.headings[pair[0]], self.headings[pair[1]] = self.headings[pair[1]], self.headings[pair[0]]
        self.names = unique([one.name or f"column {i + 1}" for i, one in enumerate(self.headings)])
        self._scales = [self.form.scale(one.name) for one in self.headings]
        self.refusal: RecordingError | None = None
        self._unreadable = UnreadableCells(lambda i: self.headings[i].text or self.names[i])
        self._timeless = 0  # rows with numbers but without a time
        self._first_pass = FirstPass()
        cells = (cells_of(self.form.sample, i) for i in range(len(self.headings)))
        self._hexadecimal = {i for i, some in enumerate(cells) if are_hexadecimal(some)}
        self.arrival_column = next((i for i, one in enumerate(self.headings) if one.name.lower() == "arrival"), None)
        self.is_export = {
            "time",
            "arrival",
        } <= by_name.keys()  # rows may share a time, or have none
        names = [one.text for one in self.headings]  # a column of this name beside the arrival is that of our exports
        self._segment = names.index(SEGMENT) if self.arrival_column is not None and SEGMENT in names else None
        newest = path.stat().st_mtime + NOW_S
        rate = options.rate or _head_rate(self.form)
        head = TableSample(path.name, self.form, self.headings, options, newest, rate)
        try:
            clock, others = axis_of_table(head)
        except RecordingError as error:
            if "no column of times" in error.message:
                raise
            self.refusal = error
            return
        sample = self._sample_times(clock)
        usual, ahead = step_limits(sample)
        if clock.kind == "rows":
            usual = clock.factors[0]
        first = float(sample[0]) if len(sample) else 0.0
        origin, dated_by = origin_of(clock, first, self.form, path)
        if dated_by and clock.epoch == "start":
            origin, dated_by = self._dated_by(clock, others) or (origin, dated_by)
        self.axis = TimeAxis(
            clock,
            others,
            origin,
            dated_by,
            usual,
            _head_rate(self.form),
            self.form.decimal,
            {one.name: self.option_of(one) for one in (clock, *others) if one.columns},
        )
        self._ahead = ahead
        self.axis.order = order_words(sample) if path.stat().st_size <= SORTED_BYTES else ""
        self._head = head
        if (packets := self._packets(self.axis)) is not None:
            packets.feed(sample)
            packets.end()
            self.axis.packets = packets
        self.timed = not dated_by

    def option_of(self, clock: TableClock) -> str:
        """The time column that stands for a clock: the heading of its first column, or its number from 1."""
        column = clock.columns[0]
        texts = [one.text for one in self.headings]
        return texts[column] if texts.count(texts[column]) == 1 and texts[column] else str(column + 1)

    def _form_of_file(self) -> TableFormat:
        return format_of(self.path, may_be_narrow=self._options.rate > 0)

    def _packets(self, axis: TimeAxis) -> PacketSpread | None:
        """Packets to be fed with the times of the rows; None if these have times of their own."""
        if axis.clock.kind == "rows" or axis.order:
            return None
        return spread_of(self._head, axis.clock, self._sample_times(axis.clock), axis.usual_s)

    def _sample_times(self, clock: TableClock) -> Floats:
        values = sample_times(clock, self.form.sample, self.form.decimal)
        return values[np.isfinite(values)]

    def _dated_by(self, clock: TableClock, others: Sequence[TableClock]) -> tuple[float, str] | None:
        """Origin of a clock without a date by one that has it, else by a time of day, and its name; None without."""
        for epochs in (("1970", "GPS"), ("day",)):
            for one in (one for one in others if one.epoch in epochs and len(self._sample_times(one))):
                of_day, by = origin_of(one, float(self._sample_times(one)[0]), self.form, self.path)
                fine, coarse = (sample_times(each, self.form.sample, self.form.decimal) for each in (clock, one))
                return offset_between(fine, coarse) + of_day, f"{one.name} and {by}" if by else one.name
        return None

    # -- reading -------------------------------------------------------------------------------------------------------

    def rows(self) -> Iterator[TableRows]:
        axis = self._checked_axis()
        odd: list[Any] = []
        self._unreadable.clear()
        self._timeless = 0
        size, done = max(self.path.stat().st_size, 1), 0
        parsed = known = 0  # rows, and those with a time
        held: list[TableRows] = []
        try:
            for batch in self._first_pass.batches(odd, self.damage) or self._batches(self.names, odd):
                done += batch.nbytes
                rows = self._converted(batch, axis, parsed, known, min(done / size, 1.0))
                parsed, known = parsed + len(batch), known + int(np.isfinite(rows.time).sum())
                if axis.order:
                    held.append(rows)
                else:
                    yield rows
            if held:
                yield in_order_of_time(held)
        finally:
            self._report(odd)

    def last(self) -> float:
        axis = self._checked_axis()
        watch = axis.watch
        return axis.at(watch.rows - 1, watch.final) if watch is not None and watch.rows else 0.0

    def _checked_axis(self) -> TimeAxis:
        """The axis, after the first pass over its times.

        Raises:
            RecordingError: the unit is open, all times are equal, or none can be read.
        """
        if self.refusal is not None:
            raise self.refusal
        assert self.axis is not None
        if self.axis.watch is None:
            self.axis.watch = self._watched(self.axis)
        return self.axis

    def _watched(self, axis: TimeAxis) -> ClockWatch:
        clock = axis.clock
        factor = clock.factors[-1] if clock.factors else 1.0
        watch = ClockWatch(axis.usual_s, self._ahead, periods_of(factor, clock.kind, clock.epoch))
        if clock.kind == "rows":
            return watch
        names = [self.names[column] for column in clock.columns]
        places: Sequence[int] = range(len(names))
        first_odd, held, packets = "", list[Floats](), self._packets(axis)
        first_pass = self._first_pass = FirstPass()
        if is_whole := self._may_be_numbers() and self.form.bytes_of_numbers(self.path.stat().st_size) < HELD_BYTES:
            names, places = self.names, clock.columns
        for batch in self._batches(names, first_pass.odd, first_pass.damage):
            if is_whole:
                first_pass.add(batch)
            columns = [batch.column(i) for i in places]
            cells = times_of(clock, columns, self.form.decimal)
            if len(cells.odd) and not first_odd:
                row = int(cells.odd[0])
                first_odd = " ".join(str(column[row].as_py()) for column in columns)
            times = cells.values[np.isfinite(cells.values)]
            held += [times] if axis.order else []
            watch.feed(times if not axis.order else times[:0])
            if packets is not None:
                packets.feed(times)
        if packets is not None:
            packets.end()
            axis.packets = packets
        if held:
            watch.feed(np.sort(np.concatenate(held)))
        watch.end()
        if not watch.rows and first_odd:
            hint = "Name its times: --time-column, or --rate for a table without any."
            raise RecordingError(f"{self.path.name}: {axis.name} cannot be read, first {first_odd!r:.80}.", hint)
        different = 1 if watch.is_constant else watch.rows - watch.repeats
        if not self.is_export and (watch.is_constant or (watch.rows >= FEWEST_ROWS and different <= MOST_TIMES)):
            raise few_times(self.path.name, axis.name, different, watch.rows)
        return watch

    def _batches(
        self, names: Sequence[str], odd: list[Any], damage: list[FileDamage] | None = None
    ) -> "Iterator[pa.RecordBatch]":
        """Columns of the table: of a block of rows without anything else as numbers, else as text."""
        import pyarrow as pa

        noted = self.damage if damage is None else damage
        is_number = self.axis is not None and self.axis.clock.kind == "number" and names is self.names
        timed = [self.names[i] for i in self._timed] if is_number else []
        try:
            with open_regular(self.path) as file:
                block = b""
                for block in lines_of(file, self.form.skip) if self._may_be_numbers() else ():
                    numbers = numbers_in(block, self.form.separator, self.names, names, timed)
                    if numbers is None:
                        yield from self._texts(io.BytesIO(block), 0, names, odd, noted)
                    elif len(numbers):
                        yield numbers
                if not block:
                    file.seek(0)
                    yield from self._texts(file, self.form.skip, names, odd, noted)
        except pa.ArrowInvalid as error:
            if self.form.sample:
                words = f"Not a table from some line on: {str(error).splitlines()[0][:200]}"
                noted.append(FileDamage(-1, words))

    def _may_be_numbers(self) -> bool:
        """Whether rows of plain numbers can be read as such."""
        form = self.form
        clocks = [self.axis.clock, *self.axis.others] if self.axis is not None else []
        are_numbers = all(one.base == 10 and one.kind not in ("text", "date+time") for one in clocks)
        is_plain = form.decimal == "." and form.separator != " " and not (form.marks or form.has_lines)
        return are_numbers and is_plain and not self._hexadecimal and is_fast()

    def _texts(
        self, file: BinaryIO, skip: int, names: Sequence[str], odd: list[Any], damage: list[FileDamage]
    ) -> "Iterator[pa.RecordBatch]":
        """The columns as text."""
        import pyarrow as pa
        import pyarrow.csv

        def leave_out(row: Any) -> str:
            odd.append(row)
            return "skip"

        reading = pa.csv.ReadOptions(block_size=BLOCK_BYTES, skip_rows=skip, column_names=self.names, use_threads=False)
        parsing = pa.csv.ParseOptions(
            delimiter=self.form.separator, invalid_row_handler=leave_out, newlines_in_values=self.form.has_lines
        )
        types = pa.csv.ConvertOptions(column_types=dict.fromkeys(self.names, pa.string()), include_columns=list(names))
        text = Utf8(file, damage, self.form.marks, squeeze=self.form.separator == " ")
        with pa.csv.open_csv(text, reading, parsing, types) as reader:
            yield from reader

    def _converted(
        self, batch: "pa.RecordBatch", axis: TimeAxis, parsed: int, known_before: int, done: float
    ) -> TableRows:
        """Rows of a batch: those with a time, in an export of ours also those that have only an arrival."""
        clock, decimal = axis.clock, self.form.decimal
        if clock.kind == "rows":
            raw, whole_ns = np.arange(parsed, parsed + len(batch)) * clock.factors[0], None
        else:
            own = [batch.column(column) for column in clock.columns]
            cells = times_of(clock, own, decimal, is_exact=True, rest=self._rest(batch, 0))
            raw, whole_ns = cells.values, cells.ns
            for column in clock.columns[:1]:
                self._unreadable.note(column, batch.column(column), cells, parsed)
        time = np.full(len(batch), np.nan)
        has_time = np.isfinite(raw)
        time[has_time] = axis.times(raw[has_time], known_before)
        time_ns = whole_ns
        if whole_ns is not None and not (is_whole := time == raw).all():
            time_ns = np.where(is_whole, whole_ns, nanoseconds(time))
        arrival, arrival_ns = time, time_ns
        if self.arrival_column is not None:
            arrival, arrival_ns = self._arrivals(batch, axis)
            has_none = np.isnan(arrival)
            if has_none.any() and arrival_ns is not None:
                arrival_ns = np.where(has_none, nanoseconds(time) if time_ns is None else time_ns, arrival_ns)
            arrival = np.where(has_none, time, arrival)
        is_known = np.isfinite(arrival) if self.is_export else has_time
        known: Any = slice(None) if is_known.all() else is_known  # a slice copies nothing
        is_filled = np.zeros(np.count_nonzero(~is_known), np.bool_)
        columns: dict[str, tuple[Floats, str]] = {}
        for i, (name, heading) in enumerate(zip(self.names, self.headings, strict=True)):
            if i in (*clock.columns, self.arrival_column, self._segment) or i in self.left_out:
                continue
            of_clock = next(
                (one for one in axis.others if one.kind in ("text", "date+time") and i in one.columns), None
            )
            if of_clock is not None:
                if i == of_clock.columns[0]:
                    others = [batch.column(column) for column in of_clock.columns]
                    columns[of_clock.name] = (times_of(of_clock, others, decimal).values[known], "s")
                continue
            matches = digits(batch.column(i)) if i in self._hexadecimal else numbers(batch.column(i), decimal)
            self._unreadable.note(i, batch.column(i), matches, parsed)
            scale, unit = self._scales[i]
            columns[name] = (matches.values[known] * scale if unit else matches.values[known], unit or heading.unit)
            if len(is_filled):
                is_filled |= np.isfinite(matches.values[~is_known])
        self._timeless += int(np.count_nonzero(is_filled))
        if axis.keeps_clock:
            columns[f"{axis.name} (clock)" if axis.name in columns else axis.name] = (raw[known], "s")
        frames = {name: one.frame for name, one in zip(self.names, self.headings, strict=True) if one.frame}
        segment = None if self._segment is None else numbers(batch.column(self._segment), decimal).values[known]
        exact = (None if one is None else one[known] for one in (time_ns, arrival_ns))
        return TableRows(self.path.stem, time[known], arrival[known], columns, done, frames, segment, *exact)

    @property
    def _timed(self) -> list[int]:
        """Columns that are read to their last digit: that of the clock, then that of the arrivals."""
        columns = [] if self.axis is None else [*self.axis.clock.columns[:1], self.arrival_column]
        return [i for i in columns if i is not None]

    def _rest(self, batch: "pa.RecordBatch", number: int) -> "pa.Array | None":
        """Remainders of a column of `_timed`, which its float64 lack; None where it is text."""
        at = len(self.names) + number
        return batch.column(at) if batch.num_columns > at else None

    def _arrivals(self, batch: "pa.RecordBatch", axis: TimeAxis) -> tuple[Floats, Ints | None]:
        assert self.arrival_column is not None
        unit = SPELLINGS.get(self.headings[self.arrival_column].unit.lower(), "")
        factor = UNITS[unit] if unit else axis.clock.factors[-1] if axis.clock.kind == "number" else 1.0
        column = batch.column(self.arrival_column)
        clock = TableClock("", (self.arrival_column,), "number", factors=(factor,), epoch="start")
        cells = times_of(clock, [column], self.form.decimal, is_exact=True, rest=self._rest(batch, 1))
        return cells.values + axis.origin, cells.ns if not axis.origin else None

    # -- what cannot be read -------------------------------------------------------------------------------------------

    def _report(self, odd: Sequence[Any]) -> None:
        if odd:
            lines = f"{counted(len(odd), 'line does', 'lines do')} not have {counted(len(self.names), 'field')}"
            self.damage.append(FileDamage(-1, f"{lines} and {plural(len(odd), 'was', 'were')} skipped."))
        if self.form.unused:
            there = f"The heading has {self.form.columns + self.form.unused} names, the rows {self.form.columns} cells"
            self.damage.append(FileDamage(-1, f"{there}: the first names are taken."))
        if self.form.odd_units:
            odd = ", ".join(f"{text!r:.40} ({self.names[i]})" for i, text in self.form.odd_units.items())
            self.damage.append(remark(f"Words in the line of units that are not units are left out: {odd}."))
        if self._timeless and self.axis is not None:
            rows = counted(self._timeless, "row has no time and is", "rows have no time and are")
            self.damage.append(FileDamage(-1, f"{rows} left out ({self.axis.name})."))
        if words := self.unreadable():
            self.damage.append(FileDamage(-1, words))
        if words := self._unreadable.rounded():
            self.damage.append(remark(words))

    def unreadable(self) -> str:
        """A sentence on unreadable cells, by column and row; "" if there are none."""
        return self._unreadable.sentence(self.axis.clock.columns if self.axis is not None else ())

    def texts(self) -> Mapping[str, str]:
        return {self.names[i]: text for i, text in self._unreadable.texts().items()}


def is_rate_name(name: str) -> bool:
    """Whether a value with this name in lower case is a sampling rate."""
    return _RATE_NAME.match(name) is not None


def _head_rate(form: TableFormat) -> float:
    """Sampling rate in the head of a file, Hz; 0 without one."""
    for full, text in form.metadata.items():
        name, unit = full, ""
        if (bracketed := _UNIT_OF_NAME.match(full)) is not None:
            name, unit = bracketed[1], bracketed[2]
        text = f"{text} {unit}" if is_number(text) and unit else text
        match = _RATE.match(text) if _RATE_NAME.match(name) else None
        if match is not None and (number := float(match[1])) > 0:
            return 1000 / number if match[2] == "ms" else number
        match = _INTERVAL.match(text) if _INTERVAL_NAME.match(name) else None
        if match is not None and (number := float(match[1])) > 0:
            return 1 / (number * UNITS[SPELLINGS[match[2].lower()]])
    return 0.0
