"""How much is decoded at once: so much that a turn of the event loop stays short, whatever the bytes are.

    bytes that wait     ████████████████████████████████████
    a slice             ████                                    some ms of work, by how long the last one took
    a turn              ████ ▒▒▒▒ ░░░░ ████ ▒▒▒▒ ░░░░           of every session one after the other, TURN_S in all
    then                the loop goes on; the next turn begins when that has had as long

What a byte costs to decode differs a thousandfold: a good frame costs next to nothing, the beginnings of frames that
never go on cost most. So the size of a slice follows from the time that was measured, not from what is in it. A slice
costs something whatever its size, too; one that holds next to nothing would spend all of its time on that, and fall
behind a stream that is cheap. Both costs are the line through the sizes and times of the last slices. Under load all
are full, and sizes of one kind tell no line; a shorter slice now and then does.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable

SLICE_S = 0.003
LEAST, FIRST, MOST = 1 << 11, 1 << 12, 1 << 18  # bytes
TURN_S = 0.012
FORGETTING = 0.9  # of what is known, by each slice
FLATTEST = 0.05  # of the mean cost of a byte is its own at the least, whatever noise says
ALIKE = 0.01  # of the mean square of sizes that tell no line is their variance, at the most
FEW = 4.0  # slices
SHORTER = 0.6  # of a slice

Drain = Callable[[], object]
"""Does a slice of work; true when more of it waits."""


class Costs:
    """What slices have cost, newer ones counting more: a constant and so much a byte, by least squares."""

    def __init__(self) -> None:
        self._sums = (0.0, 0.0, 0.0, 0.0, 0.0)  # weights, sizes, times, sizes squared, sizes by times

    def add(self, size: int, spent: float) -> None:
        """A slice of `size` bytes took `spent` s."""
        new = (1.0, float(size), spent, float(size) * size, size * spent)
        constant, byte_s = self._line()
        if spent > max(SLICE_S, 4 * (constant + byte_s * size)):
            self._sums = new  # other bytes than those before
        else:
            n, sizes, times, squares, products = (
                FORGETTING * old + one for old, one in zip(self._sums, new, strict=True)
            )
            self._sums = n, sizes, times, squares, products

    def fitting(self) -> int:
        """The bytes whose own cost is `SLICE_S`, or what any slice costs, if that is more."""
        constant, byte_s = self._line()
        return int(max(SLICE_S, constant) / byte_s)

    @property
    def are_alike(self) -> bool:
        """All of the last slices were of one size, and more than a few."""
        return self._sums[0] > FEW and self._spread() <= ALIKE * self._sums[3]

    def _spread(self) -> float:
        n, sizes, _, squares, _ = self._sums
        return squares - sizes * sizes / n

    def _line(self) -> tuple[float, float]:
        """What any slice costs, and what each byte, s."""
        n, sizes, times, squares, products = self._sums
        if not n:
            return 0.0, 0.0
        byte_s, spread = times / sizes, self._spread()
        if spread > ALIKE * squares:
            byte_s *= min(max((products - sizes * times / n) / spread / byte_s, FLATTEST), 1.0)
        return (times - byte_s * sizes) / n, byte_s


class Slices:
    """The slices of one session.

    Args:
        clock: s of processor time of this thread, so that a busy machine does not look like costly bytes.
    Attributes:
        size: of the next one, bytes.
    """

    def __init__(self, clock: Callable[[], float] = time.thread_time) -> None:
        self.size = FIRST
        self._clock = clock
        self._costs = Costs()
        self._most = FIRST  # that is known to fit
        self._began = 0.0
        self._taken = 0
        self._room = asyncio.Event()

    def take(self, size: int) -> None:
        """So many bytes were taken, and are to be decoded."""
        self._taken += size

    @property
    def full(self) -> bool:
        """A slice has been taken."""
        return self._taken >= self.size

    async def room(self) -> None:
        """Wait until what was taken is decoded, if that is a slice."""
        while self.full:
            self._room.clear()
            await self._room.wait()

    def begin(self) -> None:
        """From here on what was taken is decoded."""
        self._began = self._clock()

    def end(self) -> None:
        """It has been."""
        size, self._taken = self._taken, 0
        self._room.set()
        if not size:
            return
        spent = max(self._clock() - self._began, 1e-6)
        self._costs.add(size, spent)
        fitting = self._costs.fitting()
        if fitting < self._most and spent > SLICE_S:
            self._most = max(LEAST, fitting)
        elif size > self._most // 2:  # fewer say little: most of it may be what any slice costs
            self._most = min(MOST, 2 * self._most, max(self._most, fitting))
        tells = self._most < MOST and self._costs.are_alike
        self.size = int(SHORTER * self._most) if tells else self._most


class Turns:
    """Gives each of many a slice after the other, until the time is over.

    Args:
        clock: s of processor time of this thread: one that others keep from running has not had its turn.
    Attributes:
        spent: by the last turn, s.
        more: whether it left work.
    """

    def __init__(self, clock: Callable[[], float] = time.thread_time) -> None:
        self._all: list[Drain] = []
        self._clock = clock
        self.spent = 0.0
        self.more = False

    def add(self, drain: Drain) -> Callable[[], None]:
        """Have a part in it; returns what takes that off again."""
        self._all.append(drain)
        return lambda: self._all.remove(drain)

    def turn(self) -> None:
        """One turn. Who had no slice in it, or has more to do, comes first in the next."""
        began = self._clock()
        waiting = deque(self._all)
        while waiting and self._clock() - began < TURN_S:
            drain = waiting.popleft()
            if drain():
                waiting.append(drain)
        self.more = bool(waiting)
        if waiting:
            self._all.sort(key=lambda drain: waiting.index(drain) if drain in waiting else len(waiting))
        self.spent = self._clock() - began
