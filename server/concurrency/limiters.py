"""Rate limits: token buckets, one per key, and a limit per period that counts suppressed events."""

from collections import OrderedDict


class TokenBucket:
    """Burst limit and sustained rate, of requests or of bytes.

    Args:
        at_once: size of a burst; infinite for no limit.
        now: time of a monotonic clock, s, as in every call.
    """

    __slots__ = ("_at_once", "_left", "_per_s", "_updated_at")

    def __init__(self, per_s: float, at_once: float, now: float) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._left, self._updated_at = at_once, now

    def wait_s(self, now: float, count: float = 1.0) -> float:
        """Seconds until so many tokens are available; 0 if they are available now."""
        missing = count - self.available(now)
        return missing / self._per_s if missing > 0 else 0.0

    def acquire(self, now: float, count: float = 1.0) -> None:
        """Take tokens, in advance if they are not available."""
        self._left, self._updated_at = self.available(now) - count, now

    def change(self, per_s: float, at_once: float, now: float) -> None:
        """Set the limits; the rate counts from the last call on."""
        self._per_s, self._at_once = per_s, at_once
        self.acquire(now, 0.0)

    def available(self, now: float) -> float:
        """Tokens available now; negative after tokens were taken in advance."""
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
        """Seconds until the bucket of this key has a token; 0 if it has one."""
        bucket = self._buckets.get(key)
        return 0.0 if bucket is None else bucket.wait_s(now)

    def acquire(self, key: str, now: float) -> None:
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
