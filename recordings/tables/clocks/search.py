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

from dataclasses import replace

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.tables.clock import TableClock
from imuscope.recordings.tables.clocks import names
from imuscope.recordings.tables.clocks.dates import date_clocks, part_clocks, stamp_clocks, text_clock, unnamed_stamps
from imuscope.recordings.tables.clocks.numbers import (
    counter_clocks,
    fine_clock,
    is_of_day,
    number_clock,
    row_clock,
    unnamed_clocks,
)
from imuscope.recordings.tables.clocks.parts import complete_clock
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.clocks.weeks import of_gps, week_clocks
from imuscope.recordings.tables.dates import order_of
from imuscope.recordings.tables.options import NO_COLUMN
from imuscope.recordings.tables.time_units import SPELLINGS


def clocks_of(sample: TableSample) -> list[TableClock]:
    """All clocks, the best first."""
    options = sample.options
    if options.time_column == NO_COLUMN:
        return [row_clock(sample)]
    if options.time_column:
        chosen = complete_clock(sample, _chosen(sample, sample.column_named(options.time_column)))
        return [chosen, *_others(sample, chosen)]
    return _all(sample)


def _others(sample: TableSample, chosen: TableClock) -> list[TableClock]:
    """Clocks besides one that was named; none if one of them would need a further option."""
    try:
        return [one for one in _all(sample) if not {*one.columns} & {*chosen.columns}]
    except RecordingError:
        return []


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
    if sample.rate and all(_is_constant(sample, one) for one in matches):
        matches = [row_clock(sample)]
    complete = [complete_clock(sample, one) for one in matches]
    whole = [{*one.columns} for one in complete if one.part]
    dated = [of_gps(sample, one) for one in complete if not any({*one.columns} < columns for columns in whole)]
    filled = {one.columns: _filled(sample, one) for one in dated}
    most = max(filled.values(), default=0)

    def order(one: TableClock) -> tuple[bool, bool, bool, int, tuple[int, ...]]:
        is_sparse = 2 * filled[one.columns] < most
        return _is_constant(sample, one), is_sparse, _stands(sample, one), one.rank, one.columns

    return sorted(dated, key=order)


def _filled(sample: TableSample, clock: TableClock) -> int:
    """Rows with a time of a clock."""
    return sum(all(row[column].strip() for column in clock.columns) for row in sample.form.sample)


def _is_constant(sample: TableSample, clock: TableClock) -> bool:
    """Whether all rows have one time, as where a program had none to write."""
    rows = sample.form.sample
    return len(rows) >= names.FEWEST and len({tuple(row[column] for column in clock.columns) for row in rows}) == 1


def _stands(sample: TableSample, clock: TableClock) -> bool:
    """Whether most rows repeat the time of the row before, in a clock of whole seconds."""
    rows = ["\t".join(row[column] for column in clock.columns) for row in sample.form.sample]
    is_coarse = clock.unit in ("", "s") and not any(map(names.DECIMALS.search, rows))
    return is_coarse and len(rows) >= names.FEWEST and len(set(rows)) < len(rows) / 2


def _chosen(sample: TableSample, column: int) -> TableClock:
    for one in (*stamp_clocks(sample), *date_clocks(sample), *week_clocks(sample)):
        if column in one.columns:
            return replace(one, rank=0)
    matches = _of_name(sample, column)
    if matches is None:
        counters = [one for one in counter_clocks(sample) if column in one.columns]
        matches = counters[0] if counters else number_clock(sample, column, 0)
    return replace(matches, rank=0, why=f"{matches.why}; chosen from others")


def _of_name(sample: TableSample, column: int) -> TableClock | None:
    heading = sample.headings[column]
    words = names.words_of(heading.name)
    if words == names.FINE and sample.cells(column):
        return fine_clock(sample, column)
    is_ros = heading.name.startswith("%") or words.endswith("header_stamp")
    last = names.words_of(heading.name.rpartition(".")[2])  # of a structure: ref.t
    is_inner = "." in heading.name and names.TIMES.match(last) is not None and sample.rises(column)
    is_named = is_ros or is_inner or is_of_day(heading)
    is_named = is_named or any(one.match(words) for one in (names.TIME, names.ELAPSED, names.TIMES))
    if not (is_named or (words in SPELLINGS and sample.rises(column))) or (
        words == "t" and names.has_odd_unit(heading)
    ):  # a temperature
        return None
    rank = 1 if words.endswith("header_stamp") else 2 if names.is_plain(heading) or is_ros else 3
    rank += bool(names.OF_HOST.match(words))
    if heading.name.lower() == "arrival" or (rank == 1 and not sample.advances((column,))):
        return None
    if not sample.cells(column) and len(sample.form.sample) >= names.FEWEST:  # the program had no time to write
        return None
    return text_clock(sample, column, rank) if sample.is_text(column) else number_clock(sample, column, rank)
