"""Scheduler of decoding: soon after bytes arrive, in turns that leave time for the event loop.

    bytes arrive ─> request ──interval──> turn: a slice of each session (decode_budget.py) ─> rows on the bus
                                            │ more is waiting
                                            └─ pause as long as the turn took, some passes of the loop, next turn

The interval is that of the most demanding viewer: 12 ms if samples are drawn as they arrive, the page's drawing
interval if it reports one, 0.2 s without viewers; one turn for many samples costs far less than one for each. All
sessions share one timer, because waking the loop costs more than most slices, and because samples decoded together are
sent to clients together. A session that waits for an answer decodes at once.

A turn in which a session found bytes requests the next one, so that while bytes arrive no link needs to wake the loop.
"""

import asyncio
from collections.abc import Callable

from imuscope.server.concurrency.heartbeat import UNWATCHED_S, next_beat
from imuscope.server.devices.decode.decode_budget import Drain, RoundRobin

LOOP_PASSES = 8  # of the event loop between two turns that leave work: as many as it takes to answer a request


class DecodeScheduler:
    """Turns of the sessions of a server.

    Args:
        interval: present minimum time between two turns, s.
    """

    def __init__(self, interval: Callable[[], float] = lambda: UNWATCHED_S) -> None:
        self._interval = interval
        self._turns = RoundRobin()
        self._timer: asyncio.Handle | None = None
        self._passes = 0  # of the loop before the next turn
        self._last = float("-inf")  # beginning of the last turn, by the loop's clock
        self._rest_until = 0.0  # by the loop's clock: other tasks of the loop come first

    def add(self, drain: Drain) -> Callable[[], None]:
        """Add `drain` to each turn; returns a function that removes it."""
        return self._turns.add(drain)

    @property
    def interval_ns(self) -> int:
        """Present minimum time between two turns, ns."""
        return round(self._interval() * 1e9)

    def request(self) -> None:
        """Schedule a turn for received bytes as soon as the interval allows. Call it in the event loop."""
        interval = self._interval()
        if self._timer is None:
            loop, due = asyncio.get_running_loop(), self._last + interval
            if interval >= UNWATCHED_S and due > loop.time():
                due = next_beat(due - interval, interval)  # with all other periodic work
            self._schedule(loop, due)

    def _schedule(self, loop: asyncio.AbstractEventLoop, due: float) -> None:
        if self._timer is not None:  # requested in a turn that leaves work
            self._timer.cancel()
        self._timer = loop.call_at(max(loop.time(), due, self._rest_until), self._run_turn, loop)

    def _run_turn(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._passes:
            self._passes -= 1
            self._timer = loop.call_soon(self._run_turn, loop)
            return
        self._timer = None
        self._last = loop.time()
        self._turns.run()
        self._rest_until = loop.time() + self._turns.spent
        if self._turns.has_more:  # without an interval: bytes would arrive faster than they are decoded
            self._passes = LOOP_PASSES
            self._schedule(loop, self._last)
