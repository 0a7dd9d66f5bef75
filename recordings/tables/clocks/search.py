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
reported with the reason; one that remains open is settled by another clock, or is an error that names the options. A
clock that is far finer and more even than the first one becomes the axis instead (evenness.py).
Times in whole seconds may have their parts of a second in a column of their own (time, and ms from 0 to 999).
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from imuscope.protocols.registry.families import unit_flag
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.tables.cells import are_hexadecimal, sample_times
from imuscope.recordings.tables.clock import FEWEST_ROWS, MOST_TIMES, AmbiguousTableError, TableClock, few_times
from imuscope.recordings.tables.clocks import names
from imuscope.recordings.tables.clocks.dates import (
    date_clocks,
    of_gps,
    part_clocks,
    stamp_clocks,
    text_clock,
    unnamed_stamps,
    week_clocks,
)
from imuscope.recordings.tables.clocks.evenness import evenest
from imuscope.recordings.tables.clocks.numbers import (
    counter_clocks,
    fine_clock,
    is_of_day,
    number_clock,
    row_clock,
    unnamed_clocks,
)
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.dates import WEEK_S, order_of
from imuscope.recordings.tables.options import NO_COLUMN
from imuscope.recordings.tables.time_units import RATE_TOLERANCE, SPELLINGS, UNITS, rate_text, usual_step

MOST_NAMED = 4
MAX_STEP_RATIO = 1.5  # longest of nearly all steps, in shortest ones


def axis_of_table(sample: TableSample) -> tuple[TableClock, list[TableClock]]:
    """The clock that is the axis, and the others.

    Raises:
        RecordingError: there is none, or its unit is open.
    """
    clocks = _clocks_of(sample)
    if not clocks:
        listed = [one.text for one in sample.headings]
        empty = [listed[i] for i, one in enumerate(sample.headings) if names.is_plain(one) and not sample.cells(i)]
        if empty:
            hint = f"{empty[0]} is empty in all rows. Give --rate, or another column with --time-column."
        elif sample.form.headings:
            hint = "Name one time, with its unit: time (s), or give --time-column or --rate."
            hint += f" There are: {', '.join(listed)[:300]}."
        else:
            hint = f"It has no heading either: {_hint_without_heading(sample)}"
        raise AmbiguousTableError(f"{sample.file} has no column of times.", hint, "time")
    axis, *others = clocks
    _check_digits(sample, axis)
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
    if not sample.options.time_column:
        axis, others = evenest(sample, axis, others)
    if sample.options.rate and axis.kind in ("number", "parts"):
        _check_rate(sample, axis)
    return axis, others


def _check_digits(sample: TableSample, axis: TableClock) -> None:
    """Refuse numbers that have lost their digits: no unit of them is right.

    Raises:
        AmbiguousTableError: many rows have one or two times, in no known unit or with an exponent.
    """
    cells = sample.cells(axis.columns[0]) if axis.kind == "number" else []
    times = {*cells}
    mantissas = [cell.lower().partition("e") for cell in times]
    digits = max((sum(map(str.isdigit, one)) for one, mark, _ in mantissas if mark), default=0)
    if len(cells) < FEWEST_ROWS or len(times) > MOST_TIMES or not (axis.is_open or digits):
        return
    written = f", written with {digits} digits" if digits else ""
    raise few_times(sample.file, axis.name, len(times), len(cells), written)


def _hint_without_heading(sample: TableSample) -> str:
    """The remedy for a table without names, by what its columns look like."""
    width = len(sample.headings)
    rising = [column for column in range(width) if sample.rises(column)]
    for week in (column - 1 for column in rising):
        numbers, seconds = sample.numbers(week) if week >= 0 else np.zeros(0), sample.numbers(week + 1)
        if len(numbers) and sample.is_gps_week(numbers) and seconds.min() >= 0 and seconds.max() < WEEK_S:
            lines = f'"{week + 1} = week" and "{week + 2} = tow (s)"'
            likeness = f"columns {week + 1} and {week + 2} look like a GPS week and the seconds of it"
            return (
                f"{likeness}. If they are, give --columns FILE, with the lines {lines}; else --time-column or --rate."
            )
    if rising:
        columns = ", ".join(str(column + 1) for column in rising[:MOST_NAMED])
        what = f"rising from row to row: column {columns}"
        return f"{what}. If that is the time, give --time-column {rising[0] + 1}; else --rate."
    return "name its sampling rate with --rate, and the columns with --columns."


