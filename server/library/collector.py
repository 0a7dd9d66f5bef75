"""Sink for the samples of a recording while it is decoded. Writes to a column store instead of live rings.

channels    as on a live page, and Euler angles of rotations sent in another form
clocks      device time and UTC of each sample: for exports, not for plots
payloads    unknown payloads, also for exports (recordings/columns/payloads.py)
events      a bounded number for each device
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Ints
from imuscope.protocols.clocks.unix_time import seconds
from imuscope.protocols.events import Batch
from imuscope.protocols.rotations import euler_columns
from imuscope.protocols.schema.fields import Message
from imuscope.recordings.columns.health_history import HealthHistoryWriter
from imuscope.recordings.columns.payloads import BYTES, SHAPE, PayloadsWriter
from imuscope.recordings.columns.store import BLOCK_ROWS, ChannelLayout, ColumnStoreWriter
from imuscope.server import wire
from imuscope.server.streaming.channel_rows import ChannelRows, WireRows
from imuscope.server.streaming.channels import clock_alone, factors_of
from imuscope.server.streaming.sink import Dated, EventSink
from imuscope.server.streaming.unknown_payloads import Payloads, described

MAX_EVENTS = 20_000  # of each device; beyond that only errors of the link are stored
MAX_KINDS = 512  # of payloads, of each device: noise that passes a weak checksum must not create unlimited files
DEVICE_TIME = "device_time"
EULER = "EulerAngles"  # computed from other rotations
CLOCKS = {
    DEVICE_TIME: "Time of the device, on the clock of the host; the time axis is the arrival.",
    "utc": "UTC as the device says it, unix time.",
    "timestamp": "Timestamp of the frame's header, as sent.",
    "sequence": "Sequence number of the frame's header.",
}


class RecordingSink(EventSink):
    """A TelemetrySink (server/streaming/sink.py) that writes samples to a store, and the rest to its manifest.

    Args:
        writer: writer of the store.
        health_history: rates, delays and clocks per second.
        by_arrival: whether the arrival is the time axis; the time of the device is stored with the clocks then.
    """

    reports_every_gap = True  # plots show each gap, and there is no live log to flood

    def __init__(
        self, writer: ColumnStoreWriter, health_history: HealthHistoryWriter, *, by_arrival: bool = False
    ) -> None:
        self.by_arrival = by_arrival
        self.time = 0.0  # arrival of the bytes being decoded, unix s
        self.infos: dict[int, wire.ChannelInfo] = {}
        self.events: list[wire.EventInfo] = []
        self.left_out = 0
        self.health_history = health_history
        self._writer = writer
        self._derived: dict[int, int] = {}  # channel of a rotation → that of its angles
        self.clocks: dict[tuple[Any, ...], wire.ChannelInfo] = {}  # clock readings; channels, but not shown
        self.payloads: dict[tuple[Any, ...], dict[str, Any]] = {}  # kinds of payloads, described like channels
        self.payloads_left_out: Counter[str] = Counter()  # number of payloads above MAX_KINDS, by device
        self._bytes = PayloadsWriter(writer.temporary)

    @property
    def archive(self) -> "RecordingSink":
        """The sink itself, which stores the data for exports."""
        return self

    def now(self) -> float:
        """Arrival of the bytes being decoded, unix s."""
        return self.time

    def flush(self) -> None:
        """Flush the files beside the columns, so that they can be read."""
        self.health_history.flush()
        self._bytes.flush()

    def close(self) -> None:
        """Close the files beside the columns at the end of the data."""
        self.health_history.close()
        self._bytes.close()

    @property
    def _number(self) -> int:
        """Number of the next channel, shown or not."""
        return len(self.infos) + len(self.clocks) + len(self.payloads) + 1

    def advertise(self, info: wire.ChannelInfo) -> int:
        number = self._number
        self.infos[number] = replace(info, id=number)
        status = tuple(info.kind == "status" and bool(column.bits) for column in info.columns)
        dtypes = tuple(column.dtype for column in info.columns)
        self._writer.channel(number, ChannelLayout(dtypes, status, factors_of(info)))
        return number

    def publish(self, pieces: Iterable[ChannelRows | WireRows]) -> None:
        leading: dict[tuple[str, str], int] = {}  # a message's samples are counted once, by the first of its quantities
        for piece in pieces:
            info = self.infos[piece.channel]
            clocks = piece.exact or piece.columns[:2]
            columns = [clocks[0], clocks[0] if self.by_arrival else clocks[1], *piece.values]
            self._writer.append(piece.channel, columns, piece.place)
            if leading.setdefault((info.device, info.message), piece.channel) == piece.channel:
                counted = clocks if piece.exact is None else [seconds(one) for one in clocks]
                self.health_history.samples(info.device, info.message, *counted)
            if info.kind in ("quaternion", "matrix"):
                self._angles(piece.channel, columns, piece.place)

    def keep_computed(self, number: int, columns: Sequence[NDArray[Any]]) -> None:
        """Append rows of a computed signal: arrival, time, then its columns. They are not samples of the device."""
        for begin in range(0, len(columns[0]), BLOCK_ROWS):
            self._writer.append(number, [column[begin : begin + BLOCK_ROWS] for column in columns])

    def keep_clocks(self, device: str, dated: Sequence[Dated]) -> None:
        clocks: dict[int, list[Sequence[NDArray[Any]]]] = {}
        for one in dated:
            for number, rows in self._clocks_in(device, *one):
                clocks.setdefault(number, []).append(rows)
        for number, parts in clocks.items():
            self._append(number, parts)

    def _clocks_in(
        self, device: str, batch: Batch, time: Ints, utc: NDArray[np.float64] | None
    ) -> Iterator[tuple[int, Sequence[NDArray[Any]]]]:
        """Channel number and rows of each stored clock: offset, arrival, time, values."""
        message = batch.message
        sent = {name: (values, "") for name, values in batch.header.items()}
        if clock_alone(message, described(batch.columns, message.fields)) and message.time in batch.columns:
            unit = next(field.unit for field in message.fields if field.name == message.time)
            sent[message.time] = np.asarray(batch.columns[message.time]), unit
        arrival = batch.arrival_ns
        if self.by_arrival:
            sent[DEVICE_TIME], time = (seconds(time), "s"), arrival
        for stored in (sent, {} if utc is None else {"utc": (utc, "s")}):
            if stored:
                number = self._clock_of(device, message, batch.verified, stored)
                yield number, [batch.offset, arrival, time, *(values for values, _ in stored.values())]

    def _append(self, number: int, parts: Sequence[Sequence[NDArray[Any]]]) -> None:
        """Append the rows of a drain, which has one batch per layout, in stream order.

        Args:
            parts: offset, arrival, time, then the channel's own columns, for each batch.
        """
        offset, *columns = (np.concatenate(column) for column in zip(*parts, strict=True))
        order = np.argsort(offset, kind="stable")
        self._writer.append(number, [column[order] for column in columns], offset[order])

    def _clock_of(
        self, device: str, message: Message, verified: bool, stored: Mapping[str, tuple[NDArray[Any], str]]
    ) -> int:
        """Channel number of the stored clock of a message."""
        dtypes = {name: values.dtype.str[1:] for name, (values, _) in stored.items()}
        key = device, message.name, verified, *dtypes.items()
        info = self.clocks.get(key)
        if info is None:
            columns = [
                wire.ColumnInfo(name, dtypes[name], unit, label=CLOCKS.get(name, "Device clock as sent"))  # type: ignore[arg-type]
                for name, (_, unit) in stored.items()
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
            if sum(device == first.device for device, *_ in self.payloads) >= MAX_KINDS:
                self.payloads_left_out[first.device] += sum(len(part.rows) for part in parts)
                return
            info = self.payloads[first.kind] = self._described(first)
            self._writer.channel(info["id"], SHAPE)
        times = [part.arrival_ns if self.by_arrival else part.time_ns for part in parts]
        rows = [
            (part.offset, part.arrival_ns, time, *self._bytes.put(part.rows))
            for part, time in zip(parts, times, strict=True)
        ]
        self._append(info["id"], rows)

    def _described(self, stored: Payloads) -> dict[str, Any]:
        """A kind of payloads in the manifest: like a channel, with one column of "bytes"."""
        column = wire.ColumnInfo(stored.column, "u1", label="Payload", doc=stored.doc)
        described_channel = wire.ChannelInfo(
            self._number,
            stored.device,
            stored.message,
            stored.name,
            stored.name,
            "record",
            "",
            "",
            [column],
            stored.doc,
        )
        described_channel.verified = stored.verified
        info = {**asdict(described_channel), "kind": BYTES}
        info["columns"][0]["dtype"] = BYTES
        return info

    def _angles(self, channel: int, columns: Sequence[NDArray[Any]], place: NDArray[Any] | None) -> None:
        """Euler angles of rotations sent in another form (protocols/rotations.py)."""
        number = self._derived.get(channel)
        if number is None:
            number = self._derived[channel] = self._derive(self.infos[channel])
        if number:
            self._writer.append(number, [*columns[:2], *euler_columns(columns[2:])], place)

    def shown(self) -> list[wire.ChannelInfo]:
        """The channels. Computed angles are named after their rotation if the message has others: sent, or of another
        rotation of it.
        """
        sources = {number: self.infos[channel] for channel, number in self._derived.items() if number}
        others = {_of_angles(info) for info in self.infos.values() if info.name == EULER and info.id not in sources}
        shown = []
        for info in self.infos.values():
            source = sources.get(info.id)
            if source is not None and _of_angles(info) in others:
                info = replace(info, name=f"{source.name}.{EULER}", title=f"{info.title} of {source.title}")
            elif source is not None:
                others.add(_of_angles(info))
            shown.append(info)
        return shown

    def _derive(self, source: wire.ChannelInfo) -> int:
        """The channel of Euler angles; 0 if they would be meaningless, without a level frame."""
        if source.frame.startswith("ECEF") or len(source.columns) not in (4, 9):
            return 0
        turns = (("roll", "x", 360.0), ("pitch", "y", 0.0), ("yaw", "z", 360.0))
        columns = [
            wire.ColumnInfo(name, "f8", unit="°", label=name, axis=axis, decimals=2, period=period)  # type: ignore[arg-type]
            for name, axis, period in turns
        ]
        words = f"Computed from {source.title or source.name}; yaw, then pitch, then roll."
        return self.advertise(
            replace(source, name=EULER, title="Euler angles", kind="euler", unit="°", columns=columns, doc=words)
        )

    def add_event(self, event: wire.EventInfo) -> wire.EventInfo:
        event = replace(event, seq=len(self.events) + self.left_out)
        if len(self.events) < MAX_EVENTS or event.kind == "gap":
            self.events.append(event)
        else:
            self.left_out += 1
        return event

    def set_device(self, info: wire.DeviceInfo) -> None:
        """No-op; the manifest uses the state of devices at the time of writing."""

    def remove_device(self, device: str) -> None:
        """No-op; a recording keeps its devices."""


def _of_angles(info: wire.ChannelInfo) -> tuple[str, str, bool, str]:
    """Key that channels of the same angles share."""
    return info.device, info.message, info.verified, info.frame
