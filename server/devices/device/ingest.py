"""Conversion of the decoded messages of one device into channels, events and figures.

    device_demux.py ─> Batch ──> device time → host time ──> channels ──> sink
                       Text  ──> its numbers are a channel too (an NMEA sentence)
                       Reply ──> an event, and the identity of the device
                       SampleGap, ClockStep, RejectedFrame ──> sentences (event_reporter.py) and counts
                       unknown payloads ──> server/streaming/unknown_payloads.py

All batches of a drain are mapped to host time together. A gap lies between the frames before and after it *in the
stream*, whatever their layouts, so their times are looked up by offset.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Ints
from imuscope.protocols.clocks.capture_clock import CaptureClock
from imuscope.protocols.clocks.chunk_boundaries import ChunkBoundaries
from imuscope.protocols.clocks.clock_sync import ClockSync, TimedRows
from imuscope.protocols.clocks.host_timestamps import StampClock
from imuscope.protocols.clocks.unix_time import NO_TIME, seconds
from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, SampleGap, Text
from imuscope.protocols.family.info import DeviceTraits, StreamTraits
from imuscope.protocols.framing.stream_buffer import REFUSED
from imuscope.protocols.rotations import UNIT_TOLERANCE
from imuscope.server.devices.device.event_reporter import EventReporter
from imuscope.server.devices.device.jitter_causes import Span, cause_of
from imuscope.server.devices.device.link_stats import LinkStatistics
from imuscope.server.devices.device.losses import LossReporter
from imuscope.server.devices.device.sentence_clock import SentenceRows
from imuscope.server.devices.device.utc_time import Dating
from imuscope.server.links.base import Link
from imuscope.server.links.line_timing import byte_time_ns, holds_ns, port_of
from imuscope.server.links.registry import is_network
from imuscope.server.streaming.channels import MAX_CHANNELS, ChannelRegistry, is_quaternion
from imuscope.server.streaming.sink import TelemetrySink
from imuscope.server.streaming.unknown_payloads import UnknownPayloadTracker
from imuscope.server.wire import JitterCause

NETWORK_NS = 1e6  # one-way delay of a local network: the minimum cannot be measured from one end
MAX_RESETS = 100  # stored
SETTLED_S = 2.0  # the mapping of a clock follows a step some samples later
SLICE_NS = 1_000_000_000  # part of a drain that is mapped to host time at once
PAUSE_S = 5.0  # shortest reported pause of a capture, by the device's clock
NEAR_S = 0.5  # a jump that ends this near the end of a pause is that pause
NORM_CHECK_NS, NORM_REPORT_NS = 250_000_000, 60_000_000_000  # looking at each sample would cost a live stream too much
NO_TIMES: Ints = np.zeros(0, np.int64)
REMAP_INTERVAL_S = 10.0  # between reports, so that an unsettled mapping does not fill the log
REPORTED_ONCE = ("no_key",)  # by server/devices/device/stream_diagnostics.py, not for every frame
MAX_PROTECTIONS = 8  # listed for one device
EMBEDDED_NAMES = {"ubx": "u-blox receiver (UBX)", "rtcm3": "RTCM 3 source", "nmea": "NMEA 0183 device"}
"""Name of a device that sends only such messages, the most specific kind first: any device may send NMEA."""


@dataclass(frozen=True, slots=True)
class ProtocolTraits:
    """Properties of a protocol for ingest and session, besides its decoder; see registry.ProtocolInfo."""

    stream: StreamTraits = StreamTraits()  # noqa: RUF009 - frozen
    device: DeviceTraits = DeviceTraits()  # noqa: RUF009 - frozen
    protection: Callable[[Batch], str] | None = None
    frame_size: str = ""
    configuration_frames: str = ""


@dataclass(slots=True)
class DeviceIdentity:
    """Identity that a device reported; "" while unknown.

    Args:
        read: identity in a reply.
        sender: name of the senders, if a stream identifies its senders.
        fallback_name: name while the device sends only embedded messages (NMEA, UBX, RTCM); "" to use the protocol.
    """

    read: Callable[[Reply], Mapping[str, str]]
    sender: str = ""
    product: str = ""
    serial_number: str = ""
    firmware: str = ""
    protection: str = ""
    fallback_name: str = ""
    _protections: dict[str, None] = field(default_factory=dict)  # in order of first use

    def update(self, reply: Reply) -> bool:
        """Update from a reply; True if something is new."""
        values = self.read(reply)
        if not values:
            return False
        before = (self.product, self.serial_number, self.firmware)
        self.product = values.get("product", self.product or values.get("series", ""))
        self.serial_number = values.get("serial_number", self.serial_number)
        self.firmware = values.get("firmware", self.firmware)
        return before != (self.product, self.serial_number, self.firmware)

    def forget(self) -> None:
        """Forget who it is: what sends next may be another device."""
        self.product = self.serial_number = self.firmware = ""

    def update_protection(self, sender: str, protection: str) -> bool:
        """Note the protection of received frames; True if it is new."""
        if self.serial_number == sender and (protection == "" or protection in self._protections):
            return False
        if protection and len(self._protections) < MAX_PROTECTIONS:
            self._protections[protection] = None
        before = (self.serial_number, self.product, self.protection)
        self.protection = "; ".join(self._protections)
        if self.sender:
            self.serial_number, self.product = sender, self.sender
        return before != (self.serial_number, self.product, self.protection)

    @property
    def name(self) -> str:
        """Name of the device; "" to use the product."""
        return f"{self.product} {self.serial_number}" if self.sender and self.product else ""


@dataclass(frozen=True, slots=True)
class LinkTiming:
    """Timing properties of the link of a device.

    Args:
        byte_time_ns: duration of a byte on the link, 0 if unknown.
        kind: kind of the link (wire.DeviceInfo.link).
        capacity: bytes/s that it can carry, None if unknown.
        holds_ns: longest time for which an adapter holds bytes back, 0 without an adapter or if unknown.
        port: name of the port in the kernel, "" if it is not a serial port.
        timed: whether arrival times are real; False if they were derived from the device's own clock.
        speed: speed of delivery relative to the device's clock (Link.speed).
        by_gnss: whether arrival times are those in the messages of a GNSS receiver.
        dropped: datagrams that this host's kernel dropped so far.
    """

    byte_time_ns: float = 0
    kind: str = ""
    capacity: float | None = None
    holds_ns: float = 0
    port: str = ""
    timed: bool = True
    speed: float = 1.0
    by_gnss: Callable[[], bool] = lambda: False
    dropped: Callable[[], int] = lambda: 0

    @classmethod
    def of(cls, link: Link) -> "LinkTiming":
        """Timing properties of an open link."""
        line = byte_time_ns(link), link.kind, link.capacity, holds_ns(link), port_of(link)
        return cls(*line, speed=link.speed, dropped=lambda: getattr(link, "lost", 0))


class Ingest:
    """Ingest of one device during one connection.

    Args:
        sink: receives samples and events.
        figures, channels, incidents, unknown_payloads: of the device; they continue over reconnections.
        identify: called when the identity or the protection of frames is known.
        line, about: properties of its link and its protocol.
        pieces: chunk boundaries of the stream, updated by its reader.
        counts_rejects: the device counts the rejects of the link, whose sender is unknown.
    """

    def __init__(
        self,
        sink: TelemetrySink,
        *,
        figures: LinkStatistics,
        channels: ChannelRegistry,
        incidents: EventReporter,
        unknown_payloads: UnknownPayloadTracker,
        identify: Callable[[DeviceIdentity], None] = lambda identity: None,
        line: LinkTiming = LinkTiming(),
        pieces: ChunkBoundaries | None = None,
        about: ProtocolTraits = ProtocolTraits(),
        counts_rejects: bool = True,
    ) -> None:
        self._sink = sink
        self._stats = figures
        self._channels = channels
        self._events = incidents
        self._unknown_payloads = unknown_payloads
        self._identify = identify
        self._line = line
        self._counts_rejects = counts_rejects
        self._losses = LossReporter(figures, incidents, sink.now, line.dropped, kind=line.kind, capacity=line.capacity)
        if about.stream.output_changes is not None:
            self._losses.changes = about.stream.output_changes()
        unknown_ns = NETWORK_NS if is_network(line.kind) else 0
        self.clock: ClockSync = CaptureClock()
        if about.stream.stamped:
            self.clock = StampClock()
        elif line.timed:
            self.clock = ClockSync(line.byte_time_ns, holds_ns=line.holds_ns, unknown_ns=unknown_ns, pieces=pieces)
        receiver = ClockSync(line.byte_time_ns, holds_ns=line.holds_ns, unknown_ns=unknown_ns)
        self._sentences = SentenceRows(receiver if line.timed else None, line.by_gnss)
        self._clock_set_ns = 0  # total adjustment of a device clock that continued to count
        self._resets: deque[float] = deque(maxlen=MAX_RESETS)  # unix s
        self._breaks: list[float] = []  # restarts of the clock mapping that are not reported yet, unix s
        self._steps_ignored_until = 0.0  # clock steps until then are not reported again, unix s
        self._traits = about
        self._norms_checked_ns = self._norm_reported_ns = -(1 << 62)
        self._dating = Dating(about.stream.utc)
        self.identity = DeviceIdentity(about.device.identity, about.device.sender)
        self._kinds: set[str] | None = set()  # of embedded messages, until a message of the protocol itself arrives
        self.samples = 0

    def ingest(self, events: Sequence[Event]) -> None:
        """Process decoded events of this device, in stream order."""
        batches = [event for event in events if isinstance(event, Batch) and len(event)]
        others = events if len(batches) < len(events) else ()  # samples only, the usual case
        steps = [event for event in others if isinstance(event, ClockStep)]
        texts = [event for event in others if isinstance(event, Text)]
        exact = self._host_times(batches, steps)
        times = [seconds(one) for one in exact]
        if self._kinds is not None:
            self._update_identity(events, self._kinds)
        sentences = self._sentences.rows(texts, is_alone=self._kinds is not None)
        full = self._channels.is_full
        self._sink.publish(
            self._channels.split(
                [
                    *zip(batches, times, exact, strict=True),
                    *((one.batch, seconds(one.time_ns), one.time_ns) for one in sentences),
                ]
            )
        )
        if self._channels.is_full and not full:
            words = f"More than {MAX_CHANNELS} quantities from one device: further ones are counted, not shown."
            self._events.report("device", "warning", words, data={"most": MAX_CHANNELS})
        if (archive := self._sink.archive) is not None:
            dated = zip(batches, exact, self._dating.utc_of(batches, steps), strict=True)
            received = [(one.batch, one.time_ns, one.utc) for one in sentences if one.utc is not None]
            archive.keep_clocks(self._channels.device, [*dated, *received])
        for batch, time in zip(batches, exact, strict=True):
            self._stats.count_batch(batch)
            self.samples += len(batch)
            self._stats.count_numbered(batch, self._traits.stream)
            self._unknown_payloads.batch(batch, time)
            if (since := int(batch.arrival_ns[-1]) - self._norms_checked_ns) > NORM_CHECK_NS or since < 0:
                self._check_norms(batch)
        self.samples += len(texts)  # a device that sends only sentences is live too
        if self._traits.protection is not None:
            self._count_verified(batches, self._traits.protection)
        self._report(events, batches, times)
        self._unknown_payloads.drained()

    def _check_norms(self, batch: Batch) -> None:
        """Report quaternions whose norm is not 1; the attitude derived from them has a gap there."""
        for field_ in batch.message.fields:
            if field_.shape != (4,) or not is_quaternion(field_) or field_.name not in batch.columns:
                continue
            self._norms_checked_ns = int(batch.arrival_ns[-1])
            with np.errstate(all="ignore"):
                values = np.asarray(batch.columns[field_.name])
                norms = np.sqrt(np.einsum("ij,ij->i", values, values))
            odd = np.flatnonzero(np.abs(norms - 1) > UNIT_TOLERANCE)
            if len(odd) and self._norms_checked_ns - self._norm_reported_ns > NORM_REPORT_NS:
                self._norm_reported_ns, norm = self._norms_checked_ns, float(norms[odd[0]])
                text = f"{field_.title or field_.name} has norm {norm:.3g} instead of 1, so it gives no attitude."
                self._events.report("device", "warning", text, time=batch.arrival_ns[odd[0]] / 1e9, data={"norm": norm})

    def _update_identity(self, events: Sequence[Event], kinds: set[str]) -> None:
        """Name the device by its embedded messages until a message of its protocol arrives."""
        if any(isinstance(event, Batch) or (isinstance(event, Reply) and event.message.id >= 0) for event in events):
            detected, self._kinds = "", None
        else:
            kinds.update(event.protocol for event in events if isinstance(event, Text))
            detected = next((name for kind, name in EMBEDDED_NAMES.items() if kind in kinds), "")
        if detected != self.identity.fallback_name:
            self.identity.fallback_name = detected
            self._identify(self.identity)

    def _count_verified(self, batches: Sequence[Batch], protection: Callable[[Batch], str]) -> None:
        """Count verified samples; changes of sender and protection are reported."""
        for batch in batches:
            self._stats.count_verified(len(batch), batch.verified)
            if self.identity.update_protection(batch.device, protection(batch)):
                self._identify(self.identity)

    # ── time ──

    def jitter_cause(self, now: float, pauses: Sequence[Span] = ()) -> JitterCause | None:
        """Cause of its uneven arrival times; `pauses`: when this process did not run."""
        line = self._line
        return cause_of(self.clock, self._resets, kind=line.kind, port=line.port, now=now, pauses=pauses)

    def _host_times(self, batches: Sequence[Batch], steps: Sequence[ClockStep]) -> list[Ints]:
        """Device time of every batch, mapped to host time (unix ns); NO_TIME where a message has no clock.

        A drain of a recording may span many seconds, in which the clock may step and its mapping restart. So rows are
        mapped a second at a time, with the knowledge at that time, as they were live.
        """
        if len(batches) == 1 and not steps and self._line.timed and not isinstance(self.clock, CaptureClock):
            (batch,) = batches  # the usual case
            if batch.time_ns is not None and int(batch.arrival_ns[-1]) - int(batch.arrival_ns[0]) < SLICE_NS:
                return self._map([self._part(batch, ())])
        out = [np.full(len(batch), NO_TIME) if batch.time_ns is None else NO_TIMES for batch in batches]
        clock_sets = [step for step in steps if step.kind == "sync" and step.by_ns]
        if isinstance(self.clock, CaptureClock):
            self.clock.stepped([step.offset for step in steps if step not in clock_sets])
        timed = [i for i, batch in enumerate(batches) if batch.time_ns is not None]
        whole = {i: self._part(batches[i], clock_sets) for i in timed}
        self._clock_set_ns += sum(step.by_ns for step in clock_sets)
        if not timed:
            return out
        first = min(int(batches[i].arrival_ns[0]) for i in timed)
        last = max(int(batches[i].arrival_ns[-1]) for i in timed)
        if last - first < SLICE_NS or not self._line.timed:
            for i, times in zip(timed, self._map(list(whole.values())), strict=True):
                out[i] = times
            return out
        seconds = np.unique(np.concatenate([(part.arrival - first) // SLICE_NS for part in whole.values()]))
        done = dict.fromkeys(whole, 0)
        for i in timed:
            out[i] = np.full(len(batches[i]), NO_TIME)
        for edge in (first + (seconds + 1) * SLICE_NS).tolist():  # none of a long pause
            ends = {i: int(np.searchsorted(part.arrival, edge)) for i, part in whole.items()}
            rows = {i: slice(done[i], end) for i, end in ends.items() if done[i] < end}
            done |= ends
            for i, times in zip(rows, self._map([whole[i].rows(some) for i, some in rows.items()]), strict=True):
                out[i][rows[i]] = times
        return out

    def _part(self, batch: Batch, clock_sets: Sequence[ClockStep]) -> TimedRows:
        """The rows of a batch by a continuous clock: the jump of a device clock that received the date, or was set by
        a receiver, is removed.
        """
        assert batch.time_ns is not None
        message, device = batch.message, batch.time_ns
        if self._clock_set_ns or clock_sets:
            device = device - self._clock_set_ns
            for step in clock_sets:
                device[int(np.searchsorted(batch.offset, step.offset)) :] -= step.by_ns
        if self._line.speed != 1:  # device seconds per host second
            device = np.rint(device / self._line.speed).astype(np.int64)
        return TimedRows(device, batch.arrival_ns, batch.offset, batch.size, id(message))

    def _map(self, parts: list[TimedRows]) -> list[Ints]:
        if not parts:
            return []
        times = self.clock.map_to_host(parts)
        self._breaks += self.clock.discontinuities
        return times

    # ── events ──

    def _report(self, events: Sequence[Event], batches: Sequence[Batch], times: Sequence[NDArray[np.float64]]) -> None:
        is_usual = len(batches) == len(events) and batches and self._line.timed
        if is_usual and not self._losses.interruptions:
            ends = [_last(batch, time) for batch, time in zip(batches, times, strict=True)]
            self._losses.usual(max(ends), max(int(batch.offset[-1]) for batch in batches), batches[-1].device)
            self._report_remapping()
            return
        offsets, hosts = _stream_order(batches, times)
        if self._losses.last_time is not None and len(hosts):
            hosts = np.maximum(hosts, self._losses.last_time)
        pauses = self._pauses(hosts) if not self._line.timed else ()
        self._losses.begin(events, offsets, hosts)
        rejects: list[RejectedFrame] = []
        for event in events:
            if isinstance(event, Batch):
                continue
            if isinstance(event, Text):
                self._stats.samples(f"{event.protocol} {event.name}", 1, self._sink.now())
                self._events.text(event)
            elif isinstance(event, RejectedFrame):
                if event.reason in REFUSED or self._losses.is_new(event):
                    rejects.append(event)
                if event.reason not in REFUSED:
                    self._losses.damaged_at = event.offset
            elif isinstance(event, SampleGap):
                self._losses.gap(event)
            elif isinstance(event, ClockStep):
                if event.kind == "reset":
                    self._resets.append(event.arrival_ns / 1e9)
                after = _time_after(event, batches, times)
                if event.kind == "jump" and any(abs(after - pause) < NEAR_S for pause in pauses):
                    continue  # the clock continued during the pause
                before = [time for time in self._breaks if after - SETTLED_S < time <= after]
                self._events.step(event, before[0] if before else after)  # the mapping may have noticed it sooner
                self._steps_ignored_until = max(self._steps_ignored_until, event.arrival_ns / 1e9 + SETTLED_S)
            else:
                self._reply(event)
        self._report_remapping()
        if rejects and self._counts_rejects:
            self._stats.rejected(reject.reason for reject in rejects)
            self._events.rejects([reject for reject in rejects if reject.reason not in REPORTED_ONCE])
        if len(hosts):
            self._losses.end()

    def _pauses(self, hosts: NDArray[np.float64]) -> list[float]:
        """Report pauses of a capture by the device's clock; returns the end of each, unix s."""
        known = (
            np.concatenate(([hosts[0] if self._losses.last_time is None else self._losses.last_time], hosts))
            if len(hosts)
            else hosts
        )
        ends = []
        for at in np.flatnonzero(np.diff(known) > PAUSE_S).tolist():
            t0, t1 = float(known[at]), float(known[at + 1])
            text = f"No data was captured for {t1 - t0:.1f} s, by the device's clock."
            self._events.report("clock", "warning", text, time=t1, span=(t0, t1), data={"kind": "pause"})
            ends.append(t1)
        return ends

    def _report_remapping(self) -> None:
        """Report clock steps that only the mapping to host time detected. The decoder gets the time of some rows to
        report them first.
        """
        due = self._sink.now() - SETTLED_S
        while self._breaks and self._breaks[0] < due:
            time = self._breaks.pop(0)
            if time > self._steps_ignored_until:
                self._steps_ignored_until = time + REMAP_INTERVAL_S
                text = "The device's clock jumped: the mapping to this host's clock restarts here."
                self._events.report("clock", "warning", text, time=time, data={"kind": "jump"})

    def _reply(self, reply: Reply) -> None:
        self._stats.samples(reply.message.name, 1, self._sink.now())
        if not self._unknown_payloads.reply(reply):
            self._events.reply(reply)
        if self.identity.update(reply):
            self._identify(self.identity)