def _runs_evenly(sample: TableSample, column: int) -> bool:
    """Whether the numbers of a column rise in nearly equal steps."""
    steps = np.diff(sample.numbers(column)) if sample.rises(column) else np.zeros(0)
    return len(steps) > 0 and float(np.quantile(steps, 0.9)) < MAX_STEP_RATIO * float(np.quantile(steps, 0.1))


def _by_another(sample: TableSample, axis: TableClock, others: Sequence[TableClock]) -> TableClock | None:
    """The axis with the unit in which it runs like another clock."""
    values = sample.numbers(axis.columns[0])
    if len(values) < names.MIN_ROWS or not np.ptp(values):
        return None
    for other in (one for one in others if not one.is_open and one.kind in ("number", "counter")):
        theirs = sample.numbers(other.columns[0])
        ratio = float(np.ptp(theirs)) * other.factors[0] / float(np.ptp(values)) if len(theirs) == len(values) else 0.0
        for unit, factor in UNITS.items():
            if abs(ratio / factor - 1) < RATE_TOLERANCE:
                epoch, why = sample.epoch(float(values[0]) * factor), f"so it runs like {other.name}"
                return replace(axis, unit=unit, factors=(factor,), epoch=epoch, sure="inferred", why=why, readings=())
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
    both = zip(axis.columns, axis.factors, strict=True)
    values = np.sum([sample.numbers(column) * factor for column, factor in both], axis=0)
    step = usual_step(values)
    if step and abs(1 / step - sample.options.rate) > RATE_TOLERANCE * sample.options.rate:
        words = f"{sample.file}: {axis.name} in {axis.unit} has {rate_text(1 / step)}, not {sample.options.rate:g} Hz."
        hint = f"Leave --rate out, or give --time-column {NO_COLUMN} to count the rows instead."
        raise AmbiguousTableError(words, hint, "rate")


def _clocks_of(sample: TableSample) -> list[TableClock]:
    """All clocks, the best first: the one that is named, besides it none if one of them would need a further option."""
    column = sample.options.time_column
    if column == NO_COLUMN:
        return [row_clock(sample)]
    if not column:
        return _all(sample)
    chosen = _complete(sample, _chosen(sample, sample.column_named(column)))
    try:
        return [chosen, *(one for one in _all(sample) if not {*one.columns} & {*chosen.columns})]
    except RecordingError:
        return [chosen]


class _Evidence(NamedTuple):
    """Evidence for a clock in its cells.

    Args:
        filled: rows with a time.
        is_constant: whether all rows have one time, as where a program had none to write.
        stands: whether most rows repeat the time of the row before, in a clock of whole seconds.
    """

    filled: int
    is_constant: bool
    stands: bool

    @classmethod
    def of(cls, sample: TableSample, clock: TableClock) -> "_Evidence":
        rows = [tuple(row[column] for column in clock.columns) for row in sample.form.sample]
        times = len({*rows}) if len(rows) >= names.MIN_ROWS else math.inf
        is_coarse = clock.unit in ("", "s") and not any(names.DECIMALS.search(cell) for row in rows for cell in row)
        return cls(sum(all(map(str.strip, row)) for row in rows), times == 1, is_coarse and times < len(rows) / 2)


def _all(sample: TableSample) -> list[TableClock]:
    """All clocks by form and name, the best first."""
    matches = [*stamp_clocks(sample), *date_clocks(sample), *week_clocks(sample), *part_clocks(sample)]
    used = {column for one in matches for column in one.columns}
    left = [column for column in range(len(sample.headings)) if column not in used]
    matches += [one for column in left if (one := _of_name(sample, column)) is not None]
    used |= {column for one in matches for column in one.columns}
    for column in left:
        if column not in used and sample.is_text(column) and len(cells := {*sample.cells(column)}) > 1:
            matches += [text_clock(sample, column, 4)] if order_of(cells, sample.newest)[0] or not matches else []
    matches += counter_clocks(sample)
    matches = matches or (unnamed_stamps(sample) if not sample.form.headings else [])
    matches = matches or unnamed_clocks(sample)
    if sample.rate and all(_Evidence.of(sample, one).is_constant for one in matches):
        matches = [row_clock(sample)]
    complete = [_complete(sample, one) for one in matches]
    whole = [{*one.columns} for one in complete if one.part]
    dated = [of_gps(sample, one) for one in complete if not any({*one.columns} < columns for columns in whole)]
    evidence = {one.columns: _Evidence.of(sample, one) for one in dated}
    most = max((one.filled for one in evidence.values()), default=0)

    def order(clock: TableClock) -> tuple[bool, bool, bool, int, tuple[int, ...]]:
        one = evidence[clock.columns]
        return one.is_constant, 2 * one.filled < most, one.stands, clock.rank, clock.columns

    return sorted(dated, key=order)


