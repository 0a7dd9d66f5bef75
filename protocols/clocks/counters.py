"""Counters that wrap and counters that skip.

    TickUnwrapper      raw ticks of a wrapping clock     →  continuous ticks, and where the clock stepped
    SequenceCounter    raw numbers of a frame counter    →  number of frames missing before each

Both see only the numbers. clock_sync.py maps device time to the host's clock.
"""

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.clocks.tick_unwrap import (
    ADVANCE,
    ARRIVAL,
    LATE_RUN,
    NEAR_SHARE,
    NEWEST,
    OPEN_FROM,
    OPEN_TO,
    RESET,
    STATES,
    WRAP,
    follow,
)
from imuscope.protocols.native.kernels import FOUR, INT, INTS, compiled

LATE_SHARE = 1024  # a row behind the newest by up to this share of the modulus is late
RESTART_SHARE = 8
RESTART_ROWS = 256  # missing before a number near 0: a restart


@compiled(FOUR, INTS, INT, INT, INTS, INTS, INTS)
def count_missing(
    values: Ints, last: int, modulus: int, lost: Ints, restarts: Ints, late: Ints
) -> tuple[int, int, int, int]:
    """Count the numbers missing before each of the rows `values`.

    A row is late, or a repeat, when it is a little behind the newest; the clock of a device that restarts goes back to
    0 or jumps by more than an eighth of the modulus.

    Args:
        values: (n,) as sent.
        last: the newest number before them.
        lost: (n,), written: numbers missing just before each.
        restarts: (n,), written: rows where the sequence restarts.
        late: (n,), written: rows that are late or repeat one.

    Returns:
        the newest number, the total of missing numbers, the number of restarts and that of late rows.
    """
    total = 0
    late_count = 0
    restart_count = 0
    for row in range(len(values)):
        value = values[row]
        missing = value - last - 1
        if missing != 0:
            missing %= modulus
            if modulus - missing <= modulus // LATE_SHARE + 1:
                lost[row] = 0
                late[late_count] = row
                late_count += 1
                continue
            if missing > modulus // RESTART_SHARE or (missing >= RESTART_ROWS and value < 2):
                restarts[restart_count] = row
                restart_count += 1
                missing = 0
        lost[row] = missing
        total += missing
        last = value
    return last, total, restart_count, late_count


Times = NDArray[np.int64]

# -- counters ----------------------------------------------------------------------------------------------------------

LATE_S = 10.0  # a row this much older than the newest is an old row, not a restart (PVT on an MTi: 2.5 s measured)
_UNKNOWN = np.empty(0, np.int64)
AHEAD_S = 1.0  # device time that ran ahead of arrival time by more than this has jumped
_AHEAD_NS = int(AHEAD_S * 1e9)


