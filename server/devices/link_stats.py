"""How is this device doing? Rates over the last two seconds, counts since the session began.

A meter keeps what came lately, with arrival times. Its rate is what came *between* the first and the last of those
arrivals, over the time between them: 400 Hz in bursts of any size read 400, where counting what falls into a window
would swing by a burst. It falls to 0 one second after the last arrival, when the page also calls a device lost; what
comes seldom is given one and a half of its own intervals.

Latency is from the arrival of the oldest byte that waited to the moment its samples were handed to the browsers.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable

from server.prometheus_text import Histogram
from server.wire import MessageHealth

WINDOW_S = 2.0
FRESH_S = 1.0
SHORTEST_S = 0.2  # two arrivals closer than this say nothing about a rate
MOST_MESSAGES = 256  # kinds that are counted by name; a healthy device has a few dozen, a flood of names any number
OTHERS = "other messages"
LATENCIES_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # 8 and 16 ms are what a flush may wait


class RateMeter:
    """Counts of something, and their rate over the last seconds."""

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

    def rate(self, now: float) -> float:
        """Per second, over what came in the seconds before `now` (s)."""
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


class LinkStatistics:
    """The counts of one session."""

    def __init__(self) -> None:
        self.bytes = RateMeter()
        self.messages: dict[str, RateMeter] = {}
        self.gaps = 0
        self.lost = 0
        self.rejects = 0
        self.rejects_by: Counter[str] = Counter()  # reason → how many
        self.verified: int | None = None  # samples; None where a protocol has no such notion
        self.unverified: int | None = None
        self.left_out = 0  # bytes that were dropped because they could not be decoded in time
        self.left_out_at = float("-inf")  # when that was seen last, unix s
        self.last_arrival: float | None = None  # of bytes
        self.last_sample: float | None = None  # of something that was read in them
        self.latency = Histogram(LATENCIES_S)  # s
        self._waiting_since: float | None = None

    def heard(self, size: int, arrival: float) -> None:
        """`size` bytes came."""
        self.bytes.add(size, arrival)
        self.last_arrival = arrival
        if self._waiting_since is None:
            self._waiting_since = arrival

    def handed_on(self, now: float) -> None:
        """What came has been decoded and is on its way to the browsers."""
        if self._waiting_since is not None:
            self.latency.add(max(0.0, now - self._waiting_since))
            self._waiting_since = None

    def samples(self, message: str, count: int, now: float) -> None:
        """`count` samples of a message were decoded."""
        meter = self.messages.get(message)
        if meter is None:
            if len(self.messages) >= MOST_MESSAGES:
                message = OTHERS
            meter = self.messages.setdefault(message, RateMeter())
        meter.add(count, now)
        self.last_sample = max(now, self.last_sample or now)

    def rejected(self, reasons: Iterable[str]) -> None:
        """Candidates that failed, each for a reason."""
        self.rejects_by.update(reasons)
        self.rejects = self.rejects_by.total()

    def trusted(self, count: int, verified: bool) -> None:
        """`count` samples of a protocol that tells verified from unverified ones."""
        self.verified = (self.verified or 0) + (count if verified else 0)
        self.unverified = (self.unverified or 0) + (0 if verified else count)

    def read_anew(self) -> None:
        """The bytes are read in another way from here on: what was refused and trusted before says nothing of it."""
        self.rejects, self.rejects_by = 0, Counter()
        self.verified = self.unverified = None

    def report(self, now: float) -> list[MessageHealth]:
        """Every message, the most frequent first."""
        found = [MessageHealth(name, meter.rate(now), meter.total) for name, meter in self.messages.items()]
        return sorted(found, key=lambda one: -one.count)