def _chosen(sample: TableSample, column: int) -> TableClock:
    """The clock of a column that the user names."""
    for one in (*stamp_clocks(sample), *date_clocks(sample), *week_clocks(sample)):
        if column in one.columns:
            return replace(one, rank=0)
    counters = (one for one in counter_clocks(sample) if column in one.columns)
    clock = _of_name(sample, column) or next(counters, None) or number_clock(sample, column, 0)
    return replace(clock, rank=0, why=f"{clock.why}; chosen from others")


def _of_name(sample: TableSample, column: int) -> TableClock | None:
    """The clock of a column whose heading names a time; None for any other."""
    heading, words = sample.headings[column], sample.words(column)
    has_cells = bool(sample.cells(column))
    if words == names.FINE and has_cells:
        return fine_clock(sample, column)
    is_stamp = words.endswith("header_stamp")
    is_ros = heading.name.startswith("%") or is_stamp
    last = names.words_of(heading.name.rpartition(".")[2])  # of a structure: ref.t
    is_inner = "." in heading.name and names.TIMES.match(last) is not None
    is_named = is_ros or is_of_day(heading) or any(one.match(words) for one in (names.TIME, names.ELAPSED, names.TIMES))
    if not is_named and not ((is_inner or words in SPELLINGS) and sample.rises(column)):
        return None
    if heading.name.lower() == "arrival" or (words == "t" and names.has_odd_unit(heading)):  # a temperature
        return None
    if not has_cells and len(sample.form.sample) >= names.MIN_ROWS:  # the program had no time to write
        return None
    rank = (1 if is_stamp else 2 if names.is_plain(heading) or is_ros else 3) + bool(names.OF_HOST.match(words))
    if rank == 1 and not sample.advances((column,)):
        return None
    return text_clock(sample, column, rank) if sample.is_text(column) else number_clock(sample, column, rank)


def _complete(sample: TableSample, clock: TableClock) -> TableClock:
    """A clock with the digits of its numbers, and with the column of its parts of a second."""
    if clock.kind == "number" and len(clock.columns) == 1 and are_hexadecimal(sample.cells(clock.columns[0])):
        return replace(clock, base=16, why=f"{clock.why}; its digits are hexadecimal")
    if clock.kind not in ("text", "date+time", "utc") and (clock.kind, clock.unit) != ("number", "s"):
        return clock
    for column, heading in enumerate(sample.headings):
        last, in_brackets = sample.words(column).rpartition("_")[2], heading.unit.strip().lower()
        unit = SPELLINGS.get(last, "") or SPELLINGS.get(in_brackets, "")
        factor = UNITS[unit or "s"]
        if factor < 1 and column not in clock.columns and _completes(sample, clock, column, factor):
            columns, factors = (*clock.columns, column), (*clock.factors, factor)
            name, why = f"{clock.name} + {heading.name}", f"{clock.why}, with {unit} in a column of their own"
            return replace(clock, name=name, columns=columns, factors=factors, why=why, part=factor)
    return clock


def _completes(sample: TableSample, clock: TableClock, column: int, factor: float) -> bool:
    """Whether times in whole seconds, several of which are equal, rise in every row with these parts."""
    rows, parts = sample.form.sample, sample.numbers(column)
    if len(rows) < names.MIN_ROWS or len(parts) != len(rows) or parts.min() < 0 or parts.max() * factor >= 1:
        return False
    seconds = sample_times(clock, rows, sample.form.decimal)
    if not np.isfinite(seconds).all() or (seconds != np.floor(seconds)).any() or (parts != np.floor(parts)).any():
        return False
    repeats = bool((np.diff(seconds) == 0).any())
    return repeats and bool((np.diff(seconds + parts * factor) > 0).mean() > names.MIN_RISING)
