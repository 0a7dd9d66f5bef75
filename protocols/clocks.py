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

Array = NDArray[Any]
Times = NDArray[np.int64]

# -- counters ----------------------------------------------------------------------------------------------------------

LATE_S = 10.0  # a row this much older than the newest is an old row, not a restart (PVT on an MTi: 2.5 s measured)
LATE_ROWS = 8  # ... unless so many come in a row
AHEAD_S = 1.0  # device time that ran ahead of arrival time by more than this has jumped


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
        self.wrap = wrap
        self.steps: list[tuple[int, str, int]] = []
        self._auto = tuple(sorted({wrap, *auto})) if auto else ()
        self._tick_ns = tick_ns
        self._turns = 0  # added to every raw value, ticks
        self._newest: int | None = None
        self._newest_arrival = 0
        self._late_run = 0

    def set_wrap(self, wrap: int) -> None:
        """The modulus is known now (from the product code)."""
        self.wrap = wrap
        self._auto = ()

    def ticks(self, raw: Array, arrival_ns: Array | None = None) -> Times:
        """Unwrapped ticks of the rows `raw`, (n,) int64, going on from the last call.

        `steps` then lists (row, kind, by ticks): "reset" where the clock started again from near zero, "jump" where it
        moved otherwise; `by` is negative backwards.
        """
        values = np.asarray(raw).astype(np.int64)
        self.steps = []
        if len(values) == 1 and arrival_ns is None and self._goes_on(int(values[0])):
            return values + self._turns
        out = np.empty(len(values), np.int64)
        done = 0
        while done < len(values):
            done = self._stretch(values, out, arrival_ns, done)
        return out

    def _goes_on(self, value: int) -> bool:
        """Is this one row plainly the next? The usual case of a live stream, decided without arrays."""
        if self._newest is None or self._newest_arrival or (self._auto and value >= self.wrap):
            return False
        if not 0 <= value + self._turns - self._newest <= self._near():
            return False
        self._newest = value + self._turns
        self._late_run = 0
        return True

    def _stretch(self, raw: Times, out: Times, arrival: Array | None, start: int) -> int:
        """Unwrap rows from `start` up to the first that needs a decision; take that decision; where to go on."""
        if self._newest is None:
            self._newest = int(raw[start])
            self._newest_arrival = 0 if arrival is None else int(arrival[start])
        values = raw[start:] + self._turns
        newest = np.maximum.accumulate(np.concatenate(([self._newest], values)))
        ahead = np.diff(newest) > self._near()
        if arrival is not None and self._tick_ns:
            ahead |= self._ran_ahead(newest, arrival[start:])
        behind = newest[:-1] - values
        suspect = ahead | (behind > 0)
        if not suspect.any():
            self._accept(values, arrival, start, out)
            self._late_run = 0
            return len(raw)
        odd = ahead | (behind > min(self._late(), self.wrap // 4))
        plain = int(np.argmax(odd)) if odd.any() else len(values)
        if plain and self._only_late(behind[:plain]):
            self._newest = int(newest[plain])
            self._accept(values[:plain], arrival, start, out)
            return start + plain
        first = int(np.argmax(suspect))
        if first:
            self._accept(values[:first], arrival, start, out)
            self._late_run = 0
            return start + first
        return self._decide(raw, out, arrival, start, behind, bool(ahead[0]))

    def _only_late(self, behind: Times) -> bool:
        """Are only few in a row of these rows late, none of them by much? Then they keep their own times."""
        on_time = np.flatnonzero(behind <= 0)
        if not len(on_time):
            return False
        tail = len(behind) - 1 - int(on_time[-1])
        between = int(np.diff(on_time).max()) - 1 if len(on_time) > 1 else 0
        if max(int(on_time[0]) + self._late_run, between, tail) >= LATE_ROWS:
            return False
        self._late_run = tail
        return True

    def _decide(self, raw: Times, out: Times, arrival: Array | None, at: int, behind: Times, ahead: bool) -> int:
        """Row `at` does not simply go on counting: a late row, a wrap, a reset or a jump."""
        value = int(raw[at])
        newest = self._newest
        assert newest is not None
        if ahead:
            self.steps.append((at, "jump", value + self._turns - newest))
            return self._settle(value, out, arrival, at)
        if self._wrapped(value, newest, arrival, at):
            self._turns += self.wrap
            return self._settle(value, out, arrival, at)
        before = value + self._turns - self.wrap  # a late row from before a wrap
        if 0 <= newest - before <= self._late():
            out[at] = before
            return at + 1
        depth = int(behind[0])
        run = _leading(behind > 0)
        if depth <= self._late() and run + self._late_run < LATE_ROWS:
            out[at : at + run] = raw[at : at + run] + self._turns
            self._late_run += run
            return at + run
        kind = "reset" if value < max(self._near() // 4, 1) else "jump"
        self.steps.append((at, kind, value + self._turns - newest))
        if kind == "reset":
            self._turns = 0
        return self._settle(value, out, arrival, at)

    def _settle(self, value: int, out: Times, arrival: Array | None, at: int) -> int:
        """Count on from row `at`, whatever came before."""
        self._newest = value + self._turns
        self._newest_arrival = 0 if arrival is None else int(arrival[at])
        self._late_run = 0
        out[at] = self._newest
        return at + 1

    def _accept(self, values: Times, arrival: Array | None, start: int, out: Times) -> None:
        out[start : start + len(values)] = values
        self._newest = max(int(values[-1]), self._newest or 0)
        if arrival is not None:
            self._newest_arrival = int(arrival[start + len(values) - 1])
        for candidate in self._auto:  # a value at or past a candidate rules it out
            if self.wrap == candidate and self._newest - self._turns >= candidate:
                self._auto = tuple(c for c in self._auto if c > candidate)
                self.wrap = self._auto[0] if self._auto else self.wrap

    def _wrapped(self, value: int, newest: int, arrival: Array | None, at: int) -> bool:
        """Did the clock wrap between the newest row and `value`? Learns the modulus where it is open."""
        raw_newest = newest - self._turns
        for wrap in self._auto or (self.wrap,):
            forward = value + wrap - raw_newest
            near = raw_newest < wrap and 0 <= forward <= wrap // 4096
            if not near and arrival is not None and self._tick_ns and self._newest_arrival and raw_newest < wrap:
                waited = (int(arrival[at]) - self._newest_arrival) / self._tick_ns  # an outage across the wrap
                near = abs(forward - waited) <= AHEAD_S * 1e9 / self._tick_ns + 1e-3 * waited
            if near:
                self.set_wrap(wrap)
                return True
        return False

    def _ran_ahead(self, newest: Times, arrival: Array) -> NDArray[np.bool_]:
        """Rows whose clock advanced by more than the time that passed at the host."""
        before = np.concatenate(([self._newest_arrival or arrival[0]], arrival[:-1]))
        passed = (arrival - before) * 1.001 + AHEAD_S * 1e9
        return np.asarray(np.diff(newest) * self._tick_ns > passed)

    def _near(self) -> int:
        if self._tick_ns and self._newest_arrival:
            return self.wrap  # arrival times judge instead
        return max(self.wrap // 4096, 1)

    def _late(self) -> int:
        return int(LATE_S * 1e9 / self._tick_ns) if self._tick_ns else max(self.wrap // 4096, 1)


def _leading(flags: NDArray[np.bool_]) -> int:
    """How many of `flags` are set before the first that is not."""
    return len(flags) if flags.all() else int(np.argmin(flags))


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

    def missing(self, raw: Array) -> Times:
        """(n,) int64: how many were lost just before each row, going on from the last call."""
        values = np.asarray(raw).astype(np.int64)
        self.restarts = []
        if len(values) == 0:
            return values
        if len(values) == 1 and self._last is not None and (int(values[0]) - self._last) % self.modulus == 1:
            self._last = int(values[0])  # the usual case of a live stream, without arrays
            return np.zeros(1, np.int64)
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
        self._candidate_rows: list[tuple[int, int, float]] = []
        self._back_rows: list[tuple[int, int, float]] = []

    def restart(self) -> None:
        """Forget the mapping: the next row added begins a new one. For a new link; steps of the clock need no call."""
        self._before, self._now, self._candidate = self._now, None, None
        self._candidate_rows, self._back_rows = [], []

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
            now = self._now = self._begin(int(device[-1]), int(sent[-1]))
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
            self._candidate, self._candidate_rows, self._back_rows = None, [], []
        now.learn(x, delay, int(arrival[-1]))
        if self._before is not None and now.newest > LATE_NS:
            self._before = None

    def _begin(self, device: int, sent: int) -> Mapping:
        self.restarts += 1
        return Mapping(device, sent)

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
                    self._switch(self._back_rows)
                del self._back_rows[:-64]
            else:
                self._candidate, self._candidate_rows, self._back_rows = None, [], []
                now.learn(np.array([x]), np.array([delay]), a)

    def _suspect(self, device: int, sent: int, arrival: int) -> None:
        """A row that the mapping cannot explain: it begins, or confirms, another."""
        rows = self._candidate_rows
        if rows and abs((sent - device) - (rows[-1][1] - rows[-1][0])) > 10 * STEP_NS:
            rows.clear()  # not even its predecessor explains it
            self._candidate = None
        rows.append((device, sent, arrival))
        if self._candidate is None:
            self._candidate = Mapping(device, sent)
        self._candidate.newest = max(self._candidate.newest, float(device - self._candidate.origin))
        if len(rows) >= CONFIRM_ROWS:
            self._switch(rows)

    def _switch(self, rows: list[tuple[int, int, float]]) -> None:
        """Another mapping from `rows` on. Host time does not run backwards where it begins."""
        old = self._now
        assert old is not None
        device, sent, _ = rows[0]
        new = self._begin(device, sent)
        best = min(s - d for d, s, _ in rows)
        for d, s, a in rows:
            x = float(d - new.origin)
            new.learn(np.array([x]), np.array([float(s - new.host_origin) - x - new.intercept]), int(a))
        new.begin_at(max(float(device + best - new.host_origin), old.last_host() - float(new.host_origin)))
        self._now, self._before, self._candidate = new, old, None
        self._candidate_rows, self._back_rows = [], []
