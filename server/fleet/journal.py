"""The last reports of a robot, in memory: what happened while the line was away.

The fleet server asks for the reports after the last number that it has stored. Above the limit the oldest are
dropped; those that were never asked for are counted. A restart of the robot's server begins a new run with an empty
journal: what happened before is in the robot's own recordings and its log.
"""

from __future__ import annotations

import logging
import secrets
import threading
from collections import deque
from collections.abc import Iterator

from server.fleet.reports import (
    MAX_EVENTS,
    MAX_REPORTS,
    JournalAnswer,
    ReportError,
    RobotEvent,
    RobotReport,
    RobotStatus,
    decode_report,
    encode,
)

log = logging.getLogger("imuscope.fleet")

LIMIT_BYTES = 2 * 1024 * 1024
ANSWER_BYTES = 128 * 1024
EVENT_BYTES = 32 * 1024
MAX_WAITING = 1000
"""Events that wait for the next report."""


class Journal:
    """Reports of one run. May be used from any thread.

    Args:
        limit: bytes of reports.
    """

    def __init__(self, limit: int = LIMIT_BYTES) -> None:
        self.boot = secrets.token_hex(8)
        self._limit = limit
        self._lock = threading.Lock()
        self._reports: deque[tuple[RobotReport, int]] = deque()
        self._bytes = 0
        self._number = 0
        self._dropped = 0
        self._stored = 0  # number up to which the fleet server has them
        self._events: deque[RobotEvent] = deque()

    @property
    def dropped(self) -> int:
        """Reports that were dropped before the fleet server had them, and events that were too many."""
        return self._dropped

    @property
    def has_events(self) -> bool:
        """Whether events wait for the next report."""
        return bool(self._events)

    @property
    def nbytes(self) -> int:
        """Size of the reports."""
        return self._bytes

    def add_event(self, event: RobotEvent) -> None:
        """Store an event for the next report."""
        with self._lock:
            self._events.append(event)
            if len(self._events) > MAX_WAITING:
                self._events.popleft()
                self._dropped += 1

    def report(self, time: float, status: RobotStatus | None) -> bytes:
        """The next report, with a number and stored if something happened.

        Args:
            status: None if it is as before.
        """
        with self._lock:
            events = tuple(self._next_events())
            is_empty = status is None and not events
            report = RobotReport(
                self.boot, self._number + (not is_empty), time, status=status, events=events, dropped=self._dropped
            )
            data = encode(report)
            try:
                decode_report(data)
            except ReportError as error:  # the fleet server would refuse it, and ask for it for ever
                log.error("A report for the fleet is left out. %s", error)
                self._dropped += 1
                return encode(RobotReport(self.boot, self._number, time, dropped=self._dropped))
            self._number = report.number
            if not is_empty:
                self._reports.append((report, len(data)))
                self._bytes += len(data)
                while self._bytes > self._limit:
                    oldest, size = self._reports.popleft()
                    self._bytes -= size
                    self._dropped += oldest.number > self._stored
            return data

    def _next_events(self) -> Iterator[RobotEvent]:
        """Waiting events, as many as fit into a report."""
        size = 0
        for _ in range(min(MAX_EVENTS, len(self._events))):
            size += len(self._events[0].text.encode())
            if size > EVENT_BYTES:
                return
            yield self._events.popleft()

    def answer(self, boot: str, after: int, limit: int = ANSWER_BYTES) -> bytes:
        """The reports after a number, up to which the fleet server has stored them.

        Args:
            boot: run that the number is of; of another one, all reports are sent.
            limit: bytes of the answer.
        """
        with self._lock:
            if boot != self.boot:
                after = 0
            self._stored = max(self._stored, min(after, self._number))
            found: list[RobotReport] = []
            size = 0
            for report, length in self._reports:
                if report.number <= after:
                    continue
                size += length
                if (found and size > limit) or len(found) == MAX_REPORTS:
                    break
                found.append(report)
            first = self._reports[0][0].number if self._reports else self._number + 1
            return encode(JournalAnswer(self.boot, first, self._number, tuple(found)))
