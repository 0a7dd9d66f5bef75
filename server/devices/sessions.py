"""Which devices are there? All sessions of the server: added, removed, retried, and looked after ten times a second."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import replace

from server import wire
from server.devices.decode_options import OPTIONS, DecodeOptions, ReadingError, parse_source_options
from server.devices.protocol_detection import ProtocolSet
from server.devices.sequence_store import EVERY_S, SequenceStore
from server.devices.session import Session
from server.links.base import Link, LinkError, LinkSettings
from server.links.replay import split_devices
from server.links.source_url import SourceUrl
from server.listeners import CallbackList
from server.streaming.hub import Hub

TICK_S = 0.1
HEALTH_EVERY = 5  # ticks
SAVE_EVERY = round(EVERY_S / TICK_S)
WALL_STEP_S = 0.05  # NTP slews at most 0.5 ms/s; more than this between two ticks is a step
MOST_DEVICES = 64
OPTIONS_HINT = f"A source may say {', '.join(OPTIONS)} after its question mark."

OpenLink = Callable[[str, LinkSettings], Link]


class Sessions:
    """All devices.

    Args:
        hub: where they publish.
        open_link: makes a (closed) link of a source; raises LinkError "bad-source".
        speech: the protocols.
        settings: for the links; `protocol` and `key` are filled in per source.
        wall_ns: the wall clock, which may step; a step is told as an event and moves no sample.
        sequences: where the last numbers of Secure devices are kept; None: with this process.
    """

    def __init__(
        self,
        hub: Hub,
        open_link: OpenLink,
        speech: ProtocolSet,
        settings: LinkSettings,
        *,
        wall_ns: Callable[[], int] = time.time_ns,
        sequences: SequenceStore | None = None,
    ) -> None:
        self._hub = hub
        self._open_link = open_link
        self._speech = speech
        self._settings = settings
        self._wall_ns = wall_ns
        self._sequences = sequences or SequenceStore(None)
        self._saving: asyncio.Task[None] | None = None
        self._sessions: dict[str, Session] = {}
        self._added: CallbackList[[Session]] = CallbackList()
        self._next_id = 1
        self._ticker: asyncio.Task[None] | None = None
        self._wall_offset_ns = wall_ns() - settings.now_ns()
        self._ticks = 0

    def start(self) -> None:
        """Begin to look after the sessions."""
        self._ticker = asyncio.get_running_loop().create_task(self._tick_forever(), name="sessions")

    async def close(self) -> None:
        """Stop everything and close every link."""
        if self._ticker is not None:
            self._ticker.cancel()
            await asyncio.gather(self._ticker, return_exceptions=True)
        await asyncio.gather(*(self.remove(device) for device in list(self._sessions)))
        await asyncio.to_thread(self._sequences.save)

    def add(self, source: str, reading: DecodeOptions = DecodeOptions()) -> Session:  # noqa: B008 - frozen
        """Open a source.

        Args:
            reading: what was said about it; what the source itself says comes before that, and is shown nowhere.
        Raises:
            LinkError: kind "bad-source", "busy" when it is open already, or "full" when there are too many.
        """
        try:
            source, reading = parse_source_options(source, reading)
        except ReadingError as error:
            place = source.partition("?")[0]
            raise LinkError("bad-source", f"The source {place!r} cannot be used: {error}.", OPTIONS_HINT) from None
        session = self.at(source)
        if session is not None:
            raise LinkError("busy", f"{source} is open already, as device {session.info.id}.", "Retry or remove it.")
        if len(self._sessions) >= MOST_DEVICES:
            raise LinkError("full", f"{MOST_DEVICES} devices are open, and that is the most.", "Remove one first.")
        link = self._open_link(source, replace(self._settings, protocol=reading.protocol, key=reading.key))
        device = str(self._next_id)
        self._next_id += 1
        session = self._sessions[device] = Session(device, link, self._hub, self._speech, reading, self._sequences)
        self._added.tell(session)
        session.start()
        return session

    def at(self, source: str) -> Session | None:
        """The session that has this source open, however it is written; simulators are never the same.

        Raises:
            LinkError: kind "bad-source".
        """
        wanted = SourceUrl.parse(source)
        found = (one for one in self._sessions.values() if SourceUrl.parse(one.info.source).same_place(wanted))
        return next(found, None)

    def add_all(self, source: str, reading: DecodeOptions = DecodeOptions()) -> list[Session]:  # noqa: B008 - frozen
        """Open a source; of a recording with several devices, each. As `add`; at least one."""
        return [self.add(one, reading) for one in split_devices(source)]

    def on_added(self, callback: Callable[[Session], None]) -> None:
        """Call `callback` with every session, before it starts."""
        self._added.add(callback)

    async def remove(self, device: str) -> None:
        """Close a device and forget it. KeyError when there is none of that id."""
        await self._sessions.pop(device).close()

    def get(self, device: str) -> Session:
        """KeyError when there is none of that id."""
        return self._sessions[device]

    @property
    def all(self) -> list[Session]:
        """Every session."""
        return list(self._sessions.values())

    @property
    def infos(self) -> list[wire.DeviceInfo]:
        """Every device; those on one link follow each other."""
        return [info for session in self._sessions.values() for info in session.infos]

    async def _tick_forever(self) -> None:
        while True:
            await asyncio.sleep(TICK_S)
            self.tick()

    def tick(self) -> None:
        """One look at everything."""
        now = self._hub.now()
        for session in self._sessions.values():
            session.tick(now)
        self._ticks += 1
        if self._ticks % HEALTH_EVERY == 0:
            sessions = self._sessions.values()
            self._hub.report_health([health for session in sessions for health in session.healths(now)])
            self._hub.report_raws([payload for session in sessions for payload in session.raws(now)])
        self._watch_wall_clock()
        if self._ticks % SAVE_EVERY == 0:
            for session in self._sessions.values():
                session.restarts.keep()
            if self._saving is None or self._saving.done():
                saving = asyncio.to_thread(self._sequences.save)
                self._saving = asyncio.get_running_loop().create_task(saving, name="sequences")

    def _watch_wall_clock(self) -> None:
        offset = self._wall_ns() - self._settings.now_ns()
        step_s = (offset - self._wall_offset_ns) / 1e9
        self._wall_offset_ns = offset
        if abs(step_s) >= WALL_STEP_S:
            way = "ahead" if step_s > 0 else "back"
            size = f"{abs(step_s):.3g}" if abs(step_s) < 100 else f"{abs(step_s):,.0f}".replace(",", " ")
            text = f"This host's clock was set {way} by {size} s; times on this page stay as they were."
            self._hub.event("", "clock", "caution", text, data={"step_s": step_s})
