"""Which row of what has come is shown now? Rows come many at once, and a screen shows them one after another. Pure.

    messages   │─┬─┬─┬─┬─│─┬─┬─┬─┬─│      every 33 ms, each with the rows that were measured since the one before
    shown      ──────────┬────┬────┬────┬    every 17 ms, the newest row at the head

    head(now) = now + ahead − DELAY_S         ahead: the server's clock over ours, by the message that came soonest

So motion on screen is as even as it was in the device, though messages are half as many as pictures and the machine
lets them wait now and then. Each message costs the server a pass through its decoders; showing a row costs next to
nothing.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from server.wire_codec import SampleFrame

MESSAGES_PER_S = 30.0
ON_ITS_WAY_S = 0.012
DELAY_S = 1 / MESSAGES_PER_S + ON_ITS_WAY_S  # a message's rows are shown while the next one comes
FAR_S = 1.0  # device time further than that from arrival is not when it was measured, as far as anybody can tell
OVERDUE_S = 0.5  # what waits longer has a time that makes no sense here
MOST_WAITING = 32  # messages, while nobody looks


class PlayoutBuffer:
    """The rows of one channel, each in its time.

    Args:
        delay_s: from when a row was measured until it is shown.
    """

    def __init__(self, delay_s: float = DELAY_S) -> None:
        self._delay_s = delay_s
        self._ahead = -math.inf
        self._coming: deque[tuple[float, NDArray[np.float64], list[NDArray[Any]]]] = deque(maxlen=MOST_WAITING)

    @property
    def waits(self) -> bool:
        """There are rows whose time has not come."""
        return bool(self._coming)

    def hear(self, samples: SampleFrame, heard: float) -> None:
        """Rows came, at least one.

        Args:
            heard: when they came, monotonic, s.
        """
        self._ahead = max(self._ahead, samples.now - heard)
        arrival, time, *own = samples.columns
        times = time if abs(float(time[-1]) - float(arrival[-1])) < FAR_S else arrival  # NaN, too: arrival
        self._coming.append((heard, times, own))

    def at(self, now: float) -> list[float] | None:
        """The newest row whose time has come; None while that is one which was given before.

        Args:
            now: monotonic, s.
        """
        head = now + self._ahead - self._delay_s
        row = None
        while self._coming:
            heard, times, own = self._coming[0]
            if times[-1] > head and now - heard < OVERDUE_S:
                due = int(np.searchsorted(times, head, "right"))
                return [float(column[due - 1]) for column in own] if due else row
            row = [float(column[-1]) for column in own]
            self._coming.popleft()
        return row