def _last(batch: Batch, time: NDArray[np.float64]) -> float:
    """Host time of the last sample of a batch, its arrival without device time. Neither decreases."""
    last = float(time[-1])
    return float(batch.arrival_ns[-1]) / 1e9 if math.isnan(last) else last


def _stream_order(
    batches: Sequence[Batch], times: Sequence[NDArray[np.float64]]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Offset and running maximum of host time (arrival without device time) of every sample, in stream order."""
    if not batches:
        return np.zeros(0, np.int64), np.zeros(0)
    arrivals = [batch.arrival_ns / 1e9 for batch in batches]
    hosts = [np.where(np.isnan(time), arrival, time) for time, arrival in zip(times, arrivals, strict=True)]
    if len(batches) == 1:
        return batches[0].offset, np.maximum.accumulate(hosts[0])
    offsets = np.concatenate([batch.offset for batch in batches])
    order = np.argsort(offsets, kind="stable")
    return offsets[order], np.maximum.accumulate(np.concatenate(hosts)[order])


def _time_after(step: ClockStep, batches: Sequence[Batch], times: Sequence[NDArray[np.float64]]) -> float:
    """Host time of the first sample after a step of the clock, where a page breaks its lines."""
    offset, time = np.inf, math.nan
    for batch, hosts in zip(batches, times, strict=True):
        at = int(np.searchsorted(batch.offset, step.offset))
        if at < len(batch) and batch.offset[at] < offset and not math.isnan(hosts[at]):
            offset, time = float(batch.offset[at]), float(hosts[at])
    return step.arrival_ns / 1e9 if math.isnan(time) else time
