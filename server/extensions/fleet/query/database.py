"""The state of a fleet server that outlasts it: the last state of each robot, and events. One SQLite file.

The number of the last report of a robot and the events of that report are written in one transaction. So after a crash
exactly the missing reports are requested from the robot, and none is stored twice.
"""

import contextlib
import sqlite3
import threading
from collections.abc import Iterable
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path

FILE = "fleet.sqlite"
MAX_EVENTS = 200_000
PRUNE_EVERY = 1000  # events


class FleetDatabaseError(Exception):
    """The file cannot be used: the reason as one sentence."""


@dataclass(slots=True)
class StoredRobot:
    """The last state of a robot: a row of its table.

    Args:
        boot, number: run of its server, and its last report.
        since: unix s; it was live, or lost, since then.
        status: MessagePack of RobotStatus; empty before the first.
        received: reports that were taken, of all runs.
        missed: reports that were dropped before they could be taken.
    """

    name: str
    boot: str = ""
    number: int = 0
    is_live: bool = False
    since: float = 0.0
    status: bytes = b""
    received: int = 0
    missed: int = 0


@dataclass(frozen=True, slots=True)
class StoredEvent:
    """An event of a robot: a row of its table, without the id. `number` is that of the report that contained it; 0 for
    one of the fleet server.
    """

    robot: str
    boot: str
    number: int
    time: float
    kind: str
    level: str
    text: str
    device: str


@dataclass(slots=True)
class FleetBatch:
    """Changes to write at once."""

    robots: dict[str, StoredRobot] = field(default_factory=dict)
    events: list[StoredEvent] = field(default_factory=list)
    removed: set[str] = field(default_factory=set)

    def __bool__(self) -> bool:
        return bool(self.robots or self.events or self.removed)


_TABLES = """
CREATE TABLE IF NOT EXISTS robots (name TEXT PRIMARY KEY, boot TEXT, number INTEGER, is_live INTEGER, since REAL,
    status BLOB, received INTEGER, missed INTEGER);
CREATE TABLE IF NOT EXISTS events (id INTEGER PRIMARY KEY AUTOINCREMENT, robot TEXT, boot TEXT, number INTEGER,
    time REAL, kind TEXT, level TEXT, text TEXT, device TEXT);
CREATE INDEX IF NOT EXISTS events_of_robot ON events (robot, id);
"""


class FleetDatabase:
    """The file. May be used from any thread.

    Raises:
        FleetDatabaseError: it cannot be opened.
    """

    def __init__(self, folder: Path) -> None:
        self._lock = threading.Lock()
        self._written = PRUNE_EVERY  # a server that is started often writes less than that in a run
        with contextlib.ExitStack() as at_failure:
            try:
                folder.mkdir(parents=True, exist_ok=True)
                self._file = sqlite3.connect(folder / FILE, check_same_thread=False, isolation_level=None)
                at_failure.callback(self._file.close)
                self._file.execute("PRAGMA journal_mode=WAL")
                self._file.execute("PRAGMA synchronous=NORMAL")
                self._file.executescript(_TABLES)
            except (OSError, sqlite3.Error) as error:
                raise FleetDatabaseError(f"{folder / FILE} cannot be opened: {error}.") from None
            at_failure.pop_all()

    def robots(self) -> list[StoredRobot]:
        with self._lock:
            rows = self._file.execute("SELECT * FROM robots ORDER BY name").fetchall()
        robots = [StoredRobot(*row) for row in rows]
        return [replace(one, is_live=bool(one.is_live)) for one in robots]  # SQLite has no booleans

    def write(self, batch: FleetBatch) -> None:
        """Write all changes, or none.

        Raises:
            FleetDatabaseError: such as a full disk.
        """
        with self._lock:
            try:
                self._file.execute("BEGIN")
                self._file.executemany("DELETE FROM robots WHERE name = ?", [(name,) for name in batch.removed])
                self._file.executemany(
                    "INSERT OR REPLACE INTO robots VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                    map(astuple, batch.robots.values()),
                )
                self._file.executemany(
                    "INSERT INTO events VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?)", map(astuple, batch.events)
                )
                self._prune(len(batch.events))
                self._file.execute("COMMIT")
            except sqlite3.Error as error:
                with contextlib.suppress(sqlite3.Error):
                    self._file.execute("ROLLBACK")
                raise FleetDatabaseError(f"The state of the fleet cannot be written: {error}.") from None

    def _prune(self, events: int) -> None:
        self._written += events
        if self._written >= PRUNE_EVERY:
            self._written = 0
            self._file.execute("DELETE FROM events WHERE id <= (SELECT max(id) FROM events) - ?", (MAX_EVENTS,))

    def events(self, robot: str = "", before: int | None = None, limit: int = 200) -> list[tuple[int, StoredEvent]]:
        """The newest events with their ids, newest first.

        Args:
            robot: of it only.
            before: an id: only older ones.
        """
        conditions, values = ["1"], list[object]()
        if robot:
            conditions.append("robot = ?")
            values.append(robot)
        if before is not None:
            conditions.append("id < ?")
            values.append(before)
        where = " AND ".join(conditions)
        with self._lock:
            rows: Iterable[tuple[int, str, str, int, float, str, str, str, str]] = self._file.execute(
                f"SELECT * FROM events WHERE {where} ORDER BY id DESC LIMIT ?",
                (*values, limit),
            ).fetchall()
        return [(row[0], StoredEvent(*row[1:])) for row in rows]

    def last_number(self, robot: str, boot: str) -> int:
        """Number of the last report of a run whose events are here; 0 if there is none."""
        with self._lock:
            row = self._file.execute(
                "SELECT max(number) FROM events WHERE robot = ? AND boot = ?", (robot, boot)
            ).fetchone()
        return int(row[0] or 0)

    def close(self) -> None:
        with self._lock:
            self._file.close()
