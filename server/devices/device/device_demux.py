"""Demultiplexer of the devices on a link. One link may carry several devices (IDTP, Xbus), each shown separately on the
page.

    bytes ─feed─> decoder ─drain─> Batch.device "102" ──> LinkDevice  DeviceInfo "1"     the first received
                                   Batch.device "7"   ──> LinkDevice  DeviceInfo "1.7"   parent "1": a further one
                                   Text, RejectedFrame       ──> the first: their sender is unknown

The first device is the link's own, managed by server/devices/link/session.py. A further device has its own channels,
figures, clock, name and events; link, bytes and state of the link are shared. Each may fall silent while the others
continue, which is reported within seconds.

At most `MAX_SENDERS` devices of a link are shown; messages of others are counted as "other devices".
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.clocks.chunk_boundaries import ChunkBoundaries
from imuscope.protocols.events import AccountsForBytes, Decoder, Event, RejectedFrame, Shared, sender_of
from imuscope.server import wire
from imuscope.server.concurrency.listeners import CallbackList
from imuscope.server.devices.device.device_state import DeviceState, health
from imuscope.server.devices.device.event_reporter import EventReporter
from imuscope.server.devices.device.ingest import DeviceIdentity, Ingest, LinkTiming, ProtocolTraits
from imuscope.server.devices.device.link_stats import LinkStatistics
from imuscope.server.devices.device.losses import FULL_LINK_SHARE, link_load
from imuscope.server.devices.device.silence_watchdog import SilenceWatchdog
from imuscope.server.links.base import Chunk
from imuscope.server.streaming.channels import ChannelRegistry
from imuscope.server.streaming.sink import TelemetrySink
from imuscope.server.streaming.unknown_payloads import UnknownPayloadTracker

MAX_SENDERS = 16  # on one link; more are probably noise
SILENT_S = 2.0  # from its first sample on; a link has less (silence_watchdog.py)
FULL_S = 5.0  # a host that catches up after a pause reads as much for a moment
FEW_CHUNKS = 8  # are fed one by one
TAIL_BYTES = 1 << 17  # of the stream, stored for the traffic log
STOPS_WITHIN_S = 2.0  # samples on their way may come until then
SILENT_HINT = "Check that it is powered and in range; it is shown again when it sends."


NOT_QUIET = {"message": "", "hint": "", "resume": "", "quiet_since": None, "next_attempt": None}
"""Published state of a device that sends."""


@dataclass(frozen=True, slots=True)
class QuietReason:
    """Known reason why a device sends nothing.

    Args:
        text: a sentence.
        hint: what makes it send again.
        resume: command that does; "" if there is none.
        since: unix s; it explains a silence that begins then, not one that begins later.
    """

    text: str
    hint: str
    resume: str
    since: float

    def explains(self, last_arrival: float | None) -> bool:
        """Whether it explains a silence after this arrival, unix s."""
        return last_arrival is None or last_arrival < self.since + STOPS_WITHIN_S


class LinkDevice:
    """One device on a link: its state over all connections, and its ingest during one connection.

    Args:
        name: in the stream (Batch.device); "" before any data, and in a stream of one device.
        bytes_of: statistics with the byte count of the link, which it shares.
    """

    def __init__(
        self, sink: TelemetrySink, state: DeviceState, name: str = "", bytes_of: LinkStatistics | None = None
    ) -> None:
        device = state.info.id
        self.name = name
        self.state = state
        self.stats = LinkStatistics()
        if bytes_of is not None:
            self.stats.bytes = bytes_of.bytes
        self.channels = ChannelRegistry(device, sink.advertise)
        self.events = EventReporter(sink, device)
        self.unknown_payloads = UnknownPayloadTracker(
            device, sink.archive.keep_payloads if sink.archive is not None else None
        )
        self.ingest: Ingest | None = None
        self.last_sample_at = 0.0  # unix s of the last sample
        self.quiet_reason: QuietReason | None = None
        self._silence = SilenceWatchdog(SILENT_S, SILENT_S)
        state.replaced.add(self._on_replaced)

    def _on_replaced(self, before: str) -> None:
        now = self.state.info.serial_number
        text = f"Another sensor is here: {self.state.info.name} {now}, in place of {before}."
        self.events.report("link", "warning", text, data={"kind": "replaced", "before": before, "now": now})

    def count_samples(self, samples: int, now: float) -> None:
        if samples:
            self._silence.note_chunk(now, self.last_sample_at or None)
            self.last_sample_at = now

    def suppress_timeout(self, on: bool, now: float) -> None:
        """Ignore silence while `on`."""
        self._silence.suppress(on, now)

    def came_to_rest(self) -> bool:
        """Publish that the device is quiet for a known reason; False if its silence has none."""
        reason, last = self.quiet_reason, self.last_sample_at or self.stats.last_arrival
        if reason is None or not reason.explains(last):
            return False
        self.events.report("device", "info", reason.text, data={"kind": "rest", "hint": reason.hint})
        self.state.set(
            status="idle",
            message=reason.text,
            hint=reason.hint,
            resume=reason.resume,
            quiet_since=reason.since,
            next_attempt=None,
            last_arrival=self.stats.last_arrival,
        )
        if self.ingest is not None:
            self.ingest.samples = 0  # the next sample makes it live again
        return True

    def silence(self, now: float) -> float:
        """Time since the last expected data, s."""
        return self._silence.silence(now, self.last_sample_at)

    def is_silent(self, now: float) -> bool:
        """Whether the device has been silent for longer than usual."""
        return self.silence(now) > self._silence.limit


class LinkDevices:
    """The devices of one link.

    Args:
        own: state of the link's own device.
        title: displayed name of a protocol.
    """

    def __init__(self, sink: TelemetrySink, own: DeviceState, title: Callable[[str], str]) -> None:
        self._sink = sink
        self._title = title
        self.own = LinkDevice(sink, own)
        self.others: dict[str, LinkDevice] = {}
        self.own_is_unnamed = False  # the stream names only further devices (Xbus); unnamed messages are the own's
        self.addresses: dict[str, int] = {}  # of devices that share a line, over all connections (events.Shared)
        self.created: CallbackList[[LinkDevice]] = CallbackList()  # called with each further device
        self._free_at: float | None = None  # when the link had room last, or the first report, unix s
        self._rejected_names: set[str] = set()

    @property
    def all(self) -> list[LinkDevice]:
        return [self.own, *self.others.values()]

    @property
    def stats(self) -> list[LinkStatistics]:
        """Figures of every device of the link, its own first."""
        return [sender.stats for sender in self.all]

    @property
    def infos(self) -> list[wire.DeviceInfo]:
        """Every device of the link, its own first."""
        return [sender.state.info for sender in self.all]

    def of(self, name: str) -> LinkDevice | None:
        """The device with a name in the stream, created on first use; None beyond the maximum number."""
        if not (self.own.name or self.own_is_unnamed):
            self.own.name = name
        if name in ("", self.own.name):
            return self.own
        sender = self.others.get(name)
        if sender is None and len(self.others) < MAX_SENDERS - 1:
            sender = self.others[name] = self._make(name)
            self.created.call(sender)
        elif sender is None:
            self._reject_device(name)
        return sender

    def expect_reply(self, name: str, address: int) -> None:
        """Add a device with a known address from which nothing has been received on this link yet.

        Args:
            name: "" for the link's own, else the name of a further one.
        """
        self.addresses[name] = address
        self.own_is_unnamed = True
        sender = self.of(name)
        if sender is not None:
            sender.last_sample_at = sender.last_sample_at or self._sink.now()

    def suppress_timeout(self, name: str, on: bool) -> None:
        """Ignore the silence of a device while it is being configured."""
        sender = self.of(name)
        if sender is not None:
            sender.suppress_timeout(on, self._sink.now())

    def _make(self, name: str) -> LinkDevice:
        own = self.own.state.info
        info = replace(
            own,
            id=f"{own.id}.{name}",
            parent=own.id,
            name=name,
            product="",
            serial_number="",
            firmware="",
            protection="",
            status="live",
            message="",
            hint="",
            notices=[],
            attempts=[],
        )
        self.own.last_sample_at = self.own.last_sample_at or self._sink.now()  # not tracked while it was alone
        state = DeviceState(self._sink, info, self._title, self.own.state.names)
        return LinkDevice(self._sink, state, name, self.own.stats)

    def _reject_device(self, name: str) -> None:
        if not self._rejected_names:
            text = f"More than {MAX_SENDERS} devices send on this link: data of the others is counted, not shown."
            self.own.events.report("device", "warning", text, data={"most": MAX_SENDERS})
        if len(self._rejected_names) < MAX_SENDERS:
            self._rejected_names.add(name)

    def reset_decoding(self) -> None:
        """Reset for changed decode options."""
        self.own_is_unnamed = False
        self.addresses.clear()
        for sender in self.all:
            sender.stats.reset_decoding()
            sender.state.set(protection="")

    def tick(self, now: float, down: wire.DeviceInfo | None) -> tuple[str, str] | None:
        """Detect silent devices, pass on the state of the link, sum up events. Called ten times a second.

        Args:
            down: the link's own device while the link is down.

        Returns:
            Message and hint if the link's own device fell silent while its session considers it live, else None.
        """
        for sender in self.all:
            sender.events.tick(now)
        if not self.others:
            return None
        own_silence = None
        for sender in self.others.values():
            if down is not None:
                state = {
                    "status": down.status,
                    "message": down.message,
                    "hint": down.hint,
                    "next_attempt": down.next_attempt,
                    "is_open": False,
                }
                sender.state.set(**state)
        if down is None:
            states_before = ("live",) if all(one.is_silent(now) for one in self.all) else ("live", "connecting")
            for sender in self.all:
                if sender.state.info.status in states_before and sender.is_silent(now):
                    if sender is self.own:
                        own_silence = self._silence_text(sender, now)
                    else:
                        self._fell_silent(sender, now)
        return own_silence

    def _silence_text(self, sender: LinkDevice, now: float) -> tuple[str, str]:
        others = (
            "the link is still open" if all(one.is_silent(now) for one in self.all) else "others on its link continue"
        )
        return f"No data from {sender.state.info.name}; {others}.", SILENT_HINT

    def _fell_silent(self, sender: LinkDevice, now: float) -> None:
        text, hint = self._silence_text(sender, now)
        if sender.came_to_rest():
            return
        sender.events.report("link", "error", text, data={"kind": "silent"})
        last = sender.stats.last_arrival
        sender.state.set(status="lost", message=text, hint=hint, next_attempt=None, last_arrival=last)
        if sender.ingest is not None:
            sender.ingest.samples = 0  # the next sample makes it live again

    def health_of_all(
        self, now: float, capacity: float | None, pauses: Sequence[tuple[float, float]] | None = ()
    ) -> list[wire.DeviceHealth]:
        """The figures of every device of the link for the page, its own first. Rejects are those of the link, because
        their sender is unknown; without `pauses`, when this process did not run, there is no cause of jitter.
        """
        reports = []
        if self._free_at is None or link_load(self.own.stats, capacity, now) < FULL_LINK_SHARE:
            self._free_at = now
        is_full = now - self._free_at >= FULL_S
        for sender in self.all:
            clock = sender.ingest.clock if sender.ingest is not None else None
            cause = sender.ingest.jitter_cause(now, pauses) if sender.ingest and pauses is not None else None
            reports.append(health(sender.state.info.id, sender.stats, clock, capacity, now, cause, is_full=is_full))
        for one in reports[1:]:
            one.rejects, one.rejects_by = reports[0].rejects, reports[0].rejects_by
        return reports

    def unknown_payloads(self, now: float) -> list[wire.UnknownPayload]:
        """Unknown payloads of every device of the link."""
        return [
            payload for sender in self.all if sender.unknown_payloads for payload in sender.unknown_payloads.report(now)
        ]

    def remove(self) -> None:
        """Remove all devices of a link that is closed."""
        for sender in self.all:
            self._sink.remove_device(sender.state.info.id)


class LinkDecoder:
    """Decodes the bytes of one connection and distributes the events to their senders.

    `feed` only appends, so that reading a 2 kHz device costs little; `drain` decodes the received bytes, a slice at a
    time.

    Args:
        decoder: a new decoder of the stream's protocol.
        on_events: called with all decoded events, after the sink has them.
    """

    def __init__(
        self,
        sink: TelemetrySink,
        senders: LinkDevices,
        decoder: Decoder,
        *,
        line: LinkTiming = LinkTiming(),  # noqa: B008 - frozen
        about: ProtocolTraits = ProtocolTraits(),  # noqa: B008 - frozen
        on_events: Callable[[Sequence[Event]], None] = lambda events: None,
    ) -> None:
        self._sink = sink
        self._devices = senders
        self._decoder = decoder
        if isinstance(decoder, Shared):
            decoder.addresses, senders.own_is_unnamed = senders.addresses, True
        self._line = line
        self._traits = about
        self._on_events = on_events
        self._fed = False
        self._accounting = decoder if isinstance(decoder, AccountsForBytes) else None  # slow, so not in every turn
        self._skipped = 0
        self._tail = bytearray()
        self._end = 0
        self._boundaries = ChunkBoundaries()
        for sender in senders.all:
            sender.ingest = None  # a new connection has new clocks
        self._own = self._new_ingest(senders.own)

    @property
    def buffered(self) -> int:
        return self._decoder.buffered

    @property
    def unclaimed(self) -> int | None:
        """Bytes so far that belong to no message that the decoder knows; None if it does not count them."""
        return None if self._accounting is None else self._skipped

    @property
    def identity(self) -> DeviceIdentity:
        """Identity of the link's own device, as reported since its link came back."""
        return self._own.identity

    @property
    def samples(self) -> int:
        return self._own.samples

    @samples.setter
    def samples(self, count: int) -> None:
        self._own.samples = count

    def feed(self, chunk: Chunk) -> None:
        """Append bytes."""
        self._decoder.feed(chunk.data, chunk.arrival_ns)
        self._fed = True
        self._tail += chunk.data
        self._end += len(chunk.data)
        self._boundaries.add(self._end, chunk.arrival_ns)
        if len(self._tail) > 2 * TAIL_BYTES:
            del self._tail[:-TAIL_BYTES]

    def feed_all(self, chunks: Sequence[Chunk]) -> None:
        """Append chunks."""
        if len(chunks) < FEW_CHUNKS:
            for chunk in chunks:
                self.feed(chunk)
            return
        pieces = [chunk.data for chunk in chunks]
        ends = np.array(list(accumulate([len(data) for data in pieces])), np.int64)
        self.feed_chunks(b"".join(pieces), ends, np.array([chunk.arrival_ns for chunk in chunks], np.int64))

    def feed_chunks(self, data: bytes, ends: Ints, arrival_ns: Ints) -> None:
        """Append many chunks at once; see events.Decoder."""
        self._decoder.feed_chunks(data, ends, arrival_ns)
        self._fed = True
        self._tail += data
        self._boundaries.add_many((ends + self._end).tolist(), arrival_ns.tolist())
        self._end += len(data)
        if len(self._tail) > 2 * TAIL_BYTES:
            del self._tail[:-TAIL_BYTES]

    def bytes_at(self, offset: int, size: int) -> bytes:
        """Bytes of the stream at an event's offset; b"" if they are no longer stored."""
        at = offset - (self._end - len(self._tail))
        return bytes(self._tail[at : at + size]) if at >= 0 else b""

    def undecided(self) -> bytes:
        """Bytes that are not decoded yet; only the newest, if they are too many to be stored."""
        size = self._decoder.buffered
        return bytes(self._tail[-size:]) if size else b""

    def drain(self, *, stalled: bool = False) -> None:
        """Decode and pass on all complete messages."""
        if not (self._fed or stalled):
            return
        self._fed = False
        events = self._decoder.drain(stalled=stalled)
        if events:
            self._decode(events)
        if self._accounting is not None:
            skipped = self._accounting.skipped
            self._devices.own.stats.unclaimed += skipped - self._skipped
            self._skipped = skipped
        self._boundaries.forget(self._end - self._decoder.buffered)

    def _decode(self, events: Sequence[Event]) -> None:
        own = self._devices.own
        if all(sender_of(event) in ("", own.name) for event in events) and not self._devices.others:
            self._own.ingest(events)
        else:
            self._distribute(events)
        own.stats.note_published(self._sink.now())
        self._on_events(events)

    def _distribute(self, events: Sequence[Event]) -> None:
        """Pass events to their senders. Rejects go to all of them, to find the cause of losses."""
        parts: dict[str, list[Event]] = {}
        rejected = [event for event in events if isinstance(event, RejectedFrame)]
        for name in dict.fromkeys(sender_of(event) for event in events):
            sender = self._devices.of(name)
            if sender is not None:
                parts.setdefault(sender.name, [])
        for event in events:
            name = sender_of(event) or self._devices.own.name
            if name in parts and not isinstance(event, RejectedFrame):
                parts[name].append(event)
            elif not isinstance(event, RejectedFrame):
                self._devices.own.stats.samples("other devices", 1, self._sink.now())
        for sender in self._devices.all:
            part = parts.get(sender.name, [])
            if part or rejected:
                self._ingest(sender, sorted([*part, *rejected], key=_offset) if rejected else part)

    def _ingest(self, sender: LinkDevice, events: list[Event]) -> None:
        ingest = sender.ingest or self._new_ingest(sender)
        before = ingest.samples
        ingest.ingest(events)
        now = self._sink.now()
        new = ingest.samples - before
        sender.count_samples(new, now)
        if sender is self._devices.own or not new:
            return
        sender.stats.last_arrival = now
        if sender.state.info.status != "live":
            sender.quiet_reason = None
            sender.state.set(status="live", is_open=True, **NOT_QUIET, last_arrival=now)
            sender.events.report("link", "info", f"{sender.state.info.name} is back.", data={"kind": "back"})

    def _new_ingest(self, sender: LinkDevice) -> Ingest:
        sender.ingest = Ingest(
            self._sink,
            figures=sender.stats,
            channels=sender.channels,
            incidents=sender.events,
            unknown_payloads=sender.unknown_payloads,
            identify=sender.state.identified,
            line=self._line,
            pieces=self._boundaries,
            about=self._traits,
            counts_rejects=sender is self._devices.own,
        )
        return sender.ingest


def _offset(event: Event) -> int:
    offset = event.offset
    return offset if isinstance(offset, int) else int(offset[0])
