"""Who sends on a link? One link may carry several devices (IDTP, Xbus), and each is a device on the page.

    bytes ─feed─> decoder ─drain─> Batch.device "102" ──> Sender  DeviceInfo "1"      the first that was heard
                                   Batch.device "7"   ──> Sender  DeviceInfo "1.7"    parent "1": a further one
                                   Text, RejectedFrame       ──> the first: nobody knows who sent them

The first sender is the link's own device, whose life server/devices/session.py tells. A further one has channels,
figures, clock, name and events of its own, so that it can be looked at by itself; link, bytes and state of the link it
shares. Each may fall silent while the others go on, which is told within seconds.

A page is told of at most `MOST_SENDERS` devices on a link: what others send is counted as messages of "other devices".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from protocols.chunk_boundaries import ChunkBoundaries
from protocols.events import Decoder, Event, RejectedFrame, Shared, sender_of
from protocols.framing import Ints
from server import wire
from server.devices.device_state import DeviceState, health
from server.devices.event_reporter import EventReporter
from server.devices.ingest import DeviceIdentity, Ingest, LinkTiming, ProtocolTraits
from server.devices.link_stats import LinkStatistics
from server.devices.silence_watchdog import SilenceWatchdog
from server.links.base import Chunk
from server.listeners import CallbackList
from server.streaming.channels import Channels
from server.streaming.hub import Hub
from server.streaming.unknown_payloads import UnknownPayloads

MOST_SENDERS = 16  # on one link; more are noise, or nobody's to look at
SILENT_S = 2.0  # from its first sample on; a link has less (silence_watchdog.py)
TAIL_BYTES = 1 << 17  # of the stream, kept for who wants to see a frame as it came
SILENT_HINT = "Is it powered and in range? It is shown again as soon as it speaks."


class LinkDevice:
    """One device on a link: what goes on over reconnections, and its intake during one.

    Args:
        name: in the stream (Batch.device); "" while nobody was heard, and where a stream has one device.
        bytes_of: whose count of bytes it shares: they are the link's.
    """

    def __init__(self, hub: Hub, portrait: DeviceState, name: str = "", bytes_of: LinkStatistics | None = None) -> None:
        device = portrait.info.id
        self.name = name
        self.portrait = portrait
        self.figures = LinkStatistics()
        if bytes_of is not None:
            self.figures.bytes = bytes_of.bytes
        self.channels = Channels(device, hub.advertise)
        self.incidents = EventReporter(hub, device)
        self.raws = UnknownPayloads(device, hub.keep_payloads if hub.keeps_clocks else None)
        self.intake: Ingest | None = None
        self.heard_at = 0.0  # unix s of the last sample
        self.silence_hint = ""  # what to do about its silence, where the reason for that is known
        self._patience = SilenceWatchdog(SILENT_S, SILENT_S)

    def listen(self, samples: int, now: float) -> None:
        """It sent so many samples."""
        if samples:
            self._patience.heard(now, self.heard_at or None)
            self.heard_at = now

    def hush(self, on: bool, now: float) -> None:
        """From now on (until it is taken off) silence is meant."""
        self._patience.hush(on, now)

    def quiet(self, now: float) -> float:
        """How long nothing came of it that should have, s."""
        return self._patience.quiet(now, self.heard_at)

    def is_silent(self, now: float) -> bool:
        """It has been silent for longer than is usual for it."""
        return self.quiet(now) > self._patience.limit


class LinkDevices:
    """The devices of one link.

    Args:
        own: the portrait of the link's own device.
        title: a protocol's name for a person.
    """

    def __init__(self, hub: Hub, own: DeviceState, title: Callable[[str], str]) -> None:
        self._hub = hub
        self._title = title
        self.own = LinkDevice(hub, own)
        self.others: dict[str, LinkDevice] = {}
        self.own_is_unnamed = False  # its stream names only further devices (Xbus): no name is the own device's
        self.addresses: dict[str, int] = {}  # of devices that share a line, over connections (events.Shared)
        self.made: CallbackList[[LinkDevice]] = CallbackList()  # told of each further device
        self._beyond: set[str] = set()

    @property
    def all(self) -> list[LinkDevice]:
        return [self.own, *self.others.values()]

    @property
    def figures(self) -> list[LinkStatistics]:
        """Of every device of the link, its own first."""
        return [sender.figures for sender in self.all]

    @property
    def infos(self) -> list[wire.DeviceInfo]:
        """Every device of the link, its own first."""
        return [sender.portrait.info for sender in self.all]

    def of(self, name: str) -> LinkDevice | None:
        """The device of that name in the stream, made when it is first heard; None for one too many."""
        if not (self.own.name or self.own_is_unnamed):
            self.own.name = name
        if name in ("", self.own.name):
            return self.own
        sender = self.others.get(name)
        if sender is None and len(self.others) < MOST_SENDERS - 1:
            sender = self.others[name] = self._make(name)
            self.made.tell(sender)
        elif sender is None:
            self._turn_away(name)
        return sender

    def expect(self, name: str, address: int) -> None:
        """There is a device of that address, though nothing was heard of it on this link yet.

        Args:
            name: "" for the link's own, else of a further one.
        """
        self.addresses[name] = address
        self.own_is_unnamed = True
        sender = self.of(name)
        if sender is not None:
            sender.heard_at = sender.heard_at or self._hub.now()

    def hush(self, name: str, on: bool) -> None:
        """The silence of a device is meant, as it is being configured."""
        sender = self.of(name)
        if sender is not None:
            sender.hush(on, self._hub.now())

    def _make(self, name: str) -> LinkDevice:
        own = self.own.portrait.info
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
            tries=[],
        )
        self.own.heard_at = self.own.heard_at or self._hub.now()  # while it was alone nobody asked
        return LinkDevice(self._hub, DeviceState(self._hub, info, self._title), name, self.own.figures)

    def _turn_away(self, name: str) -> None:
        if not self._beyond:
            text = f"More than {MOST_SENDERS} devices send on this link: what the others send is counted, not shown."
            self.own.incidents.say("device", "caution", text, data={"most": MOST_SENDERS})
        if len(self._beyond) < MOST_SENDERS:
            self._beyond.add(name)

    def read_anew(self) -> None:
        """The bytes are read in another way from here on."""
        self.own_is_unnamed = False
        self.addresses.clear()
        for sender in self.all:
            sender.figures.read_anew()
            sender.portrait.set(protection="")

    def tick(self, now: float, down: wire.DeviceInfo | None) -> None:
        """Ten times a second: who fell silent, and what became of the link; sums of what happened.

        Args:
            down: the link's own device while the link itself is not there.
        """
        for sender in self.all:
            sender.incidents.tick(now)
        if not self.others:
            return
        for sender in self.others.values():
            if down is not None:
                state = {
                    "status": down.status,
                    "message": down.message,
                    "hint": down.hint,
                    "next_try": down.next_try,
                    "is_open": False,
                }
                sender.portrait.set(**state)
        if down is None:
            waiting = ("live",) if all(one.is_silent(now) for one in self.all) else ("live", "connecting")
            for sender in self.all:
                if sender.portrait.info.status in waiting and sender.is_silent(now):
                    self._fell_silent(sender, now)

    def _fell_silent(self, sender: LinkDevice, now: float) -> None:
        others = "the link is still open" if all(one.is_silent(now) for one in self.all) else "others on its link go on"
        text = f"Nothing from {sender.portrait.info.name} for {sender.quiet(now):.1f} s; {others}."
        sender.incidents.say("link", "fault", text, data={"kind": "silent"})
        last = sender.figures.last_arrival
        hint = sender.silence_hint or SILENT_HINT
        sender.portrait.set(status="lost", message=text, hint=hint, next_try=None, last_arrival=last)
        if sender.intake is not None:
            sender.intake.samples = 0  # the next sample makes it live again

    def healths(self, now: float, capacity: float | None) -> list[wire.DeviceHealth]:
        """The figures of every device of the link for the page, its own first. What was refused is the link's: nobody
        can say who sent it."""
        found = []
        for sender in self.all:
            clock = sender.intake.clock if sender.intake is not None else None
            cause = sender.intake.cause(now) if sender.intake is not None else None
            found.append(health(sender.portrait.info.id, sender.figures, clock, capacity, now, cause))
        for one in found[1:]:
            one.rejects, one.rejects_by = found[0].rejects, found[0].rejects_by
        return found

    def raws(self, now: float) -> list[wire.RawPayload]:
        """What nobody has described, of every device of the link."""
        return [payload for sender in self.all if sender.raws for payload in sender.raws.report(now)]

    def leave(self) -> None:
        """The link is closed for good: all its devices go."""
        for sender in self.all:
            self._hub.remove_device(sender.portrait.info.id)


class StreamDecoder:
    """The bytes of one connection, decoded and handed to who sent them.

    `feed` only appends, so that the reader of a 2 kHz device costs little; `drain` decodes what has come, once per
    flush of the hub.

    Args:
        decoder: of the stream's protocol, fresh.
        on_events: called with all that the decoder gave, after the hub has it.
    """

    def __init__(
        self,
        hub: Hub,
        senders: LinkDevices,
        decoder: Decoder,
        *,
        line: LinkTiming = LinkTiming(),  # noqa: B008 - frozen
        about: ProtocolTraits = ProtocolTraits(),  # noqa: B008 - frozen
        on_events: Callable[[Sequence[Event]], None] = lambda events: None,
    ) -> None:
        self._hub = hub
        self._senders = senders
        self._decoder = decoder
        if isinstance(decoder, Shared):
            decoder.addresses, senders.own_is_unnamed = senders.addresses, True
        self._line = line
        self._about = about
        self._on_events = on_events
        self._fed = False
        self._tail = bytearray()
        self._end = 0
        self._pieces = ChunkBoundaries()
        for sender in senders.all:
            sender.intake = None  # a fresh connection has fresh clocks
        self._own = self._intake(senders.own)

    @property
    def buffered(self) -> int:
        return self._decoder.buffered

    @property
    def identity(self) -> DeviceIdentity:
        """Who the link's own device is."""
        return self._own.identity

    @property
    def samples(self) -> int:
        """Of the link's own device, since it was last silent."""
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
        self._pieces.add(self._end, chunk.arrival_ns)
        if len(self._tail) > 2 * TAIL_BYTES:
            del self._tail[:-TAIL_BYTES]

    def feed_many(self, data: bytes, ends: Ints, arrival_ns: Ints) -> None:
        """Append many chunks at once; see events.Decoder."""
        self._decoder.feed_many(data, ends, arrival_ns)
        self._fed = True
        self._tail += data
        self._pieces.add_many(ends + self._end, arrival_ns)
        self._end += len(data)
        del self._tail[:-TAIL_BYTES]

    def bytes_at(self, offset: int, size: int) -> bytes:
        """Bytes of the stream, as events tell their places in it; b"" where they are gone."""
        at = offset - (self._end - len(self._tail))
        return bytes(self._tail[at : at + size]) if at >= 0 else b""

    def drain(self, *, stalled: bool = False) -> None:
        """Decode all that is complete and hand it on."""
        if not (self._fed or stalled):
            return
        self._fed = False
        events = self._decoder.drain(stalled=stalled)
        if events:
            self._take(events)
        self._pieces.forget(self._end - self._decoder.buffered)

    def _take(self, events: Sequence[Event]) -> None:
        own = self._senders.own
        if all(sender_of(event) in ("", own.name) for event in events) and not self._senders.others:
            self._own.take(events)
        else:
            self._hand_out(events)
        own.figures.handed_on(self._hub.now())
        self._on_events(events)

    def _hand_out(self, events: Sequence[Event]) -> None:
        """To each sender what is its own. Rejects go to all: who lost samples is judged by them."""
        parts: dict[str, list[Event]] = {}
        refused = [event for event in events if isinstance(event, RejectedFrame)]
        for name in dict.fromkeys(sender_of(event) for event in events):
            sender = self._senders.of(name)
            if sender is not None:
                parts.setdefault(sender.name, [])
        for event in events:
            name = sender_of(event) or self._senders.own.name
            if name in parts and not isinstance(event, RejectedFrame):
                parts[name].append(event)
            elif not isinstance(event, RejectedFrame):
                self._senders.own.figures.samples("other devices", 1, self._hub.now())
        for sender in self._senders.all:
            part = parts.get(sender.name, [])
            if part or refused:
                self._give(sender, sorted([*part, *refused], key=_offset) if refused else part)

    def _give(self, sender: LinkDevice, events: list[Event]) -> None:
        intake = sender.intake or self._intake(sender)
        before = intake.samples
        intake.take(events)
        now = self._hub.now()
        new = intake.samples - before
        sender.listen(new, now)
        if sender is self._senders.own or not new:
            return
        sender.figures.last_arrival = now
        if sender.portrait.info.status != "live":
            sender.portrait.set(status="live", is_open=True, message="", hint="", next_try=None, last_arrival=now)
            sender.incidents.say("link", "info", f"{sender.portrait.info.name} is back.", data={"kind": "back"})

    def _intake(self, sender: LinkDevice) -> Ingest:
        sender.intake = Ingest(
            self._hub,
            figures=sender.figures,
            channels=sender.channels,
            incidents=sender.incidents,
            raws=sender.raws,
            identify=sender.portrait.identified,
            line=self._line,
            pieces=self._pieces,
            about=self._about,
            counts_rejects=sender is self._senders.own,
        )
        return sender.intake


def _offset(event: Event) -> int:
    """Where an event stands in the stream."""
    offset = event.offset
    return offset if isinstance(offset, int) else int(offset[0])
