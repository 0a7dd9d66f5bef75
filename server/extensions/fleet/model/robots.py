"""The robots that a fleet server knows, and what changed of them since a revision.

Each visible change of a robot has the next revision. Revisions of a server begin at its clock in milliseconds, so those
of an earlier run are older than all of this one: a request with one of them is answered with everything.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from imuscope.server.extensions.fleet.model.summaries import FleetRobots, RobotSummary, with_hysteresis

MAX_ROBOTS = 100_000
MAX_GONE = 10_000
"""Removals that are remembered; a request for older ones is answered with everything."""


class TooManyRobotsError(Exception):
    """The fleet has as many robots as a server shows."""


@dataclass(slots=True)
class _Entry:
    summary: RobotSummary
    revision: int
    text: bytes


class Robots:
    """Summaries by name. To be used in one thread.

    Args:
        now: unix s.
        limit: number of robots.
    """

    def __init__(self, now: Callable[[], float] = time.time, limit: int = MAX_ROBOTS) -> None:
        self._now = now
        self._limit = limit
        self._entries: dict[str, _Entry] = {}  # in order of revisions, the newest last
        self._gone: deque[tuple[int, str]] = deque()
        self._first = self._revision = round(now() * 1000)

    @property
    def revision(self) -> int:
        """Revision of the newest change."""
        return self._revision

    @property
    def summaries(self) -> Mapping[str, RobotSummary]:
        """All robots by name."""
        return MappingProxyType({name: entry.summary for name, entry in self._entries.items()})

    def get(self, name: str) -> RobotSummary | None:
        entry = self._entries.get(name)
        return None if entry is None else entry.summary

    def update(self, summary: RobotSummary) -> bool:
        """Take over a summary; returns whether a user sees a change.

        Raises:
            TooManyRobotsError: it is a new robot, and there are as many as this server shows.
        """
        known = self._entries.get(summary.name)
        if known is None and len(self._entries) >= self._limit:
            raise TooManyRobotsError
        summary = with_hysteresis(summary, None if known is None else known.summary)
        if known is not None and known.summary == summary:
            return False
        self._revision += 1
        self._entries.pop(summary.name, None)  # to the end
        self._entries[summary.name] = _Entry(summary, self._revision, summary.model_dump_json().encode())
        return True

    def remove(self, name: str) -> bool:
        """Remove a robot; returns whether there was one."""
        if self._entries.pop(name, None) is None:
            return False
        self._revision += 1
        self._gone.append((self._revision, name))
        if len(self._gone) > MAX_GONE:
            self._first = self._gone.popleft()[0]
        return True

    def since(self, revision: int | None) -> bytes:
        """The robots that changed after a revision, as JSON of FleetRobots; all of them for None or an unknown one."""
        complete = revision is None or not self._first <= revision <= self._revision
        after = -1 if complete or revision is None else revision
        texts: list[bytes] = []
        for entry in reversed(self._entries.values()):
            if entry.revision <= after:
                break
            texts.append(entry.text)
        gone = [] if complete else list(dict.fromkeys(name for number, name in self._gone if number > after))
        head = FleetRobots(
            revision=self._revision,
            time=self._now(),
            complete=complete,
            gone=[name for name in gone if name not in self._entries],
            robots=[],
        ).model_dump_json()
        return b"".join([head[: -len("[]}")].encode(), b"[", b",".join(reversed(texts)), b"]}"])