class TickUnwrapper:
    """Ticks of a wrapping clock, made continuous.

    Args:
        wrap: ticks at which the clock returns to 0.
        auto: other candidates, while the deciding product is unknown: the true one is chosen when the clock wraps there
            or passes a smaller candidate. `wrap` holds until then.
        tick_ns: length of a tick; lets `ticks` distinguish an outage from a jump if arrival times are given too.

    Notes:
        Feed rows in stream order. Rows up to ten seconds older than the newest keep their own, older time: they are
        neither a wrap nor a reset, unless eight of them come in a row.
    """

    def __init__(self, wrap: int, *, auto: tuple[int, ...] = (), tick_ns: int = 0) -> None:
        self.steps: list[tuple[int, str, int]] = []
        self._wraps = np.array(sorted({wrap, *auto}), np.int64)
        self._tick_ns = tick_ns
        self._late = int(LATE_S * 1e9 / tick_ns) if tick_ns else max(wrap // NEAR_SHARE, 1)
        self._state = np.zeros(STATES, np.int64)
        self._state[WRAP] = self._wraps.tolist().index(wrap)
        self._state[OPEN_TO] = len(self._wraps)
        self._load_state()

    @property
    def wrap(self) -> int:
        """The modulus in effect."""
        return int(self._wraps[self._state[WRAP]])

    def set_wrap(self, wrap: int) -> None:
        """Set the modulus, once known from the product code."""
        self._wraps = np.array([wrap], np.int64)
        if self._is_ahead:
            self._store_state()
        self._state[WRAP], self._state[OPEN_FROM], self._state[OPEN_TO] = 0, 0, 1
        self._load_state()

    def _load_state(self) -> None:
        """State needed by `tick`, as plain numbers."""
        self._is_ahead = False  # they are newer than the array
        started, self._newest, self._turns, _, self._arrived, wrap, first, last, self._advance, _ = self._state.tolist()
        self._near = max(int(self._wraps[wrap]) // NEAR_SHARE, 1)
        in_doubt = first + 1 < last
        self._below = (int(self._wraps[first]) if in_doubt else 1 << 63) if started else -1

    def tick(self, raw: int, arrival_ns: int | None = None) -> int:
        """`ticks` of one row, for a live stream: same result, without arrays if the clock just continues."""
        advance = raw + self._turns - self._newest
        near = self._near
        if arrival_ns is not None and self._tick_ns:
            passed = arrival_ns - self._arrived
            near = (passed + passed // 1000 + _AHEAD_NS) // self._tick_ns
        if raw >= self._below or not 0 <= advance <= near:
            arrival = None if arrival_ns is None else np.array((arrival_ns,))
            return int(self.ticks(np.array((raw,)), arrival)[0])
        if self.steps:
            self.steps = []
        if advance:
            self._advance = advance
            self._newest += advance
        self._is_ahead = True
        if arrival_ns is not None and self._tick_ns:
            self._arrived = arrival_ns
        return self._newest

    def _store_state(self) -> None:
        """Write what `tick` changed into the array."""
        self._is_ahead = False
        state = self._state
        state[NEWEST], state[ARRIVAL], state[LATE_RUN] = self._newest, self._arrived, 0
        state[ADVANCE] = self._advance

    def ticks(self, raw: Array, arrival_ns: Array | None = None) -> Times:
        """Unwrapped ticks of the rows `raw`, (n,) int64, continuing from the last call.

        `steps` then lists (row, kind, by ticks): "reset" where the clock restarted near zero, "jump" where it moved
        otherwise; `by`, negative backwards, is the difference to a clock that advanced as it last did.
        """
        values = np.ascontiguousarray(raw, np.int64)
        arrival = _UNKNOWN if arrival_ns is None else np.ascontiguousarray(arrival_ns, np.int64)
        out = np.empty(len(values), np.int64)
        steps = np.empty((3, len(values)), np.int64)
        if self._is_ahead:
            self._store_state()
        result = follow(values, arrival, self._state, self._wraps, self._late, self._tick_ns, _AHEAD_NS, out, steps)
        self._load_state()
        self.steps = []
        if result:  # rarely
            table = steps[:, :result].T.tolist()
            self.steps = [(row, "reset" if kind == RESET else "jump", by) for row, kind, by in table]
        return out


class SequenceCounter:
    """Frames lost, by a counter in each frame.

    Args:
        modulus: numbers before the counter returns to 0.

    Notes:
        More than an eighth of the modulus missing, or a return to 0, is a restart: `restarts` lists the rows, and
        nothing is counted as lost. A repeated or slightly older number is a late row and not a loss: `late` lists them.
    """

    def __init__(self, modulus: int) -> None:
        self.modulus = modulus
        self.restarts: list[int] = []
        self.late: list[int] = []
        self.first: int | None = None  # the first number seen
        self.passed = 0  # its progress since, without late rows and restarts
        self._last: int | None = None

    @property
    def last(self) -> int | None:
        """The newest number, None before any."""
        return self._last

    def follows(self, number: int) -> bool:
        """Whether this is the next number. If so, accept it, with nothing missing; otherwise call `missing`."""
        if self._last is None or (number - self._last) % self.modulus != 1:
            return False
        self._last = number
        self.passed += 1
        self.restarts = self.late = []
        return True

    def missing(self, raw: Array) -> Times:
        """(n,) int64: number of frames lost just before each row, continuing from the last call."""
        values = np.asarray(raw).astype(np.int64)
        self.restarts, self.late = [], []
        if len(values) == 0:
            return values
        if self._last is None:
            self.first, self.passed = int(values[0]), -1
        last = int(values[0]) - 1 if self._last is None else self._last
        lost, restarts, late = np.empty((3, len(values)), np.int64)
        self._last, total, restarted, behind = count_missing(values, last, self.modulus, lost, restarts, late)
        self.restarts = restarts[:restarted].tolist() if restarted else []
        self.late = late[:behind].tolist() if behind else []
        self.passed += len(values) - behind + total
        return lost
