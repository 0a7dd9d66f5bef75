"""Several tables as one file: those of an archive, each a message with the name of its file."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.sources import FileDamage, remark
from imuscope.recordings.tables.clocks.axis import LAST_CHANGE, TimeAxis
from imuscope.recordings.tables.dates import dated_name
from imuscope.recordings.tables.table_rows import TableRows
from imuscope.recordings.tables.table_source import TableSource


def _dated_by_a_clock(tables: Sequence[TableSource]) -> TimeAxis | None:
    """The axis of a table that has dates, too: $TIME rows of a FlySight relate its uptime to the time of GPS."""
    axes = [axis for one in tables if (axis := one.axis) is not None and axis.clock.epoch == "start"]
    return next((axis for axis in axes if any(other.name == axis.dated_by for other in axis.others)), None)


class TableSet(TableSource):
    """Tables of one archive.

    The axis is that of the first table; a different one of another table is listed with the damage.

    Args:
        path: of the archive.
    """

    def __init__(self, path: Path, tables: Sequence[TableSource]) -> None:
        super().__init__(path, tables[0].format)
        self.members = tables
        self._noted: list[FileDamage] = []
        self.axis = tables[0].axis
        self.timed = all(one.timed for one in tables)
        named = dated_name(path.name)
        for axis in (one.axis for one in tables):
            if axis is not None and named is not None and axis.dated_by == LAST_CHANGE and axis.clock.epoch == "start":
                axis.origin += named - path.stat().st_mtime
                axis.dated_by = "the file's name"
        known = _dated_by_a_clock(tables) or self.axis
        for axis in (one.axis for one in tables):  # one clock without a date has one zero, whenever its rows begin
            if axis is not None and known is not None and axis.dated_by and axis.clock.epoch == "start":
                same = (axis.name, axis.clock.unit) == (known.name, known.clock.unit)
                axis.origin, axis.dated_by = (known.origin, known.dated_by) if same else (axis.origin, axis.dated_by)

    def rows(self) -> Iterator[TableRows]:
        self._noted = self._noted or list(self.damage)
        self.damage[:] = self._noted
        count, refused = len(self.members), 0
        for number, table in enumerate(self.members):
            name = table.path.name
            try:
                for rows in table.rows():
                    yield replace(rows, done=(number + rows.done) / count)
            except RecordingError as error:
                refused += 1
                if refused == count:
                    raise  # none of them can be read
                self.damage.append(remark(f"{name} is left out: {error.text}"))
                continue
            self.damage += [replace(one, words=f"{name}: {one.words}") for one in table.damage]
            if number and table.axis is not None:
                self._note_axis(table)

    def _note_axis(self, table: TableSource) -> None:
        axis, first = table.axis, self.axis
        assert axis is not None
        if first is not None and (first.name, first.clock.unit) == (axis.name, axis.clock.unit):
            steps = axis.watch.steps if axis.watch is not None else []
            if not steps:
                return
        self.damage.append(remark(f"{table.path.name}: {' '.join(axis.sentences())}"))

    def unreadable(self) -> str:
        return next((words for one in self.members if (words := one.unreadable())), "")

    def texts(self) -> Mapping[str, str]:
        return {name: text for one in self.members for name, text in one.texts().items()}
