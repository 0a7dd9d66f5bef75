"""Share of lost samples of a device, for all that state one: alarms and the fleet.

Lost samples are those that a counter shows. The share is that of all samples which this counter numbers: where several
messages share it, of all of them together.
"""

from collections import deque

from imuscope.server import wire


class LossWindow:
    """Loss over the last seconds, from the counts of a device.

    Args:
        seconds: its length.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._counts: deque[tuple[float, int, int]] = deque()  # time, lost, received

    def add(self, health: wire.DeviceHealth) -> bool:
        """Add figures; whether they continue those before. Fewer samples are those of another session."""
        continues = not self._counts or health.numbered >= self._counts[-1][2]
        if not continues:
            self._counts.clear()
        if not self._counts or health.time > self._counts[-1][0]:
            self._counts.append((health.time, health.lost, health.numbered))
        while len(self._counts) > 2 and self._counts[1][0] <= health.time - self._seconds:
            self._counts.popleft()
        return continues

    def clear(self) -> None:
        """Forget the counts."""
        self._counts.clear()

    @property
    def share(self) -> float | None:
        """Lost samples of those sent in this time, 0..1; None if none were."""
        if not self._counts:
            return None
        (_, lost_before, before), (_, lost, received) = self._counts[0], self._counts[-1]
        missing = max(0, lost - lost_before)  # a false loss is taken back
        sent = missing + received - before
        return missing / sent if sent > 0 else None
