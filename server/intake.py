"""How do the bytes of one device become channels, events and figures?

    chunks ─feed─> decoder ─drain─> Batch ──> device time → host time ──> channels ──> hub
                                    Text  ──> its numbers are a channel too (an NMEA sentence)
                                    Reply ──> an event, and who the device is
                                    Gap, Step, Reject ──> sentences (server/incidents.py) and counts

`feed` only appends, so that the reader of a 2 kHz device costs little; `drain` decodes what has come, once per flush of
the hub. All batches of a drain are mapped to host time together. A gap lies between the frame before and the frame
after it *in the stream*, whichever layouts those two have, so their times are looked up by offset.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.clocks import HostClock
from protocols.events import Batch, Decoder, Event, Gap, Reject, Reply, Step, Text
from protocols.schema import Field, Message
from protocols.sentences import Sentences
from server.channels import Channels
from server.health import Figures
from server.hub import Hub
from server.incidents import Blame, Incidents
from server.links.base import Chunk

FULL = 0.9  # share of a link's capacity above which a gap is put down to the link being full
SETTLED_S = 2.0  # the mapping of a clock follows a step some samples later
ANEW_S = 10.0  # a mapping that cannot settle must not fill the log
TOLD_ONCE = ("no_key",)  # by server/advice.py: that every frame is refused again is no news
MOST_SENDERS = 16  # named; more in one stream are noise, or nobody's to remember
_WIRE_BYTES = {"fp1220": 4, "fp1632": 6, "bytes": 1, "ascii": 1}
_ITEM_OVERHEAD, _FRAME_OVERHEAD = 3, 5  # bytes around an item and a frame; Xbus, and near enough for the others


def _nothing(reply: Reply) -> Mapping[str, str]:
    return {}


@dataclass(frozen=True, slots=True)
class About:
    """What an intake and a session know of a protocol beside its decoder; see registry.ProtocolInfo."""

    greeting: bytes = b""
    identity: Callable[[Reply], Mapping[str, str]] = _nothing
    protection: Callable[[Batch], str] | None = None
    sender: str = ""


@dataclass(slots=True)
class Identity:
    """Who a device said it is; "" while unknown.

    Args:
        read: what an answer tells.
        sender: what to call who sends, where a stream names its senders.
    """

    read: Callable[[Reply], Mapping[str, str]] = _nothing
    sender: str = ""
    product: str = ""
    serial_number: str = ""
    firmware: str = ""
    protection: str = ""
    _protections: dict[str, str] = field(default_factory=dict)  # by sender

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
        """Somebody sent frames that are protected in some way; True when something is new."""
        known = self._protections.get(sender)
        if known is not None and protection in (known, ""):
            return False
        if known is None and len(self._protections) >= MOST_SENDERS:
            return False
        self._protections[sender] = protection
        self.protection = "; ".join(dict.fromkeys(words for words in self._protections.values() if words))
        if self.sender:
            self.serial_number = ", ".join(sorted(self._protections, key=lambda name: (len(name), name)))
            self.product = self.sender + "s" * (len(self._protections) > 1)
        return True

    @property
    def name(self) -> str:
        """What to call it; "" to go by the product."""
        return f"{self.product} {self.serial_number}" if self.sender and self.product else ""


class Intake:
    """The data side of a session.

    Args:
        hub: where samples and events go.
        device: DeviceInfo.id.
        decoder: of the stream's protocol, fresh.
        figures: counts that go on over reconnections.
        channels: of the device; go on over reconnections, so that a channel keeps its id.
        identify: called when an answer told who the device is, or its frames how they are protected.
        about: what is known of the protocol.
        on_events: called with all that the decoder gave, after the hub has it.
    """

    def __init__(
        self,
        hub: Hub,
        device: str,
        decoder: Decoder,
        *,
        figures: Figures,
        channels: Channels,
        incidents: Incidents,
        identify: Callable[[Identity], None] = lambda identity: None,
        byte_time_ns: float = 0,
        link_kind: str = "",
        capacity: float | None = None,
        about: About = About(),
        on_events: Callable[[Sequence[Event]], None] = lambda events: None,
    ) -> None:
        self._hub = hub
        self._on_events = on_events
        self._decoder = decoder
        self._figures = figures
        self._channels = channels
        self._incidents = incidents
        self._identify = identify
        self._link_kind = link_kind
        self._capacity = capacity
        self._has_size = byte_time_ns > 0
        self._sizes: dict[int, tuple[Message, int]] = {}
        self._sentences = Sentences()
        self._last_time: float | None = None  # host time of the last frame of the previous drain
        self._fed = False
        self._rejects_before = 0  # since the last frame that was good
        self._byte_time_ns = byte_time_ns
        self._clocks: dict[str, HostClock] = {}  # by sender: each has a clock of its own
        self.clock = HostClock(byte_time_ns)  # of the first sender: what the health figures tell
        self._restarts = 0  # of all clocks' mappings, as far as they have been told
        self._quiet_until = 0.0  # until when a step of a clock is no news, unix s
        self._about = about
        self.identity = Identity(about.identity, about.sender)
        self.samples = 0

    @property
    def buffered(self) -> int:
        return self._decoder.buffered

    def feed(self, chunk: Chunk) -> None:
        """Append bytes."""
        self._decoder.feed(chunk.data, chunk.arrival_ns)
        self._fed = True

    def drain(self, *, stalled: bool = False) -> None:
        """Decode all that is complete and hand it to the hub."""
        if not (self._fed or stalled):
            return
        self._fed = False
        events = self._decoder.drain(stalled=stalled)
        if not events:
            return
        batches = [event for event in events if isinstance(event, Batch) and len(event)]
        times = self._host_times(batches)
        texts = [event for event in events if isinstance(event, Text)]
        said = [(batch, np.full(len(batch), np.nan)) for batch in self._sentences.batches(texts)]
        self._hub.publish(self._channels.split([*zip(batches, times, strict=True), *said]))
        for batch in batches:
            self._figures.samples(batch.message.name, len(batch), float(batch.arrival_ns[-1]) / 1e9)
            self.samples += len(batch)
        self.samples += len(texts)  # a device that speaks in sentences alone is alive as well
        if self._about.protection is not None:
            self._trust(batches, self._about.protection)
        self._tell(events, batches, times)
        self._on_events(events)

    def _trust(self, batches: Sequence[Batch], protection: Callable[[Batch], str]) -> None:
        """Count what is verified; who sends, and how well that is protected, is told when it changes."""
        for batch in batches:
            self._figures.trusted(len(batch), batch.verified)
            if self.identity.heard(batch.device, protection(batch)):
                self._identify(self.identity)

    # ── time ──

    def _host_times(self, batches: Sequence[Batch]) -> list[NDArray[np.float64]]:
        """Device time of every batch, mapped to host time (unix s); NaN where a message has no clock."""
        for sender in dict.fromkeys(batch.device for batch in batches):
            if sender not in self._clocks:
                self._clocks[sender] = HostClock(self._byte_time_ns) if self._clocks else self.clock
            timed = [
                (batch, batch.time_ns) for batch in batches if batch.time_ns is not None and batch.device == sender
            ]
            self._learn(self._clocks[sender], timed)
        return [
            np.full(len(batch), np.nan) if batch.time_ns is None else self._clocks[batch.device].host(batch.time_ns)
            for batch in batches
        ]

    def _learn(self, clock: HostClock, timed: list[tuple[Batch, NDArray[np.int64]]]) -> None:
        """Show a sender's clock its rows of this drain, in the order of the stream."""
        if len(timed) == 1:
            batch, device = timed[0]
            clock.add(device, batch.arrival_ns, self._frame_size(batch.message))
        elif timed:
            size: Any = 0
            if self._has_size:
                size = np.concatenate([np.full(len(batch), self._frame_size(batch.message)) for batch, _ in timed])
            order = np.argsort(np.concatenate([batch.offset for batch, _ in timed]), kind="stable")
            device = np.concatenate([device for _, device in timed])
            arrival = np.concatenate([batch.arrival_ns for batch, _ in timed])
            clock.add(device[order], arrival[order], size[order] if self._has_size else 0)

    def _frame_size(self, message: Message) -> int:
        """Bytes of a frame of this layout on the wire, 0 when the link's speed is unknown anyway."""
        if not self._has_size:
            return 0
        known = self._sizes.get(id(message))
        if known is None or known[0] is not message:
            if len(self._sizes) > 256:
                self._sizes.clear()
            size = sum(_field_bytes(field) + _ITEM_OVERHEAD for field in message.fields) + _FRAME_OVERHEAD
            known = self._sizes[id(message)] = (message, size)
        return known[1]

    # ── events ──

    def _tell(self, events: Sequence[Event], batches: Sequence[Batch], times: Sequence[NDArray[np.float64]]) -> None:
        offsets, hosts = _stream_order(batches, times)
        if self._last_time is not None and len(hosts):
            hosts = np.maximum(hosts, self._last_time)
        rejects = []
        for event in events:
            if isinstance(event, Batch):
                continue
            if isinstance(event, Text):
                self._figures.samples(f"{event.protocol} {event.name}", 1, self._hub.now())
                self._incidents.text(event)
            elif isinstance(event, Reject):
                rejects.append(event)
            elif isinstance(event, Gap):
                self._gap(event, offsets, hosts, len(rejects) + self._rejects_before)
            elif isinstance(event, Step):
                self._quiet_until = max(self._quiet_until, event.arrival_ns / 1e9 + SETTLED_S)
                self._incidents.step(event, _time_after(event, batches, times))
            else:
                self._reply(event)
        self._mapped_anew()
        if rejects:
            self._figures.rejected(reject.reason for reject in rejects)
            self._incidents.rejects([reject for reject in rejects if reject.reason not in TOLD_ONCE])
        if len(hosts):
            self._last_time = float(hosts[-1])
            self._rejects_before = sum(reject.offset > offsets[-1] for reject in rejects)
        else:
            self._rejects_before += len(rejects)

    def _mapped_anew(self) -> None:
        """A clock that ran ahead without a word of the decoder: only its mapping to host time noticed."""
        restarts = sum(clock.restarts for clock in self._clocks.values())
        if restarts <= self._restarts:
            return
        self._restarts = restarts
        now = self._hub.now()
        if now > self._quiet_until:
            self._quiet_until = now + ANEW_S
            text = "The device's clock jumped: its times are mapped to this host's anew from here on."
            self._incidents.say("clock", "caution", text, data={"kind": "jump"})

    def _reply(self, reply: Reply) -> None:
        self._figures.samples(reply.message.name, 1, self._hub.now())
        self._incidents.reply(reply)
        if self.identity.learn(reply):
            self._identify(self.identity)

    def _gap(self, gap: Gap, offsets: NDArray[np.int64], hosts: NDArray[np.float64], rejects: int) -> None:
        self._figures.gaps += 1
        self._figures.lost += gap.missing
        at = int(np.searchsorted(offsets, gap.offset))
        before = float(hosts[at - 1]) if 0 < at <= len(hosts) else self._last_time
        # The first frame after the hole may carry an older time (a GNSS solution): it ends at the first newer one.
        newer = hosts[at:] if before is None else hosts[at:][hosts[at:] > before]
        after = float(newer[0]) if len(newer) else gap.arrival_ns / 1e9
        self._incidents.gap(gap, after if before is None else min(before, after), after, self._blame(rejects))

    def _blame(self, rejects: int) -> Blame:
        """Who lost samples, as far as this end can tell."""
        if rejects:
            frames = f"{rejects} damaged frame{'s' if rejects > 1 else ''}"
            return Blame("wire", f"{frames} came in between, so bytes were damaged on the wire.")
        if self._link_kind == "udp":
            return Blame("network", "the network did not deliver them.")
        if self._capacity and self._figures.bytes.rate(self._hub.now()) >= FULL * self._capacity:
            return Blame("link", "the link is full, so the device could not send them. Lower a rate or raise the baud.")
        words = "no damaged bytes came, so they were lost before this host: in the device, the adapter or the cable."
        return Blame("device", words)


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


def _time_after(step: Step, batches: Sequence[Batch], times: Sequence[NDArray[np.float64]]) -> float:
    """Host time of the first sample that follows a step of the clock: there a page breaks its lines."""
    offset, time = np.inf, math.nan
    for batch, hosts in zip(batches, times, strict=True):
        at = int(np.searchsorted(batch.offset, step.offset))
        if at < len(batch) and batch.offset[at] < offset and not math.isnan(hosts[at]):
            offset, time = float(batch.offset[at]), float(hosts[at])
    return step.arrival_ns / 1e9 if math.isnan(time) else time


def _field_bytes(field: Field) -> int:
    if field.fields:
        return sum(_field_bytes(sub) for sub in field.fields)
    size = _WIRE_BYTES.get(field.dtype) or (np.dtype(field.dtype).itemsize if field.dtype else 0)
    return size * math.prod(max(extent, 1) for extent in field.shape)
