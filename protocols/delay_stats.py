"""How late do frames come, and what may that hide?

Every frame is late by something: the host wakes up, a network queues, an adapter waits for more bytes. The least late
ones show where the line of a clock lies (clock_model.py); how all of them are spread shows how far off it may still be.

    delay            delay                 delay                  delay
     │                │  /|  /|  /|  /      │ ·                    │    |\\
     │                │ / | / | / | /       │   · ·   ·            │    | \\
     │···········     │/  |/  |/  |/        │·  ·  ··  · ··        │____|  \\____
     clean            an adapter's bursts   a network              a host that did not read

## What an adapter hides

An adapter that hands over when 62 bytes have gathered, or when its timer T runs out, keeps no byte for longer than

    hold = min(T, the time until the next frames have filled a packet)

So all true delays lie between 0 and `hold`. If those seen reach from the line up to R, the line itself is at most
hold − R too high, and no more can be said: a stream locked to the timer, each frame late by the same 8 ms, looks like
one that is never late. (A stream whose frames are cut by full packets is known better: chunk_boundaries.py. Of each
frame both delays are kept, of its last bytes and of those that came soonest.) Where T is not known but bursts are seen
it is taken
for the 16 ms with which adapters are delivered. Without an adapter, what may be hidden is judged from the delays
themselves: as much as the greatest hole among the smaller ones, as in a poll grid that beats with the stream.

Source: FTDI, AN232B-04 "Data Throughput, Latency and Handshaking", sections 3.2 and 3.3.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

KEPT = 2048  # delays remembered
RECENT_NS = 5e9
FEWEST = 24  # delays from which anything is concluded
PACKET = 62
USUAL_TIMER_NS = 16e6  # of an adapter as delivered
WAKE_NS = 1e6  # a host that is up takes no longer to read
BURST_NS = 2e6  # an adapter that holds bytes no longer than this is no trouble
STALL_NS = 0.1e9  # a delay that only a host makes, or a network
UNSURE = 0.4
STALLS = 8
MOST = 0.9  # share of the delays that must fit what is known of an adapter


@dataclass(frozen=True, slots=True)
class DelaySpread:
    """The delays of the last seconds, ns.

    Attributes:
        low: of the least late frame. top: R above, stalls left out.
        gap: the greatest hole among the smaller delays.
        hidden: how much of a delay that all frames have the line may hide.
        bursts: an adapter gathers bytes.
        holds: for how long it keeps one, 0 where there is none.
    """

    low: float = 0.0
    top: float = 0.0
    gap: float = 0.0
    hidden: float = 0.0
    bursts: bool = False
    holds: float = 0.0


class DelayStatistics:
    """The delays of one stretch of a device's clock.

    Args:
        holds_ns: what the adapter's timer is known to be; 0: not known, or there is none.
        byte_ns: time of a byte on the line; 0: not known.
    Attributes:
        stalls: (arrival in unix ns, how late the first frame was in ns) of the last ones.
    """

    def __init__(self, holds_ns: float = 0.0, byte_ns: float = 0.0) -> None:
        self.rows = 0
        self.stalls: deque[tuple[int, float]] = deque(maxlen=STALLS)
        self._holds_ns = holds_ns
        self._byte_ns = byte_ns
        self._delays = np.zeros(KEPT)  # of the last bytes of frames
        self._least = np.zeros(KEPT)  # of the bytes that came soonest: the same where frames came whole
        self._x = np.full(KEPT, -np.inf)
        self._size = 0.0
        self._late, self._late_since = 0.0, 0  # how late the first frame of what may be a stall was, and when it came

    def add(self, x: Array, delay: Array, size: float, arrival: int, waited: Array | None = None) -> None:
        """Keep rows that came together: x in ns, their delays, bytes of a frame, unix ns at which the last came, how
        much longer the last bytes of frames had waited than those that came before them."""
        least = delay
        if waited is not None:
            delay = delay + waited
        if self._late or delay[0] > STALL_NS:
            self._catches_up(float(delay[0]), float(delay[-1]), arrival)
        start = self.rows % KEPT
        count = len(x)
        self.rows += count
        self._size = size
        if start + count <= KEPT:
            self._delays[start : start + count] = delay
            self._least[start : start + count] = least
            self._x[start : start + count] = x
        else:
            rows = np.arange(start, start + count) % KEPT
            self._delays[rows] = delay
            self._least[rows] = least
            self._x[rows] = x

    def _catches_up(self, first: float, last: float, arrival: int) -> None:
        """A frame came late: is it a stall, after which the others come all at once, and none of them lost its time?"""
        if not self._late and self.rows >= FEWEST:
            self._late, self._late_since = first, arrival
        if self._late and last < self._late / 4:
            self.stalls.append((arrival, self._late))
            self._late = 0.0
        elif arrival - self._late_since > self._late / 2:
            self._late = 0.0  # the stream goes on late: a queue, not a stall

    def recent(self, newest: float) -> NDArray[np.float64]:
        """Delays of the last seconds before `newest`, ascending; those of out-of-date rows left out."""
        return np.sort(self._delays[self._x >= newest - RECENT_NS])

    def soonest(self, newest: float) -> NDArray[np.float64]:
        """The same of the bytes of each frame that came soonest."""
        return np.sort(self._least[self._x >= newest - RECENT_NS])

    def spread(self, newest: float) -> DelaySpread:
        """Judge the last seconds before `newest`."""
        delays = self.recent(newest)
        count = len(delays)
        if count < 2:
            return DelaySpread(hidden=self._holds_ns)  # nothing is known yet
        soonest = self.soonest(newest)
        low = max(float(soonest[0]), 0.0)
        gap = float(np.diff(soonest[: count * 5 // 8 + 2]).max())
        if count < FEWEST:
            return DelaySpread(low, 0.0, gap, max(gap, self._holds_ns))
        bursts = _bursts(delays)
        timer = self._holds_ns or (USUAL_TIMER_NS if bursts else 0.0)
        hold = min(timer, self._filled_after(newest))
        inside = delays[: int(np.searchsorted(delays, hold + WAKE_NS if hold else STALL_NS))]
        top = float(inside[len(inside) * 49 // 50]) if len(inside) else 0.0
        sure = min(self._holds_ns, WAKE_NS) * UNSURE  # how late those are that are least late is never known to a hair
        longer = len(inside) < MOST * count  # it keeps bytes for longer than was thought
        return DelaySpread(low, top, gap, gap if longer or not hold else max(sure, hold - top), bursts, hold)

    def _filled_after(self, newest: float) -> float:
        """How long the last byte of a frame waits at most until those after it have filled a packet, ns."""
        recent = self._x[self._x >= newest - RECENT_NS]
        if len(recent) < 2 or self._size < 1:
            return USUAL_TIMER_NS
        period = (float(recent.max()) - float(recent.min())) / (len(recent) - 1)
        more = -(-(PACKET - 1) // self._size)  # frames until 61 more bytes have come
        return float(more * period + (PACKET - 1 - more * self._size) * self._byte_ns)


def _bursts(delays: Array) -> bool:
    """Do these delays, ascending, come of an adapter that gathers bytes? They are spread over some ms, evenly or in few
    steps, and end sharply; those of a busy host or a network thin out instead."""
    delays = delays[: int(np.searchsorted(delays, STALL_NS))]
    count = len(delays)
    if count < FEWEST:
        return False
    middle, high, top = (float(delays[int(share * (count - 1))]) for share in (0.5, 0.9, 0.98))
    mean = float(delays.mean())
    return top > BURST_NS and max(middle, mean) > 0.3 * top and high > 0.7 * top
