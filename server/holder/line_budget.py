"""Limit of what a client may send: as much as the line carries, with short bursts."""

from __future__ import annotations

BURST_S, LEAST_BURST = 0.25, 2048  # a burst is at least one large frame


class LineBudget:
    """Bytes that may be sent, which grow with time."""

    def __init__(self) -> None:
        self._tokens = 0.0
        self._at = 0.0

    def available(self, now: float, rate: float) -> int:
        """Bytes that may be sent now.

        Args:
            now: monotonic, s.
            rate: bytes/s of the line since the last call.
        """
        burst = max(LEAST_BURST, rate * BURST_S)
        self._tokens = min(burst, self._tokens + (now - self._at) * rate) if self._at else burst
        self._at = now
        return int(self._tokens)

    def take(self, size: int) -> None:
        """Note that so many bytes were sent."""
        self._tokens -= size
