"""The fleet server's end of the bus: receives, requests, stores.

    Zenoh's threads ─> a queue of limited length ─> Collector (event loop, ten times a second) ─> Robots ─> page
                                                        ├─> missing reports are requested from journals
                                                        └─> FleetDatabase, once a second, in a thread

A report that does not fit into the queue is not lost: its number is missed, and it is requested from the robot.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.bus import FleetBusError, open_bus
from imuscope.server.extensions.fleet.model.reports import MAX_JOURNAL, PARTS, ReportError
from imuscope.server.extensions.fleet.model.robots import Robots
from imuscope.server.extensions.fleet.model.summaries import RobotSummary
from imuscope.server.extensions.fleet.query.database import FleetDatabase, FleetDatabaseError
from imuscope.server.extensions.fleet.rollouts.group_profiles import GroupProfiles
from imuscope.server.extensions.fleet.rollouts.rollout_steps import RolloutTiming
from imuscope.server.extensions.fleet.rollouts.rollouts import RolloutFiles, Rollouts
from imuscope.server.extensions.fleet.server.collector import Collector
from imuscope.server.extensions.fleet.server.fleet_alarms import FleetAlarms
from imuscope.server.extensions.fleet.tunnel.http_tunnel_server import RobotPages
from imuscope.server.text.prometheus import PrometheusText

if TYPE_CHECKING:
    import zenoh

log = logging.getLogger("imuscope.fleet")

TURN_S = 0.1
WRITE_S = 1.0
MAX_QUEUE = 50_000
MAX_QUEUE_BYTES = 128 * 1024 * 1024
QUESTIONS_PER_TURN = 100
SETTLE_S = 30.0
QUERY_TIMEOUT_S = 5.0
WATCH_S = 2.0

TOKEN, REPORT, JOURNAL, SETTINGS = range(4)


class FleetServer:
    """One session, and what it receives. To be used in the event loop of the server.

    Args:
        settings: of the session; called again when what `version` returns has changed, and the session is reopened.
        version: such as that of the file of robots.
        profiles: of groups.
        alarms: its own.
        rollouts: those of earlier runs.
        timing: of rollouts; tests pass their own.

    Attributes:
        problem: why the state cannot be stored, or the settings cannot be used; empty otherwise.
    """

    def __init__(
        self,
        robots: Robots,
        database: FleetDatabase,
        settings: Callable[[], Mapping[str, Any]],
        version: Callable[[], object] = lambda: None,
        *,
        profiles: GroupProfiles,
        alarms: FleetAlarms,
        rollouts: RolloutFiles,
        timing: RolloutTiming | None = None,
    ) -> None:
        self.robots, self.database, self.profiles, self.alarms = robots, database, profiles, alarms
        self.collector = Collector(
            robots,
            database.robots(),
            judged=lambda robot: alarms.with_alarms(profiles.judged(robot)),
            last_number=database.last_number,
            clock=time.monotonic,
        )
        self.pages = RobotPages(self.collector.boot_of, robots.get)
        self.rollouts = Rollouts(rollouts, robots, profiles, self.pages, self._note_command, timing)
        self.problem = ""
        self.overflows = 0
        self._settings, self._version = settings, version
        self._opened: object = None
        self._closed = False
        self._session: zenoh.Session | None = None
        self._declared: list[object] = []
        self._queue: deque[tuple[int, str, bytes]] = deque()
        self._queued = 0
        self._task: asyncio.Task[None] | None = None
        self._writing: asyncio.Task[None] | None = None

    def open(self) -> None:
        """Open the session. Received messages wait until `start`.

        Raises:
            FleetBusError: it cannot be opened.
        """
        version = self._version()
        session = open_bus(self._settings())
        self._declare(session)
        self._session, self._opened = session, version

    def start(self) -> None:
        """Begin to collect, in the event loop. A session that is not open is opened in the background."""
        if self._session is None:  # of a client: that lasts until its router is there
            threading.Thread(target=self._open_late, name="fleet server", daemon=True).start()
        self.pages.start()
        self.rollouts.start()
        self._task = asyncio.create_task(self._run(), name="fleet server")

    def _open_late(self) -> None:
        try:
            self.open()
        except (FleetBusError, ValueError) as error:
            self.problem = str(error)
            log.error("%s No robots are received.", error)
            return
        if self._closed:
            self._leave()

    async def close(self) -> None:
        """Close the session and write the remaining data."""
        self._closed = True
        await self.rollouts.close()
        self.pages.close()
        await end_tasks(self._task)
        if self._writing is not None:
            await asyncio.gather(self._writing, return_exceptions=True)
        await self.alarms.close()  # after it: the last state is written last
        await asyncio.to_thread(self._leave)
        self._drain()
        with contextlib.suppress(FleetDatabaseError):
            await asyncio.to_thread(self.database.write, self.collector.taken_batch())
        await asyncio.to_thread(self.database.close)

    def _declare(self, session: zenoh.Session) -> None:
        import zenoh

        def on_token(sample: zenoh.Sample) -> None:
            alive = sample.kind == zenoh.SampleKind.PUT
            self._put(TOKEN, str(sample.key_expr), b"\x01" if alive else b"")

        def on_report(sample: zenoh.Sample) -> None:
            self._put(REPORT, str(sample.key_expr), sample.payload.to_bytes())

        def on_clock(query: zenoh.Query) -> None:
            with query:
                query.reply(keys.CLOCK, struct.pack(">d", time.time()))

        self._declared = [
            session.declare_queryable(keys.CLOCK, on_clock),
            session.declare_subscriber(keys.ALL_REPORTS, on_report),
            self.pages.declare(session),
            session.liveliness().declare_subscriber(keys.ALL_TOKENS, on_token, history=True),
        ]

    def _leave(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            with contextlib.suppress(Exception):
                session.close()  # type: ignore[no-untyped-call]

    def _put(self, kind: int, key: str, data: bytes) -> None:
        """Queue a received message, from any thread. Tokens always fit: they are few, and not repeated."""
        too_many = len(self._queue) >= MAX_QUEUE or self._queued + len(data) > MAX_QUEUE_BYTES
        if len(data) > MAX_JOURNAL or (too_many and kind != TOKEN):
            self.overflows += 1
            return
        self._queued += len(data)
        self._queue.append((kind, key, data))

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        settle_at = loop.time() + SETTLE_S
        write_at = watch_at = loop.time()
        while True:
            await asyncio.sleep(TURN_S)
            try:
                self._drain()
                self._request_missing()
                self.pages.tick()
                now = loop.time()
                if now >= write_at and (self._writing is None or self._writing.done()):
                    write_at = now + WRITE_S
                    self._update_alarms()
                    self._writing = loop.create_task(self._write(), name="fleet database")
                if now >= settle_at:
                    settle_at = float("inf")
                    self.collector.settle_absent()
                if now >= watch_at:
                    watch_at = now + WATCH_S
                    await self._reopen_if_changed()
            except Exception:  # a fault here must not end the collection
                log.exception("a turn of the fleet server failed")

    def _drain(self) -> None:
        collector = self.collector
        for _ in range(len(self._queue)):
            kind, key, data = self._queue.popleft()
            self._queued -= len(data)
            if kind == TOKEN:
                collector.on_token(key, alive=bool(data))
            elif kind == REPORT:
                collector.on_report(key, data)
            elif kind == JOURNAL:
                collector.on_journal(key, data)
            else:
                self._learn(data)

    def _learn(self, data: bytes) -> None:
        """Take settings that a robot answered with, and compare all robots that have them."""
        try:
            digest = self.profiles.learn(data)
        except ReportError:
            self.collector.counts.invalid += 1
            return
        self.collector.show_again(lambda robot: any(one.settings == digest for one in robot.devices))

    def profile_changed(self, robot: RobotSummary, text: str, by: str) -> None:
        """Log a change of the profile of a robot's group, and compare all robots of the group."""
        self.collector.note(robot.name, "command", "info", f"{text}: {by}.")
        log.warning("%s (robot %s): %s.", text, robot.name, by)
        self.collector.show_again(lambda other: other.group == robot.group)

    def _update_alarms(self) -> None:
        collector = self.collector
        changed = self.alarms.turn(
            self.robots.summaries, time.time(), lambda name, level, text: collector.note(name, "alarm", level, text)
        )
        if changed:
            collector.show_again(lambda robot: robot.name in changed)

    def group_of(self, robot: str) -> str | None:
        entry = self.robots.get(robot)
        return None if entry is None else entry.group

    def group_of_rollout(self, number: str) -> str | None:
        try:
            return self.rollouts.get(int(number)).group
        except DomainError:
            return None

    def acknowledge(self, robot: str, condition: str, by: str) -> None:
        """Acknowledge an alarm of this server.

        Raises:
            DomainError: it is not raised, or the name is missing.
        """
        self.alarms.acknowledge(robot, condition, by, time.time())
        text = f"“{self.alarms.title_of(condition)}” was acknowledged by {' '.join(by.split())}."
        self.collector.note(robot, "alarm", "info", text)
        self.collector.show_again(lambda one: one.name == robot)

    def _request_missing(self) -> None:
        session = self._session
        if session is None:
            return
        import zenoh

        def on_reply(reply: zenoh.Reply, kind: int = JOURNAL) -> None:
            if reply.ok is not None:
                self._put(kind, str(reply.ok.key_expr), reply.ok.payload.to_bytes())

        for name, device in self.profiles.questions(time.monotonic(), QUESTIONS_PER_TURN // 10):
            robot = self.robots.get(name)
            if robot is None or robot.state == "lost":
                self.profiles.forget_question(name, device)
                continue
            with contextlib.suppress(Exception):  # repeated later
                parameters = zenoh.Parameters({"device": device})
                selector = zenoh.Selector(keys.settings_key(name), parameters)
                session.get(selector, partial(on_reply, kind=SETTINGS), timeout=QUERY_TIMEOUT_S)
        for name, boot, after, stored in self.collector.questions(QUESTIONS_PER_TURN):
            with contextlib.suppress(Exception):  # repeated later
                query = f"{keys.journal_key(name)}?boot={boot};after={after};earlier=1;kept={stored}"
                session.get(query, on_reply, timeout=QUERY_TIMEOUT_S)

    async def _write(self) -> None:
        if self.alarms.is_changed:
            await asyncio.to_thread(self.alarms.save, self.alarms.saved_text())
        batch = self.collector.taken_batch()
        if not batch:
            return
        try:
            await asyncio.to_thread(self.database.write, batch)
            self.collector.written(batch)
            self.problem = ""
        except FleetDatabaseError as error:
            self.collector.give_back(batch)
            if not self.problem:
                log.error("%s Free space; nothing is lost as long as this server runs.", error)
            self.problem = str(error)

    async def _reopen_if_changed(self) -> None:
        """Reopen the session when the file of robots has changed, so that a removed robot is out."""
        if self._version() == self._opened:  # both None for a client of a router
            return
        try:
            self._settings()
        except ValueError as error:  # a line is not valid: the rules stay as they are
            if self.problem != str(error):
                log.error("%s The robots that may connect stay as they were.", error)
            self.problem = str(error)
            return
        await asyncio.to_thread(self._leave)
        self._drain()
        self.collector.all_lost()
        await asyncio.to_thread(self.open)
        self.problem = ""
        log.warning("The file of robots has changed: all robots reconnect.")

    def note_command(self, robot: str, level: str, text: str) -> None:
        """Store that a viewer commanded a robot, or tried to."""
        log.info("%s: %s", robot, text)
        self.collector.note(robot, "command", level, text)

    def _note_command(self, robot: str, level: str, text: str) -> None:
        self.collector.note(robot, "command", level, text)

    def add_metrics(self, page: PrometheusText) -> None:
        """Add the families of the fleet to the page for Prometheus."""
        self.pages.add_metrics(page)
        counts = self.collector.counts
        page.family("imuscope_fleet_robots", "gauge", "Robots by state.")
        live = self.collector.live
        page.add(live, state="live")
        page.add(len(self.robots.summaries) - live, state="lost")
        page.family("imuscope_fleet_reports_total", "counter", "Reports received, by what became of them.")
        kinds = ("reports", "repeated", "invalid", "unannounced", "refused", "missed")
        for kind in kinds:
            page.add(getattr(counts, kind), result={"reports": "valid"}.get(kind, kind))
        page.family("imuscope_fleet_unknown_total", "counter", "What a later version reported, by part of a report.")
        for part in PARTS:
            page.add(counts.unknown[part], part=part)
        page.family("imuscope_fleet_received_bytes_total", "counter", "Bytes of reports and journals.")
        page.add(counts.bytes)
        page.family("imuscope_fleet_overflows_total", "counter", "Messages that did not fit into the queue.")
        page.add(self.overflows)
