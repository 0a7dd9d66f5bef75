"""Rate of arrivals over the last two seconds.

A meter stores recent arrivals with their times. The rate is the count *between* the first and the last of them, divided
by the time between them: 400 Hz in bursts of any size gives 400, whereas counts in a window would vary by a burst. It
falls to 0 one second after the last arrival, when the page also shows the device as lost; for rare arrivals, after 1.5
intervals.
"""

from collections import deque
from collections.abc import Sequence

WINDOW_S = 2.0
FRESH_S = 1.0
SHORTEST_S = 0.2  # arrivals closer together than this give no rate


class RateMeter:
    """Total count of arrivals, and their rate over the last seconds."""

    __slots__ = ("_recent", "_recent_sum", "total")

    def __init__(self) -> None:
        self.total = 0
        self._recent: deque[tuple[float, int]] = deque()
        self._recent_sum = 0

    def add(self, count: int, now: float) -> None:
        self.total += count
        self._recent.append((now, count))
        self._recent_sum += count
        self._forget(now)

    def add_all(self, counts: Sequence[int], times: Sequence[float]) -> None:
        """As `add` for each, in order of time."""
        total = sum(counts)
        self.total += total
        self._recent.extend(zip(times, counts, strict=True))
        self._recent_sum += total
        if times:
            self._forget(times[-1])

    def rate(self, now: float) -> float:
        """Arrivals per second, in the window before `now` (s)."""
        self._forget(now)
        if not self._recent:
            return 0.0
        (first, opening), (last, _) = self._recent[0], self._recent[-1]
        spacing = (last - first) / (len(self._recent) - 1) if len(self._recent) > 1 else WINDOW_S
        if now - last > max(FRESH_S, 1.5 * spacing):
            return 0.0
        if last - first < SHORTEST_S:
            return self._recent_sum / WINDOW_S
        return (self._recent_sum - opening) / (last - first)

    def _forget(self, now: float) -> None:
        while self._recent and self._recent[0][0] <= now - WINDOW_S:
            self._recent_sum -= self._recent.popleft()[1]
