"""Decoding of a recording with the code of a live device: channels, events and figures.

The recorded chunks, each with its arrival time, go through decoder and ingest as they did live, but as fast as
possible; the results go into a column store instead of to browsers:

    Source.parts() ──> LinkDecoder of each device ──> RecordingSink ──> ColumnStoreWriter ──>
    ColumnStore
                                                 events, devices, channels       ──> its manifest
                                                 rates, delays, the clock        ──> health.bin, second by second

So an old file is decoded by the present decoder, and a recording looks as it did live. Information stored beside the
bytes (markers, user actions, states of the link) is copied; information that follows from the bytes (gaps, rejects,
clock steps, answers) is derived again.

A long file is shown while it is decoded: the part decoded so far is published repeatedly and can be read like a
complete store (`ProgressPublisher`).

Memory is bounded by one part and the blocks waiting to be written.
"""

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.events import Doubts, Remarks
from imuscope.protocols.messages.decoder import MessageDecoder
from imuscope.protocols.registry.families import remedies
from imuscope.recordings import sidecar
from imuscope.recordings.capture_timing import BLIND_RATE
from imuscope.recordings.columns.health_history import HealthHistoryWriter
from imuscope.recordings.columns.store import ColumnStore, ColumnStoreWriter
from imuscope.recordings.importers.open_file import CaptureSource
from imuscope.recordings.mcap.source import McapSource
from imuscope.recordings.mcap.writer import EVENTS, NOTES, SIGNALS, SNAPSHOT, is_simulated
from imuscope.recordings.readers.formats.log_clock import LogTimes
from imuscope.recordings.readers.message_source import MessageFile
from imuscope.recordings.sources import ChunkBlock, Source, damage_of
from imuscope.recordings.system.freed_memory import keep_freed_memory
from imuscope.recordings.tables.options import FileReading
from imuscope.recordings.tables.table_source import TableSource
from imuscope.server import wire
from imuscope.server.devices.decode.decode_options import DecodeOptions, recorded
from imuscope.server.devices.decode.protocol_detection import GUESS_SCORE, ProtocolSet
from imuscope.server.devices.device.device_demux import LinkDecoder, LinkDevices
from imuscope.server.devices.device.device_state import DeviceState, short_source
from imuscope.server.devices.device.ingest import LinkTiming
from imuscope.server.devices.device.stream_diagnostics import doubt_text
from imuscope.server.library.axis_words import (
    ARRIVAL_WORDS,
    LOG_TIME_WORDS,
    axis_sentences,
    axis_words,
    capture_words,
    segments_of,
)
from imuscope.server.library.collector import RecordingSink
from imuscope.server.library.decode_tables import decode_tables
from imuscope.server.links.registry import link_kind
from imuscope.server.wire import codec as wire_codec

DRAIN_BYTES = 1 << 20  # decoded at once; the decoders are benchmarked with this size
DRAIN_NS = 5_000_000_000  # maximum recorded time decoded at once; the clock state is stored at this interval
COUNTED_NS = 100_000_000
DERIVED_EVENTS = ("gap", "reject", "clock", "reply", "text")
GUESS_BYTES = 1 << 16
REMARK = "remark"  # reason of an event that the decoder has on its stream as a whole
MAX_TIME = 9e9  # unix s
STAMPS_FOLLOW_S = 2.0  # after a step of the log time, if they step as well
PROBE_NS, PROBE_BYTES = 2_500_000_000, 1 << 22  # examined before decoding, to find the unit of timestamps
FIRST_SHOWN_S, LAST_SHOWN_S = 0.3, 2.0  # time until the first partial result; doubles after each, up to the second
EVENTS_SHOWN = 2000  # maximum in a partial result: writing all events of a very bad line would exceed decoding


ComputeSignals = Callable[[ColumnStore, Mapping[str, Any], RecordingSink], None]
"""Adds channels to a sink, given the decoded channels and the recorded definitions by device."""


