"""Tokens, reports and journals of robots, made into a state. No I/O: requests and rows to write are returned.

    token of NAME, BOOT ──> live, or lost
    report of NAME  ──┬─ the next number          taken
                      ├─ an earlier number        ignored: taken already
                      └─ a later number           those after the last one are requested from its journal
    journal of NAME ────> reports in order, taken; what NAME had to drop is counted

A robot that was restarted has reports of earlier runs. Those come first, run by run, from the last report that this
server has of each; until then only the status of its reports is used.

Nothing here trusts the bus: whatever does not decode, belongs to a run that is not announced, or has no valid name is
counted and ignored.
"""

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import msgspec

from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.reports import (
    ReportError,
    RobotReport,
    RobotStatus,
    decode_journal,
    decode_report,
    unknown_parts,
)
from imuscope.server.extensions.fleet.model.robots import Robots, TooManyRobotsError
from imuscope.server.extensions.fleet.model.summaries import RobotSummary, summary_of
from imuscope.server.extensions.fleet.query.database import FleetBatch, StoredEvent, StoredRobot
from imuscope.server.text.printable import printable

REQUEST_INTERVAL_S = 5.0
CONFIRM_S = 300.0
"""Interval of acknowledging stored reports to a robot, by requesting those after them."""
MAX_BOOTS = 4
MAX_ENDS = 64
MAX_UNWRITTEN = 50_000
"""Events that wait for the disk; above it reports are not taken, but stay with the robots."""
_status = msgspec.msgpack.Decoder(RobotStatus)


@dataclass(slots=True)
class _Robot:
    stored: StoredRobot  # boot and number: the last report that was taken
    status: RobotStatus | None = None
    boots: list[str] = field(default_factory=list)  # announced runs; the last one is shown by the name alone
    statuses: dict[str, RobotStatus] = field(default_factory=dict)  # of the others, as far as they are known
    others: list[str] = field(default_factory=list)  # those that report: robots of the same name
    numbered: int = 0  # rows that they have
    latest: int = 0  # number that the robot has of that run
    newest_number: int = 0  # number of the newest report of the live run, also while those of an earlier run are taken
    left: str | None = None  # run whose reports were being taken when a second robot of the name came
    written: str = ""  # RUN.NUMBER that are on disk
    ends: dict[str, int] = field(default_factory=dict)  # numbers up to which reports of earlier runs were taken
    request_at: float = float("inf")
    confirm_at: float = 0.0

    @property
    def live_boot(self) -> str:
        """The run that is shown; empty if the robot is lost."""
        return self.boots[-1] if self.boots else ""


class Question(NamedTuple):
    """A question for the reports of a robot after a number of a run.

    Args:
        stored: RUN.NUMBER up to which they are on disk; empty if that is not known.
    """

    name: str
    boot: str
    after: int
    stored: str


@dataclass(slots=True)
class CollectorCounts:
    """Counts since the start."""

    reports: int = 0
    bytes: int = 0
    repeated: int = 0
    invalid: int = 0
    unannounced: int = 0
    refused: int = 0
    missed: int = 0
    unknown: Counter[str] = field(default_factory=Counter)  # words and fields of later versions, by part of a report


