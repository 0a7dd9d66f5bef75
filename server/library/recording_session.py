"""Writers of one recording: bytes, events and metadata of its devices.

    session.listeners         every chunk, both directions                 rx/<device>, tx/<device>
                              of a device that sends messages, each one    its topic
    bus: events               of its devices and of the server             events
    bus: traffic              only notes (frames are recorded as bytes,
                              commands as events)                          events
    bus: devices              identity of a device, when it changes        metadata
    controller: settings      as read, when they change                    snapshot/<device>
    computed signals          their definitions, when they change          signals/<device>
    log header                Configuration of an Xsens device             metadata, and among the bytes

A recording may begin before it was started: with the bytes that are in memory (server/devices/link/byte_memory.py), and
the events of that time. Data that arrives in the meantime follows them, in order; each byte is written once.

A device that shares a link with others (id "1.102") is recorded with the link's first ("1"), which has all received
bytes; its settings are stored separately, with its address, as another device may be the first when the recording is
opened.
"""

import asyncio
import heapq
import math
import shutil
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal

from imuscope.protocols.messages.family import NAME as MESSAGES
from imuscope.recordings.mcap.live_writer import RecordingWriter
from imuscope.recordings.mcap.read_memory import ReadFollower
from imuscope.recordings.mcap.writer import Direction
from imuscope.server import wire
from imuscope.server.configuration.controllers import ControllerRegistry
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.devices.link.byte_memory import LATEST_NS, ByteMemory, Follower, Take
from imuscope.server.devices.link.session import Session
from imuscope.server.library.api_models import MarkerRequest
from imuscope.server.library.log_header import LogHeaderRequest
from imuscope.server.library.signal_definitions import SignalDefinitions
from imuscope.server.links.base import Chunk
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.wire import codec as wire_codec

Piece = list[tuple[bytes, int]]
WAYS: tuple[Direction, ...] = ("rx", "tx")
MARKER = "Marker"  # text of a marker without one
RATE_S = 10.0  # averaging time of the rate for `seconds_left`
METADATA_FIELDS = (
    "name",
    "source",
    "link",
    "simulated",
    "protocol",
    "product",
    "serial_number",
    "firmware",
    "baud",
    "protection",
    "topic",
)


