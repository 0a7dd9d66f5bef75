"""Playout buffer, which determines the row to show now: rows arrive in bursts and are shown one after another. Pure.

    messages   │─┬─┬─┬─┬─│─┬─┬─┬─┬─│      every 33 ms, each with the rows measured since the previous one
    shown      ──────────┬────┬────┬────┬    every 17 ms, the newest row at the head

    head(now) = now + ahead − DELAY_S         ahead: server clock minus ours, from the message with the least delay

So motion on screen is as even as in the device, although there are half as many messages as frames, with varying
delays. Each message costs the server a pass through its decoders; showing a row costs next to nothing.
"""

import math
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.server.wire.codec import SampleFrame

MESSAGES_PER_S = 30.0
ON_ITS_WAY_S = 0.012
DELAY_S = 1 / MESSAGES_PER_S + ON_ITS_WAY_S  # a message's rows are shown while the next one arrives
FAR_S = 1.0  # device time further than that from arrival cannot be trusted
OVERDUE_S = 0.5  # rows that wait longer have an invalid time
MAX_WAITING = 32  # messages, without viewers


class PlayoutBuffer:
    """The rows of one channel, each in its time."""

    def __init__(self) -> None:
        self._ahead = -math.inf
        self._pending: deque[tuple[float, NDArray[np.float64], list[NDArray[Any]]]] = deque(maxlen=MAX_WAITING)

    @property
    def waits(self) -> bool:
        """Whether rows are waiting for their time."""
        return bool(self._pending)

    def add(self, samples: SampleFrame, received_at: float) -> None:
        """Add received rows, at least one.

        Args:
            received_at: time of arrival, monotonic, s.
        """
        self._ahead = max(self._ahead, samples.now - received_at)
        arrival, time, *own = samples.columns
        times = time if abs(float(time[-1]) - float(arrival[-1])) < FAR_S else arrival  # NaN, too: arrival
        self._pending.append((received_at, times, own))

    def due(self, now: float) -> list[float] | None:
        """The newest due row; None if it was already returned.

        Args:
            now: monotonic, s.
        """
        head = now + self._ahead - DELAY_S
        row = None
        while self._pending:
            received_at, times, own = self._pending[0]
            if times[-1] > head and now - received_at < OVERDUE_S:
                due = int(np.searchsorted(times, head, "right"))
                return [float(column[due - 1]) for column in own] if due else row
            row = [float(column[-1]) for column in own]
            self._pending.popleft()
        return row
