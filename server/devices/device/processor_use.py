"""Processor time of the thread that decodes: why decoding is behind.

Linux counts for each thread how long it ran and how long it waited for a processor although it had work
(/proc/thread-self/schedstat). Where it is not counted, no reason is reported.
"""

from __future__ import annotations

from pathlib import Path

from imuscope.server.wire import BusyReason

SCHEDSTAT = Path("/proc/thread-self/schedstat")
OVER_S = 2.0
WAITED, USED = 0.25, 0.7  # shares of the time


class ProcessorUse:
    """Shares of the last seconds in which the calling thread waited for a processor, and ran.

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
        return "others" if self.waited > WAITED else "decoding" if self.used > USED else ""