class RecordingSession:
    """One running recording.

    Args:
        writer: writer of the file.
        controllers: for known settings, and for requests to an Xsens device; None without configuration.
        request_header: whether to request the header.
        memory: of the bytes of links; None for none.
        since: begin with the bytes in memory from this time on, unix s; None: with the next bytes.
        signals: definitions of computed signals; None for none.
    """

    def __init__(
        self,
        bus: TelemetryBus,
        controllers: ControllerRegistry | None,
        writer: RecordingWriter,
        title: str,
        *,
        every: bool,
        request_header: bool,
        memory: ByteMemory | None = None,
        since: float | None = None,
        signals: SignalDefinitions | None = None,
    ) -> None:
        self.writer = writer
        self.title = title
        self.every = every  # devices that appear later join
        self.started = bus.now()
        self._memory = memory if since is not None else None
        self._since = since or 0.0
        self._pasts: list[tuple[Follower, Take]] = []
        self._past_events = bus.events_since(since) if since is not None else []
        self._bus = bus
        self._controllers = controllers
        self._with_header = request_header
        self._unsubscribe_traffic: dict[str, Callable[[], None]] = {}  # device → removes its listener
        self._written_settings: dict[str, Any] = {}  # device → settings written last
        self._signals = signals
        self._written_signals: dict[str, Any] = {}  # device → definitions written last
        self._heads: dict[str, LogHeaderRequest] = {}
        self._sessions: dict[str, Session] = {}  # being recorded
        self._recorded: dict[str, None] = {}  # devices
        self._off_closing: dict[str, Callable[[], None]] = {}  # device → removes what runs before its link closes
        self._following = threading.Lock()  # held while the writer looks for links to follow, and while one leaves
        self._follows = False
        self._has_ended = False
        self._size_history: list[tuple[float, int]] = []  # (time, bytes) of the last updates
        self._unsubscribe = [
            bus.events.subscribe(self._event),
            bus.devices.subscribe(self._device),
            bus.jobs.subscribe(self._job_report),
            bus.traffic.subscribe(self._traffic),
            *([signals.on_change(self._all_signals)] if signals is not None else ()),
        ]

    @property
    def devices(self) -> list[str]:
        """Devices being recorded."""
        return list(self._unsubscribe_traffic)

    @property
    def recorded(self) -> list[str]:
        """Devices that have been recorded."""
        return list(self._recorded)

    def join(self, session: Session, *, with_past: bool = False) -> None:
        """Also record this session, unless the recording has ended.

        Args:
            with_past: begin with its bytes in memory; `write_past` is called next.
        """
        if self._has_ended:
            return
        device, writer = session.info.id, self.writer
        self._sessions[device] = session
        self._recorded[device] = None
        writer.device(device, {**about(session.info), **session.decode_options.recorded})

        described = False

        def write(received: Sequence[tuple[bytes, int]], way: Direction, *, late: bool = False) -> None:
            nonlocal described
            if way == "rx" and session.access.link.is_followed and not late:
                return
            if way == "rx" and session.access.link.protocol == MESSAGES:
                if not described:  # earlier messages define the layout of these
                    received = [(session.access.link.preamble, received[0][1]), *received]
                    described = True
                writer.messages(device, received, late=late)
            else:
                writer.chunks(device, way, received, late=late)
            if way == "rx" and not in_event_loop():
                writer.room()

        def take(chunks: Sequence[Chunk], way: Direction) -> None:
            write([(chunk.data, chunk.arrival_ns) for chunk in chunks], way)

        link = self._memory.of(device) if self._memory is not None and with_past else None
        if link is None:
            self._unsubscribe_traffic[device] = session.listeners.chunks(take)
        else:
            follower = link.follow(write, round(self._since * 1e9))
            self._pasts.append((follower, lambda received, way: write(received, way, late=True)))
            self._unsubscribe_traffic[device] = follower.stop

        async def removed() -> None:
            with self._following:
                if (stop := self._unsubscribe_traffic.pop(device, None)) is not None:
                    self._stop(device, stop)
                    self._forget(device)

        self._off_closing[device] = session.listeners.before_close(removed)
        for one in self._controllers.on_link_of(device) if self._controllers is not None else ():
            self._settings(one)
        self._all_signals()
        controller = self._controller(device)
        if controller is not None:
            self._heads[device] = LogHeaderRequest(controller, lambda header: writer.device(device, header))
            self._request_header(session.info)

    def write_past(self, until: float | None = None) -> tuple[int, int, int] | None:
        """Write the bytes in memory, then those received since. Call it in a thread, after `join`.

        Args:
            until: write only earlier bytes, unix s, and let nothing follow.

        Returns:
            Times of the first and the last chunk in memory, ns, and their bytes; None if there were none.
        """
        pasts, self._pasts = self._pasts, []
        for event in self._past_events:
            if until is None or event.time < until:
                self._past_event(event)
        until_ns = LATEST_NS if until is None or math.isinf(until) else round(until * 1e9)
        first = last = size = 0
        for time_ns, chunks, way, take in _merged(pasts, until_ns):
            first, last = first or time_ns, max(last, chunks[-1][1])
            size += sum(len(data) for data, _ in chunks)
            take(chunks, way)
        for follower, _ in pasts if until is None else ():
            follower.begin()
        return (first, last, size) if size else None

    def note_past(self, past: tuple[int, int, int] | None) -> None:
        """Begin at the first chunk that was in memory."""
        if past is not None:
            self.started = min(self.started, past[0] / 1e9)

    def follow_links(self) -> None:
        """Let the writer take the bytes of links from their own memory where that is possible. After `write_past`."""
        self._follows = True
        self.writer.follow = self._followers

    def _followers(self) -> list[tuple[str, ReadFollower]]:
        """The links that the writer takes from by itself. In its thread."""
        with self._following:
            devices = self.devices if self._follows else []
            followers = [(device, self._sessions[device].access.link.follow()) for device in devices]
        return [(device, follower) for device, follower in followers if follower is not None]

    def _stop(self, device: str, stop: Callable[[], None]) -> None:
        """Stop recording a session, with its last bytes. The lock is held."""
        if self._follows:
            self._sessions[device].access.link.unfollow()
        stop()

    def _forget(self, device: str) -> None:
        """Keep nothing of a session that was removed: a recording may last for weeks."""
        del self._sessions[device], self._off_closing[device]
        if (head := self._heads.pop(device, None)) is not None:
            head.close()
        for known in (self._written_settings, self._written_signals):
            for one in [one for one in known if one.partition(".")[0] == device]:
                del known[one]
        self.writer.forget(device)

    def detach(self) -> None:
        """Stop recording all sessions. Idempotent: a recording may be stopped while it ends by itself."""
        if self._has_ended:
            return
        self._has_ended = True
        for off in (*self._unsubscribe, *self._off_closing.values()):
            off()
        with self._following:
            for device, stop in self._unsubscribe_traffic.items():
                self._stop(device, stop)
            self._follows = False
        for head in self._heads.values():
            head.close()

    def mark(self, mark: MarkerRequest) -> None:
        """Write a marker or a note, now or at its time."""
        when = self._bus.now() if mark.time is None else mark.time
        self.writer.note(mark.kind, mark.text, round(when * 1e9), mark.device)
        self._bus.event(mark.device, "marker", "info", mark.text or MARKER, time=when, data={"kind": mark.kind})

    def update(self) -> None:
        """Update the growth rate of the file; call it regularly."""
        now = self._bus.now()
        self._size_history.append((now, self.writer.bytes))
        self._size_history = [one for one in self._size_history if one[0] >= now - RATE_S]

    @property
    def free_bytes(self) -> int | None:
        """Free space of the disk; None if unknown."""
        try:
            return shutil.disk_usage(self.writer.path.parent).free
        except OSError:
            return None

    def seconds_left(self, free: int | None) -> float | None:
        """Time until `free` bytes are used up at the recent rate, s; None if unknown."""
        return seconds_left(self._size_history, free)

    # ── bus callbacks ────────────────────────────────────────────────────────────────────────────────────────────────

    def _controller(self, device: str) -> DeviceController | None:
        try:
            return self._controllers.get(device) if self._controllers is not None else None
        except KeyError:
            return None

    def _request_header(self, info: wire.DeviceInfo) -> None:
        """Schedule a query for the header of a log."""
        if self._with_header and info.status == "live" and info.id in self._heads:
            self._heads[info.id].send()

    @property
    def headless(self) -> list[str]:
        """Names of the devices whose header is lacking and could be requested."""
        return [name for head in self._heads.values() if (name := head.lacking)]

    def request_headers(self) -> None:
        """Request the headers that are lacking: their devices pause."""
        for head in self._heads.values():
            if head.lacking:
                head.send()

    def _settings(self, controller: DeviceController) -> None:
        """Write the settings of a device if they are known and have changed."""
        if not controller.values or self._written_settings.get(controller.device) == controller.values:
            return
        self._written_settings[controller.device] = dict(controller.values)
        known = controller.context
        body = {
            "values": controller.values,
            "missing": controller.missing,
            "reason": "as read while it was recorded" if controller.read_at >= self.started else "as read before",
            "taken": controller.read_at,
            "protocol": controller.member.info.protocol,
            "product": known.product,
            "serial_number": known.serial_number,
            "firmware": known.firmware,
            "address": controller.member.address,
        }
        self.writer.snapshot(controller.device, wire_codec.to_json_safe(body), round(self._bus.now() * 1e9))

    def _all_signals(self) -> None:
        """Write the definitions of computed signals that have changed, of all devices being recorded."""
        for info in self._bus.devices.latest.values():
            if info.id.partition(".")[0] in self._sessions:
                self._computed_signals(info)

    def _computed_signals(self, info: wire.DeviceInfo) -> None:
        if self._signals is None:
            return
        signals = [{"name": one.name, "expression": one.expression} for one in self._signals.of(info)]
        if signals == self._written_signals.get(info.id, []):
            return
        self._written_signals[info.id] = signals
        controller = self._controller(info.id)
        address = controller.member.address if controller is not None else ""
        self.writer.computed_signals(info.id, {"signals": signals, "address": address}, round(self._bus.now() * 1e9))

    def _event(self, event: wire.EventInfo) -> None:
        if event.kind == "marker":  # written as a note
            return
        if not event.device or event.device.partition(".")[0] in self._unsubscribe_traffic:
            self.writer.event(wire_codec.to_json_safe(event), round(event.time * 1e9))

    def _past_event(self, event: wire.EventInfo) -> None:
        """Write an event from before the recording; a marker was set in another one."""
        if event.kind != "marker":
            self._event(event)
        elif not event.device or event.device.partition(".")[0] in self._unsubscribe_traffic:
            kind: Literal["marker", "note"] = "note" if event.data.get("kind") == "note" else "marker"
            text = "" if event.text == MARKER else event.text
            self.writer.note(kind, text, round(event.time * 1e9), event.device)

    def _device(self, info: wire.DeviceInfo) -> None:
        if info.id in self._unsubscribe_traffic:
            self.writer.device(info.id, {**about(info), **self._sessions[info.id].decode_options.recorded})
            self._request_header(info)
        if info.id.partition(".")[0] in self._unsubscribe_traffic:
            self._computed_signals(info)

    def _job_report(self, state: wire.DeviceJobs) -> None:
        controller = self._controller(state.device)
        if (
            controller is not None
            and state.device.partition(".")[0] in self._unsubscribe_traffic
            and state.running is None
        ):
            self._settings(controller)

    def _traffic(self, entry: wire.TrafficEntry) -> None:
        if entry.direction == "note" and entry.device in self._unsubscribe_traffic:
            event = {"device": entry.device, "kind": "command", "level": entry.level, "text": entry.text, "data": {}}
            self.writer.event(event, round(entry.time * 1e9))


