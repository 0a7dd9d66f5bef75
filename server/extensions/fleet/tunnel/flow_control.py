"""Limit of the bytes on their way to a viewer: as much as arrives within about half a second.

The receiver acknowledges the bytes it has delivered. If that took long, the window shrinks, otherwise it grows. So what
waits for a slow line or a slow browser waits at its origin, where live samples can be dropped, and not on the way.
"""

import asyncio
from collections import deque

from imuscope.server.extensions.fleet.tunnel.http_tunnel_protocol import MAX_PART

MIN_WINDOW_BYTES, MAX_WINDOW_BYTES = 8 * 1024, 192 * 1024
SLOW_S = 0.5


class Window:
    """Bytes of one stream on their way. To be used in an event loop.

    Attributes:
        size: bytes that may be on their way at present.
        is_closed: nothing waits any more.
    """

    def __init__(self) -> None:
        self.size = 64 * 1024
        self.is_closed = False
        self._sent = self._acknowledged = 0
        self._marks: deque[tuple[int, float]] = deque()  # bytes sent up to a time
        self._changed = asyncio.Event()

    @property
    def under_way(self) -> int:
        """Bytes that were sent and not taken yet."""
        return self._sent - self._acknowledged

    @property
    def piece(self) -> int:
        """Bytes that may be sent at once."""
        return min(MAX_PART, self.size // 2)

    async def wait(self, size: int) -> None:
        """Wait until so many bytes may be sent, or it is closed."""
        while not self.is_closed and self.under_way and self.under_way + size > self.size:
            self._changed.clear()
            await self._changed.wait()

    def sent(self, size: int, now: float) -> None:
        """Count bytes that are sent now."""
        self._sent += size
        self._marks.append((self._sent, now))

    def acknowledge(self, size: int, now: float) -> bool:
        """The other side has passed on so many bytes in all; returns False for a number that cannot be."""
        if not self._acknowledged <= size <= self._sent:
            return False
        gained, took = size - self._acknowledged, 0.0
        self._acknowledged = size
        while self._marks and self._marks[0][0] <= size:
            took = now - self._marks.popleft()[1]
        self.size = (
            max(MIN_WINDOW_BYTES, self.size // 2) if took > SLOW_S else min(MAX_WINDOW_BYTES, self.size + gained)
        )
        self._changed.set()
        return True

    def close(self) -> None:
        """Wake all waiting senders."""
        self.is_closed = True
        self._changed.set()
