"""Reports of bytes that were dropped because they arrived faster than they could be decoded.

The oldest waiting bytes are dropped (server/links/reader_thread.py). A recording has all of them, because it takes the
bytes before.
"""

from imuscope.server.devices.device.event_reporter import EventReporter
from imuscope.server.devices.device.link_stats import LinkStatistics

EVERY_S = 5.0  # between two reports
OVER_S = 10.0  # duration of the notice after the last drop
NOTICE = "Bytes arrive faster than this host can decode them: the oldest are left out. A recording has them all."


class DroppedBytes:
    """Report of bytes that one session drops, as one event for each overload."""

    def __init__(self, incidents: EventReporter, figures: LinkStatistics, source: str) -> None:
        self._events = incidents
        self._stats = figures
        self._source = source
        self._reported = 0
        self._reported_at = float("-inf")

    def update(self, total: int, now: float, arrivals: tuple[float, float]) -> None:
        """Update the number of bytes left out since the session began; `arrivals` of bytes before and after them."""
        figures = self._stats
        if total != figures.left_out:
            figures.left_out, figures.left_out_at = total, now
            figures.left_out_spans.append(arrivals)

    def tick(self, now: float) -> None:
        """Report new drops at intervals."""
        new = self._stats.left_out - self._reported
        if new and now - self._reported_at >= EVERY_S:
            self._reported, self._reported_at = self._stats.left_out, now
            size = f"{new / 1e6:.1f} MB" if new >= 1e5 else f"{new / 1e3:.1f} kB"
            text = f"{size} of {self._source} were left out: they arrived faster than this host can decode them."
            self._events.report(
                "link", "error", f"{text} A recording has them all.", data={"kind": "left-out", "bytes": new}
            )

    def notices(self, now: float) -> list[str]:
        """The notice while drops continue."""
        return [NOTICE] if now - self._stats.left_out_at < OVER_S else []
