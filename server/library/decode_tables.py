"""Decoding of numeric files (CSV) into an opened recording; each table becomes a channel.

There are no bytes, so no decoder, clock mapping or losses: times are taken from the file, and the unit of a column from
its heading.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.clocks.unix_time import nanoseconds
from imuscope.recordings.columns.store import ChannelLayout, ColumnStore, ColumnStoreWriter
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.sources import damage_of, remark
from imuscope.recordings.tables.clocks.axis import TimeAxis
from imuscope.recordings.tables.clocks.steps import StepOfClock, step_words
from imuscope.recordings.tables.headings import axis_of, grouped
from imuscope.recordings.tables.table_rows import TableRows
from imuscope.recordings.tables.table_source import DEVICE, TableSource
from imuscope.server import wire
from imuscope.server.wire import codec as wire_codec

if TYPE_CHECKING:
    from imuscope.server.library.decode import ProgressPublisher

MOST_EVENTS = 100  # of the steps of one clock
MOST_NAMED = 10  # columns
BY_UNIT = -1  # decimals of a column
QUATERNION, EULER = ("q0", "q1", "q2", "q3"), ("roll", "pitch", "yaw")


class _Tables:
    """Channels of the tables read so far.

    Args:
        texts: the columns that have nothing but texts so far.
        is_export: whether rows in which a quantity is empty are none of its samples (TableSource).
    """

    def __init__(self, writer: ColumnStoreWriter, texts: Callable[[], Collection[str]], *, is_export: bool) -> None:
        self._texts = texts
        self._is_export = is_export
        self.infos: list[wire.ChannelInfo] = []
        self.counts: dict[str, int] = {}
        self.first, self.last = np.inf, -np.inf
        self.segments: dict[float, float] = {}  # number → its begin, of those that a file numbers
        self._writer = writer
        self._plans: dict[tuple[str, ...], list[tuple[int, list[str]]]] = {}  # by table and columns
        self._filled: set[int] = set()  # channels with a number
        self._whole: set[int] = set()  # channels that have only whole numbers

    def add(self, rows: TableRows) -> None:
        """Add a block of rows."""
        if not len(rows.time):
            return
        form = (rows.table, *rows.columns)
        plan = self._plans.get(form)
        if plan is None:
            plan = self._plans[form] = self._begin(rows)
        before = self.counts.get(rows.table, 0)
        place = np.arange(before, before + len(rows.time), dtype=np.float64)
        time = nanoseconds(rows.time) if rows.time_ns is None else rows.time_ns
        arrival = rows.arrival_ns
        if arrival is None:
            arrival = time if np.array_equal(rows.time, rows.arrival) else nanoseconds(rows.arrival)
        for number, headings in plan:
            columns = [rows.columns[name][0] for name in headings]
            there: Any = slice(None)
            if self._is_export and np.isnan(columns[0]).any():
                there = ~np.isnan(columns).all(axis=0)
            every = [arrival[there], time[there], *(column[there] for column in columns)]
            self._writer.append(number, every, place[there])
            if number not in self._filled and any(np.isfinite(column).any() for column in columns):
                self._filled.add(number)
            if number in self._whole and not all(map(_are_whole, columns)):
                self._whole.discard(number)
                for column in self.infos[number - 1].columns:
                    column.decimals = BY_UNIT
        if rows.segment is not None:
            for number in np.unique(rows.segment[rows.segment > 0]).tolist():
                times = np.where(np.isnan(rows.time), rows.arrival, rows.time)
                begin = float(times[rows.segment == number].min())
                self.segments[number] = min(begin, self.segments.get(number, np.inf))
        self.counts[rows.table] = before + len(rows.time)
        self.first = min(self.first, float(rows.arrival.min()))
        self.last = max(self.last, float(rows.arrival.max()))

    def shown(self, clocks: Collection[str] = ()) -> list[wire.ChannelInfo]:
        """Channels with a number; all if there are none. Those of `clocks` are last."""
        filled = [info for info in self.infos if info.id in self._filled] or self.infos
        return sorted(filled, key=lambda info: info.name in clocks)

    def empty(self) -> list[str]:
        """Headings of the columns that are not shown."""
        shown = {info.id for info in self.shown()}
        plans = [one for plan in self._plans.values() for one in plan]
        return [heading for number, headings in plans if number not in shown for heading in headings]

    def _begin(self, rows: TableRows) -> list[tuple[int, list[str]]]:
        plan = []
        texts = self._texts()  # of channels of their own, which are left out if no number comes
        with_numbers = [name for name in rows.columns if name not in texts]
        for name, members in [*grouped(with_numbers), *grouped([name for name in rows.columns if name in texts])]:
            units = {rows.columns[heading][1] for heading, _ in members}
            columns = [
                wire.ColumnInfo(inner, "f8", rows.columns[heading][1], axis=axis_of(inner, len(members)))  # type: ignore[arg-type]
                for heading, inner in members
            ]
            for column in columns:
                column.decimals = 0  # until a number has some
            frames = {rows.frames.get(heading, "") for heading, _ in members}
            frame = frames.pop() if len(frames) == 1 else ""
            has_axes = len(columns) == 3 and all(one.axis or one.name.isdecimal() for one in columns)
            kind: Any = "scalar" if len(columns) == 1 else "vector" if has_axes else "record"
            if " from " in frame:
                kind = {QUATERNION: "quaternion", EULER: "euler"}.get(tuple(inner for _, inner in members), kind)
            if kind == "scalar":
                columns[0].label = name
            info = wire.ChannelInfo(
                id=len(self.infos) + 1,
                device=DEVICE,
                message=rows.table,
                name=name,
                title=name,
                kind=kind,
                unit=units.pop() if len(units) == 1 else "",
                frame=frame,
                columns=columns,
            )
            self._writer.channel(info.id, ChannelLayout(("f8",) * len(columns), (False,) * len(columns)))
            self.infos.append(info)
            self._whole.add(info.id)
            plan.append((info.id, [heading for heading, _ in members]))
        return plan


def _are_whole(column: NDArray[np.float64]) -> bool:
    return bool((np.isnan(column) | (column == np.floor(column))).all())


def decode_tables(
    source: TableSource, writer: ColumnStoreWriter, progress: Callable[[float], None], showing: "ProgressPublisher"
) -> ColumnStore:
    """Write the tables of a file into a store, publishing partial results.

    Raises:
        RecordingError: the tables contain no numbers.
    """
    tables = _Tables(writer, source.texts, is_export=source.is_export)
    last = source.last()
    for rows in source.rows():
        tables.add(rows)
        progress(min(rows.done, 0.99))
        if showing.is_due and tables.infos:
            so_far = _manifest(source, tables) | {"progress": min(rows.done, 0.99), "ended": max(tables.last, last)}
            showing.show(writer.show(wire_codec.to_json_safe(so_far)))
    if not tables.infos:
        why = source.unreadable() or "A table needs at least one row."
        raise RecordingError(f"{source.path.name} contains no numbers.", why)
    if empty := tables.empty():
        source.damage.append(remark(_without_numbers(empty, source.texts())))
    return writer.finish(wire_codec.to_json_safe(_manifest(source, tables)))


def _without_numbers(headings: Sequence[str], texts: Mapping[str, str]) -> str:
    """A sentence on columns that are left out, with what some of them have instead."""
    named = [f"{one} ({texts[one]!r:.40})" if one in texts else one for one in headings[:MOST_NAMED]]
    more = f" and {len(headings) - len(named)} more" if len(headings) > len(named) else ""
    return f"Columns without numbers are left out: {', '.join(named)}{more}."


def _manifest(source: TableSource, tables: _Tables) -> dict[str, Any]:
    name = source.path.name
    device = wire.DeviceInfo(id=DEVICE, name=source.path.stem, source=name, link="file", status="ended")
    axis = source.axis
    events, segments, left_out = _events(axis, tables.first) if axis is not None else ([], [], 0)
    return {
        "format": source.format,
        "timed": source.timed,
        "about": {},
        "started": tables.first,
        "ended": tables.last,
        "devices": [device],
        "channels": tables.shown(axis.clocks if axis is not None else ()),
        "events": events,
        "events_left_out": left_out,
        "time": axis.described() if axis is not None else None,
        "segments": {DEVICE: sorted({*segments, *tables.segments.values()})},
        "markers": [],
        "snapshots": {},
        "damage": damage_of(source),
        "figures": {DEVICE: {"bytes": 0, "lost": 0, "gaps": 0, "rejects": 0, "messages": tables.counts}},
    }


def _events(axis: TimeAxis, start: float) -> tuple[list[wire.EventInfo], list[float], int]:
    """Events of the clock, begins of its segments after the first, unix s, and the number of further events."""
    texts = [
        wire.EventInfo(0, start, DEVICE, "clock", "info", words, data={"kind": "axis"}) for words in axis.sentences()
    ]
    if axis.clock.sure == "assumed":
        texts[0].level = "warning"
    watch = axis.watch
    if watch is None:
        return texts, [], 0
    events = [_step_event(axis, step) for step in watch.steps[:MOST_EVENTS]]
    segments = [axis.at(step.row, step.after) for step in watch.segments]
    events = [*texts, *events]
    for number, event in enumerate(events):
        event.seq = number
    return events, segments, len(watch.steps) - len(watch.steps[:MOST_EVENTS]) + watch.left_out


def _step_event(axis: TimeAxis, step: StepOfClock) -> wire.EventInfo:
    after = axis.at(step.row, step.after)
    before = axis.at(step.row - 1, step.before)
    level: Any = "info" if step.kind == "wrap" else "warning"
    data = {"kind": step.kind, "by_s": step.by_s, "row": step.row + 1, "clock": axis.name}
    return wire.EventInfo(0, after, DEVICE, "clock", level, step_words(step, axis.name), t0=before, t1=after, data=data)
