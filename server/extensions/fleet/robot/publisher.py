"""A robot's side of a fleet (`--fleet`, off by default): its status once a second, and its events.

    telemetry bus ─> DeviceFigures ─> status ──┐ once a second
                  ─> events ───────────────────┴─> Journal ─> report ─> Zenoh ─> router or fleet server
                                                      └──────<── "reports after 17?"

The connection is outgoing only. A thread of its own opens the session, because that lasts until the router is there;
the event loop never waits for the line. A report that is not received is requested again by its number, so nothing is
repeated by itself. Figures that changed less than a user would see (summaries.py) are not sent.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import shutil
import threading
import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from imuscope.server import wire
from imuscope.server.access.route_rules import RouteRules
from imuscope.server.concurrency.limiters import TokenBucket
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.extensions.alarms.service import AlarmService
from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.bus import FleetBusError, client_settings, open_bus
from imuscope.server.extensions.fleet.model.device_figures import DeviceFigures, clipped
from imuscope.server.extensions.fleet.model.journal import ANSWER_BYTES, FOLDER, Journal
from imuscope.server.extensions.fleet.model.reports import (
    MAX_ALARMS,
    AlarmRaisedState,
    ReportedAlarm,
    RobotEvent,
    RobotStatus,
)
from imuscope.server.extensions.fleet.model.settings import FleetTables
from imuscope.server.extensions.fleet.model.summaries import RobotSummary, summary_of, with_hysteresis
from imuscope.server.extensions.fleet.robot.robot_settings import allowed_pages, credentials_of, robot_name
from imuscope.server.extensions.fleet.store.known_settings import KnownSettings
from imuscope.server.extensions.fleet.tunnel.http_tunnel_robot import PageServer
from imuscope.server.settings.config import Config
from imuscope.server.streaming.telemetry import Telemetry
from imuscope.server.version import VERSION

if TYPE_CHECKING:
    import zenoh


log = logging.getLogger("imuscope.fleet")

PERIOD_S = 1.0
QUIET_EVERY = 10  # reports: without news the others are left out; this one reveals whether one was lost on the way
CLOCK_S = 60.0
FULL_EVERY = 600  # reports: the whole status, for fleet servers that have joined since
BURST_S = 10.0  # a line with a limit may send the bytes of so many seconds at once
REPORT_SHARE = 0.3
"""Share of it that pages leave for reports."""
KINDS = ("link", "device", "alarm", "marker", "command", "clock")
"""Events that are reported; gaps and rejects are in the figures."""


def report_budget(rate: float, now: float) -> TokenBucket:
    """Bytes that may be sent.

    Args:
        rate: bytes/s; 0 for no limit.
        now: monotonic, s.
    """
    return TokenBucket(rate, rate * BURST_S if rate else float("inf"), now)


class FleetPublisher:
    """The robot in its fleet. To be used in the event loop of the server.

    Args:
        rules: of the routes of its pages.
        alarms: those that are raised at present.
        settings: those of the devices, as far as they are known.

    Raises:
        FleetSettingsError, DecodeOptionError: the settings of the fleet are not valid.
    """

    def __init__(
        self,
        telemetry: Telemetry,
        config: Config,
        rules: RouteRules,
        alarms: Callable[[], Iterable[ReportedAlarm]],
        settings: KnownSettings,
    ) -> None:
        self._settings = config.of(FleetTables).fleet
        self._data = config.data
        self._bus = telemetry.bus
        self._alarms = alarms
        self._known_settings = settings
        self._figures = DeviceFigures(telemetry.bus, telemetry.store)
        self.journal = Journal(folder=config.data / FOLDER)
        self.name, self._credentials = robot_name(self._settings), credentials_of(self._settings)
        rate = self._settings.limit_kb_s * 1000
        self._budget = report_budget(rate, time.monotonic())
        self._reserved = rate * BURST_S * REPORT_SHARE
        self._budget_lock = threading.Lock()
        pages = allowed_pages(self._settings)
        self.pages = PageServer(self.name, self.journal.boot, pages, rules, self._report_command, self._delay_of_pages)
        self._session: zenoh.Session | None = None
        self._publisher: zenoh.Publisher | None = None
        self._declared: list[object] = []  # a token ends with its object
        self._closed = threading.Event()
        self._task: asyncio.Task[None] | None = None
        self._unsubscribe: Callable[[], None] | None = None
        self._latency_ms: float | None = None
        self._shown: RobotSummary | None = None
        self._was_connected: bool | None = None
        self._ticks = 0
        self._measure_at = 0.0

    def start(self) -> None:
        """Join in the background."""
        self._unsubscribe = self._bus.events.subscribe(self._on_event)
        self.journal.start()
        loop = asyncio.get_running_loop()
        threading.Thread(target=self._open, args=(loop,), name="fleet", daemon=True).start()
        self._task = loop.create_task(self._report_each_second(), name="fleet")

    async def close(self) -> None:
        self._closed.set()
        await self.pages.close()
        if self._unsubscribe is not None:
            self._unsubscribe()
        await end_tasks(self._task)
        session, self._session = self._session, None
        if session is not None:
            await asyncio.to_thread(_leave, session)
        await asyncio.to_thread(self.journal.close)

    # ── in the event loop ────────────────────────────────────────────────────────────────────────────────────────────

    def _on_event(self, event: wire.EventInfo) -> None:
        if event.kind in KINDS or event.level != "info":
            self.journal.add_event(
                RobotEvent(event.time, event.kind, event.level, clipped(event.text, 500), clipped(event.device))
            )

    async def _report_each_second(self) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due = max(due + PERIOD_S, loop.time())
            await asyncio.sleep(due - loop.time())
            try:
                self._report()
            except Exception:  # a fault here must not end the reports
                log.exception("a report for the fleet failed")

    def _report(self) -> None:
        publisher = self._publisher
        self._report_connection()
        self.pages.tick()
        session = self._session
        if session is not None and time.monotonic() >= self._measure_at:
            self._measure_at = time.monotonic() + CLOCK_S
            self._measure_latency(session)
        status = self._changed_status()
        if status is None and not self.journal.has_events and self._ticks % QUIET_EVERY:
            return  # the token announces the robot
        data = self.journal.report(time.time(), status)
        with self._budget_lock:
            fits = self._budget.available(time.monotonic()) >= len(data)
            if publisher is None or not fits:
                return  # it will be requested
            self._budget.acquire(time.monotonic(), len(data))
        with contextlib.suppress(Exception):  # a closed session: the journal has the report
            publisher.put(data)

    def _report_connection(self) -> None:
        session = self._session
        is_connected = session is not None and _is_connected(session)
        if is_connected == self._was_connected:
            return
        if not is_connected:
            self._latency_ms = None
            self.pages.line_lost()
        place = self._settings.router
        if is_connected:
            self._bus.event("", "link", "info", f"The fleet at {place} is reached; this robot is {self.name}.")
        elif self._was_connected:
            words = f"The line to the fleet at {place} is lost; reports are kept until it is back."
            self._bus.event("", "link", "warning", words)
        self._was_connected = is_connected
        self.journal.set_line(is_there=is_connected)

    def _report_command(self, level: wire.Level, text: str) -> None:
        self._bus.event("", "command", level, text)

    def _delay_of_pages(self, size: int) -> float:
        """Seconds until a message of a page may be sent; 0: it is counted as sent. A part of the limit is left for
        reports.
        """
        with self._budget_lock:
            now = time.monotonic()
            pause = self._budget.wait_s(now, size + self._reserved)
            if pause == 0:
                self._budget.acquire(now, size)
            return pause

    def _changed_status(self) -> RobotStatus | None:
        """Status to publish: changed beyond display precision, or the refresh interval elapsed."""
        recorder = self._bus.recorder.latest
        status = RobotStatus(
            version=VERSION,
            group=clipped(self._settings.group),
            address=clipped(self._settings.address, 500),
            latency_ms=self._latency_ms,
            recording=recorder is not None and recorder.running,
            disk_free_bytes=_free(self._data),
            pages=self.pages.pages,
            alarms=tuple(self._alarms())[:MAX_ALARMS],
            devices=self._known_settings.with_settings(self._figures.devices()),
        )
        shown = with_hysteresis(summary_of(self.name, status, 0.0), self._shown)
        self._ticks += 1
        if shown == self._shown and self._ticks % FULL_EVERY:
            return None
        self._shown = shown
        return status

    # ── in threads ───────────────────────────────────────────────────────────────────────────────────────────────────

    def _open(self, loop: asyncio.AbstractEventLoop) -> None:
        try:
            session = open_bus(client_settings(self._settings.router, self._credentials))
        except FleetBusError as error:
            words, place = str(error), self._settings.router
            with contextlib.suppress(RuntimeError):  # the loop is closed already
                loop.call_soon_threadsafe(
                    lambda: self._bus.event("", "link", "error", f"{words} This robot is not in the fleet at {place}.")
                )
            return
        if self._closed.is_set():
            _leave(session)
            return
        import zenoh

        self.journal.wait_loaded()  # earlier runs are requested as soon as the token is there
        self._session = session
        self._declared.append(self.pages.declare(session))
        self._declared.append(session.declare_queryable(keys.journal_key(self.name), self._on_query))
        self._declared.append(session.declare_queryable(keys.settings_key(self.name), self._on_settings_query))
        self._publisher = session.declare_publisher(
            keys.report_key(self.name), congestion_control=zenoh.CongestionControl.DROP
        )
        self._declared.append(session.liveliness().declare_token(keys.token_key(self.name, self.journal.boot)))

    def _on_query(self, query: zenoh.Query) -> None:
        """Answer with the reports after a number."""
        parameters = query.selector.parameters
        try:
            boot, after = str(parameters.get("boot") or ""), int(parameters.get("after") or 0)
        except (TypeError, ValueError):
            boot, after = "", 0
        with self._budget_lock:
            room = self._budget.available(time.monotonic())
            limit = ANSWER_BYTES if room == float("inf") else max(0, int(room))
            earlier, stored = bool(parameters.get("earlier")), str(parameters.get("kept") or "")
            data = self.journal.answer(boot, after, limit, earlier=earlier, stored=stored)
            self._budget.acquire(time.monotonic(), len(data))
        with query:
            query.reply(keys.journal_key(self.name), data)

    def _on_settings_query(self, query: zenoh.Query) -> None:
        with query, self._budget_lock:
            data = self._known_settings.answer(str(query.selector.parameters.get("device") or ""))
            if data and self._budget.available(time.monotonic()) > 0:  # else the request is repeated
                self._budget.acquire(time.monotonic(), len(data))
                query.reply(keys.settings_key(self.name), data)

    def _measure_latency(self, session: zenoh.Session) -> None:
        start = time.monotonic()

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self._latency_ms = (time.monotonic() - start) * 1000

        with contextlib.suppress(Exception):  # a closed session
            session.get(keys.CLOCK, on_reply, timeout=5.0)


def _is_connected(session: zenoh.Session) -> bool:
    with contextlib.suppress(Exception):
        return bool(list(session.info.routers_zid()))
    return False


def _free(folder: object) -> int | None:
    with contextlib.suppress(OSError):
        return shutil.disk_usage(str(folder)).free
    return None


def _leave(session: zenoh.Session) -> None:
    with contextlib.suppress(Exception):
        session.close()  # type: ignore[no-untyped-call]


def active_alarms(alarms: AlarmService) -> list[ReportedAlarm]:
    """The alarms that are raised at present, one for each device."""
    reports = []
    for stored in alarms.alarms:
        for state in alarms.states(stored.id):
            if state.raised:
                acknowledged: AlarmRaisedState = "raised" if state.acknowledged is None else "acknowledged"
                shown: AlarmRaisedState = "missing" if state.status == "missing" else acknowledged
                definition = stored.definition
                reports.append(ReportedAlarm(clipped(definition.name), definition.level, shown, clipped(state.device)))
    return reports
