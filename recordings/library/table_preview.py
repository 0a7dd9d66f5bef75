"""First rows of a table as they will be read: time column, unit, rate, decimal sign, separator, vectors and units.

A table that leaves something open is shown all the same, with the question (`AmbiguousTableError`): its columns and
rows as far as they are known, and the rate for each unit that its times can have.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.previewed_table import PreviewColumn, Role, TablePreview, TableQuestion, UnitChoice
from imuscope.recordings.library.probe import probe
from imuscope.recordings.library.recording_probe import RecordingProbe
from imuscope.recordings.sources import Source
from imuscope.recordings.tables.cells import numbers, sample_times
from imuscope.recordings.tables.clock import AmbiguousTableError, TableClock
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.format import has_rows
from imuscope.recordings.tables.headings import axis_of, grouped
from imuscope.recordings.tables.options import NO_COLUMN, TableOptions
from imuscope.recordings.tables.table_source import NOW_S, CsvSource, TableSource
from imuscope.recordings.tables.time_units import UNITS, mean_step, usual_step

FIRST_ROWS = 8


def table_of(source: Source) -> CsvSource | None:
    """The table of a source, the first of an archive; None if it is not one."""
    if isinstance(source, TableSource) and source.members:
        return table_of(source.members[0])
    return source if isinstance(source, CsvSource) else None


def question_of(path: Path) -> TableQuestion | None:
    """Open question of the table at `path`, with the choices stored with it; None if it can be read.

    Raises:
        RecordingError: it cannot be opened for another reason.
    """
    try:
        table = table_of(open_file(path))
        question = table.refusal if table is not None else None
    except AmbiguousTableError as error:
        question = error
    return TableQuestion(question.about, question.message) if isinstance(question, AmbiguousTableError) else None


def heading_of(path: Path) -> list[str]:
    """Heading of the table at `path`; [] if it is not a table, or cannot be opened."""
    try:
        table = table_of(open_file(path))
    except (OSError, RecordingError):
        return []
    return list(table.form.headings) if table is not None else []


def check_upload(path: Path) -> RecordingProbe | None:
    """Metadata of a file that can be opened, or that is a table of numbers which only lacks an option.

    Raises:
        RecordingError: it is neither.
    """
    try:
        open_file(path)
    except AmbiguousTableError:
        if not has_rows(path):
            raise
    return probe(path)


def preview_of(path: Path, options: TableOptions) -> TablePreview | None:
    """The table at `path` as it is read with these options alone; None without a table.

    Raises:
        RecordingError: it cannot be opened.
    """
    question: AmbiguousTableError | None = None
    try:
        table = table_of(open_file(path, table=options, is_complete=True))
    except AmbiguousTableError as error:  # its columns and rows can be shown by counting them
        question = error
        counting = replace(options, time_column=NO_COLUMN, rate=1.0)
        table = table_of(open_file(path, table=counting, is_complete=True))
    if table is None:
        return None
    refusal = table.refusal if question is None else question
    if refusal is not None and not isinstance(refusal, AmbiguousTableError):
        raise refusal
    return _preview(table, refusal, options)


def _preview(table: CsvSource, question: AmbiguousTableError | None, options: TableOptions) -> TablePreview:
    axis = table.axis if question is None else None
    open_clock = question.clock if question is not None else None
    clock = open_clock or (axis.clock if axis is not None else None)
    others = list(axis.others) if axis is not None else []
    names = {one.name: table.option_of(one) for one in (clock, *others) if one is not None and one.columns}
    rows_are_counted = clock is not None and clock.kind == "rows"
    return TablePreview(
        table.form.separator,
        table.form.decimal,
        table.form.skip,
        _columns(table, clock, others),
        names,
        clock.name if clock is not None else "",
        NO_COLUMN if rows_are_counted else names.get(clock.name, "") if clock is not None else "",
        _units(table, clock, options),
        clock.unit if clock is not None else "",
        1 / axis.usual_s if axis is not None and axis.usual_s else None,
        axis.clock.epoch if axis is not None else "",
        axis.clock.sure if axis is not None else "",
        axis.sentences() if axis is not None else [],
        _times(table) if axis is not None else [None] * len(table.form.sample[:FIRST_ROWS]),
        _rows(table, clock, others),
        question.about if question is not None else "",
        question.message if question is not None else "",
        question.hint if question is not None else "",
        list(table.form.headings),
        axis.packets.stamp if axis is not None and axis.packets is not None else "",
    )


def _columns(table: CsvSource, clock: TableClock | None, others: list[TableClock]) -> list[PreviewColumn]:
    roles: dict[int, Role] = {column: "clock" for one in others for column in one.columns}
    roles |= dict.fromkeys(clock.columns if clock is not None else (), "time")
    roles |= {} if table.arrival_column is None else {table.arrival_column: "arrival"}
    roles |= dict.fromkeys(table.left_out, "left out")
    vectors = {
        name: (group, axis_of(inner, len(members)) or inner)
        for group, members in grouped([one for i, one in enumerate(table.names) if roles.get(i, "value") == "value"])
        for name, inner in members
        if len(members) > 1
    }
    plain = list(table.form.headings) or [""] * table.form.columns
    return [
        PreviewColumn(i + 1, plain[i].strip(), name, heading.unit, *vectors.get(name, ("", "")), roles.get(i, "value"))
        for i, (name, heading) in enumerate(zip(table.names, table.headings, strict=True))
    ]


def _units(table: CsvSource, clock: TableClock | None, options: TableOptions) -> list[UnitChoice]:
    """Units for a column of plain numbers."""
    if clock is None or clock.kind != "number" or len(clock.columns) != 1:
        return []
    newest = table.path.stat().st_mtime + NOW_S
    values = TableSample(table.path.name, table.form, table.headings, options, newest).numbers(clock.columns[0])
    step = mean_step(values) or usual_step(values)
    plausible = {one.unit for one in clock.readings} or {clock.unit}
    return [UnitChoice(unit, 1 / (step * s) if step else None, unit in plausible) for unit, s in UNITS.items()]


def _times(table: CsvSource) -> list[float | None]:
    assert table.axis is not None
    values = sample_times(table.axis.clock, table.form.sample[:FIRST_ROWS], table.form.decimal)
    known = np.isfinite(values)
    values[known] = table.axis.times(values[known], 0)
    return [float(one) if math.isfinite(one) else None for one in values]


def _rows(table: CsvSource, clock: TableClock | None, others: list[TableClock]) -> list[list[str | float | None]]:
    import pyarrow as pa

    sample = table.form.sample[:FIRST_ROWS]
    texts = {column for one in (clock, *others) if one is not None for column in one.columns}
    read: list[list[str | float | None]] = []
    for i in range(table.form.columns):
        cells = [row[i] for row in sample]
        if i in texts:
            read.append([cell.strip() for cell in cells])
            continue
        values = numbers(pa.array(cells, pa.string()), table.form.decimal).values
        read.append([float(one) if math.isfinite(one) else None for one in values])
    return [list(row) for row in zip(*read, strict=True)]
