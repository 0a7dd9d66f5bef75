"""How does what one device sent become channels, events and figures?

    server/devices/device_demux.py ─take─> Batch ──> device time → host time ──> channels ──> hub
                              Text  ──> its numbers are a channel too (an NMEA sentence)
                              Reply ──> an event, and who the device is
                              Gap, ClockStep, RejectedFrame ──> sentences (server/devices/event_reporter.py) and counts
                              bytes that nobody has described ──> server/streaming/unknown_payloads.py

All batches of a drain are mapped to host time together. A gap lies between the frame before and the frame
after it *in the stream*, whichever layouts those two have, so their times are looked up by offset.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from protocols.capture_clock import CaptureClock
from protocols.chunk_boundaries import ChunkBoundaries
from protocols.clock_sync import ClockSync, TimedRows
from protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, SampleGap, Text
from protocols.framing import REFUSED
from protocols.nmea_quantities import NmeaQuantities
from server.devices.dating import Dating
from server.devices.event_reporter import EventReporter, LossCause
from server.devices.jitter_causes import NETWORKS, cause_of
from server.devices.link_stats import LinkStatistics
from server.links.base import Link
from server.links.line_timing import byte_time_ns, holds_ns, port_of
from server.streaming.channels import MOST_CHANNELS, Channels
from server.streaming.hub import Hub
from server.streaming.unknown_payloads import UnknownPayloads
from server.wire import TimeCause

NETWORK_NS = 1e6  # of a local network, one way: how long the quickest packet takes is not to be seen from one end
RESETS = 100  # remembered
BACK_NS = 1e9  # a clock that jumps back by more began anew: the first frames after a reset may be lost, or refused
FULL = 0.9  # share of a link's capacity above which a gap is put down to the link being full
SETTLED_S = 2.0  # the mapping of a clock follows a step some samples later
LEFT_OUT_S = 10.0  # a gap so soon after bytes were left out is put down to that
SLICE_NS = 1_000_000_000  # of a drain, mapped to host time at once
PAUSE_S = 5.0  # without data, by the clock of a capture, that are worth telling
NEAR_S = 0.5  # a jump that ends so near the end of a pause is that pause
ANEW_S = 10.0  # a mapping that cannot settle must not fill the log
TOLD_ONCE = ("no_key",)  # by server/devices/stream_diagnostics.py: that every frame is refused again is no news
MOST_PROTECTIONS = 8  # named of one device
HEARD = {"ubx": "u-blox receiver (UBX)", "rtcm3": "RTCM 3 source", "nmea": "NMEA 0183 device"}
"""What sends nothing but messages of that kind, the most telling kind first: any device may speak NMEA."""


def _nothing(reply: Reply) -> Mapping[str, str]:
    return {}


@dataclass(frozen=True, slots=True)
class ProtocolTraits:
    """What an intake and a session know of a protocol beside its decoder; see registry.ProtocolInfo."""

    greeting: bytes = b""
    identity: Callable[[Reply], Mapping[str, str]] = _nothing
    protection: Callable[[Batch], str] | None = None
    sender: str = ""
    utc: Callable[[Batch], NDArray[np.int64] | None] = lambda batch: None
    datagrams: bool = False


@dataclass(slots=True)
class DeviceIdentity:
    """Who a device said it is; "" while unknown.

    Args:
        read: what an answer tells.
        sender: what to call who sends, where a stream names its senders.
        speaks: what to call it while it speaks only what passes through any port; "" to go by the protocol.
    """

    read: Callable[[Reply], Mapping[str, str]] = _nothing
    sender: str = ""
    product: str = ""
    serial_number: str = ""
    firmware: str = ""
    protection: str = ""
    speaks: str = ""
    _protections: dict[str, None] = field(default_factory=dict)  # in the order in which they were met

    def learn(self, reply: Reply) -> bool:
        """Take what an answer tells; True when something is new."""
        told = self.read(reply)
        if not told:
            return False
        before = (self.product, self.serial_number, self.firmware)
        self.product = told.get("product", self.product or told.get("series", ""))
        self.serial_number = told.get("serial_number", self.serial_number)
        self.firmware = told.get("firmware", self.firmware)
        return before != (self.product, self.serial_number, self.firmware)

    def heard(self, sender: str, protection: str) -> bool:
        """It sent frames that are protected in some way; True when something is new."""
        if self.serial_number == sender and (protection == "" or protection in self._protections):
            return False
        if protection and len(self._protections) < MOST_PROTECTIONS:
            self._protections[protection] = None
        before = (self.serial_number, self.product, self.protection)
        self.protection = "; ".join(self._protections)
        if self.sender:
            self.serial_number, self.product = sender, self.sender
        return before != (self.serial_number, self.product, self.protection)

    @property
    def name(self) -> str:
        """What to call it; "" to go by the product."""
        return f"{self.product} {self.serial_number}" if self.sender and self.product else ""


@dataclass(frozen=True, slots=True)
class LinkTiming:
    """What is known of the link that a device is on.

    Args:
        byte_time_ns: how long a byte takes on it, 0 where that is not known.
        kind: of the link (wire.DeviceInfo.link).
        capacity: bytes/s that it can carry, None where that is not known.
        holds_ns: for how long an adapter in it is known to keep bytes back, 0 where there is none or nobody knows.
        port: what the kernel calls it, "" where it is no serial port.
        timed: whether its times of arrival are true; False: they were made from the device's own clock.
        speed: how many times faster than by the device's clock it brings bytes (Link.speed).
    """

    byte_time_ns: float = 0
    kind: str = ""
    capacity: float | None = None
    holds_ns: float = 0
    port: str = ""
    timed: bool = True
    speed: float = 1.0

    @classmethod
    def of(cls, link: Link) -> LinkTiming:
        """What is known of an open link."""
        return cls(byte_time_ns(link), link.kind, link.capacity, holds_ns(link), port_of(link), speed=link.speed)


class Ingest:
    """One device during one connection.

    Args:
        hub: where samples and events go.
        figures, channels, incidents, raws: of the device; they go on over reconnections.
        identify: called when an answer told who the device is, or its frames how they are protected.
        line, about: what is known of its link and of its protocol.
        pieces: of the stream, kept up by who reads it.
        counts_rejects: it answers for what was refused on the link; nobody knows who sent that.
    """

    def __init__(
        self,
        hub: Hub,
        *,
        figures: LinkStatistics,
        channels: Channels,
        incidents: EventReporter,
        raws: UnknownPayloads,
        identify: Callable[[DeviceIdentity], None] = lambda identity: None,
        line: LinkTiming = LinkTiming(),
        pieces: ChunkBoundaries | None = None,
        about: ProtocolTraits = ProtocolTraits(),
        counts_rejects: bool = True,
    ) -> None:
        self._hub = hub
        self._figures = figures
        self._channels = channels
        self._incidents = incidents
        self._raws = raws
        self._identify = identify
        self._line = line
        self._counts_rejects = counts_rejects
        self._sentences = NmeaQuantities()
        self._last_time: float | None = None  # host time of the last frame of the previous drain
        self._rejects_before = 0  # since the last frame that was good
        unknown_ns = NETWORK_NS if line.kind in NETWORKS else 0
        self.clock = (
            ClockSync(line.byte_time_ns, holds_ns=line.holds_ns, unknown_ns=unknown_ns, pieces=pieces)
            if line.timed
            else CaptureClock()
        )
        self._renamed_ns = 0  # by how much the device's clock was set, while it went on counting
        self._resets: deque[float] = deque(maxlen=RESETS)  # unix s
        self._breaks: list[float] = []  # where the clock's mapping began anew, unix s, as far as not told yet
        self._quiet_until = 0.0  # until when a step of the clock is no news, unix s
        self._about = about
        self._dating = Dating(about.utc)
        self.identity = DeviceIdentity(about.identity, about.sender)
        self._kinds: set[str] | None = set()  # of foreign messages, while nothing of the protocol's own was heard
        self.samples = 0

    def take(self, events: Sequence[Event]) -> None:
        """What the decoder gave of this device, in the order of the stream."""
        batches = [event for event in events if isinstance(event, Batch) and len(event)]
        steps = [event for event in events if isinstance(event, ClockStep)]
        times = self._host_times(batches, steps)
        texts = [event for event in events if isinstance(event, Text)]
        if self._kinds is not None:
            self._hear(events, self._kinds)
        said = [(batch, np.full(len(batch), np.nan)) for batch in self._sentences.batches(texts)]
        full = self._channels.full
        self._hub.publish(self._channels.split([*zip(batches, times, strict=True), *said]))
        if self._channels.full and not full:
            words = f"More than {MOST_CHANNELS} quantities came of one device: further ones are counted, not shown."
            self._incidents.say("device", "caution", words, data={"most": MOST_CHANNELS})
        if self._hub.keeps_clocks:
            dated = zip(batches, times, self._dating.of(batches, steps), strict=True)
            self._hub.keep_clocks(self._channels.device, list(dated))
        for batch, time in zip(batches, times, strict=True):
            self._figures.samples(batch.message.name, len(batch), float(batch.arrival_ns[-1]) / 1e9)
            self.samples += len(batch)
            self._raws.batch(batch, time)
        self.samples += len(texts)  # a device that speaks in sentences alone is alive as well
        if self._about.protection is not None:
            self._trust(batches, self._about.protection)
        self._tell(events, batches, times)
        self._raws.drained()

    def _hear(self, events: Sequence[Event], kinds: set[str]) -> None:
        """A device is called by its protocol once it has said something in it, and by what it does say until then."""
        if any(isinstance(event, Batch) or (isinstance(event, Reply) and event.message.id >= 0) for event in events):
            heard, self._kinds = "", None
        else:
            kinds.update(event.protocol for event in events if isinstance(event, Text))
            heard = next((name for kind, name in HEARD.items() if kind in kinds), "")
        if heard != self.identity.speaks:
            self.identity.speaks = heard
            self._identify(self.identity)

    def _trust(self, batches: Sequence[Batch], protection: Callable[[Batch], str]) -> None:
        """Count what is verified; who sends, and how well that is protected, is told when it changes."""
        for batch in batches:
            self._figures.trusted(len(batch), batch.verified)
            if self.identity.heard(batch.device, protection(batch)):
                self._identify(self.identity)

    # ── time ──

    def cause(self, now: float) -> TimeCause | None:
        """What makes its times uneven."""
        return cause_of(self.clock, self._resets, kind=self._line.kind, port=self._line.port, now=now)

    def _host_times(self, batches: Sequence[Batch], steps: Sequence[ClockStep]) -> list[NDArray[np.float64]]:
        """Device time of every batch, mapped to host time (unix s); NaN where a message has no clock.

        A drain of a recording may hold many seconds, in which the clock steps and its mapping begins anew: rows are
        mapped a second at a time, by what was known then, as they were live.
        """
        out = [np.full(len(batch), np.nan) for batch in batches]
        renames = [step for step in steps if step.kind == "sync" and step.by_ns]
        if isinstance(self.clock, CaptureClock):
            self.clock.stepped([step.offset for step in steps if step not in renames])
        timed = [i for i, batch in enumerate(batches) if batch.time_ns is not None]
        whole = {i: self._part(batches[i], renames) for i in timed}
        self._renamed_ns += sum(step.by_ns for step in renames)
        if not timed:
            return out
        first = min(int(batches[i].arrival_ns[0]) for i in timed)
        last = max(int(batches[i].arrival_ns[-1]) for i in timed)
        if last - first < SLICE_NS or not self._line.timed:
            for i, times in zip(timed, self._map(list(whole.values())), strict=True):
                out[i] = times
            return out
        for edge in range(first + SLICE_NS, last + SLICE_NS + 1, SLICE_NS):
            rows = {i: slice(*np.searchsorted(part.arrival, (edge - SLICE_NS, edge))) for i, part in whole.items()}
            rows = {i: some for i, some in rows.items() if some.start < some.stop}
            for i, times in zip(rows, self._map([whole[i].rows(some) for i, some in rows.items()]), strict=True):
                out[i][rows[i]] = times
        return out

    def _part(self, batch: Batch, renames: Sequence[ClockStep]) -> TimedRows:
        """The rows of a batch by a clock that goes on counting where the device's learned the date, or was set by a
        receiver: only its name for the moment changed."""
        assert batch.time_ns is not None
        message, device = batch.message, batch.time_ns
        if self._renamed_ns or renames:
            device = device - self._renamed_ns
            for step in renames:
                device[int(np.searchsorted(batch.offset, step.offset)) :] -= step.by_ns
        if self._line.speed != 1:  # so much of the device's time passes in a second of the host's
            device = np.rint(device / self._line.speed).astype(np.int64)
        return TimedRows(device, batch.arrival_ns, batch.offset, batch.size, id(message))

    def _map(self, parts: list[TimedRows]) -> list[NDArray[np.float64]]:
        if not parts:
            return []
        times = self.clock.times(parts)
        self._breaks += self.clock.breaks
        return times

    # ── events ──

    def _tell(self, events: Sequence[Event], batches: Sequence[Batch], times: Sequence[NDArray[np.float64]]) -> None:
        offsets, hosts = _stream_order(batches, times)
        if self._last_time is not None and len(hosts):
            hosts = np.maximum(hosts, self._last_time)
        pauses = self._pauses(hosts) if not self._line.timed else ()
        rejects: list[RejectedFrame] = []
        damaged: list[RejectedFrame] = []  # what is refused for another reason says nothing of the line
        for event in events:
            if isinstance(event, Batch):
                continue
            if isinstance(event, Text):
                self._figures.samples(f"{event.protocol} {event.name}", 1, self._hub.now())
                self._incidents.text(event)
            elif isinstance(event, RejectedFrame):
                rejects.append(event)
                if event.reason not in REFUSED:
                    damaged.append(event)
            elif isinstance(event, SampleGap):
                self._gap(event, offsets, hosts, len(damaged) + self._rejects_before)
            elif isinstance(event, ClockStep):
                if event.kind == "reset" or (event.kind == "jump" and event.by_ns < -BACK_NS):
                    self._resets.append(event.arrival_ns / 1e9)
                after = _time_after(event, batches, times)
                if event.kind == "jump" and any(abs(after - pause) < NEAR_S for pause in pauses):
                    continue  # it went on meanwhile
                before = [time for time in self._breaks if after - SETTLED_S < time <= after]
                self._incidents.step(event, before[0] if before else after)  # the mapping may have noticed it sooner
                self._quiet_until = max(self._quiet_until, event.arrival_ns / 1e9 + SETTLED_S)
            else:
                self._reply(event)
        self._mapped_anew()
        if rejects:
            self._refused(rejects)
        if len(hosts):
            self._last_time = float(hosts[-1])
            self._rejects_before = sum(reject.offset > offsets[-1] for reject in damaged)
        else:
            self._rejects_before += len(damaged)

    def _pauses(self, hosts: NDArray[np.float64]) -> list[float]:
        """Tell where a capture, by the device's clock, has a hole; when each ended, unix s."""
        known = (
            np.concatenate(([hosts[0] if self._last_time is None else self._last_time], hosts)) if len(hosts) else hosts
        )
        ends = []
        for at in np.flatnonzero(np.diff(known) > PAUSE_S).tolist():
            t0, t1 = float(known[at]), float(known[at + 1])
            text = f"Nothing was captured for {t1 - t0:.1f} s, by the device's clock."
            self._incidents.say("clock", "caution", text, time=t1, span=(t0, t1), data={"kind": "pause"})
            ends.append(t1)
        return ends

    def _refused(self, rejects: list[RejectedFrame]) -> None:
        if self._counts_rejects:
            self._figures.rejected(reject.reason for reject in rejects)
            self._incidents.rejects([reject for reject in rejects if reject.reason not in TOLD_ONCE])

    def _mapped_anew(self) -> None:
        """A clock that stepped without a word of the decoder: only its mapping to host time noticed. The decoder is
        given some rows' time to say more."""
        due = self._hub.now() - SETTLED_S
        while self._breaks and self._breaks[0] < due:
            time = self._breaks.pop(0)
            if time > self._quiet_until:
                self._quiet_until = time + ANEW_S
                text = "The device's clock jumped: its times are mapped to this host's anew from here on."
                self._incidents.say("clock", "caution", text, time=time, data={"kind": "jump"})

    def _reply(self, reply: Reply) -> None:
        self._figures.samples(reply.message.name, 1, self._hub.now())
        if not self._raws.reply(reply):
            self._incidents.reply(reply)
        if self.identity.learn(reply):
            self._identify(self.identity)

    def _gap(self, gap: SampleGap, offsets: NDArray[np.int64], hosts: NDArray[np.float64], rejects: int) -> None:
        self._figures.gaps += 1
        self._figures.lost += gap.missing
        at = int(np.searchsorted(offsets, gap.offset))
        before = float(hosts[at - 1]) if 0 < at <= len(hosts) else self._last_time
        # The first frame after the hole may carry an older time (a GNSS solution): it ends at the first newer one.
        newer = hosts[at:] if before is None else hosts[at:][hosts[at:] > before]
        after = float(newer[0]) if len(newer) else gap.arrival_ns / 1e9
        self._incidents.gap(gap, after if before is None else min(before, after), after, self._blame(rejects))

    def _blame(self, rejects: int) -> LossCause:
        """Who lost samples, as far as this end can tell."""
        if self._hub.now() - self._figures.left_out_at < LEFT_OUT_S:
            return LossCause("host", "this host could not decode them in time, and left bytes out.")
        if rejects:
            frames = f"{rejects} damaged frame{'s' if rejects > 1 else ''}"
            return LossCause("wire", f"{frames} came in between, so bytes were damaged on the wire.")
        if self._line.kind == "udp":
            return LossCause("network", "the network did not deliver them.")
        capacity = self._line.capacity
        if capacity and self._figures.bytes.rate(self._hub.now()) >= FULL * capacity:
            return LossCause(
                "link", "the link is full, so the device could not send them. Lower a rate or raise the baud."
            )
        words = "no damaged bytes came, so they were lost before this host: in the device, the adapter or the cable."
        return LossCause("device", words)


def _stream_order(
    batches: Sequence[Batch], times: Sequence[NDArray[np.float64]]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Offset and host time (arrival where there is no device time) reached by then, of every sample in stream order."""
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
    """Host time of the first sample that follows a step of the clock: there a page breaks its lines."""
    offset, time = np.inf, math.nan
    for batch, hosts in zip(batches, times, strict=True):
        at = int(np.searchsorted(batch.offset, step.offset))
        if at < len(batch) and batch.offset[at] < offset and not math.isnan(hosts[at]):
            offset, time = float(batch.offset[at]), float(hosts[at])
    return step.arrival_ns / 1e9 if math.isnan(time) else time