class _Device:
    """One device of the file while it is decoded."""

    def __init__(
        self,
        sink: RecordingSink,
        name: str,
        source: Source,
        protocol_set: ProtocolSet,
        reading: DecodeOptions,
        usual: DecodeOptions,
    ) -> None:
        recorded_device = source.devices.get(name)
        about: Mapping[str, str] = recorded_device.identity if recorded_device is not None else {}
        self._sink = sink
        self._protocols = protocol_set
        self._reading = reading = recorded(reading, about, usual)
        self.protocol = reading.protocol or (recorded_device.protocol if recorded_device is not None else "")
        link = about.get("link", "file")
        info = wire.DeviceInfo(
            id=name,
            name=about.get("name") or short_source(about.get("source", "") or source.path.name),
            source=about.get("source", "") or source.path.name,
            link=link if link_kind(link) is not None else "file",
            status="ended",
            protocol=self.protocol,
            product=about.get("product", ""),
            serial_number=about.get("serial_number", ""),
            firmware=about.get("firmware", ""),
            simulated=is_simulated(about),
            baud=int(about["baud"]) if about.get("baud", "").isdecimal() else None,
            topic=about.get("topic", ""),
        )
        self.state = DeviceState(sink, info, protocol_set.title)
        self.devices = LinkDevices(sink, self.state, protocol_set.title)
        self._link = info.link
        self._timed = source.timed
        self._by_gnss = lambda: getattr(source, "by_gnss", False)
        self._capacity = info.baud / 10 if info.baud else None
        self._reader: LinkDecoder | None = None
        self._decoder: object = None
        self._waiting: list[ChunkBlock] = []
        self._fed = 0
        self._drained = 0  # arrival of the last decoded chunk, ns
        self._next_tick = 0.0

        if self.protocol and self._probe() is None:
            self._begin()

    def _probe(self) -> Doubts | None:
        """Decoder that checks an option by arrival; None if no check is needed."""
        if not self._timed:
            return None
        decoder: object = self._protocols.decoder(self.protocol, self._reading, self._link)
        return decoder if isinstance(decoder, Doubts) and decoder.doubted not in self._reading.values else None

    def _settle_doubts(self) -> None:
        """Determine an option that is not given from the arrival of the first seconds."""
        probe = self._probe()
        if probe is None:
            return
        for part in self._waiting:
            probe.feed_chunks(part.data, part.ends, part.times)
        probe.drain()
        if (doubt := probe.contradiction) is not None:
            self._reading = self._reading.replaced({probe.doubted: doubt.value})
            data = {"reason": "unit", "option": probe.doubted, "unit": doubt.value}
            self.devices.own.events.report("device", "warning", doubt_text(probe.doubted, doubt), data=data)

    def _begin(self) -> None:
        byte_time_ns = 1e9 / self._capacity if self._capacity else 0
        line = LinkTiming(byte_time_ns, self._link, self._capacity, timed=self._timed, by_gnss=self._by_gnss)
        self._settle_doubts()
        decoder = self._decoder = self._protocols.decoder(self.protocol, self._reading, self._link)
        about = self._protocols.about(self.protocol)
        self.state.set(protocol=self.protocol)
        self._reader = LinkDecoder(self._sink, self.devices, decoder, line=line, about=about)

    def feed(self, part: ChunkBlock) -> None:
        """Decode bytes received from the device."""
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
            guesses = self._protocols.guess(b"".join(part.data for part in self._waiting)[: 4 * GUESS_BYTES])
            self.protocol = guesses[0].protocol if guesses and guesses[0].score >= GUESS_SCORE else ""
        if self.protocol:
            self._begin()
            assert self._reader is not None
            for part in self._waiting:
                self._feed(self._reader, part)
            self._waiting.clear()

    def _feed(self, reader: LinkDecoder, part: ChunkBlock) -> None:
        first = 0
        while first < len(part.ends):
            start = int(part.ends[first - 1]) if first else 0
            self._drained = self._drained or int(part.times[first])
            past = int(np.searchsorted(part.ends, start + DRAIN_BYTES - self._fed, "right"))
            past = max(min(past, int(np.searchsorted(part.times, self._drained + DRAIN_NS, "right"))), first + 1)
            end = int(part.ends[past - 1])
            reader.feed_chunks(part.data[start:end], part.ends[first:past] - start, part.times[first:past])
            self._fed += end - start
            last = int(part.times[past - 1])
            self._sink.time = last / 1e9
            self._count(part.ends[first:past] - start, part.times[first:past])
            if self._fed >= DRAIN_BYTES or last - self._drained >= DRAIN_NS or past < len(part.ends):
                self._drained = last
                self._drain(reader)
            first = past
        self._sink.health_history.add(self.state.info.id, part.ends, part.times)

    def _count(self, ends: NDArray[np.int64], times: NDArray[np.int64]) -> None:
        """Count bytes, summed over intervals far shorter than the window of their rate."""
        last = np.append(np.flatnonzero(np.diff(times // COUNTED_NS)), len(times) - 1)
        self.devices.own.stats.count_chunks(np.diff(ends[last], prepend=0).tolist(), (times[last] / 1e9).tolist())

    def _drain(self, reader: LinkDecoder) -> None:
        self._fed = 0
        reader.drain()
        if self._sink.time >= self._next_tick:
            self._next_tick = self._sink.time + 1.0
            self._store_clocks()
            for sender in self.devices.all:
                sender.events.tick(self._sink.time)

    def _store_clocks(self) -> None:
        """Store what the page shows live: ± of a line that is full is infinite, which ends the figures before it."""
        for one in self.devices.health_of_all(self._sink.time, self._capacity, pauses=None):
            drift, uncertainty = one.drift_ppm, one.uncertainty_ms
            if uncertainty is not None or one.time_presumes:
                none = math.inf if uncertainty is None else math.nan
                self._sink.health_history.clock(
                    one.device,
                    self._sink.time,
                    none if drift is None else drift,
                    none if uncertainty is None else uncertainty,
                )

    @property
    def axes(self) -> Mapping[str, str]:
        """The clock that gives the times of each topic, of a stream of messages."""
        return self._decoder.axes if isinstance(self._decoder, MessageDecoder) else {}

    def _report_remarks(self) -> None:
        for words in self._decoder.remarks if isinstance(self._decoder, Remarks) else ():
            self.devices.own.events.report("device", "warning", words, data={"reason": REMARK})

    def end(self) -> None:
        """Finish decoding at the end of the file."""
        if self._reader is None and self._waiting:
            self._recognise()
        if self._reader is not None:
            self._reader.drain(stalled=True)
            self._store_clocks()
        self._report_refusals()
        self._report_remarks()
        for sender in self.devices.all:
            sender.events.tick(self._sink.time + 3600.0)
            sender.state.set(status="ended", message="", hint="", next_attempt=None)

    def _report_refusals(self) -> None:
        """Report frames that another option would accept, so that missing data is explained."""
        own = self.devices.own
        for reason, one in remedies().items():
            if count := own.stats.rejects_by.get(reason, 0):
                text = f"{one.words} {one.remedy_of_file or one.remedy}"
                own.events.report("device", "warning", text, data={"reason": reason, "count": count})


class ProgressPublisher:
    """Publishes the part decoded so far: soon at first, then at growing intervals to limit the cost.

    Args:
        shown: called with the folder that contains it.
    """

    def __init__(self, shown: Callable[[Path], None]) -> None:
        self._shown = shown
        self._wait = FIRST_SHOWN_S
        self._next = time.monotonic() + self._wait

    @property
    def is_due(self) -> bool:
        return time.monotonic() >= self._next

    def show(self, folder: Path) -> None:
        """Publish the folder, and schedule the next time."""
        self._shown(folder)
        self._wait = min(2 * self._wait, LAST_SHOWN_S)
        self._next = time.monotonic() + self._wait


def decode(
    source: Source,
    folder: Path,
    protocol_set: ProtocolSet,
    reading: DecodeOptions = DecodeOptions(),  # noqa: B008 - frozen
    progress: Callable[[float], None] = lambda share: None,
    shown: Callable[[Path], None] = lambda folder: None,
    usual: DecodeOptions = DecodeOptions(),  # noqa: B008 - frozen
    compute: ComputeSignals | None = None,
) -> ColumnStore:
    """Decode a file into a store.

    Args:
        folder: of the store.
        reading: decode options from the user; a protocol given here applies to every device.
        progress: called with 0..1, from the decoding thread.
        usual: default decode options, if neither the user nor the recording gives others.
        shown: called with a ColumnStore folder of the part decoded so far, until the store itself is complete.
        compute: adds the channels of computed signals whose definitions were recorded; None: they are left out.

    Raises:
        RecordingError, OSError: the file cannot be read, or the store cannot be written; nothing is left behind.
    """
    keep_freed_memory()
    writer, files = ColumnStoreWriter(folder), contextlib.ExitStack()
    try:
        if isinstance(source, TableSource):
            return decode_tables(source, writer, progress, ProgressPublisher(shown))
        health_history = HealthHistoryWriter(writer.temporary)
        clock = reading.clock or (sidecar.stored_reading(source.path) or FileReading()).clock
        sink = RecordingSink(writer, health_history, by_arrival=clock == "arrival")
        files.callback(sink.close)
        showing = ProgressPublisher(shown)
        devices = {name: _Device(sink, name, source, protocol_set, reading, usual) for name in source.devices}
        spans: dict[str, list[int]] = {}
        log_times = LogTimes() if isinstance(source, MessageFile) and source.format == "table" else None
        for part in source.parts() if log_times is None else map(log_times.continued, source.parts()):
            if part.direction == "rx":
                if part.device not in devices:
                    devices[part.device] = _Device(sink, part.device, source, protocol_set, reading, usual)
                devices[part.device].feed(part)
            span = spans.setdefault(part.device, [int(part.times[0]), int(part.times[-1])])
            span[:] = min(span[0], int(part.times[0])), max(span[1], int(part.times[-1]))
            progress(min(part.done, 0.99))
            if showing.is_due and sink.infos:
                sink.flush()
                manifest = _manifest(source, sink, devices, spans, most_events=EVENTS_SHOWN)
                manifest |= {"progress": part.done, "ended": max(manifest["ended"], _end(source))}
                showing.show(writer.show(wire_codec.to_json_safe(manifest)))
        for device in devices.values():
            device.end()
        for name, count in sink.payloads_left_out.items():
            words = f"{count} payloads of further kinds are only in exports of the original bytes."
            sink.event(name, "device", "warning", words, data={"reason": "payloads", "count": count})
        if isinstance(source, CaptureSource) and source.guessed:
            words = f"Parts have no device clock: their times are estimated at {BLIND_RATE} B/s (115 200 Bd)."
            for name in devices:
                sink.event(name, "clock", "warning", words, data={"kind": "guessed"})
        if sink.by_arrival:
            axis = LOG_TIME_WORDS if isinstance(source, MessageFile) else ARRIVAL_WORDS
        elif isinstance(source, CaptureSource) and source.by_gnss:
            axis = capture_words(source)[0]
        else:
            axis = axis_words(one.axes for one in devices.values()) if isinstance(source, MessageFile) else ""
        if axis and devices:
            sink.event(next(iter(devices)), "clock", "info", axis, time=_begin(spans), data={"kind": "axis"})
        for at, by in source.clock_steps if isinstance(source, CaptureSource) else ():
            words = f"The time of the GNSS receiver goes back by {-by:.6g} s: a new segment begins there."
            data = {"kind": "jump", "by_ns": round(by * 1e9)}
            sink.event(next(iter(devices)), "clock", "warning", words, time=at, data=data)
        for at, by in log_times.steps if log_times is not None else ():
            near = (one for one in sink.events if one.kind == "clock" and abs(one.time - at) < STAMPS_FOLLOW_S)
            if all(one.data.get("kind") != "jump" for one in near):
                words = f"The log time goes back by {-by:.6g} s: a new segment begins there."
                data = {"kind": "log", "by_ns": round(by * 1e9)}
                sink.event(next(iter(devices)), "clock", "warning", words, time=at, data=data)
        sink.close()
        definitions = _signals_in(source, devices)
        if compute is not None and definitions:
            manifest = _manifest(source, sink, devices, spans, most_events=0)
            compute(ColumnStore(writer.show(wire_codec.to_json_safe(manifest))), definitions, sink)
        return writer.finish(wire_codec.to_json_safe(_manifest(source, sink, devices, spans)))
    except BaseException:
        files.close()
        writer.abandon()
        raise


def _end(source: Source) -> float:
    """End of a recording, unix s, from its index; 0 without an index."""
    return max(source.indexed, default=0) / 1e9 if isinstance(source, McapSource | MessageFile) else 0.0


def _manifest(
    source: Source,
    sink: RecordingSink,
    devices: Mapping[str, _Device],
    spans: Mapping[str, list[int]],
    most_events: int | None = None,
) -> dict[str, Any]:
    events = sink.events[:most_events]
    gaps = [event for event in sink.events if event.kind == "gap"]
    markers: list[dict[str, Any]] = []
    snapshots: dict[str, Any] = {}
    for channel, time_ns, body in source.metadata():
        if channel == EVENTS and (body.get("kind") not in DERIVED_EVENTS or _is_outage(body)):
            event = _event(body, time_ns)
            if event.kind != "gap" or not _is_counted(event, gaps):
                events.append(event)
        elif channel == NOTES:
            markers.append({"time": time_ns / 1e9, "id": len(markers) + 1, **_note(body)})
        elif channel.startswith(SNAPSHOT):
            snapshots[_sender(channel.removeprefix(SNAPSHOT), body, devices)] = dict(body)
    events.sort(key=lambda event: event.time)
    for number, event in enumerate(events):
        event.seq = number
    infos = [info for device in devices.values() for info in device.devices.infos]
    figures = {sender.state.info.id: sender for device in devices.values() for sender in device.devices.all}
    starts = [first for first, _ in spans.values()]
    stops = [last for _, last in spans.values()]
    return {
        "format": source.format,
        "timed": source.timed,
        "about": dict(source.header),
        "started": min(starts) / 1e9 if starts else None,
        "ended": max(stops) / 1e9 if stops else None,
        "devices": infos,
        "channels": sink.shown(),
        "clocks": list(sink.clocks.values()),
        "payloads": list(sink.payloads.values()),
        "events": events,
        "events_left_out": sink.left_out,
        "clock": "arrival" if sink.by_arrival else "",
        "segments": {} if sink.by_arrival else segments_of(sink.events, source),
        "time": {"sentences": sentences}
        if (sentences := axis_sentences(source, sink.events, is_empty=not sink.infos or sink.by_arrival))
        else None,
        "markers": markers,
        "snapshots": snapshots,
        "damage": damage_of(source),
        "health": sink.health_history.names,
        "figures": {
            device: {
                "bytes": sender.stats.bytes.total,
                "lost": sender.stats.lost,
                "restarts": sender.stats.restarts,
                "gaps": sender.stats.gaps,
                "rejects": sender.stats.rejects,
                "rejects_by": dict(sender.stats.rejects_by),
                "messages": {name: meter.total for name, meter in sender.stats.messages.items()},
            }
            for device, sender in figures.items()
        },
    }


def _begin(spans: Mapping[str, Sequence[int]]) -> float:
    """First arrival, unix s."""
    return min((first for first, _ in spans.values()), default=0) / 1e9


def _signals_in(source: Source, devices: Mapping[str, _Device]) -> dict[str, Any]:
    """Definitions of computed signals recorded with a file, the last ones of each device; as written, not checked."""
    signals: dict[str, Any] = {}
    for channel, _, body in source.metadata():
        if channel.startswith(SIGNALS):
            signals[_sender(channel.removeprefix(SIGNALS), body, devices)] = body.get("signals")
    return signals


def _sender(device: str, body: Mapping[str, Any], devices: Mapping[str, _Device]) -> str:
    """Device that the settings belong to, among those that share a line: the first device live may not be the first
    here.
    """
    own = device.partition(".")[0]
    addresses = devices[own].devices.addresses if own in devices else {}
    name = next((name for name, address in addresses.items() if address == body.get("address")), None)
    return device if name is None else f"{own}.{name}" if name else own


def _is_outage(body: Mapping[str, Any]) -> bool:
    """Whether an event is a link outage. It is not derived again, since the bytes do not show that any are missing."""
    data = body.get("data")
    times = (body.get("t0"), body.get("t1"))
    numbers = all(isinstance(time, int | float) and abs(time) < MAX_TIME for time in times)  # nor NaN
    return body.get("kind") == "gap" and numbers and isinstance(data, Mapping) and data.get("by") == "link"


def _is_counted(outage: wire.EventInfo, gaps: Sequence[wire.EventInfo]) -> bool:
    """Whether a gap detected by a counter already covers the outage."""
    t0, t1 = outage.t0 or 0.0, outage.t1 or 0.0
    return any(
        gap.device == outage.device and (gap.t0 or 0.0) < t1 and (gap.t1 or 0.0) > t0 and gap.samples for gap in gaps
    )


def _event(body: Mapping[str, Any], time_ns: int) -> wire.EventInfo:
    kind, level = body.get("kind"), str(body.get("level"))
    return wire.EventInfo(
        0,
        float(body.get("time") or time_ns / 1e9),
        str(body.get("device", "")),
        kind if kind in get_args(wire.EventKind) else "device",  # type: ignore[arg-type]
        level if level in get_args(wire.Level) else "info",  # type: ignore[arg-type]
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
