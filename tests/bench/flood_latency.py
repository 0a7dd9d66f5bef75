"""Latency of a server during a flood: how soon it answers, and how late the bytes of another device are recorded.

How long a second is, is measured in the same time: a thread of this process needs so many times longer for a piece of
work than it would alone, because others use the machine, and so does who asks the server. The slowest answer is held
against the slowest stretch: what others do comes and goes.
"""

from __future__ import annotations

import http.client
import threading
import time

from imuscope.recordings.mcap.reader import LENGTH, TIME, McapReader
from tests.fault_injection.beside import Watched
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

WITHIN_S = 1.0
EVERY_S, WORK_S = 0.05, 0.004
STRETCH = 10  # pieces of work, about half a second
MIN_ANSWERS = 3  # answers


class FloodLatency:
    """Poll /healthz until the block ends.

    Attributes:
        answers: number of answers.
        worst_s: longest time of one answer, or the time waited so far if one is missing.
        slowness: slowdown of the machine in the slowest period, as a factor.
    """

    def __init__(self, url: str) -> None:
        self._address = url.removeprefix("http://")
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=self._request), threading.Thread(target=self._work)]
        self.answers = 0
        self.worst_s = 0.0
        self._pieces: list[tuple[float, float]] = []  # of work: how long each took, and its processor time, s

    @property
    def slowness(self) -> float:
        pieces = self._pieces
        stretches = [pieces[at : at + STRETCH] for at in range(max(1, len(pieces) - STRETCH + 1))]
        return max([1.0, *(sum(took for took, _ in some) / sum(own for _, own in some) for some in stretches if some)])

    @property
    def limit_s(self) -> float:
        """One second of an otherwise idle machine, scaled by the measured slowness."""
        return WITHIN_S * self.slowness

    def _request(self) -> None:
        while not self._stop.is_set():
            began = time.monotonic()
            try:
                requesting = http.client.HTTPConnection(self._address, timeout=PATIENCE_S)
                requesting.request("GET", "/healthz")
                fine = requesting.getresponse().status == 200
                requesting.close()
            except OSError:
                fine = False
            took = time.monotonic() - began
            self.worst_s = max(self.worst_s, took if fine else PATIENCE_S)
            self.answers += fine
            self._stop.wait(EVERY_S)

    def _work(self) -> None:
        while not self._stop.is_set():
            began, own = time.monotonic(), time.thread_time()
            while time.thread_time() - own < WORK_S:
                sum(range(200))
            self._pieces.append((time.monotonic() - began, time.thread_time() - own))
            self._stop.wait(EVERY_S)

    def __enter__(self) -> FloodLatency:
        for thread in self._threads:
            thread.start()
        block_until(lambda: self.answers, "the server answers before the flood")
        return self

    def __exit__(self, *_: object) -> None:
        block_until(lambda: self.answers >= MIN_ANSWERS, "the flood was looked at")
        self._stop.set()
        for thread in self._threads:
            thread.join(2 * PATIENCE_S)


def lateness_s(there: Watched) -> float:
    """By how much the latest byte of the recording arrived after it was sent; of all floods so far."""
    wall = time.time() - time.monotonic()
    worst, place = 0.0, there.begins
    with McapReader(there.path) as reader:
        for block in reader.blocks():
            channel = reader.topic("rx/1")
            if channel is None:
                continue
            rows = block.of(channel.id)
            for size, arrived in zip(rows[LENGTH].tolist(), rows[TIME].tolist(), strict=True):
                worst = max(worst, arrived / 1e9 - wall - there.line.sent_at(place))
                place += size
    return worst
