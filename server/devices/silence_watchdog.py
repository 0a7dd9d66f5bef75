"""How long may a device be silent before it is called lost?

Under a second for one that streams: the page knows within a second, the tick and the flush after it included. A slow
device has three of its usual intervals, and with its first chunks, when that is not known yet, a few seconds. A silence
that is meant (a device that is being configured does not measure) is not held against it.
"""

from __future__ import annotations

SILENT_S = 0.8
SLOW_FACTOR = 3.0  # a device that speaks every 2 s is silent after 6 s
FEW_CHUNKS = 3  # with fewer than these its usual interval is not known, and it has this long:
FEW_CHUNKS_S = 3.0
SLOWEST_S = 10.0
LINK_SILENT_HINT = "Is the device powered and in measurement state? It is shown again as soon as it speaks."


class SilenceWatchdog:
    """With one device.

    Args:
        least_s: it may always be silent for so long.
        first_s: and for so long while its usual interval is not known.
    """

    def __init__(self, least_s: float = SILENT_S, first_s: float = FEW_CHUNKS_S) -> None:
        self._least_s, self._first_s = least_s, first_s
        self._interval = 0.0  # the usual time between chunks of this device, s
        self._chunks = 0
        self.hushed = False
        self._hushed_until = 0.0

    def heard(self, arrival: float, before: float | None) -> None:
        """A chunk came; both unix s, None where it is the first."""
        if before is not None:
            gap = arrival - before
            self._interval = max(gap if gap < SLOWEST_S else 0.0, 0.9 * self._interval)
        self._chunks += 1

    def hush(self, on: bool, now: float) -> None:
        """From now on (until it is taken off) silence is meant."""
        self.hushed = on
        self._hushed_until = now

    def quiet(self, now: float, since: float) -> float:
        """How long nothing came that should have, s: `since` the last byte, or the opening of the link."""
        return 0.0 if self.hushed else now - max(since, self._hushed_until)

    @property
    def limit(self) -> float:
        """How long this device may be silent, s."""
        least = self._first_s if self._chunks < FEW_CHUNKS else self._least_s
        return max(least, min(SLOW_FACTOR * self._interval, SLOWEST_S))
