"""Counters that wrap, counters that skip: what do their numbers say?

    Unwrap      raw ticks of a wrapping clock        →  ticks that go on counting, and where the clock stepped
    Counter     raw numbers of a frame counter       →  how many frames are missing before each

Both know the numbers only. clock_sync.py says when a device time was on the host's clock.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.tick_unwrap import ARRIVAL, LATE_RUN, NEAR_SHARE, NEWEST, OPEN_FROM, OPEN_TO, RESET, STATES, WRAP, follow

Array = NDArray[Any]
Times = NDArray[np.int64]

# -- counters ----------------------------------------------------------------------------------------------------------

LATE_S = 10.0  # a row this much older than the newest is an old row, not a restart (PVT on an MTi: 2.5 s measured)
_UNKNOWN = np.empty(0, np.int64)
AHEAD_S = 1.0  # device time that ran ahead of arrival time by more than this has jumped
_AHEAD_NS = int(AHEAD_S * 1e9)


class TickUnwrapper:
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


class SequenceCounter:
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
        self.first: int | None = None  # the number that was seen first
        self.passed = 0  # how far it has gone since, late rows and restarts aside
        self._last: int | None = None

    @property
    def last(self) -> int | None:
        """The newest number, None before any."""
        return self._last

    def follows(self, number: int) -> bool:
        """Is this the number after the last one? Then it is taken, and nothing is missing; otherwise ask `missing`."""
        if self._last is None or (number - self._last) % self.modulus != 1:
            return False
        self._last = number
        self.passed += 1
        self.restarts = []
        return True

    def missing(self, raw: Array) -> Times:
        """(n,) int64: how many were lost just before each row, going on from the last call."""
        values = np.asarray(raw).astype(np.int64)
        self.restarts = []
        if len(values) == 0:
            return values
        if self._last is None:
            self.first, self.passed = int(values[0]), -1
        last = values[0] - 1 if self._last is None else self._last
        lost: Times = np.diff(values, prepend=last) - 1
        lost %= self.modulus
        odd = np.flatnonzero(lost >= min(256, self.modulus // 8)).tolist()
        if odd:
            lost = self._judge(values, lost, odd, int(last))
        else:
            self._last = int(values[-1])
        self.passed += len(values) + int(lost.sum())
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
