"""Bounds on the work of one decoding step: each turn of the event loop stays short, whatever the bytes are.

    waiting bytes       ████████████████████████████████████
    a slice             ████                                    some ms of work, by the time of the last ones
    a turn              ████ ▒▒▒▒ ░░░░ ████ ▒▒▒▒ ░░░░           a slice of each session in turn, TURN_S in all
    then                the loop runs as long as the turn took; then the next turn

The cost of decoding a byte varies a thousandfold: a good frame costs next to nothing, incomplete beginnings of frames
cost most. So the size of a slice follows from measured time, not from its content. A slice also has a fixed cost, on
which a very small slice would spend all of its time and fall behind a cheap stream. Both costs are the line fitted to
sizes and times of the last slices. Under load all slices have the same size, which does not determine a line;
therefore a shorter slice is used now and then.
"""

import asyncio
import time
from collections import deque
from collections.abc import Callable

SLICE_S = 0.003
MIN_BYTES, INITIAL_BYTES, MAX_BYTES = 1 << 11, 1 << 12, 1 << 18  # bytes
TURN_S = 0.012
SLICE_MEMORY = 0.9  # weight of older slices, per slice
MIN_SIZE_SHARE = 0.05  # minimum share of the mean cost per byte that depends on size, whatever the noise
MIN_VARIANCE = 0.01  # sizes with a smaller variance, relative to their mean square, do not determine a line
MIN_SLICES = 4.0
TARGET_SLICE_SHARE = 0.6

Drain = Callable[[], object]
"""Does a slice of work; true if more is waiting."""


class Costs:
    """Measured cost of slices, newer ones weighted more: a constant and a cost per byte, by least squares."""

    def __init__(self) -> None:
        self._sums = (0.0, 0.0, 0.0, 0.0, 0.0)  # weights, sizes, times, sizes squared, sizes by times

    def add(self, size: int, spent: float) -> None:
        """Add a slice of `size` bytes that took `spent` s."""
        square, product = float(size) * size, size * spent
        constant, byte_s = self._line()
        if spent > max(SLICE_S, 4 * (constant + byte_s * size)):
            self._sums = 1.0, float(size), spent, square, product  # the kind of bytes has changed
            return
        n, sizes, times, squares, products = (SLICE_MEMORY * old for old in self._sums)
        self._sums = n + 1.0, sizes + size, times + spent, squares + square, products + product

    def fitting(self) -> int:
        """The number of bytes that cost `SLICE_S`, or the fixed cost of a slice if that is more."""
        constant, byte_s = self._line()
        return int(max(SLICE_S, constant) / byte_s)

    @property
    def are_uniform(self) -> bool:
        """Whether all of the last slices had the same size, and there were enough of them."""
        return self._sums[0] > MIN_SLICES and self._spread() <= MIN_VARIANCE * self._sums[3]

    def _spread(self) -> float:
        n, sizes, _, squares, _ = self._sums
        return squares - sizes * sizes / n

    def _line(self) -> tuple[float, float]:
        """Fixed cost of a slice, and cost per byte, s."""
        n, sizes, times, squares, products = self._sums
        if not n:
            return 0.0, 0.0
        byte_s, spread = times / sizes, self._spread()
        if spread > MIN_VARIANCE * squares:
            byte_s *= min(max((products - sizes * times / n) / spread / byte_s, MIN_SIZE_SHARE), 1.0)
        return (times - byte_s * sizes) / n, byte_s


class Slices:
    """The slices of one session.

    Args:
        clock: processor time of this thread, s, so that a busy machine does not look like costly bytes.

    Attributes:
        size: size of the next slice, bytes.
    """

    def __init__(self, clock: Callable[[], float] = time.thread_time) -> None:
        self.size = INITIAL_BYTES
        self._clock = clock
        self._costs = Costs()
        self._most = INITIAL_BYTES  # largest size known to fit
        self._began = 0.0
        self._used = 0
        self._has_room = asyncio.Event()

    def add(self, size: int) -> None:
        """Add bytes that are to be decoded."""
        self._used += size

    @property
    def is_full(self) -> bool:
        """Whether a whole slice has been added."""
        return self._used >= self.size

    async def wait_for_room(self) -> None:
        """Wait until a whole slice is decoded."""
        while self.is_full:
            self._has_room.clear()
            await self._has_room.wait()

    def begin(self) -> None:
        self._began = self._clock()

    def end(self) -> None:
        """End a slice, and determine the size of the next one."""
        size, self._used = self._used, 0
        self._has_room.set()
        if not size:
            return
        spent = max(self._clock() - self._began, 1e-6)
        self._costs.add(size, spent)
        fitting = self._costs.fitting()
        if fitting < self._most and spent > SLICE_S:
            self._most = max(MIN_BYTES, fitting)
        elif size > self._most // 2:  # smaller ones are mostly fixed cost
            self._most = min(MAX_BYTES, 2 * self._most, max(self._most, fitting))
        is_limited = self._most < MAX_BYTES and self._costs.are_uniform
        self.size = int(TARGET_SLICE_SHARE * self._most) if is_limited else self._most


class RoundRobin:
    """Gives each participant slices in turn, until the time is over.

    Args:
        clock: processor time of this thread, s: waiting for the processor does not count.

    Attributes:
        spent: time spent by the last turn, s.
        has_more: whether it left work.
    """

    def __init__(self, clock: Callable[[], float] = time.thread_time) -> None:
        self._all: list[Drain] = []
        self._clock = clock
        self.spent = 0.0
        self.has_more = False

    def add(self, drain: Drain) -> Callable[[], None]:
        """Add a participant; returns a function that removes it."""
        self._all.append(drain)
        return lambda: self._all.remove(drain)

    def run(self) -> None:
        """Run one turn. Participants without a slice, or with more work, come first in the next turn."""
        began = self._clock()
        waiting = deque(self._all)
        while waiting and self._clock() - began < TURN_S:
            drain = waiting.popleft()
            if drain():
                waiting.append(drain)
        self.has_more = bool(waiting)
        if waiting:
            self._all.sort(key=lambda drain: waiting.index(drain) if drain in waiting else len(waiting))
        self.spent = self._clock() - began
