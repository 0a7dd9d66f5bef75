"""Decoding of numeric files (CSV) into an opened recording; each table becomes a channel.

There are no bytes, so no decoder, clock mapping or losses: times are taken from the file, and the unit of a column from
its heading.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from imuscope.recordings.column_store import ChannelLayout, ColumnStore, ColumnStoreWriter
from imuscope.recordings.mcap_writer import RecordingError
from imuscope.recordings.tabular import DEVICE, TableRows, TableSource, grouped
from imuscope.server import wire, wire_codec

if TYPE_CHECKING:
    from imuscope.server.library.decode import ProgressPublisher

AXES = ("x", "y", "z", "w")


class _Tables:
    """Channels of the tables read so far."""

    def __init__(self, writer: ColumnStoreWriter) -> None:
        self.infos: list[wire.ChannelInfo] = []
        self.counts: dict[str, int] = {}
        self.first, self.last = np.inf, -np.inf
        self._writer = writer
        self._plans: dict[str, list[tuple[int, list[str]]]] = {}

    def add(self, rows: TableRows) -> None:
        """Add a block of rows."""
        if not len(rows.time):
            return
        plan = self._plans.get(rows.table)
        if plan is None:
            plan = self._plans[rows.table] = self._begin(rows)
        for number, headings in plan:
            self._writer.append(number, [rows.arrival, rows.time, *(rows.columns[name][0] for name in headings)])
        self.counts[rows.table] = self.counts.get(rows.table, 0) + len(rows.time)
        self.first = min(self.first, float(rows.arrival.min()))
        self.last = max(self.last, float(rows.arrival.max()))

    def _begin(self, rows: TableRows) -> list[tuple[int, list[str]]]:
        plan = []
        for name, members in grouped(list(rows.columns)):
            units = {rows.columns[heading][1] for heading, _ in members}
            columns = [
                wire.ColumnInfo(inner, "f8", rows.columns[heading][1], axis=inner if inner in AXES else "")  # type: ignore[arg-type]
                for heading, inner in members
            ]
            kind: Any = "scalar" if len(columns) == 1 else "vector" if len(columns) == 3 else "record"
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
                frame="",
                columns=columns,
            )
            self._writer.channel(info.id, ChannelLayout(("f8",) * len(columns), (False,) * len(columns)))
            self.infos.append(info)
            plan.append((info.id, [heading for heading, _ in members]))
        return plan


def decode_tables(
    source: TableSource, writer: ColumnStoreWriter, progress: Callable[[float], None], showing: ProgressPublisher
) -> ColumnStore:
    """Write the tables of a file into a store, publishing partial results.

    Raises:
        RecordingError: the tables contain no numbers.
    """
    tables = _Tables(writer)
    last = source.last()
    for rows in source.rows():
        tables.add(rows)
        progress(min(rows.done, 0.99))
        if showing.is_due and tables.infos:
            so_far = _manifest(source, tables) | {"progress": min(rows.done, 0.99), "ended": max(tables.last, last)}
            showing.show(writer.show(wire_codec.to_json_safe(so_far)))
    if not tables.infos:
        raise RecordingError(f"{source.path.name} contains no numbers.", "A table needs at least one row.")
    return writer.finish(wire_codec.to_json_safe(_manifest(source, tables)))


def _manifest(source: TableSource, tables: _Tables) -> dict[str, Any]:
    name = source.path.name
    device = wire.DeviceInfo(id=DEVICE, name=source.path.stem, source=name, link="file", status="ended")
    return {
        "format": source.format,
        "timed": source.timed,
        "about": {},
        "started": tables.first,
        "ended": tables.last,
        "devices": [asdict(device)],
        "channels": [asdict(info) for info in tables.infos],
        "events": [],
        "events_left_out": 0,
        "markers": [],
        "snapshots": {},
        "damage": [asdict(damage) for damage in source.damage],
        "figures": {DEVICE: {"bytes": 0, "lost": 0, "gaps": 0, "rejects": 0, "messages": tables.counts}},
    }
