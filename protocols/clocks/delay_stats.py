"""Delays of frames, and how much delay they may hide.

Every frame is delayed: the host wakes up, a network queues, an adapter waits for more bytes. The least delayed ones
show the line of a clock (clock_model.py); the spread of all delays bounds its error.

    delay            delay                 delay                  delay
     │                │  /|  /|  /|  /      │ ·                    │    |\\
     │                │ / | / | / | /       │   · ·   ·            │    | \\
     │···········     │/  |/  |/  |/        │·  ·  ··  · ··        │____|  \\____
     clean            an adapter's bursts   a network              a host that did not read

## What an adapter hides

An adapter that passes bytes on when 62 have gathered, or when its timer T runs out, keeps no byte for longer than

    hold = min(T, the time until the next frames have filled a packet)

So all true delays lie between 0 and `hold`. If the observed ones reach from the line up to R, the line itself is at
most hold − R too high, and no more can be concluded: a stream locked to the timer, each frame late by the same 8 ms,
looks like one that is never late. (A stream whose frames are cut by full packets is known better: chunk_boundaries.py.
Of each frame both delays are kept, of its last bytes and of its earliest ones.) If T is unknown but bursts are seen, it
is assumed to be 16 ms, the default of adapters. Without an adapter, the hidden delay is estimated from the delays
themselves: the greatest gap among the smaller ones, as in a poll grid that beats with the stream.

Source: FTDI, AN232B-04 "Data Throughput, Latency and Handshaking", sections 3.2 and 3.3.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array

MAX_DELAYS = 2048  # delays remembered
RECENT_NS = 5e9
MIN_DELAYS = 24  # delays needed for any conclusion
USB_PACKET_BYTES = 62
USUAL_TIMER_NS = 16e6  # default of an adapter
WAKE_NS = 1e6  # a running host reads within this time
BURST_NS = 2e6  # an adapter that holds bytes no longer than this is harmless
STALL_NS = 0.1e9  # a delay that only a host or a network causes
UNSURE_SHARE = 0.4
MAX_STALLS = 512  # of a minute, more than one in an eighth of a second
MIN_FIT_SHARE = 0.9  # share of the delays that must fit the known adapter


@dataclass(frozen=True, slots=True)
class DelaySpread:
    """The delays of the last seconds, ns.

    Attributes:
        low: of the least late frame. top: R above, without stalls.
        gap: the greatest gap among the smaller delays.
        hidden: part of a delay common to all frames that the line may hide.
        bursts: an adapter gathers bytes.
        hold: how long it keeps one, 0 without an adapter.
        grid: step of an unknown grid of deliveries: the distance of two groups of the smaller delays.
    """

    low: float = 0.0
    top: float = 0.0
    gap: float = 0.0
    hidden: float = 0.0
    bursts: bool = False
    hold: float = 0.0
    grid: float = 0.0


class DelayStatistics:
    """The delays of one segment of a device's clock.

    Args:
        holds_ns: the adapter's timer; 0: unknown, or no adapter.
        byte_ns: time of a byte on the line; 0: not known.

    Attributes:
        stalls: (arrival in unix ns, delay of the first frame in ns) of the latest ones.
        newest: delay of the newest frame, ns.
    """

    def __init__(self, holds_ns: float = 0.0, byte_ns: float = 0.0) -> None:
        self.rows = 0
        self.newest = 0.0
        self.stalls: deque[tuple[int, float]] = deque(maxlen=MAX_STALLS)
        self._holds_ns = holds_ns
        self._byte_ns = byte_ns
        self._delays = np.zeros(MAX_DELAYS)  # of the last bytes of frames
        self._least = np.zeros(MAX_DELAYS)  # of the earliest bytes: the same if frames came whole
        self._x = np.full(MAX_DELAYS, -np.inf)
        self._size = 0.0
        self._late, self._late_since = 0.0, 0  # delay and arrival of the first frame of a possible stall

    def add(self, x: Array, delay: Array, size: float, arrival: int, waited: Array | None = None) -> None:
        """Store rows that arrived together: x in ns, their delays, bytes of a frame, unix ns of the last arrival, and
        the extra delay of the frames' last bytes over their earlier ones.
        """
        least = delay
        if waited is not None:
            delay = delay + waited
        if self._late or delay[0] > STALL_NS:
            self._catches_up(float(delay[0]), float(delay[-1]), arrival)
        start = self.rows % MAX_DELAYS
        count = len(x)
        self.rows += count
        self.newest = float(delay[-1])
        self._size = size
        if start + count <= MAX_DELAYS:
            self._delays[start : start + count] = delay
            self._least[start : start + count] = least
            self._x[start : start + count] = x
        else:
            rows = np.arange(start, start + count) % MAX_DELAYS
            self._delays[rows] = delay
            self._least[rows] = least
            self._x[rows] = x

    def _catches_up(self, first: float, last: float, arrival: int) -> None:
        """Detect a stall: a late frame, after which the others come all at once without loss."""
        if not self._late and self.rows >= MIN_DELAYS:
            self._late, self._late_since = first, arrival
        if self._late and last < self._late / 4:
            self.stalls.append((arrival, self._late))
            self._late = 0.0
        elif arrival - self._late_since > self._late / 2:
            self._late = 0.0  # the stream stays late: a queue, not a stall

    def recent(self, newest: float) -> NDArray[np.float64]:
        """Delays of the last seconds before `newest`, ascending, without out-of-date rows."""
        return np.sort(self._delays[self._x >= newest - RECENT_NS])

    def minimum(self, newest: float) -> NDArray[np.float64]:
        """The same for the earliest bytes of each frame."""
        return np.sort(self._least[self._x >= newest - RECENT_NS])

    def spread(self, newest: float) -> DelaySpread:
        """Judge the last seconds before `newest`."""
        delays = self.recent(newest)
        count = len(delays)
        if count < 2:
            return DelaySpread(hidden=self._holds_ns)  # nothing is known yet
        soonest = self.minimum(newest)
        low = max(float(soonest[0]), 0.0)
        soonest = soonest[: count * 5 // 8 + 2]
        gap, grid = float(np.diff(soonest).max()), 0.0 if self._holds_ns else _grid(soonest)
        if count < MIN_DELAYS:
            return DelaySpread(low, 0.0, gap, max(gap, self._holds_ns), grid=grid)
        bursts = _bursts(delays)
        timer = self._holds_ns or (USUAL_TIMER_NS if bursts else 0.0)
        hold = min(timer, self._filled_after(newest))
        inside = delays[: int(np.searchsorted(delays, hold + WAKE_NS if hold else STALL_NS))]
        top = float(inside[len(inside) * 49 // 50]) if len(inside) else 0.0
        sure = min(self._holds_ns, WAKE_NS) * UNSURE_SHARE  # the delay of the least late ones is never known exactly
        longer = len(inside) < MIN_FIT_SHARE * count  # it keeps bytes for longer than assumed
        hidden = gap if longer or not hold else max(sure, hold - top)
        return DelaySpread(low, top, gap, hidden, bursts, hold, grid)

    def _filled_after(self, newest: float) -> float:
        """Longest wait of the last byte of a frame for the bytes that fill a packet, ns."""
        recent = self._x[self._x >= newest - RECENT_NS]
        if len(recent) < 2 or self._size < 1:
            return USUAL_TIMER_NS
        period = (float(recent.max()) - float(recent.min())) / (len(recent) - 1)
        more = -(-(USB_PACKET_BYTES - 1) // self._size)  # frames until 61 more bytes have come
        return float(more * period + (USB_PACKET_BYTES - 1 - more * self._size) * self._byte_ns)


def _grid(delays: Array) -> float:
    """Greatest distance from the beginning of a group of these delays, ascending, to that of the next group."""
    gaps = np.diff(delays)
    widest = int(gaps.argmax())
    before = np.flatnonzero(gaps[:widest] >= gaps[widest] / 2)
    return float(delays[widest + 1] - delays[before[-1] + 1 if len(before) else 0])


def _bursts(delays: Array) -> bool:
    """Whether these delays, ascending, come from a buffering adapter: they are spread over some ms, evenly or in few
    steps, and end sharply, while those of a busy host or a network thin out.
    """
    delays = delays[: int(np.searchsorted(delays, STALL_NS))]
    count = len(delays)
    if count < MIN_DELAYS:
        return False
    middle, high, top = (float(delays[int(share * (count - 1))]) for share in (0.5, 0.9, 0.98))
    mean = float(delays.mean())
    return top > BURST_NS and max(middle, mean) > 0.3 * top and high > 0.7 * top
