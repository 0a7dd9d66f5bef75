"""When was that? Counters that wrap, counters that skip, and a device clock seen through a jittery link.

Three small machines, one question each:

    Unwrap      raw ticks of a wrapping clock        →  ticks that go on counting, and where the clock stepped
    Counter     raw numbers of a frame counter       →  how many frames are missing before each
    HostClock   (device time, arrival time) pairs    →  a host time for every device time, evenly spaced and honest

The first two know the numbers only. The third decides which rows belong to one uninterrupted stretch of the device's
clock; how such a stretch is mapped, and the theory, is in envelope.py.

## Steps of the device clock

A clock that jumps ahead makes frames arrive before they were sent by the mapping so far, which nothing else can; one
that jumps back or restarts delivers old times again and again. Such rows open a candidate mapping of their own; three
in a row make it the mapping, one good row discards it.

Rules for editing: an `add` of ten rows costs about 15 µs; count the numpy calls.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.envelope import Mapping
from protocols.ticks import ARRIVAL, LATE_RUN, NEAR_SHARE, NEWEST, OPEN_FROM, OPEN_TO, RESET, STATES, WRAP, follow

Array = NDArray[Any]
Times = NDArray[np.int64]

# -- counters ----------------------------------------------------------------------------------------------------------

LATE_S = 10.0  # a row this much older than the newest is an old row, not a restart (PVT on an MTi: 2.5 s measured)
_UNKNOWN = np.empty(0, np.int64)
AHEAD_S = 1.0  # device time that ran ahead of arrival time by more than this has jumped
_AHEAD_NS = int(AHEAD_S * 1e9)


class Unwrap:
    """Ticks of a clock that wraps, as ticks that go on counting.

    Args:
        wrap: ticks at which the clock returns to 0.
        auto: other candidates, when the product that decides is not known yet: the true one is taken when the clock is
            seen to wrap there, or to pass a smaller candidate. `wrap` holds until then.
        tick_ns: length of a tick; lets `ticks` tell an outage from a jump, when arrival times are given too.

    Notes:
        Feed rows in the order of the stream. Rows up to ten seconds older than the newest keep their own, older time:
        they are neither a wrap nor a reset, unless eight of them come in a row.
    """

    def __init__(self, wrap: int, *, auto: tuple[int, ...] = (), tick_ns: int = 0) -> None:
        self.steps: list[tuple[int, str, int]] = []
        self._wraps = np.array(sorted({wrap, *auto}), np.int64)
        self._tick_ns = tick_ns
        self._late = int(LATE_S * 1e9 / tick_ns) if tick_ns else max(wrap // NEAR_SHARE, 1)
        self._state = np.zeros(STATES, np.int64)
        self._state[WRAP] = self._wraps.tolist().index(wrap)
        self._state[OPEN_TO] = len(self._wraps)
        self._look()

    @property
    def wrap(self) -> int:
        """The modulus in effect."""
        return int(self._wraps[self._state[WRAP]])

    def set_wrap(self, wrap: int) -> None:
        """The modulus is known now (from the product code)."""
        self._wraps = np.array([wrap], np.int64)
        self._state[WRAP], self._state[OPEN_FROM], self._state[OPEN_TO] = 0, 0, 1
        self._look()

    def _look(self) -> None:
        """What `tick` needs of the state, as plain numbers."""
        started, self._newest, self._turns, _, self._arrived, wrap, first, last = self._state.tolist()
        self._near = max(int(self._wraps[wrap]) // NEAR_SHARE, 1)
        in_doubt = first + 1 < last
        self._below = (int(self._wraps[first]) if in_doubt else 1 << 63) if started else -1

    def tick(self, raw: int, arrival_ns: int | None = None) -> int:
        """`ticks` of one row, for a live stream: the same answer, without arrays where the clock just goes on."""
        value = raw + self._turns
        near = self._near
        if arrival_ns is not None and self._tick_ns:
            passed = arrival_ns - self._arrived
            near = (passed + passed // 1000 + _AHEAD_NS) // self._tick_ns
        if raw >= self._below or not 0 <= value - self._newest <= near:
            arrival = None if arrival_ns is None else np.array((arrival_ns,))
            return int(self.ticks(np.array((raw,)), arrival)[0])
        self.steps = []
        state = self._state
        state[NEWEST] = self._newest = value
        state[LATE_RUN] = 0
        if arrival_ns is not None and self._tick_ns:
            state[ARRIVAL] = self._arrived = arrival_ns
        return value

    def ticks(self, raw: Array, arrival_ns: Array | None = None) -> Times:
        """Unwrapped ticks of the rows `raw`, (n,) int64, going on from the last call.

        `steps` then lists (row, kind, by ticks): "reset" where the clock started again from near zero, "jump" where it
        moved otherwise; `by` is negative backwards.
        """
        values = np.ascontiguousarray(raw, np.int64)
        arrival = _UNKNOWN if arrival_ns is None else np.ascontiguousarray(arrival_ns, np.int64)
        out = np.empty(len(values), np.int64)
        steps = np.empty((3, len(values)), np.int64)
        found = follow(values, arrival, self._state, self._wraps, self._late, self._tick_ns, _AHEAD_NS, out, steps)
        self._look()
        self.steps = []
        if found:  # rarely
            table = steps[:, :found].T.tolist()
            self.steps = [(row, "reset" if kind == RESET else "jump", by) for row, kind, by in table]
        return out


class Counter:
    """Frames lost, by a counter that each frame carries.

    Args:
        modulus: numbers before the counter returns to 0.

    Notes:
        More than an eighth of the modulus missing, or a return to 0, is a restart: `restarts` lists the rows, and
        nothing is counted as lost. A number seen again, or a little older, is a late row and loses nothing.
    """

    def __init__(self, modulus: int) -> None:
        self.modulus = modulus
        self.restarts: list[int] = []
        self._last: int | None = None

    def follows(self, number: int) -> bool:
        """Is this the number after the last one? Then it is taken, and nothing is missing; otherwise ask `missing`."""
        if self._last is None or (number - self._last) % self.modulus != 1:
            return False
        self._last = number
        self.restarts = []
        return True

    def missing(self, raw: Array) -> Times:
        """(n,) int64: how many were lost just before each row, going on from the last call."""
        values = np.asarray(raw).astype(np.int64)
        self.restarts = []
        if len(values) == 0:
            return values
        last = values[0] - 1 if self._last is None else self._last
        lost: Times = np.diff(values, prepend=last) - 1
        lost %= self.modulus
        odd = np.flatnonzero(lost >= min(256, self.modulus // 8)).tolist()
        if odd:
            return self._judge(values, lost, odd, int(last))
        self._last = int(values[-1])
        return lost

    def _judge(self, values: Times, lost: Times, odd: list[int], last: int) -> Times:
        """Look closely at the rows `odd` and at those that follow a late one; the others stand as they are."""
        odd = [*odd, len(values)]
        row = odd[0]
        last = int(values[row - 1]) if row else last
        while row < len(values):
            value = int(values[row])
            missing = (value - last - 1) % self.modulus
            if self.modulus - missing <= self.modulus // 1024 + 1:
                lost[row] = 0  # the same number again, or a row that comes late
                row += 1
                continue
            if missing > self.modulus // 8 or (missing >= 256 and value < 2):
                self.restarts.append(row)
                missing = 0
            lost[row] = missing
            row = odd[bisect_right(odd, row)]
            last = int(values[row - 1])
        self._last = last
        return lost


# -- device time to host time ------------------------------------------------------------------------------------------

STEP_NS = 50e6  # rows that far below the line are a step of the clock: three times the longest USB burst
LATE_NS = LATE_S * 1e9
CONFIRM_ROWS = 3
BACK_ROWS, BACK_NS = 5, 0.3e9  # rows that repeat old times, all late, for so long: the clock was set back
BLOCK = 512  # rows looked at together; one point of the envelope each


class HostClock:
    """Device time → host time, learned from arrivals.

    Args:
        byte_time_ns: how long one byte takes on the wire (10 bits at 115200 Bd: 86 806 ns); 0 where it does not matter.

    Use: `add` every batch as it comes, then `host` of its times. The order of rows does not matter within some seconds.
    """

    def __init__(self, byte_time_ns: float = 0) -> None:
        self.byte_time_ns = byte_time_ns
        self.restarts = -1  # how often the mapping was begun anew; the first time does not count
        self._now: Mapping | None = None
        self._before: Mapping | None = None  # the mapping before the last restart, for rows of the same chunk
        self._candidate: Mapping | None = None
        self._candidate_rows = 0
        self._back_rows: list[tuple[int, int, int]] = []

    def restart(self) -> None:
        """Forget the mapping: the next row added begins a new one. For a new link; steps of the clock need no call."""
        self._before, self._now = self._now, None
        self._forget()

    def add(self, device_ns: Array, arrival_ns: Array, size: Array | int = 0) -> None:
        """Learn from rows.

        Args:
            device_ns: (n,) int64, unwrapped device time.
            arrival_ns: (n,) int64, host time of arrival, ns since the Unix epoch.
            size: (n,) or one, bytes of each frame.
        """
        n = len(device_ns)
        if n <= BLOCK:
            if n:
                self._add(device_ns, arrival_ns, size)
            return
        for at in range(0, n, BLOCK):
            part = slice(at, at + BLOCK)
            self._add(device_ns[part], arrival_ns[part], size if isinstance(size, int) else size[part])

    def host(self, device_ns: Array) -> NDArray[np.float64]:
        """Host time of device times, (n,) float64 unix s. NaN before the first `add`."""
        if self._now is None:
            return np.full(len(device_ns), np.nan)
        other = self._candidate or self._before
        if other is None or len(device_ns) == 0:
            return self._now.host(device_ns)
        mine = self._now.distance(device_ns) <= other.distance(device_ns)
        if mine.all():
            return self._now.host(device_ns)
        return np.where(mine, self._now.host(device_ns), other.host(device_ns))

    @property
    def drift_ppm(self) -> float:
        """How much faster the device's clock runs than the host's, parts per million; 0 until seconds have passed."""
        return -self._now.slope / (1 + self._now.slope) * 1e6 if self._now else 0.0

    @property
    def uncertainty_ns(self) -> float:
        """± of the mapping. Infinite before the first row."""
        return self._now.uncertainty() if self._now else float("inf")

    def jitter_ns(self, p: float = 99) -> float:
        """The `p`-th percentile of the delays of the last seconds: arrival against the mapping."""
        return self._now.jitter(p) if self._now else 0.0

    def _add(self, device: Array, arrival: Array, size: Array | int) -> None:
        sent = arrival
        if self.byte_time_ns:
            sent = arrival - np.asarray(size * self.byte_time_ns).astype(np.int64)
        now = self._now
        if now is None:
            now = self._now = Mapping(int(device[-1]), int(sent[-1]))
            self.restarts += 1
        x = (device - now.origin).astype(np.float64)
        delay = (sent - now.host_origin).astype(np.float64)
        delay -= x
        delay -= now.slope * x
        delay -= now.intercept
        low, high = float(delay.min()), float(delay.max())
        if low < -STEP_NS or (high > STEP_NS and self._odd(now, x, arrival, delay)):
            self._row_by_row(device, sent, arrival)
            return
        if self._candidate_rows or self._back_rows:
            self._forget()
        now.learn(x, delay, int(arrival[-1]))
        if self._before is not None and now.newest > LATE_NS:
            self._before = None

    @staticmethod
    def _odd(now: Mapping, x: Array, arrival: Array, delay: Array) -> bool:
        """Rows that are late by their own clock and newest by arrival: they may be a clock that was set back."""
        odd = (delay > STEP_NS) & (x <= now.newest) & ((arrival > now.arrival) | (x < now.newest - LATE_NS))
        return bool(odd.any())

    def _row_by_row(self, device: Array, sent: Array, arrival: Array) -> None:
        """The careful way, for adds that hold a row which does not fit the mapping."""
        for d, s, a in zip(device.tolist(), sent.tolist(), arrival.tolist(), strict=True):
            now = self._now
            assert now is not None
            x = float(d - now.origin)
            delay = float(s - now.host_origin) - x - now.slope * x - now.intercept
            back = delay > STEP_NS and x <= now.newest and a > now.arrival
            if delay < -STEP_NS or (delay > STEP_NS and x < now.newest - LATE_NS):
                self._suspect(d, s, a)
            elif back:
                self._back_rows.append((d, s, a))
                if len(self._back_rows) >= BACK_ROWS and a - self._back_rows[0][2] >= BACK_NS:
                    self._turn_back()
                del self._back_rows[:-64]
            else:
                self._forget()
                now.learn(np.array([x]), np.array([delay]), a)

    def _suspect(self, device: int, sent: int, arrival: int) -> None:
        """A row that the mapping cannot explain: it begins, or confirms, another."""
        new = self._candidate
        if new is not None:
            x = float(device - new.origin)
            delay = float(sent - new.host_origin) - x - new.intercept
            if abs(delay) > 10 * STEP_NS:
                new = None  # not even its predecessor explains it
            else:
                new.learn(np.array([x]), np.array([delay]), arrival)
                self._candidate_rows += 1
        if new is None:
            new, self._candidate_rows = self._following(device, sent, arrival), 1
        self._candidate = new
        if self._candidate_rows >= CONFIRM_ROWS:
            self._switch(new)

    def _following(self, device: int, sent: int, arrival: int) -> Mapping:
        """A mapping that begins with this row. Host time does not run backwards there."""
        new = Mapping(device, sent)
        new.learn(np.zeros(1), np.zeros(1), arrival)
        if self._now is not None:
            new.begin_at(max(0.0, self._now.last_host() - float(sent)))
        return new

    def _turn_back(self) -> None:
        """The clock was set back: the rows that repeated old times are the mapping."""
        (device, sent, arrival), *rows = self._back_rows
        new = self._following(device, sent, arrival)
        for d, s, a in rows:
            x = float(d - new.origin)
            new.learn(np.array([x]), np.array([float(s - new.host_origin) - x - new.intercept]), a)
        self._switch(new)

    def _switch(self, new: Mapping) -> None:
        """Another mapping from now on."""
        self.restarts += 1
        self._now, self._before = new, self._now
        self._forget()

    def _forget(self) -> None:
        """No doubt about the mapping."""
        self._candidate, self._candidate_rows, self._back_rows = None, 0, []