def _merged(pasts: Sequence[tuple[Follower, Take]], until_ns: int) -> Iterator[tuple[int, Piece, Direction, Take]]:
    """The stored chunks of all links and directions, by time: (time of the first, chunks, direction, their taker)."""

    def stored(follower: Follower, take: Take, way: Direction) -> Iterator[tuple[int, Piece, Direction, Take]]:
        for run in follower.past:
            if run.direction == way and (before := run.between(0, until_ns)) is not None:
                yield from ((piece[0][1], piece, way, take) for piece in before.pieces())

    streams = [stored(*past, way) for past in pasts for way in WAYS]
    return heapq.merge(*streams, key=lambda one: one[0])


def about(info: wire.DeviceInfo) -> dict[str, Any]:
    """Device metadata for a recording; unknown values are omitted."""
    return {name: value for name in METADATA_FIELDS if (value := getattr(info, name)) not in ("", None, False)}


def in_event_loop() -> bool:
    """Whether this thread runs an event loop, for which others wait."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


def seconds_left(sizes: Sequence[tuple[float, int]], free: int | None) -> float | None:
    """Time until the disk is full at the rate between these points (unix s, bytes), s; None if unknown."""
    if free is None or len(sizes) < 2:
        return None
    (first, before), (last, after) = sizes[0], sizes[-1]
    if last <= first or after <= before:
        return None
    return free / ((after - before) / (last - first))
