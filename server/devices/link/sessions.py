"""Registry of all device sessions of the server: adds, removes and retries them, and checks them at a beat."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from imuscope.server import wire
from imuscope.server.concurrency.heartbeat import UNWATCHED_S, beat, next_beat
from imuscope.server.concurrency.listeners import CallbackList
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.devices.decode.decode_options import (
    DecodeOptionError,
    DecodeOptions,
    parse_source_options,
    url_options,
)
from imuscope.server.devices.decode.decode_scheduler import DecodeScheduler
from imuscope.server.devices.decode.protocol_detection import ProtocolSet
from imuscope.server.devices.decode.sequence_store import EVERY_S, SequenceStore
from imuscope.server.devices.device.device_names import DeviceNames
from imuscope.server.devices.link.byte_memory import ByteMemory, LinkMemory
from imuscope.server.devices.link.session import Session
from imuscope.server.errors import DomainError
from imuscope.server.links.base import Link, LinkError, LinkSettings
from imuscope.server.links.replay import split_devices
from imuscope.server.links.source_url import SourceUrl
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.streaming.shedding import Shedding
from imuscope.server.wire import BusyReason

log = logging.getLogger("imuscope.session")

TICK_S = 0.1  # with viewers; without them the checks share the wake-ups of decoding
IDLE_TICK_S = 1.0  # without a session only the wall clock is watched
HEALTH_S = 0.5
WALL_STEP_S = 0.05  # NTP slews at most 0.5 ms/s; more than this between two ticks is a step
MAX_DEVICES = 64

OpenLink = Callable[[str, LinkSettings], Link]


class Sessions:
    """All devices.

    Args:
        bus: receives everything they publish.
        open_link: creates a (closed) link for a source; raises LinkError "bad-source".
        protocol_set: the protocols.
        settings: for the links; `protocol` and `decode_options` are filled in per source.
        wall_ns: the wall clock, which may step; a step is reported as an event and does not move samples.
        sequences: store of the last numbers of Secure devices; None: in this process only.
        sample_interval: present interval at which samples are needed, s.
        shedding: the work left out while decoding is behind.
        byte_memory: keeps the last bytes of every session; None: they are not kept.
        names: ids and names of devices in earlier runs; None: there were none.

    Attributes:
        scan_lock: held during a port scan, because a port can be opened only once.
    """

    def __init__(
        self,
        bus: TelemetryBus,
        open_link: OpenLink,
        protocol_set: ProtocolSet,
        settings: LinkSettings,
        *,
        wall_ns: Callable[[], int] = time.time_ns,
        sequences: SequenceStore | None = None,
        sample_interval: Callable[[], float] = lambda: UNWATCHED_S,
        shedding: Shedding | None = None,
        byte_memory: ByteMemory | None = None,
        names: DeviceNames | None = None,
    ) -> None:
        self._bus = bus
        self._scheduler = DecodeScheduler(sample_interval)
        self._open_link = open_link
        self._replacements: list[Callable[[Link], Link]] = []
        self._protocols = protocol_set
        self._settings = settings
        self._wall_ns = wall_ns
        self._byte_memory = byte_memory
        self._sequences = sequences or SequenceStore(None)
        self._saving: asyncio.Task[None] | None = None
        self._sessions: dict[str, Session] = {}
        self._added: CallbackList[[Session]] = CallbackList()
        self.names = names or DeviceNames(None)
        self._used: set[str] = set()  # ids: none is given twice in a run, or a page could take one device for another
        self.names.on_change(self._renamed)
        self._ticker: asyncio.Task[None] | None = None
        self._wall_offset_ns = wall_ns() - settings.now_ns()
        self._sample_interval = sample_interval
        self._health_due, self._save_due = 0.0, bus.now() + EVERY_S
        self._has_sessions = asyncio.Event()
        self.scan_lock = asyncio.Lock()
        self._shedding, self._processor = shedding or Shedding(), ProcessorUse()

    def open_through(self, replacement: Callable[[Link], Link]) -> None:
        """Open sources with the link that an extension gives in place of theirs, one extension after the other."""
        self._replacements.append(replacement)

    def memory_of(self, device: str) -> LinkMemory | None:
        """The last bytes of the link of a device; None if none are kept."""
        return self._byte_memory.of(device) if self._byte_memory is not None else None

    def start(self) -> None:
        """Start checking the sessions."""
        self._ticker = asyncio.get_running_loop().create_task(self._tick_forever(), name="sessions")

    async def close(self) -> None:
        """Stop everything and close every link."""
        await end_tasks(self._ticker)
        await asyncio.gather(*(self.remove(device) for device in list(self._sessions)))
        await asyncio.to_thread(self._sequences.save)

    def add(self, source: str, reading: DecodeOptions = DecodeOptions()) -> Session:  # noqa: B008 - frozen
        """Open a source.

        Args:
            reading: decode options; those in the source override them and are not shown.

        Raises:
            LinkError: kind "bad-source", "busy" if it is already open, or "full" if there are too many.
        """
        try:
            source, reading = parse_source_options(source, reading)
        except DecodeOptionError as error:
            place = source.partition("?")[0]
            hint = f"After its question mark a source accepts: {', '.join(url_options())}."
            raise LinkError("bad-source", f"The source {place!r} cannot be used: {error}.", hint) from None
        session = self.at(source)
        if session is not None:
            raise LinkError("busy", f"{source} is already open, as device {session.info.id}.", "Retry or remove it.")
        if len(self._sessions) >= MAX_DEVICES:
            raise LinkError("full", f"The maximum of {MAX_DEVICES} devices is open.", "Remove one first.")
        settings = replace(self._settings, protocol=reading.protocol, decode_options=reading.values)
        link = self._open_link(source, settings)
        for replacement in self._replacements:
            link = replacement(link)
        link.distinguish(session.access.link for session in self._sessions.values())
        device = self.names.id_of(source, self._used)
        self._used.add(device)
        session = self._sessions[device] = Session(
            device, link, self._bus, self._protocols, reading, self._sequences, self._scheduler, self.names
        )
        if self._byte_memory is not None:
            self._byte_memory.watch(session)
        self._added.call(session)
        session.start()
        self._has_sessions.set()
        return session

    def at(self, source: str) -> Session | None:
        """The session that has this source open, in any notation; simulators are never the same.

        Raises:
            LinkError: kind "bad-source".
        """
        address = SourceUrl.parse(source)
        sessions = (one for one in self.all if SourceUrl.parse(one.info.source).same_place(address))
        return next(sessions, None)

    async def add_all(
        self,
        source: str,
        reading: DecodeOptions = DecodeOptions(),  # noqa: B008 - frozen
    ) -> list[Session]:
        """Open a source, or each device of a recording. As `add`; returns at least one session."""
        return [self.add(one, reading) for one in await split_devices(source)]

    def on_added(self, callback: Callable[[Session], None]) -> None:
        """Call `callback` with every session, before it starts."""
        self._added.add(callback)

    async def remove(self, device: str) -> None:
        """Close and remove a device by its id; KeyError for an unknown one."""
        await self._sessions.pop(device).close()
        self.names.withdraw(device)

    def get(self, device: str) -> Session:
        """The session of a device, by the id or the key of its link's own device.

        Raises:
            KeyError, DomainError: as `id_of`.
        """
        return self._sessions[self.id_of(device)]

    def id_of(self, device: str) -> str:
        """The id of a device that is named by its id, its topic or its key, which is its source before it is known.

        Raises:
            KeyError: there is no such device.
            DomainError: "which-device" if several have this key.
        """
        infos = self.infos
        if any(info.id == device for info in infos):
            return device
        ids = [
            info.id for info in infos if device in (info.key, info.topic) or (info.source == device and not info.parent)
        ]
        if len(ids) > 1:
            raise DomainError("which-device", f"{len(ids)} devices are {device}.", f"Name one: {', '.join(ids)}.")
        if not ids:
            raise KeyError(device)
        return ids[0]

    def _renamed(self) -> None:
        for session in self._sessions.values():
            for sender in session.devices.all:
                sender.state.renamed()

    @property
    def all(self) -> list[Session]:
        """Every session. For any thread: routes look devices up in one."""
        return list(self._sessions.values())

    @property
    def infos(self) -> list[wire.DeviceInfo]:
        """Every device; those on one link are adjacent."""
        return [info for session in self.all for info in session.infos]

    async def _tick_forever(self) -> None:
        while True:
            if self._sessions:
                await beat(max(TICK_S, min(self._sample_interval(), UNWATCHED_S)))
            else:
                self._has_sessions.clear()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout_at(next_beat(asyncio.get_running_loop().time(), IDLE_TICK_S)):
                        await self._has_sessions.wait()
            self.tick()

    def tick(self) -> None:
        """Check all sessions once."""
        now = self._bus.now()
        for session in self._sessions.values():
            try:
                session.tick(now)
            except Exception:  # an error of one device must not affect the others
                log.exception("watching %s failed", session.info.source)
        self._processor.update(now)
        self._shedding.update(max((session.behind(now) for session in self._sessions.values()), default=0.0), now)
        if now >= self._health_due:
            self._health_due = now + HEALTH_S - TICK_S / 2
            sessions = self._sessions.values()
            health = [one for session in sessions for one in session.health_of_all(now)]
            for one in health:
                one.behind.reason = self._processor.reason if one.behind.decoding else ""
            self._bus.health.publish({one.device: one for one in health})
            self._bus.report_unknown_payloads(
                [one for session in sessions for one in session.devices.unknown_payloads(now)]
            )
        self._watch_wall_clock()
        if now >= self._save_due:
            self._save_due = now + EVERY_S
            for session in self._sessions.values():
                session.restarts.save()
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
            self._bus.event("", "clock", "warning", text, data={"step_s": step_s})


SCHEDSTAT = Path("/proc/thread-self/schedstat")
OVER_S = 2.0
WAITED_SHARE, USED_SHARE = 0.25, 0.7  # shares of the time


class ProcessorUse:
    """Shares of the last seconds in which the calling thread waited for a processor, and ran: why decoding is behind.
    Linux counts both for each thread; elsewhere no reason is reported.

    Args:
        schedstat: counters of the thread: ns that it ran, ns that it waited, turns.
    """

    def __init__(self, schedstat: Path = SCHEDSTAT) -> None:
        self._path = schedstat
        self._last: tuple[float, int, int] | None = None  # s, ns, ns
        self.waited = self.used = 0.0

    def update(self, now: float) -> None:
        """Read the counters, at most every `OVER_S`. `now`: monotonic, s."""
        if self._last is not None and now - self._last[0] < OVER_S:
            return
        try:
            ran, waited = (int(count) for count in self._path.read_text().split()[:2])
        except (OSError, ValueError):
            return
        if self._last is not None:
            span = 1e9 * (now - self._last[0])
            self.used, self.waited = (ran - self._last[1]) / span, (waited - self._last[2]) / span
        self._last = now, ran, waited

    @property
    def reason(self) -> BusyReason:
        """Why decoding is behind, if it is: "" if that is not known."""
        return "others" if self.waited > WAITED_SHARE else "decoding" if self.used > USED_SHARE else ""
