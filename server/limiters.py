"""Rate limits: token buckets, one per key, and a limit per period that counts suppressed events."""

from __future__ import annotations

from collections import OrderedDict


class TokenBucket:
    """Burst limit and sustained rate.

    Args:
        now: time of a monotonic clock, s, as in every call.
    """

    __slots__ = ("_at_once", "_left", "_per_s", "_updated_at")

    def __init__(self, per_s: float, at_once: float, now: float) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._left, self._updated_at = at_once, now

    def wait_s(self, now: float) -> float:
        """Seconds until a token is available; 0 if one is available now."""
        return max(0.0, (1.0 - self._refilled(now)) / self._per_s)

    def acquire(self, now: float) -> None:
        """Take a token, in advance if none is available."""
        self._left, self._updated_at = self._refilled(now) - 1.0, now

    def _refilled(self, now: float) -> float:
        return min(self._at_once, self._left + (now - self._updated_at) * self._per_s)


class TokenBuckets:
    """One bucket for each key, in constant memory: the least recently used one is removed first.

    Args:
        most: maximum number of keys.
    """

    def __init__(self, per_s: float, at_once: float, most: int) -> None:
        self._per_s, self._at_once, self._most = per_s, at_once, most
        self._buckets: OrderedDict[str, TokenBucket] = OrderedDict()

    def __len__(self) -> int:
        return len(self._buckets)

    def wait_s(self, key: str, now: float) -> float:
        """As TokenBucket.wait_s."""
        bucket = self._buckets.get(key)
        return 0.0 if bucket is None else bucket.wait_s(now)

    def acquire(self, key: str, now: float) -> None:
        """As TokenBucket.acquire."""
        bucket = self._buckets.setdefault(key, TokenBucket(self._per_s, self._at_once, now))
        bucket.acquire(now)
        self._buckets.move_to_end(key)
        while len(self._buckets) > self._most:
            self._buckets.popitem(last=False)


class PeriodLimit:
    """Limit per period; the period begins with the first event, and the events beyond are counted.

    Attributes:
        began: start of the current period, s.
    """

    __slots__ = ("_count", "_most", "_period_s", "began")

    def __init__(self, most: int, period_s: float) -> None:
        self._most, self._period_s = most, period_s
        self.began, self._count = float("-inf"), 0

    def begin(self, now: float) -> int:
        """Begin a new period if the last one is over; returns the number of events it suppressed."""
        if now - self.began < self._period_s:
            return 0
        suppressed = max(0, self._count - self._most)
        self.began, self._count = now, 0
        return suppressed

    def allows(self) -> bool:
        """Count an event; True if it is allowed."""
        self._count += 1
        return self._count <= self._most
