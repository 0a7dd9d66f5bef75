"""How does a recording become what a live device is: channels, events, figures?

By the very same way. The recorded chunks, each with the time at which it arrived, go through decoder and intake as they
did when they came, only as fast as the machine can; what would have gone to browsers goes into a store of columns:

    Source.parts() ──> StreamDecoder of each device ──> RecordingSink (in place of the hub) ──> ColumnStoreWriter ──>
    ColumnStore
                                                 events, devices, channels       ──> its manifest
                                                 rates, delays, the clock        ──> fared.bin, second by second

So an old file has what today's decoder makes of it, and a recording looks as it looked live. What was kept beside the
bytes (markers, what a person did, how the link fared) is taken over; what follows from the bytes (gaps, rejects, steps
of the clock, answers) is found anew.

A long file is shown while it is decoded: again and again what is there so far can be read like the whole
(`ProgressPublisher`).

Memory is bounded by one part and the blocks that wait to be written.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from protocols.events import Doubts
from recordings.capture_timing import BLIND_RATE
from recordings.column_store import ColumnStore, ColumnStoreWriter
from recordings.health_history import HealthHistoryWriter
from recordings.importers import CaptureSource
from recordings.mcap_writer import EVENTS, NOTES, SNAPSHOT
from recordings.sources import ChunkBlock, McapSource, Source
from recordings.tabular import TableSource
from server import wire, wire_codec
from server.devices.decode_options import DecodeOptions, recorded
from server.devices.device_demux import LinkDevices, StreamDecoder
from server.devices.device_state import DeviceState, short_source
from server.devices.ingest import LinkTiming
from server.devices.protocol_detection import GUESS_SCORE, ProtocolSet
from server.devices.stream_diagnostics import REMEDIES
from server.library.collector import RecordingSink
from server.library.decode_tables import decode_tables
from server.links.base import LinkKind

DRAIN_BYTES = 1 << 20  # decoded at once: what the decoders are measured with
DRAIN_NS = 5_000_000_000  # and no more than this of a recording: what is known of its clock is told so often
FOUND_ANEW = ("gap", "reject", "clock", "reply", "text")
GUESS_BYTES = 1 << 16
MOST_TIME = 9e9  # unix s
PROBE_NS, PROBE_BYTES = 2_500_000_000, 1 << 22  # looked at before it is decoded, for the unit of its timestamps
FIRST_SHOWN_S, LAST_SHOWN_S = 0.3, 2.0  # of decoding, until it is shown; then twice as long, up to this
EVENTS_SHOWN = 2000  # while it is decoded: telling all of a very bad line again and again would take longer than it


class _Device:
    """One device of the file while it is decoded."""

    def __init__(
        self,
        hub: RecordingSink,
        name: str,
        source: Source,
        speech: ProtocolSet,
        reading: DecodeOptions,
        usual: DecodeOptions,
    ) -> None:
        told = source.devices.get(name)
        about: Mapping[str, str] = told.about if told is not None else {}
        self._hub = hub
        self._speech = speech
        self._reading = reading = recorded(reading, about, usual)
        self.protocol = reading.protocol or (told.protocol if told is not None else "")
        link = about.get("link", "file")
        info = wire.DeviceInfo(
            id=name,
            name=about.get("name") or short_source(about.get("source", "") or source.path.name),
            source=about.get("source", "") or source.path.name,
            link=link if link in get_args(LinkKind) else "file",  # type: ignore[arg-type]
            status="ended",
            protocol=self.protocol,
            product=about.get("product", ""),
            serial_number=about.get("serial_number", ""),
            firmware=about.get("firmware", ""),
            baud=int(about["baud"]) if about.get("baud", "").isdecimal() else None,
        )
        self.portrait = DeviceState(hub, info, speech.title)
        self.senders = LinkDevices(hub, self.portrait, speech.title)
        self._link = info.link
        self._timed = source.timed
        self._baud = info.baud
        self._reader: StreamDecoder | None = None
        self._waiting: list[ChunkBlock] = []
        self._fed = 0
        self._drained = 0  # when the last chunk arrived that is decoded, ns
        self._next_tick = 0.0

        if self.protocol and self._probe() is None:
            self._begin()

    def _probe(self) -> Doubts | None:
        """What judges the unit of timestamps by their arrival; None where there is nothing to judge."""
        if not self._timed or self._reading.time_unit:
            return None
        decoder: object = self._speech.decoder(self.protocol, self._reading, self._link)
        return decoder if isinstance(decoder, Doubts) else None

    def _settle_unit(self) -> None:
        """Of timestamps, where nobody has named it: by the arrival of the first seconds."""
        probe = self._probe()
        if probe is None:
            return
        for part in self._waiting:
            probe.feed_many(part.data, part.ends, part.times)
        probe.drain()
        if (doubt := probe.contradiction) is not None:
            self._reading = replace(self._reading, time_unit=doubt.unit)
            text = f"Timestamps are read with time_unit={doubt.unit}: {doubt.reason}. Set time_unit to settle it."
            self.senders.own.incidents.say("device", "caution", text, data={"reason": "unit", "unit": doubt.unit})

    def _begin(self) -> None:
        byte_time_ns, capacity = (10e9 / self._baud, self._baud / 10) if self._baud else (0, None)
        line = LinkTiming(byte_time_ns, self._link, capacity, timed=self._timed)
        self._settle_unit()
        decoder = self._speech.decoder(self.protocol, self._reading, self._link)
        about = self._speech.about(self.protocol)
        self.portrait.set(protocol=self.protocol)
        self._reader = StreamDecoder(self._hub, self.senders, decoder, line=line, about=about)

    def take(self, part: ChunkBlock) -> None:
        """Bytes that came from it."""
        if self._reader is None:
            self._waiting.append(part)
            size = sum(len(one.data) for one in self._waiting)
            passed = int(part.times[-1]) - int(self._waiting[0].times[0])
            if size >= GUESS_BYTES and (passed >= PROBE_NS or size >= PROBE_BYTES):
                self._recognise()
            return
        self._feed(self._reader, part)

    def _recognise(self) -> None:
        if not self.protocol:
            guesses = self._speech.guess(b"".join(part.data for part in self._waiting)[: 4 * GUESS_BYTES])
            self.protocol = guesses[0].protocol if guesses and guesses[0].score >= GUESS_SCORE else ""
        if self.protocol:
            self._begin()
            assert self._reader is not None
            for part in self._waiting:
                self._feed(self._reader, part)
            self._waiting.clear()

    def _feed(self, reader: StreamDecoder, part: ChunkBlock) -> None:
        first = 0
        while first < len(part.ends):
            start = int(part.ends[first - 1]) if first else 0
            self._drained = self._drained or int(part.times[first])
            past = int(np.searchsorted(part.ends, start + DRAIN_BYTES - self._fed, "right"))
            past = max(min(past, int(np.searchsorted(part.times, self._drained + DRAIN_NS, "right"))), first + 1)
            end = int(part.ends[past - 1])
            reader.feed_many(part.data[start:end], part.ends[first:past] - start, part.times[first:past])
            self._fed += end - start
            self._hub.time = float(part.times[past - 1]) / 1e9
            last = int(part.times[past - 1])
            if self._fed >= DRAIN_BYTES or last - self._drained >= DRAIN_NS or past < len(part.ends):
                self._drained = last
                self._drain(reader)
            first = past
        self.senders.own.figures.heard(len(part.data), self._hub.time)
        self._hub.fared.heard(self.portrait.info.id, part.ends, part.times)

    def _drain(self, reader: StreamDecoder) -> None:
        self._fed = 0
        reader.drain()
        self._tell_clocks()
        if self._hub.time >= self._next_tick:
            self._next_tick = self._hub.time + 1.0
            for sender in self.senders.all:
                sender.incidents.tick(self._hub.time)

    def _tell_clocks(self) -> None:
        for sender in self.senders.all:
            clock = sender.intake.clock if sender.intake is not None else None
            if clock is not None and clock.uncertainty_ns < float("inf"):
                device = sender.portrait.info.id
                self._hub.fared.clock(device, self._hub.time, clock.drift_ppm, clock.uncertainty_ns / 1e6)

    def end(self) -> None:
        """The file is over."""
        if self._reader is None and self._waiting:
            self._recognise()
        if self._reader is not None:
            self._reader.drain(stalled=True)
            self._tell_clocks()
        self._tell_refusals()
        for sender in self.senders.all:
            sender.incidents.tick(self._hub.time + 3600.0)
            sender.portrait.set(status="ended", message="", hint="", next_try=None)

    def _tell_refusals(self) -> None:
        """Frames that a setting would let in are told: what is not there would be missed without a word."""
        own = self.senders.own
        for reason, (words, remedy) in REMEDIES.items():
            if count := own.figures.rejects_by.get(reason, 0):
                text = f"{words} {remedy}" if reason != "no_key" else f"{words} Give the key: --key @FILE."
                own.incidents.say("device", "caution", text, data={"reason": reason, "count": count})


class ProgressPublisher:
    """Shows what is decoded so far, now and then: soon at first, and never so often that it takes longer.

    Args:
        shown: called with the folder from which it can be read.
    """

    def __init__(self, shown: Callable[[Path], None]) -> None:
        self._shown = shown
        self._wait = FIRST_SHOWN_S
        self._next = time.monotonic() + self._wait

    @property
    def is_due(self) -> bool:
        return time.monotonic() >= self._next

    def show(self, folder: Path) -> None:
        """It can be read there."""
        self._shown(folder)
        self._wait = min(2 * self._wait, LAST_SHOWN_S)
        self._next = time.monotonic() + self._wait


def decode(
    source: Source,
    folder: Path,
    speech: ProtocolSet,
    reading: DecodeOptions = DecodeOptions(),  # noqa: B008 - frozen
    progress: Callable[[float], None] = lambda share: None,
    shown: Callable[[Path], None] = lambda folder: None,
    usual: DecodeOptions = DecodeOptions(),  # noqa: B008 - frozen
) -> ColumnStore:
    """Decode a file into a store.

    Args:
        folder: of the store.
        reading: what a person said about it; a protocol named here is that of every device.
        progress: called with 0..1, from the thread that decodes.
        usual: what is said of sources here, where neither a person nor the recording says otherwise.
        shown: called with a folder for ColumnStore that has what is decoded so far, until the store itself is there.
    Raises:
        RecordingError, OSError: the file cannot be read, or the store not be written; nothing is left behind.
    """
    writer = ColumnStoreWriter(folder)
    try:
        if isinstance(source, TableSource):
            return decode_tables(source, writer, progress, ProgressPublisher(shown))
        fared = HealthHistoryWriter(writer.aside)
        hub = RecordingSink(writer, fared)
        showing = ProgressPublisher(shown)
        devices = {name: _Device(hub, name, source, speech, reading, usual) for name in source.devices}
        spans: dict[str, list[int]] = {}
        for part in source.parts():
            if part.way == "rx":
                if part.device not in devices:
                    devices[part.device] = _Device(hub, part.device, source, speech, reading, usual)
                devices[part.device].take(part)
            span = spans.setdefault(part.device, [int(part.times[0]), int(part.times[-1])])
            span[:] = min(span[0], int(part.times[0])), max(span[1], int(part.times[-1]))
            progress(min(part.done, 0.99))
            if showing.is_due and hub.infos:
                hub.flush()
                manifest = _manifest(source, hub, devices, spans, most_events=EVENTS_SHOWN)
                manifest |= {"progress": part.done, "ended": max(manifest["ended"], _end(source))}
                showing.show(writer.show(wire_codec.to_json_safe(manifest)))
        for device in devices.values():
            device.end()
        for name, count in hub.payloads_left_out.items():
            words = f"{count} payloads of further kinds are in no export but that of the original bytes."
            hub.event(name, "device", "caution", words, data={"reason": "payloads", "count": count})
        if isinstance(source, CaptureSource) and source.guessed:
            words = f"Some of it holds no device clock: its times are guessed at {BLIND_RATE} B/s (115 200 Bd)."
            for name in devices:
                hub.event(name, "clock", "caution", words, data={"kind": "guessed"})
        hub.close()
        return writer.finish(wire_codec.to_json_safe(_manifest(source, hub, devices, spans)))
    except BaseException:
        writer.abandon()
        raise


def _end(source: Source) -> float:
    """When a recording ends, unix s, as its index says before it is read; 0 where nothing does."""
    return max(source.indexed, default=0) / 1e9 if isinstance(source, McapSource) else 0.0


def _manifest(
    source: Source,
    hub: RecordingSink,
    devices: Mapping[str, _Device],
    spans: Mapping[str, list[int]],
    most_events: int | None = None,
) -> dict[str, Any]:
    events = hub.events[:most_events]
    found = [event for event in hub.events if event.kind == "gap"]
    markers: list[dict[str, Any]] = []
    snapshots: dict[str, Any] = {}
    for channel, time_ns, body in source.said():
        if channel == EVENTS and (body.get("kind") not in FOUND_ANEW or _is_outage(body)):
            event = _event(body, time_ns)
            if event.kind != "gap" or not _is_counted(event, found):
                events.append(event)
        elif channel == NOTES:
            markers.append({"time": time_ns / 1e9, "id": len(markers) + 1, **_note(body)})
        elif channel.startswith(SNAPSHOT):
            snapshots[_sender(channel.removeprefix(SNAPSHOT), body, devices)] = dict(body)
    events.sort(key=lambda event: event.time)
    for number, event in enumerate(events):
        event.seq = number
    infos = [info for device in devices.values() for info in device.senders.infos]
    figures = {sender.portrait.info.id: sender for device in devices.values() for sender in device.senders.all}
    starts = [first for first, _ in spans.values()]
    stops = [last for _, last in spans.values()]
    return {
        "format": source.format,
        "timed": source.timed,
        "about": dict(source.about),
        "started": min(starts) / 1e9 if starts else None,
        "ended": max(stops) / 1e9 if stops else None,
        "devices": [asdict(info) for info in infos],
        "channels": [asdict(info) for info in hub.infos.values()],
        "clocks": [asdict(info) for info in hub.clocks.values()],
        "payloads": list(hub.payloads.values()),
        "events": [asdict(event) for event in events],
        "events_left_out": hub.left_out,
        "markers": markers,
        "snapshots": snapshots,
        "damage": [asdict(damage) for damage in source.damage],
        "fared": hub.fared.names,
        "figures": {
            device: {
                "bytes": sender.figures.bytes.total,
                "lost": sender.figures.lost,
                "gaps": sender.figures.gaps,
                "rejects": sender.figures.rejects,
                "messages": {name: meter.total for name, meter in sender.figures.messages.items()},
            }
            for device, sender in figures.items()
        },
    }


def _sender(device: str, body: Mapping[str, Any], devices: Mapping[str, _Device]) -> str:
    """Whose settings they are, of those that share a line: who was heard first live may be another here."""
    own = device.partition(".")[0]
    addresses = devices[own].senders.addresses if own in devices else {}
    name = next((name for name, address in addresses.items() if address == body.get("address")), None)
    return device if name is None else f"{own}.{name}" if name else own


def _is_outage(body: Mapping[str, Any]) -> bool:
    """A link that was down, of which no counter tells: who decodes the bytes sees none that are missing."""
    data = body.get("data")
    times = (body.get("t0"), body.get("t1"))
    numbers = all(isinstance(time, int | float) and abs(time) < MOST_TIME for time in times)  # nor NaN
    return body.get("kind") == "gap" and numbers and isinstance(data, Mapping) and data.get("by") == "link"


def _is_counted(outage: wire.EventInfo, found: Sequence[wire.EventInfo]) -> bool:
    """Did a counter, read across the outage, tell what it lost?"""
    t0, t1 = outage.t0 or 0.0, outage.t1 or 0.0
    return any(
        gap.device == outage.device and (gap.t0 or 0.0) < t1 and (gap.t1 or 0.0) > t0 and gap.samples for gap in found
    )


def _event(body: Mapping[str, Any], time_ns: int) -> wire.EventInfo:
    kind, level = body.get("kind"), body.get("level")
    return wire.EventInfo(
        0,
        float(body.get("time") or time_ns / 1e9),
        str(body.get("device", "")),
        kind if kind in get_args(wire.EventKind) else "device",  # type: ignore[arg-type]
        level if level in ("info", "caution", "fault") else "info",
        str(body.get("text", "")),
        t0=float(body["t0"]) if _is_outage(body) else None,
        t1=float(body["t1"]) if _is_outage(body) else None,
        data=dict(body.get("data") or {}),
    )


def _note(body: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "kind": "note" if body.get("kind") == "note" else "marker",
        "text": str(body.get("text", "")),
        "device": str(body.get("device", "")),
    }


def usual_interval(columns: ColumnStore, channel: int) -> float:
    """The usual time between two samples of a channel, s; 0 while it has fewer than two."""
    rows = columns.exact(channel, 0, 4096, columns=[])
    steps = np.diff(np.where(np.isnan(rows.time), rows.arrival, rows.time))
    return float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
