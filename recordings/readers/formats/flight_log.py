"""Logs of flight controllers: records of many kinds, each a table, with the time since the controller started.

The clock is dated by a fix of a GNSS receiver in the log, else as a table is (recordings/tables/clocks/axis.py). Where
it goes back a segment begins (log_clock.py), and the clock itself is a column of each table.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Ints
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats.log_clock import LogClock
from imuscope.recordings.sources import FileDamage, remark
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.tables.clock import TableClock
from imuscope.recordings.tables.clocks.axis import TimeAxis, origin_of
from imuscope.recordings.tables.clocks.steps import ClockWatch
from imuscope.recordings.tables.format import TableFormat
from imuscope.recordings.tables.table_rows import TableRows
from imuscope.recordings.tables.table_source import TableSource

BLOCK_BYTES = 8 << 20
MOST_TABLES, MOST_COLUMNS = 512, 256
MOST_DAMAGE = 100
UNDATED_S = 946_684_800.0  # 2000-01-01: a receiver that gives an earlier time has no fix
LONGEST_S = 1e9  # since the start; a later time is damage
DATED_WITHIN_BYTES = 256 << 20


@dataclass(frozen=True, slots=True)
class LogColumn:
    """A column of a table.

    Args:
        heading: its name.
        name: of the field in the records.
        index: of an element, if the field is an array.
        factor: by which the numbers are multiplied.
    """

    heading: str
    name: str
    index: int | None = None
    unit: str = ""
    factor: float = 1.0

    def values(self, records: NDArray[Any]) -> NDArray[np.float64]:
        """Its numbers in some records."""
        values = records[self.name] if self.index is None else records[self.name][:, self.index]
        with np.errstate(all="ignore"):  # damaged records hold anything
            return values.astype(np.float64) * self.factor if self.factor != 1.0 else values.astype(np.float64)


@dataclass(frozen=True, slots=True)
class LogTable:
    """A kind of records.

    Args:
        dtype: of a whole record.
        time: its time since the start, s.
        instance: a field with the number of the sensor, if there are several of its kind; "" if there is none.
    """

    name: str
    dtype: np.dtype[Any]
    time: LogColumn
    columns: Sequence[LogColumn]
    instance: str = ""


@dataclass(slots=True)
class LogBlock:
    """Records that were read together.

    Args:
        records: bytes of whole records by table.
        done: share of the file read, 0..1.
        places: order of the records of a table among all of the block; without it none of them is before another.
    """

    records: Mapping[str, bytes]
    done: float
    places: Mapping[str, Ints] = field(default_factory=dict)


class Records:
    """Records of a log, gathered by the number of their kind, and their order."""

    def __init__(self) -> None:
        self._gathered: dict[int, list[bytes]] = {}
        self._order: list[int] = []

    def take(self, data: bytes, offset: int) -> int:
        """Read all whole records from a place in the file on; returns how many bytes they have."""
        raise NotImplementedError

    def block(self, done: float) -> LogBlock:
        """The records since the last call, by table."""
        blocks: dict[str, bytes] = {}
        places: dict[str, Ints] = {}
        order = np.array(self._order, np.int64)
        self._order.clear()
        for kind, records in self._gathered.items():
            if not records:
                continue
            if (table := self._table_of(kind)) is not None:
                blocks[table.name] = blocks.get(table.name, b"") + self._joined(table, records)
                before = places.get(table.name, order[:0])
                places[table.name] = np.concatenate((before, np.flatnonzero(order == kind)))
            records.clear()
        return LogBlock(blocks, done, places)

    def _table_of(self, kind: int) -> LogTable | None:
        """The table of a kind; None if its records are left out."""
        raise NotImplementedError

    def _joined(self, table: LogTable, records: list[bytes]) -> bytes:
        return b"".join(records)


@dataclass(frozen=True, slots=True)
class DatedBy:
    """Time since the start and UTC at one moment, s, and where both come from."""

    clock: float
    utc: float
    by: str


@dataclass(slots=True)
class _Progress:
    """The last time of each table, and how often its clock goes back."""

    last: dict[str, float] = field(default_factory=dict)
    back: dict[str, tuple[int, float]] = field(default_factory=dict)

    def add(self, name: str, times: NDArray[np.float64]) -> None:
        steps = np.diff(times, prepend=self.last.get(name, times[0]))
        self.last[name] = float(times[-1])
        if (steps < 0).any():
            count, by = self.back.get(name, (0, 0.0))
            self.back[name] = count + int((steps < 0).sum()), min(by, float(steps.min()))


@dataclass(frozen=True, slots=True)
class _Kind:
    """Records of one table and sensor in a block, with their times, s, and places in the file.

    Args:
        odd: number of records that were left out because of an impossible time.
    """

    title: str
    table: LogTable
    records: NDArray[Any]
    clock: NDArray[np.float64]
    places: Ints
    odd: int = 0

    def plausible(self) -> "_Kind":
        """Those with a possible time."""
        usual = self.clock < LONGEST_S
        if usual.all():
            return self
        rest = self.records[usual], self.clock[usual], self.places[usual]
        return _Kind(self.title, self.table, *rest, int(np.count_nonzero(~usual)))


class FlightLog(TableSource):
    """A log. Subclasses read its blocks.

    Attributes:
        tables: those known so far; complete for the records of a block when it is yielded.
        left_out: kinds of records without numbers.

    Raises:
        RecordingError: it has no records with a time.
    """

    clock_name = "timestamp"

    def __init__(self, path: Path, format_name: str) -> None:
        super().__init__(path, format_name)
        self.tables: dict[str, LogTable] = {}
        self.left_out: dict[str, None] = {}
        fix = self.fix()
        first = self._first_time()
        clock = TableClock(self.clock_name, (), "number", "µs", (1e-6,), "start", "stated", "the format defines it")
        if fix is not None:
            origin, dated_by = fix.utc - fix.clock, fix.by
        else:
            empty = TableFormat(0, ",", ".", (), (), 0)
            origin, dated_by = origin_of(clock, first, empty, path)
        self.timed = fix is not None
        self.axis = TimeAxis(clock, (), origin, dated_by, 0.0)

    def blocks(self) -> Iterator[LogBlock]:
        """All records in the order of the file."""
        raise NotImplementedError

    def read(self, records: Records, begin: int, ends: Callable[[bytes], bool]) -> Iterator[LogBlock]:
        """The blocks of a file.

        Args:
            begin: where the records do.
            ends: whether the bytes behind the last whole record are a natural end of the file.
        """
        self.damage.clear()
        size = max(self.path.stat().st_size, 1)
        with open_regular(self.path) as file:
            file.seek(begin)
            held, at = b"", begin
            while data := file.read(BLOCK_BYTES):
                held += data
                used = records.take(held, at)
                held, at = held[used:], at + used
                yield records.block(at / size)
        if not ends(held):
            self.note(at, "The last record was cut.")

    def fix(self) -> DatedBy | None:
        """The first moment of which UTC is known: a fix of a receiver, unless a format has something else."""
        for block in self.blocks():
            for name, data in block.records.items():
                records = self._records(self.tables[name], data)
                dated = self.dated(self.tables[name], records)
                if dated is not None and dated.utc > UNDATED_S:
                    return dated
            if block.done * self.path.stat().st_size > DATED_WITHIN_BYTES:
                break
        return None

    def dated(self, table: LogTable, records: NDArray[Any]) -> DatedBy | None:
        """A fix in some records."""
        return None

    def _first_time(self) -> float:
        for block in self.blocks():
            times = [
                float(self.tables[name].time.values(self._records(self.tables[name], data))[0])
                for name, data in block.records.items()
            ]
            if times:
                return min(times)
        hint = self.damage[0].words if self.damage else "It was cut, or is empty."
        raise RecordingError(f"{self.path.name} has no records with a time.", hint)

    def _kinds(self) -> Iterator[tuple[LogBlock, list[_Kind]]]:
        """Blocks, and the records in each by table and instance."""
        first = 0
        for block in self.blocks():
            kinds = []
            most = 0
            for name, data in block.records.items():
                table = self.tables[name]
                records = self._records(table, data)
                places = block.places.get(name, np.zeros(len(records), np.int64)) + first
                most = max(most, int(places.max()) + 1 - first) if len(places) else most
                for title, which in _instances(table, records):
                    some = _Kind(title, table, records[which], table.time.values(records[which]), places[which])
                    kinds.append(some.plausible())
            first += most
            yield block, kinds

    def _watched(self) -> ClockWatch:
        """The steps of the clock, from a first pass over all records."""
        search = LogClock()
        for _, kinds in self._kinds():
            search.feed({one.title: (one.clock, one.places) for one in kinds})
        return search.watch

    def rows(self) -> Iterator[TableRows]:
        assert self.axis is not None
        if self.axis.watch is None:
            self.axis.watch = self._watched()
        shifts = self.axis.watch.shifts
        steps, moved = np.array([row for row, _ in shifts]), np.array([shift for _, shift in shifts])
        self.damage.clear()
        progress, odd = _Progress(), 0
        for block, kinds in self._kinds():
            for kind in kinds:
                odd += kind.odd
                if not len(kind.clock):
                    continue
                progress.add(kind.title, kind.clock)
                time = kind.clock + self.axis.origin
                columns = {one.heading: (one.values(kind.records), one.unit) for one in kind.table.columns}
                if self.axis.keeps_clock:
                    time = time + moved[np.searchsorted(steps, kind.places, "right") - 1]
                    name = self.clock_name
                    columns[f"{name} (clock)" if name in columns else name] = (kind.clock, "s")
                yield TableRows(kind.title, time, time, columns, min(block.done, 1.0))
        for title, (count, by) in progress.back.items():
            words = f"{title}: {self.clock_name} goes back {count} times, by up to {-by:.6g} s."
            self.damage.append(remark(words))
        if odd:
            self.damage.append(FileDamage(-1, f"Records with an impossible time are left out: {odd}."))
        if self.left_out:
            self.damage.append(remark(f"Left out: {', '.join(self.left_out)}."))

    def note(self, at: int, words: str) -> None:
        if len(self.damage) < MOST_DAMAGE:
            self.damage.append(FileDamage(at, words))

    @staticmethod
    def _records(table: LogTable, data: bytes) -> NDArray[Any]:
        return np.frombuffer(data, table.dtype)


def _instances(table: LogTable, records: NDArray[Any]) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Name of the table of each sensor, with the mask of its records."""
    if not table.instance:
        yield table.name, np.ones(len(records), np.bool_)
        return
    numbers = records[table.instance]
    for number in np.unique(numbers).tolist():
        yield f"{table.name}[{number}]", numbers == number
