"""Where do the samples of a recording go while it is decoded? Into a store of columns, in place of a hub's browsers.

channels    as a page would have them, and the angles of rotations that are not sent as such
clocks      what the device's own clock said of each sample, and its UTC: for exports, not for plots
payloads    bytes that nobody has described: for exports, too (recordings/payloads.py)
events      bounded, of each device
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.events import Batch
from protocols.schema import Message
from recordings.column_store import ChannelLayout, ColumnStoreWriter
from recordings.euler import euler_columns
from recordings.health_history import HealthHistoryWriter
from recordings.payloads import BYTES, SHAPE, PayloadsWriter
from server import wire
from server.streaming.channels import ChannelRows, clock_alone
from server.streaming.hub import Dated, Hub
from server.streaming.unknown_payloads import Payloads, described

MOST_EVENTS = 20_000  # of each device; beyond that only the faults of the link are kept
MOST_KINDS = 512  # of payloads, of each device: noise that passes a weak checksum must not make a file of each
CLOCKS = {
    "utc": "UTC as the device says it, unix time.",
    "timestamp": "Timestamp of the frame's header, as sent.",
    "sequence": "Sequence number of the frame's header.",
}


class RecordingSink(Hub):
    """Takes what a hub takes, and writes samples to a store."""

    tells_every_gap = True  # a plot of the whole shows each where it was, and nobody's log is flooded
    keeps_clocks = True  # for those who export them

    def __init__(self, writer: ColumnStoreWriter, fared: HealthHistoryWriter) -> None:
        super().__init__(self._time, history_s=0)
        self.time = 0.0  # arrival of what is decoded now, unix s
        self.infos: dict[int, wire.ChannelInfo] = {}
        self.events: list[wire.EventInfo] = []
        self.left_out = 0
        self.fared = fared
        self._writer = writer
        self._derived: dict[int, int] = {}  # channel of a rotation → that of its angles
        self.clocks: dict[tuple[Any, ...], wire.ChannelInfo] = {}  # what is kept of clocks; channels, but not shown
        self.payloads: dict[tuple[Any, ...], dict[str, Any]] = {}  # kinds of payloads, described like channels
        self.payloads_left_out: Counter[str] = Counter()  # of kinds that there was no room for, by device
        self._bytes = PayloadsWriter(writer.aside)

    def _time(self) -> float:
        return self.time

    def flush(self) -> None:
        """Let what was kept beside the columns be read."""
        self.fared.flush()
        self._bytes.flush()

    def close(self) -> None:
        """No more comes."""
        self.fared.close()
        self._bytes.close()

    @property
    def _number(self) -> int:
        """Of the next channel, be it shown or not."""
        return len(self.infos) + len(self.clocks) + len(self.payloads) + 1

    def advertise(self, info: wire.ChannelInfo) -> int:
        number = self._number
        self.infos[number] = replace(info, id=number)
        status = tuple(info.kind == "status" and bool(column.bits) for column in info.columns)
        self._writer.channel(number, ChannelLayout(tuple(column.dtype for column in info.columns), status))
        return number

    def publish(self, pieces: Iterable[ChannelRows]) -> None:
        leading: dict[tuple[str, str], int] = {}  # a message's samples are counted once, by the first of its quantities
        for piece in pieces:
            info = self.infos[piece.channel]
            self._writer.append(piece.channel, piece.columns)
            if leading.setdefault((info.device, info.message), piece.channel) == piece.channel:
                self.fared.samples(info.device, info.message, piece.columns[0], piece.columns[1])
            if info.kind in ("quaternion", "matrix"):
                self._angles(piece)

    def keep_clocks(self, device: str, dated: Sequence[Dated]) -> None:
        found: dict[int, list[Sequence[NDArray[Any]]]] = {}
        for one in dated:
            for number, rows in self._clocks_in(device, *one):
                found.setdefault(number, []).append(rows)
        for number, parts in found.items():
            self._append(number, parts)

    def _clocks_in(
        self, device: str, batch: Batch, time: NDArray[np.float64], utc: NDArray[np.float64] | None
    ) -> Iterator[tuple[int, Sequence[NDArray[Any]]]]:
        """The number of what is kept, and its rows: offset, arrival, time, values."""
        message = batch.message
        sent = {name: (values, "") for name, values in batch.header.items()}
        if clock_alone(message, described(batch.columns, message.fields)) and message.time in batch.columns:
            unit = next(field.unit for field in message.fields if field.name == message.time)
            sent[message.time] = np.asarray(batch.columns[message.time]), unit
        arrival = batch.arrival_ns / 1e9
        for kept in (sent, {} if utc is None else {"utc": (utc, "s")}):
            if kept:
                number = self._clock_of(device, message, batch.verified, kept)
                yield number, [batch.offset, arrival, time, *(values for values, _ in kept.values())]

    def _append(self, number: int, parts: Sequence[Sequence[NDArray[Any]]]) -> None:
        """Rows of a drain, whose layouts come as batches of their own, in the order of the stream.

        Args:
            parts: of each batch offset, arrival, time, then the channel's own columns.
        """
        offset, *columns = (np.concatenate(column) for column in zip(*parts, strict=True))
        order = np.argsort(offset, kind="stable")
        self._writer.append(number, [column[order] for column in columns])

    def _clock_of(
        self, device: str, message: Message, verified: bool, kept: Mapping[str, tuple[NDArray[Any], str]]
    ) -> int:
        """The number of what is kept of a message's clock."""
        dtypes = {name: values.dtype.str[1:] for name, (values, _) in kept.items()}
        key = device, message.name, verified, *dtypes.items()
        info = self.clocks.get(key)
        if info is None:
            columns = [
                wire.ColumnInfo(name, dtypes[name], unit, label=CLOCKS.get(name, "Device clock as sent"))  # type: ignore[arg-type]
                for name, (_, unit) in kept.items()
            ]
            number = self._number
            info = self.clocks[key] = wire.ChannelInfo(
                number, device, message.name, message.name, "Clock", "counter", "", "", columns, verified=verified
            )
            self._writer.channel(number, ChannelLayout(tuple(dtypes.values()), (False,) * len(columns)))
        return info.id

    def keep_payloads(self, parts: Sequence[Payloads]) -> None:
        first = parts[0]
        info = self.payloads.get(first.kind)
        if info is None:
            if sum(device == first.device for device, *_ in self.payloads) >= MOST_KINDS:
                self.payloads_left_out[first.device] += sum(len(part.rows) for part in parts)
                return
            info = self.payloads[first.kind] = self._described(first)
            self._writer.channel(info["id"], SHAPE)
        rows = [(part.offset, part.arrival, part.time, *self._bytes.put(part.rows)) for part in parts]
        self._append(info["id"], rows)

    def _described(self, kept: Payloads) -> dict[str, Any]:
        """A kind of payloads as the manifest has it: like a channel, with one column of "bytes"."""
        column = wire.ColumnInfo(kept.column, "u1", label="Payload", doc=kept.doc)
        told = wire.ChannelInfo(
            self._number, kept.device, kept.message, kept.name, kept.name, "record", "", "", [column], kept.doc
        )
        told.verified = kept.verified
        info = {**asdict(told), "kind": BYTES}
        info["columns"][0]["dtype"] = BYTES
        return info

    def _angles(self, piece: ChannelRows) -> None:
        """Euler angles of what is not sent as such (recordings/euler.py)."""
        number = self._derived.get(piece.channel)
        if number is None:
            number = self._derived[piece.channel] = self._derive(self.infos[piece.channel])
        if number:
            self._writer.append(number, [*piece.columns[:2], *euler_columns(piece.columns[2:])])

    def _derive(self, source: wire.ChannelInfo) -> int:
        """The channel of angles, as the page would call it; 0 where they would mean nothing: not against a level."""
        if source.frame.startswith("ECEF") or len(source.columns) not in (4, 9):
            return 0
        turns = (("roll", "x", 360.0), ("pitch", "y", 0.0), ("yaw", "z", 360.0))
        columns = [
            wire.ColumnInfo(name, "f8", unit="°", label=name, axis=axis, decimals=2, period=period)  # type: ignore[arg-type]
            for name, axis, period in turns
        ]
        words = f"Worked out from {source.title or source.name}; yaw, then pitch, then roll."
        return self.advertise(
            replace(
                source, name="EulerAngles", title="Euler angles", kind="euler", unit="°", columns=columns, doc=words
            )
        )

    def event(self, device: str, kind: wire.EventKind, level: wire.Level, text: str, **more: Any) -> wire.EventInfo:
        event = super().event(device, kind, level, text, **more)
        self._new_events.clear()  # nobody is told
        if len(self.events) < MOST_EVENTS or kind == "gap":
            self.events.append(event)
        else:
            self.left_out += 1
        return event

    def request_flush(self) -> None:
        """There is nobody to flush to."""
