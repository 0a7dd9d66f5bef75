"""Bytes that came faster than they could be decoded, and were dropped: how many, told while it lasts.

What is dropped is the oldest that waits (server/links/reader_thread.py). A recording has it all: it takes the bytes
before.
"""

from __future__ import annotations

from server.devices.event_reporter import EventReporter
from server.devices.link_stats import LinkStatistics

EVERY_S = 5.0  # between two sentences about it
OVER_S = 10.0  # for so long after the last of it there is a notice
NOTICE = "Bytes come faster than this host can decode them: the oldest are left out. A recording has them all."


class LeftOut:
    """Of one session."""

    def __init__(self, incidents: EventReporter, figures: LinkStatistics, source: str) -> None:
        self._incidents = incidents
        self._figures = figures
        self._source = source
        self._told = 0
        self._told_at = float("-inf")

    def look(self, total: int, now: float) -> None:
        """So many have been left out since the session began."""
        figures = self._figures
        if total != figures.left_out:
            figures.left_out, figures.left_out_at = total, now

    def tick(self, now: float) -> None:
        """Say it, now and then."""
        new = self._figures.left_out - self._told
        if new and now - self._told_at >= EVERY_S:
            self._told, self._told_at = self._figures.left_out, now
            size = f"{new / 1e6:.1f} MB" if new >= 1e5 else f"{new / 1e3:.1f} kB"
            text = f"{size} of {self._source} were left out: they came faster than this host can decode them."
            self._incidents.say(
                "link", "fault", f"{text} A recording has them all.", data={"kind": "left-out", "bytes": new}
            )

    def notices(self, now: float) -> list[str]:
        """A standing remark while it goes on."""
        return [NOTICE] if now - self._figures.left_out_at < OVER_S else []
