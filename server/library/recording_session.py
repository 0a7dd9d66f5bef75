"""What goes into a recording: the bytes of its devices, what happened to them, what is known about them?

    session.chunks            every chunk, both ways                       rx/<device>, tx/<device>
    hub: events               of its devices and of the server             events
    hub: exchange             the notes; frames are bytes, commands events events
    hub: devices              who a device is, whenever more is known      metadata
    desk: settings            as they were read, whenever they change      snapshot/<device>
    head                      Configuration of an Xsens device             metadata, and among the bytes

A device that shares a link with others (id "1.102") is recorded with the link's first ("1"), as its bytes came; its
settings are its own, with the address under which it sends, as another of them may be the first when it is opened.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from recordings.mcap_writer import Direction
from recordings.recording_writer import RecordingWriter
from server import wire, wire_codec
from server.configuration.controllers import ControllerRegistry
from server.configuration.device_controller import DeviceController
from server.devices.decode_options import schema_words
from server.devices.member import address_of
from server.devices.session import Session
from server.library.api_models import Mark
from server.library.mtb_header import MtbHeader
from server.streaming.hub import Hub

RATE_S = 10.0  # over which `seconds_left` takes the rate
TOLD = ("name", "source", "link", "protocol", "product", "serial_number", "firmware", "baud", "protection")
READ = ("time_unit", "rotation")  # how its bytes are read, where that was said; and the descriptions of vendor types


class RecordingSession:
    """One recording under way.

    Args:
        tape: takes it.
        desks: for settings that are known, and for asking an Xsens device; None where nobody configures.
        ask_head: whether to ask.
    """

    def __init__(
        self,
        hub: Hub,
        desks: ControllerRegistry | None,
        tape: RecordingWriter,
        title: str,
        *,
        every: bool,
        ask_head: bool,
    ) -> None:
        self.tape = tape
        self.title = title
        self.every = every  # devices that appear later join
        self.started = hub.now()
        self._hub = hub
        self._desks = desks
        self._ask_head = ask_head
        self._off: dict[str, Callable[[], None]] = {}  # device → takes its chunks off
        self._said: dict[str, Any] = {}  # device → the settings that were written last
        self._heads: dict[str, MtbHeader] = {}
        self._sessions: dict[str, Session] = {}
        self._sizes: list[tuple[float, int]] = []  # (when, bytes) of the last looks
        self._unhook = [
            hub.heard_event.add(self._event),
            hub.heard_device.add(self._device),
            hub.heard_control.add(self._control),
            hub.heard_exchange.add(self._exchange),
        ]

    @property
    def devices(self) -> list[str]:
        """Those that are recorded now."""
        return list(self._off)

    def join(self, session: Session) -> None:
        """Record this one, too."""
        device, tape = session.info.id, self.tape
        self._sessions[device] = session
        tape.device(device, {**about(session.info), **described(session)})

        def take(data: bytes, time_ns: int, way: Direction) -> None:
            tape.chunk(device, way, data, time_ns)
            if way == "rx":  # in the thread that reads the link
                tape.room()

        self._off[device] = session.chunks(take)

        async def left() -> None:
            self._off.pop(device, lambda: None)()

        session.before_close(left)
        for one in self._desks.on_link_of(device) if self._desks is not None else ():
            self._settings(one)
        desk = self._desk(device)
        if desk is not None:
            self._heads[device] = MtbHeader(desk, lambda told: tape.device(device, told))
            self._ask(session.info)

    def leave(self) -> None:
        """Take nothing more."""
        for off in (*self._unhook, *self._off.values()):
            off()
        for head in self._heads.values():
            head.close()

    def mark(self, mark: Mark) -> None:
        """A marker or a note, now or at its time."""
        when = self._hub.now() if mark.time is None else mark.time
        self.tape.note(mark.kind, mark.text, round(when * 1e9), mark.device)
        self._hub.event(mark.device, "marker", "info", mark.text or "Marker", time=when, data={"kind": mark.kind})

    def look(self) -> None:
        """Once in a while: how fast does it grow?"""
        now = self._hub.now()
        self._sizes.append((now, self.tape.bytes))
        self._sizes = [one for one in self._sizes if one[0] >= now - RATE_S]

    def seconds_left(self, free: int | None) -> float | None:
        """Until so many bytes are used up, as it went in the last seconds."""
        return seconds_left(self._sizes, free)

    # ── what is heard ────────────────────────────────────────────────────────────────────────────────────────────────

    def _desk(self, device: str) -> DeviceController | None:
        try:
            return self._desks.get(device) if self._desks is not None else None
        except KeyError:
            return None

    def _ask(self, info: wire.DeviceInfo) -> None:
        """Have it asked what the head of a log wants, when it is there."""
        if self._ask_head and info.status == "live" and info.id in self._heads:
            self._heads[info.id].ask()

    def _settings(self, desk: DeviceController) -> None:
        """The settings of a device, where they are known and were not written yet."""
        if not desk.values or self._said.get(desk.device) == desk.values:
            return
        self._said[desk.device] = dict(desk.values)
        known = desk.known
        body = {
            "values": desk.values,
            "missing": desk.missing,
            "reason": "as read while it was recorded" if desk.read_at >= self.started else "as read before",
            "taken": desk.read_at,
            "protocol": desk.session.info.protocol,
            "product": known.product,
            "serial_number": known.serial_number,
            "firmware": known.firmware,
            "address": address_of(desk.session),
        }
        self.tape.snapshot(desk.device, wire_codec.to_json_safe(body), round(self._hub.now() * 1e9))

    def _event(self, event: wire.EventInfo) -> None:
        if event.kind == "marker":  # that one is a note
            return
        if not event.device or event.device.partition(".")[0] in self._off:
            self.tape.event(wire_codec.to_json_safe(event), round(event.time * 1e9))

    def _device(self, info: wire.DeviceInfo) -> None:
        if info.id in self._off:
            self.tape.device(info.id, {**about(info), **described(self._sessions[info.id])})
            self._ask(info)

    def _control(self, state: wire.ControlState) -> None:
        desk = self._desk(state.device)
        if desk is not None and state.device.partition(".")[0] in self._off and state.running is None:
            self._settings(desk)

    def _exchange(self, entry: wire.ExchangeEntry) -> None:
        if entry.way == "note" and entry.device in self._off:
            event = {"device": entry.device, "kind": "command", "level": entry.level, "text": entry.text, "data": {}}
            self.tape.event(event, round(entry.time * 1e9))


def about(info: wire.DeviceInfo) -> dict[str, Any]:
    """What a recording tells of a device; what is not known is left out."""
    return {name: value for name in TOLD + READ if (value := getattr(info, name)) not in ("", None)}


def described(session: Session) -> dict[str, str]:
    """The descriptions of vendor types that its bytes are read with: without them a recording shows bytes."""
    words = schema_words(session.reading.schema)
    return {"schema": words} if words else {}


def seconds_left(sizes: Sequence[tuple[float, int]], free: int | None) -> float | None:
    """How long so many bytes last at the rate between these (unix s, bytes); None where that cannot be told."""
    if free is None or len(sizes) < 2:
        return None
    (first, before), (last, after) = sizes[0], sizes[-1]
    if last <= first or after <= before:
        return None
    return free / ((after - before) / (last - first))
