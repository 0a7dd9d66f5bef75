"""Silence timeout of a device.

It is below a second for a streaming device, so that the page shows it within a second, including tick and flush. A slow
device has three of its usual intervals, or a few seconds while its interval is not known. Expected silence (a device
that is being configured does not measure) is not counted, nor is time in which this process did not run: what came
then waits to be read.
"""

from collections import deque
from collections.abc import Sequence

SILENT_S = 0.8
SLOW_FACTOR = 3.0  # a device that sends every 2 s is silent after 6 s
FEW_CHUNKS = 3  # with fewer chunks the usual interval is not known, and the limit is:
FEW_CHUNKS_S = 3.0
SLOWEST_S = 10.0
MAX_PAUSES = 256  # of a minute
WATCHED_S = 0.25  # between two checks of a process that runs; they are due every 0.1 s, or 0.2 s without viewers
LINK_SILENT_HINT = "Check that the device is powered and in measurement state; it is shown again when it sends."


class SilenceWatchdog:
    """Silence watchdog of one device.

    Args:
        least_s: shortest limit.
        first_s: limit while the usual interval is not known.

    Attributes:
        pauses: beginning and end of the latest times in which this process did not run, unix s.
    """

    def __init__(self, least_s: float = SILENT_S, first_s: float = FEW_CHUNKS_S) -> None:
        self._least_s, self._first_s = least_s, first_s
        self._interval = 0.0  # the usual time between chunks of this device, s
        self._chunks = 0
        self.suppressed = False
        self._suppressed_until = 0.0
        self._since, self._checked_at = 0.0, 0.0  # of the last check, unix s
        self._unwatched = 0.0  # time without checks since then, s
        self.pauses: deque[tuple[float, float]] = deque(maxlen=MAX_PAUSES)

    def note_chunk(self, arrival: float, before: float | None) -> None:
        """Note a received chunk; both unix s, `before` None for the first one."""
        if before is not None:
            gap = arrival - before
            self._interval = max(gap if gap < SLOWEST_S else 0.0, 0.9 * self._interval)
        self._chunks += 1

    def note_chunks(self, arrivals: Sequence[float], before: float | None) -> None:
        """Note received chunks in order, as `note_chunk` for each."""
        interval = self._interval
        for arrival in arrivals:
            if before is not None:
                gap = arrival - before
                interval *= 0.9
                if interval < gap < SLOWEST_S:
                    interval = gap
            before = arrival
        self._interval = interval
        self._chunks += len(arrivals)

    def suppress(self, on: bool, now: float) -> None:
        """Ignore silence while `on`."""
        self.suppressed = on
        self._suppressed_until = now

    def silence(self, now: float, since: float) -> float:
        """Time since the last expected data, s: `since` the last byte, or the opening of the link."""
        since = max(since, self._suppressed_until)
        if since != self._since:
            self._since, self._unwatched = since, 0.0
        self._unwatched += max(0.0, now - max(self._checked_at, since) - WATCHED_S)
        if self._checked_at and now - self._checked_at > WATCHED_S:
            self.pauses.append((self._checked_at, now))
        self._checked_at = now
        return 0.0 if self.suppressed else now - since - self._unwatched

    @property
    def limit(self) -> float:
        """Longest silence of this device that is normal, s."""
        least = self._first_s if self._chunks < FEW_CHUNKS else self._least_s
        return max(least, min(SLOW_FACTOR * self._interval, SLOWEST_S))
