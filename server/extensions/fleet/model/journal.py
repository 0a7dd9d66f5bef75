"""The events of a robot for its fleet: what happened while the line was away, also over restarts.

    event ─> report ─┬─> put on the bus
                     └─> in memory ─> fleet-journal/ in the data folder, by a thread (journal_files.py)

The fleet server requests the reports after the last number that it has stored, first of runs that have ended, then of
this one. What a report is, is known by its run and its number, so a report that is sent twice is stored once. Of the
status only the newest is kept; the numbers of the others stay unused. Above the limit the oldest reports are dropped,
in memory and on disk; those that were never requested are counted.

The robot never waits for its disk. Within a second what happened is written, and survives the end of the process; a
power cut loses the last SYNC_AWAY_S, or SYNC_S while the fleet server receives everything anyway. A disk that fails is
logged, and tried again.
"""

import logging
import secrets
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from imuscope.server.extensions.fleet.model.journal_files import JournalFiles
from imuscope.server.extensions.fleet.model.reports import (
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

LIMIT_BYTES = 4 * 1024 * 1024
ANSWER_BYTES = 128 * 1024
EVENT_BYTES = 32 * 1024
MAX_WAITING = 1000
"""Events that wait for the next report."""
MAX_RUNS = 1000
FOLDER = "fleet-journal"  # in the data folder
WRITE_S = 1.0
SYNC_AWAY_S, SYNC_S = 5.0, 60.0
"""Longest time to a sync, without and with the line: flash memory lives for a number of writes."""
RETRY_S = 30.0  # after the disk failed


@dataclass(slots=True)
class _Run:
    """Reports of a run.

    Args:
        dropped_to: reports up to this number are not kept.
        last: number of the newest report.
        acknowledged: number up to which the fleet server has them.
    """

    boot: str
    dropped_to: int = 0
    last: int = 0
    acknowledged: int = 0
    reports: deque[tuple[int, bytes]] = field(default_factory=deque)


class Journal:
    """Reports of this run, and of those before that the fleet server has not got. May be used from any thread.

    Args:
        limit: bytes of reports.
        folder: for the files; None to keep everything in memory. `start` reads and begins to write it.
    """

    def __init__(self, limit: int = LIMIT_BYTES, folder: Path | None = None) -> None:
        self.boot = secrets.token_hex(8)
        self._limit = limit
        self._lock = threading.Lock()
        self._runs = [_Run(self.boot)]
        self._newest: RobotReport | None = None  # with a status, as it was sent
        self._bytes = 0
        self._dropped = 0
        self._events: deque[RobotEvent] = deque()
        self._files = None if folder is None else JournalFiles(folder, limit)
        self._folder = folder
        self._unwritten: deque[tuple[int, bytes]] = deque()
        self._written = 0
        self._stored_until = ("", 0)
        self._line_is_there = False
        self._wake = threading.Event()
        self._loaded = threading.Event()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None

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

    def start(self) -> None:
        """Read the files and write to them from now on, in a thread."""
        if self._files is not None:
            self._thread = threading.Thread(target=self._write_files, args=(self._files,), name="journal", daemon=True)
            self._thread.start()

    def wait_loaded(self) -> None:
        """Wait until the files were read, if `start` was called."""
        if self._thread is not None:
            self._loaded.wait()

    def close(self) -> None:
        """Write the remaining reports, and end. It waits for the disk."""
        self._closed.set()
        self._wake.set()
        if self._thread is not None:
            self._thread.join()

    def set_line(self, *, is_there: bool) -> None:
        """Note whether reports reach the fleet server as they are made."""
        self._line_is_there = is_there

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
            run = self._runs[-1]
            events = tuple(self._next_events())
            is_empty = status is None and not events
            number = run.last + (not is_empty)
            report = RobotReport(self.boot, number, time, status=status, events=events, dropped=self._dropped)
            data = encode(report)
            try:
                decode_report(data)
            except ReportError as error:  # the fleet server would reject it, and request it for ever
                log.error("A report for the fleet is left out. %s", error)
                self._dropped += 1
                return encode(RobotReport(self.boot, run.last, time, dropped=self._dropped))
            run.last = number
            if status is not None:
                self._newest = report
            if events:
                entry = data if status is None else encode(msgspec.structs.replace(report, status=None))
                run.reports.append((number, entry))
                self._bytes += len(entry)
                if self._files is not None:
                    self._unwritten.append((number, entry))
                self._limit_bytes()
                self._wake.set()
            return data

    def _next_events(self) -> Iterator[RobotEvent]:
        """Waiting events, as many as fit into a report."""
        size = 0
        for _ in range(min(MAX_EVENTS, len(self._events))):
            size += len(self._events[0].text.encode())
            if size > EVENT_BYTES:
                return
            yield self._events.popleft()

    def _limit_bytes(self) -> None:
        """Drop the oldest reports above the limit."""
        while self._bytes > self._limit:
            run = next(one for one in self._runs if one.reports)
            number, data = run.reports.popleft()
            self._bytes -= len(data)
            run.dropped_to = number
            self._dropped += number > run.acknowledged
            if self._unwritten and run.boot == self.boot and self._unwritten[0][0] <= number:
                self._unwritten.popleft()

    def answer(
        self, boot: str, after: int, limit: int = ANSWER_BYTES, *, earlier: bool = False, stored: str = ""
    ) -> bytes:
        """The reports after a number, up to which the fleet server has taken them.

        Args:
            boot: run that the number is of; of another one, all reports of the oldest run are sent.
            limit: bytes of the answer.
            earlier: whether runs that have ended count; without, the reports of this run have all numbers.
            stored: RUN.NUMBER up to which the fleet server has them on its disk.
        """
        with self._lock:
            if earlier:
                self._forget(stored)
            runs = self._runs if earlier else self._runs[-1:]
            index = next((at for at, one in enumerate(runs) if one.boot == boot), -1)
            run = runs[max(0, index)]
            after = after if index >= 0 else 0
            run.acknowledged = max(run.acknowledged, min(after, run.last))
            reports: list[RobotReport] = []
            size = 0
            for report, length in self._reports(run, after, fill=not earlier):
                size += length
                if (reports and size > limit) or len(reports) == MAX_REPORTS:
                    break
                reports.append(report)
            following = runs[max(0, index) + 1].boot if run is not runs[-1] else ""
            return encode(JournalAnswer(run.boot, run.dropped_to + 1, run.last, tuple(reports), following))

    def _reports(self, run: _Run, after: int, *, fill: bool) -> Iterator[tuple[RobotReport, int]]:
        """Reports of a run in order, with their sizes.

        Args:
            fill: reports whose status a later one replaced are there too, empty.
        """
        newest = self._newest if run.boot == self.boot else None
        expected = max(after, run.dropped_to) + 1
        reports = [(number, data) for number, data in run.reports if number > after]
        if newest is not None and newest.number > after:
            others = [one for one in reports if one[0] != newest.number]
            reports = sorted([*others, (newest.number, encode(newest))])
        for number, data in reports:
            for missing in range(expected, number) if fill else ():
                empty = RobotReport(run.boot, missing, 0.0)
                yield empty, len(encode(empty))
            expected = number + 1
            yield decode_report(data), len(data)

    def _forget(self, stored: str) -> None:
        """Forget runs that have ended as far as the fleet server has them on its disk; of this run, the files only."""
        boot, _, number = stored.partition(".")
        index = next((at for at, one in enumerate(self._runs) if one.boot == boot), -1)
        if index < 0 or not (number.isascii() and number.isdigit() and len(number) < 20):
            return
        for run in self._runs[:index]:
            self._bytes -= sum(len(data) for _, data in run.reports)
        del self._runs[:index]
        run = self._runs[0]
        if run.boot != self.boot:
            while run.reports and run.reports[0][0] <= int(number):
                self._bytes -= len(run.reports.popleft()[1])
        if self._stored_until != (boot, int(number)):
            self._stored_until = (boot, int(number))
            self._wake.set()

    # ── in the thread ────────────────────────────────────────────────────────────────────────────────────────────────

    def _write_files(self, files: JournalFiles) -> None:
        try:
            self._load(files)
        finally:
            self._loaded.set()
        is_failing = False
        sync_at: float | None = None
        while True:
            is_last = self._closed.is_set()
            try:
                if self._write(files):
                    sync_at = sync_at or time.monotonic()
                period = SYNC_S if self._line_is_there else SYNC_AWAY_S
                if sync_at is not None and (is_last or time.monotonic() - sync_at >= period):
                    files.sync()
                    sync_at = None
                is_failing = False
            except OSError as error:
                if not is_failing:
                    words = "The journal for the fleet cannot be written to %s: %s. It is kept in memory until then."
                    log.warning(words, self._folder, error.strerror)
                is_failing, sync_at = True, None
            if is_last:
                files.close()
                return
            if is_failing:
                self._closed.wait(RETRY_S)
                continue
            if sync_at is None:
                self._wake.wait()
            self._wake.clear()
            self._closed.wait(WRITE_S)

    def _load(self, files: JournalFiles) -> None:
        earlier: list[_Run] = []
        for stored in files.load()[-MAX_RUNS:]:
            earlier.append(_Run(stored.boot, stored.before, stored.last, 0, deque(stored.reports)))
        with self._lock:
            self._runs[:0] = earlier
            self._bytes += sum(len(data) for run in earlier for _, data in run.reports)
            self._limit_bytes()

    def _write(self, files: JournalFiles) -> bool:
        """Append new reports, and remove files that are not needed; returns whether something was appended."""
        with self._lock:
            reports = tuple(self._unwritten)
            boot, number = self._stored_until
            runs = [one.boot for one in self._runs]
        if reports:
            files.append(self.boot, reports, self._written)
            self._written = reports[-1][0]
            with self._lock:
                while self._unwritten and self._unwritten[0][0] <= self._written:
                    self._unwritten.popleft()
        if boot:
            later = set(runs[runs.index(boot) + 1 :]) if boot in runs else set(runs)
            files.remove(lambda one, last: one not in later and (one != boot or last <= number))
        return bool(reports)