class Collector:
    """The robots of a fleet. To be used in one thread.

    Args:
        stored: the robots as the database has them.
        now: unix s.
        judged: completes a summary by what this server knows besides.
        last_number: last number of a robot's run of which an event is stored.
        clock: when questions are due, s; it does not step. None: `now`.
    """

    def __init__(
        self,
        robots: Robots,
        stored: list[StoredRobot],
        now: Callable[[], float] = time.time,
        judged: Callable[[RobotSummary], RobotSummary] = lambda summary: summary,
        last_number: Callable[[str, str], int] = lambda robot, boot: 0,
        clock: Callable[[], float] | None = None,
    ) -> None:
        self._judged = judged
        self._last_number = last_number
        self._summaries = robots
        self._now, self._clock = now, clock or now
        self._robots: dict[str, _Robot] = {}
        self._started = now()
        self.batch = FleetBatch()
        self.counts = CollectorCounts()
        for one in stored:
            status = None
            with contextlib.suppress(msgspec.DecodeError):  # of another version
                status = _status.decode(one.status) if one.status else None
            robot = self._robots[one.name] = _Robot(one, status)
            robot.written = _position(one)
            self._show(robot)

    @property
    def live(self) -> int:
        """Number of robots that are live."""
        return sum(bool(robot.boots) for robot in self._robots.values())

    def boot_of(self, name: str) -> str:
        """Run of the server of a robot; empty if it is not live."""
        robot = self._robots.get(name)
        return robot.live_boot if robot is not None else ""

    def settle_absent(self) -> None:
        """Mark robots lost that have not reconnected since the restart."""
        for robot in self._robots.values():
            if robot.stored.is_live and not robot.boots:
                robot.stored.is_live, robot.stored.since = False, self._started
                self._changed(robot)

    def on_token(self, key: str, *, alive: bool) -> None:
        """A liveliness token appeared, or was withdrawn."""
        name, boot = keys.parse_token(key)
        if not name:
            self.counts.invalid += 1
            return
        robot = self._robot(name)
        if robot is None or (boot in robot.boots) == alive:
            return
        now = self._now()
        if not alive:
            robot.boots.remove(boot)
            robot.newest_number = 0
            self._leave(robot, boot)
            if not robot.boots:
                robot.stored.is_live, robot.stored.since = False, now
                robot.request_at = float("inf")
            self._resume(robot)
            self._changed(robot)
            return
        if len(robot.boots) >= MAX_BOOTS:
            self.counts.refused += 1
            return
        if robot.boots and robot.status is not None:
            robot.statuses[robot.live_boot] = robot.status
        robot.boots.append(boot)
        robot.newest_number = 0
        if robot.stored.boot != boot:
            robot.stored.is_live = False
        if len(robot.boots) > 1:  # which of them has earlier runs is not known
            robot.left = robot.stored.boot if robot.left is None else robot.left
            self._turn_to(robot, boot)
        self._resume(robot)
        if not robot.stored.is_live:
            robot.stored.is_live, robot.stored.since = True, now
        robot.request_at = self._clock()  # what happened while this server did not listen
        self._changed(robot)

    def on_report(self, key: str, data: bytes) -> None:
        """A report was received."""
        self.counts.bytes += len(data)
        name = keys.robot_of(key)
        try:
            report = decode_report(data)
        except ReportError:
            self.counts.invalid += 1
            return
        robot = self._robots.get(name)
        if robot is None or not robot.boots or report.boot != robot.live_boot:
            self.counts.unannounced += 1  # it is requested when the token arrives
            if robot is not None and report.boot in robot.boots:
                self._take_other(robot, report)
            return
        self.counts.reports += 1
        robot.newest_number = max(robot.newest_number, report.number)
        if report.boot != robot.stored.boot:  # the reports of earlier runs come first
            self._take_status(robot, report)
            self._changed(robot)
            return
        robot.latest = max(robot.latest, report.number)
        if report.is_empty and report.number <= robot.stored.number:
            return
        if report.number == robot.stored.number + 1 and not report.is_empty:
            self._take(robot, report)
        elif report.number <= robot.stored.number:
            self.counts.repeated += 1
        else:
            robot.request_at = min(robot.request_at, self._clock())

    def on_journal(self, key: str, data: bytes) -> None:
        """A robot answered with earlier reports."""
        self.counts.bytes += len(data)
        robot = self._robots.get(keys.robot_of(key))
        try:
            answer = decode_journal(data)
        except ReportError:
            self.counts.invalid += 1
            return
        if robot is None or not robot.boots or not self._is_expected(robot, answer.boot):
            self.counts.unannounced += 1
            return
        stored = robot.stored
        if answer.boot != stored.boot:
            self._turn_to(robot, answer.boot)
        if answer.first > stored.number + 1:
            missed = answer.first - stored.number - 1
            stored.missed += missed
            self.counts.missed += missed
            words = f"{missed} reports of {stored.name} were dropped while the line was away."
            self._note(stored.name, "warning", words)
            stored.number = answer.first - 1
            self._changed(robot)
        for report in answer.reports:
            if report.number > stored.number and not self._take(robot, report):
                return
        if answer.following and stored.number >= answer.last and answer.boot not in robot.boots:
            self._turn_to(robot, answer.following)
            return
        newest = robot.newest_number if answer.boot == robot.live_boot else 0  # since it was answered
        robot.latest = max(robot.latest, answer.last, newest)
        robot.request_at = float("inf")
        if robot.latest > stored.number:  # there is more; an answer without reports: the line of the robot is limited
            robot.request_at = self._clock() + (0.0 if answer.reports else 1.0)

    def questions(self, limit: int) -> Iterator[Question]:
        """Journals to query now. Each query is repeated if no answer comes."""
        now = self._clock()
        for name, robot in self._robots.items():
            if limit <= 0:
                return
            if (
                robot.boots
                and min(robot.request_at, robot.confirm_at) <= now
                and len(self.batch.events) < MAX_UNWRITTEN
            ):
                robot.request_at = now + REQUEST_INTERVAL_S if robot.request_at <= now else robot.request_at
                robot.confirm_at = now + CONFIRM_S
                limit -= 1
                yield Question(
                    name, robot.stored.boot, robot.stored.number, robot.written if robot.left is None else ""
                )

    def remove(self, name: str) -> bool:
        """Forget a robot that is lost; returns whether there was one."""
        robot = self._robots.get(name)
        if robot is None or robot.boots:
            return False
        del self._robots[name]
        self.batch.robots.pop(name, None)
        self.batch.removed.add(name)
        return self._summaries.remove(name)

    def show_again(self, applies: Callable[[RobotSummary], bool]) -> None:
        """Refresh robots for which this server has more data now."""
        for name, robot in self._robots.items():
            shown = self._summaries.get(name)
            if shown is not None and applies(shown):
                self._show(robot)

    def note(self, name: str, kind: str, level: str, text: str) -> None:
        """Store an event of this server about a robot."""
        self.batch.events.append(StoredEvent(name, "", 0, self._now(), kind, level, text, ""))

    def taken_batch(self) -> FleetBatch:
        """The changes since the last call, to be written."""
        batch, self.batch = self.batch, FleetBatch()
        batch.robots = {name: replace(one) for name, one in batch.robots.items()}
        return batch

    def give_back(self, batch: FleetBatch) -> None:
        """Take changes back that could not be written."""
        batch.robots.update(self.batch.robots)
        batch.events += self.batch.events
        batch.removed |= self.batch.removed
        self.batch = batch

    def written(self, batch: FleetBatch) -> None:
        """Changes are on disk: robots need not keep them any more."""
        for name, one in batch.robots.items():
            if name in self._robots:
                self._robots[name].written = _position(one)

    def all_lost(self) -> None:
        """The line to the router is lost: no token is known any more."""
        for name, robot in self._robots.items():
            for boot in list(robot.boots):
                self.on_token(keys.token_key(name, boot), alive=False)

    def _robot(self, name: str) -> _Robot | None:
        robot = self._robots.get(name)
        if robot is None:
            robot = _Robot(StoredRobot(name, since=self._now()))
            try:
                self._summaries.update(summary_of(name, RobotStatus(), robot.stored.since, is_live=False))
            except TooManyRobotsError:
                self.counts.refused += 1
                return None
            self._robots[name] = robot
        return robot

    def _is_expected(self, robot: _Robot, boot: str) -> bool:
        """Whether an answer may come from this run: not the requested one if that has ended."""
        return boot == robot.stored.boot or (len(robot.boots) == 1 and robot.stored.boot not in robot.boots)

    def _turn_to(self, robot: _Robot, boot: str) -> None:
        """Take the reports of another run from now on, after those that were taken already."""
        stored = robot.stored
        if stored.boot:
            robot.ends.pop(stored.boot, None)
            robot.ends[stored.boot] = stored.number
            while len(robot.ends) > MAX_ENDS:
                del robot.ends[next(iter(robot.ends))]
        if boot not in robot.ends:
            robot.ends[boot] = self._last_number(stored.name, boot)
        stored.boot, stored.number, robot.latest = boot, robot.ends[boot], 0
        robot.request_at = self._clock()
        self._changed(robot)

    def _resume(self, robot: _Robot) -> None:
        """Go on with the reports of a run that were left for a second robot of the name, once there is one."""
        if robot.left is not None and len(robot.boots) == 1:
            left, robot.left = robot.left, None
            self._turn_to(robot, left)

    def _take_other(self, robot: _Robot, report: RobotReport) -> None:
        """Show the robot of a run that reports while another one has its name: it has not just been restarted."""
        if report.boot not in robot.others:
            robot.others.append(report.boot)
            name = robot.stored.name
            words = (
                f"Several robots call themselves {name}. Give each its own name: imuscope serve … --fleet-name NAME."
            )
            self._note(name, "error", words)
        if report.status is not None:
            robot.statuses[report.boot] = report.status
        self._show(robot)

    def _leave(self, robot: _Robot, boot: str) -> None:
        """Forget a run that has ended; if it was the shown one, another one takes its place, with its own status."""
        robot.statuses.pop(boot, None)
        if robot.boots and robot.live_boot in robot.others:
            robot.status = robot.statuses.pop(robot.live_boot, None)
        robot.others = [one for one in robot.others if one in robot.boots[:-1]]

    def _take(self, robot: _Robot, report: RobotReport) -> bool:
        """Take a report; returns whether there was room."""
        if len(self.batch.events) >= MAX_UNWRITTEN:
            robot.request_at = self._clock() + REQUEST_INTERVAL_S
            return False
        stored = robot.stored
        stored.number = report.number
        stored.received += 1
        self.counts.unknown += unknown_parts(report)
        for event in report.events:
            words = (event.kind, event.level, printable(event.text), printable(event.device))
            self.batch.events.append(StoredEvent(stored.name, report.boot, report.number, event.time, *words))
        self._take_status(robot, report)
        self._changed(robot)
        return True

    def _take_status(self, robot: _Robot, report: RobotReport) -> None:
        if report.status is not None:
            robot.status = report.status
            robot.stored.status = msgspec.msgpack.encode(report.status)

    def _changed(self, robot: _Robot) -> None:
        self.batch.robots[robot.stored.name] = robot.stored
        self.batch.removed.discard(robot.stored.name)
        self._show(robot)

    def _show(self, robot: _Robot) -> None:
        stored = robot.stored
        status = robot.status or RobotStatus()
        since = self._started if stored.is_live and not robot.boots else stored.since
        summary = summary_of(stored.name, status, since, is_live=bool(robot.boots))
        summary.same_name = len(robot.others)
        self._update(self._judged(summary))
        for place, boot in enumerate(robot.others):
            name = keys.numbered(stored.name, place + 2)
            other = summary_of(name, robot.statuses.get(boot, RobotStatus()), since)
            other.same_name, other.pages = len(robot.others), "off"  # its name leads to the first row only
            self._update(other)
        for place in range(len(robot.others), robot.numbered):
            self._summaries.remove(keys.numbered(stored.name, place + 2))
        robot.numbered = len(robot.others)

    def _update(self, summary: RobotSummary) -> None:
        try:
            self._summaries.update(summary)
        except TooManyRobotsError:  # fewer are allowed than were stored
            self.counts.refused += 1

    def _note(self, name: str, level: str, text: str) -> None:
        self.note(name, "link", level, text)


def _position(robot: StoredRobot) -> str:
    return f"{robot.boot}.{robot.number}" if robot.boot else ""
