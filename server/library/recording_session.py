"""Writers of one recording: bytes, events and metadata of its devices.

    session.chunks            every chunk, both directions                 rx/<device>, tx/<device>
                              of a device that sends messages, each one    its topic
    bus: events               of its devices and of the server             events
    bus: traffic              only notes (frames are recorded as bytes,
                              commands as events)                          events
    bus: devices              identity of a device, when it changes        metadata
    controller: settings      as read, when they change                    snapshot/<device>
    log header                Configuration of an Xsens device             metadata, and among the bytes

A device that shares a link with others (id "1.102") is recorded with the link's first ("1"), which has all received
bytes; its settings are stored separately, with its address, as another device may be the first when the recording is
opened.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from protocols.messages.family import NAME as MESSAGES
from recordings.mcap_writer import Direction
from recordings.recording_writer import RecordingWriter
from server import wire, wire_codec
from server.configuration.controllers import ControllerRegistry
from server.configuration.device_controller import DeviceController
from server.devices.member import address_of
from server.devices.session import Session
from server.library.api_models import MarkerRequest
from server.library.log_header import LogHeaderRequest
from server.links.base import Chunk
from server.streaming.bus import TelemetryBus

RATE_S = 10.0  # averaging time of the rate for `seconds_left`
METADATA_FIELDS = ("name", "source", "link", "protocol", "product", "serial_number", "firmware", "baud", "protection")


class RecordingSession:
    """One running recording.

    Args:
        writer: writer of the file.
        controllers: for known settings, and for requests to an Xsens device; None without configuration.
        ask_head: whether to request the header.
    """

    def __init__(
        self,
        bus: TelemetryBus,
        controllers: ControllerRegistry | None,
        writer: RecordingWriter,
        title: str,
        *,
        every: bool,
        ask_head: bool,
    ) -> None:
        self.writer = writer
        self.title = title
        self.every = every  # devices that appear later join
        self.started = bus.now()
        self._bus = bus
        self._controllers = controllers
        self._ask_head = ask_head
        self._unsubscribe_traffic: dict[str, Callable[[], None]] = {}  # device → removes its listener
        self._written_settings: dict[str, Any] = {}  # device → settings written last
        self._heads: dict[str, LogHeaderRequest] = {}
        self._sessions: dict[str, Session] = {}
        self._size_history: list[tuple[float, int]] = []  # (time, bytes) of the last updates
        self._unsubscribe = [
            bus.events.subscribe(self._event),
            bus.devices.subscribe(self._device),
            bus.jobs.subscribe(self._job_report),
            bus.traffic.subscribe(self._traffic),
        ]

    @property
    def devices(self) -> list[str]:
        """Devices being recorded."""
        return list(self._unsubscribe_traffic)

    def join(self, session: Session) -> None:
        """Also record this session."""
        device, writer = session.info.id, self.writer
        self._sessions[device] = session
        writer.device(device, {**about(session.info), **session.reading.recorded})

        described = False

        def take(chunks: Sequence[Chunk], way: Direction) -> None:
            nonlocal described
            received = [(chunk.data, chunk.arrival_ns) for chunk in chunks]
            if way == "rx" and session.link.protocol == MESSAGES:
                if not described:  # what was received before says what these messages are
                    received.insert(0, (session.link.preamble, received[0][1]))
                    described = True
                writer.messages(device, received)
            else:
                writer.chunks(device, way, received)
            if way == "rx":  # in the thread that reads the link
                writer.room()

        self._unsubscribe_traffic[device] = session.chunk_batches(take)

        async def removed() -> None:
            self._unsubscribe_traffic.pop(device, lambda: None)()

        session.before_close(removed)
        for one in self._controllers.on_link_of(device) if self._controllers is not None else ():
            self._settings(one)
        controller = self._controller(device)
        if controller is not None:
            self._heads[device] = LogHeaderRequest(controller, lambda header: writer.device(device, header))
            self._request_header(session.info)

    def detach(self) -> None:
        """Stop recording all sessions."""
        for off in (*self._unsubscribe, *self._unsubscribe_traffic.values()):
            off()
        for head in self._heads.values():
            head.close()

    def mark(self, mark: MarkerRequest) -> None:
        """Write a marker or a note, now or at its time."""
        when = self._bus.now() if mark.time is None else mark.time
        self.writer.note(mark.kind, mark.text, round(when * 1e9), mark.device)
        self._bus.event(mark.device, "marker", "info", mark.text or "Marker", time=when, data={"kind": mark.kind})

    def update(self) -> None:
        """Update the growth rate of the file; call it regularly."""
        now = self._bus.now()
        self._size_history.append((now, self.writer.bytes))
        self._size_history = [one for one in self._size_history if one[0] >= now - RATE_S]

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
        if self._ask_head and info.status == "live" and info.id in self._heads:
            self._heads[info.id].send()

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
            "protocol": controller.session.info.protocol,
            "product": known.product,
            "serial_number": known.serial_number,
            "firmware": known.firmware,
            "address": address_of(controller.session),
        }
        self.writer.snapshot(controller.device, wire_codec.to_json_safe(body), round(self._bus.now() * 1e9))

    def _event(self, event: wire.EventInfo) -> None:
        if event.kind == "marker":  # written as a note
            return
        if not event.device or event.device.partition(".")[0] in self._unsubscribe_traffic:
            self.writer.event(wire_codec.to_json_safe(event), round(event.time * 1e9))

    def _device(self, info: wire.DeviceInfo) -> None:
        if info.id in self._unsubscribe_traffic:
            self.writer.device(info.id, {**about(info), **self._sessions[info.id].reading.recorded})
            self._request_header(info)

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


def about(info: wire.DeviceInfo) -> dict[str, Any]:
    """Device metadata for a recording; unknown values are omitted."""
    return {name: value for name in METADATA_FIELDS if (value := getattr(info, name)) not in ("", None)}


def seconds_left(sizes: Sequence[tuple[float, int]], free: int | None) -> float | None:
    """Time until the disk is full at the rate between these points (unix s, bytes), s; None if unknown."""
    if free is None or len(sizes) < 2:
        return None
    (first, before), (last, after) = sizes[0], sizes[-1]
    if last <= first or after <= before:
        return None
    return free / ((after - before) / (last - first))
