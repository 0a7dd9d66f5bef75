"""Measurements during a flood: how soon the server answers, and whether another device's recording is whole.

How long a second is, is measured in the same time: a thread of this process needs so many times longer for a piece of
work than it would alone, because others use the machine, and so does who asks the server. The slowest answer is held
against the slowest stretch: what others do comes and goes.
"""

from __future__ import annotations

import contextlib
import http.client
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from recordings.mcap_reader import LENGTH, TIME, McapReader
from tests.bench.tcp_device import TcpDevice
from tests.fault_injection.fault_harness import frames
from tests.fault_injection.floods import RECORDING, Place
from tests.fault_injection.recorded_files import received, recording
from tests.server_process import ServerProcess
from tests.timeouts import PATIENCE_S, http_client
from tests.waiting import block_until

RATE = 500.0  # of the other device, frames/s
WITHIN_S = 1.0
EVERY_S, WORK_S = 0.05, 0.004
STRETCH = 10  # pieces of work, about half a second
FEWEST = 3  # answers


class Beside:
    """Poll /healthz until the block ends.

    Attributes:
        answers: number of answers.
        worst_s: longest time of one answer, or the time waited so far if one is missing.
        slowness: slowdown of the machine in the slowest period, as a factor.
    """

    def __init__(self, url: str) -> None:
        self._address = url.removeprefix("http://")
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=self._ask), threading.Thread(target=self._work)]
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

    def _ask(self) -> None:
        while not self._stop.is_set():
            began = time.monotonic()
            try:
                asking = http.client.HTTPConnection(self._address, timeout=PATIENCE_S)
                asking.request("GET", "/healthz")
                fine = asking.getresponse().status == 200
                asking.close()
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

    def __enter__(self) -> Beside:
        for thread in self._threads:
            thread.start()
        block_until(lambda: self.answers, "the server answers before the flood")
        return self

    def __exit__(self, *_: object) -> None:
        block_until(lambda: self.answers >= FEWEST, "the flood was looked at")
        self._stop.set()
        for thread in self._threads:
            thread.join(2 * PATIENCE_S)


@dataclass
class Watched:
    """A server with a recorded device.

    Attributes:
        begins: number of bytes the device had sent when its recording started.
        pid: of the server.
    """

    place: Place
    line: TcpDevice
    path: Path
    begins: int
    pid: int

    def is_whole(self) -> bool:
        """Whether what is recorded is what was sent, when all is there that had been sent by now."""
        size = self.line.size - self.begins
        block_until(lambda: len(received(self.path)) >= size, "what was sent is recorded")
        recorded = received(self.path)
        return self.line.sent.startswith(recorded, self.begins)

    def lateness_s(self) -> float:
        """By how much the latest byte of the recording arrived after it was sent; of all floods so far."""
        wall = time.time() - time.monotonic()
        worst, place = 0.0, self.begins
        with McapReader(self.path) as found:
            for block in found.blocks():
                channel = found.topic("rx/1")
                if channel is None:
                    continue
                rows = block.of(channel.id)
                for size, arrived in zip(rows[LENGTH].tolist(), rows[TIME].tolist(), strict=True):
                    worst = max(worst, arrived / 1e9 - wall - self.line.sent_at(place))
                    place += size
        return worst


@contextlib.contextmanager
def watched(folder: Path, seconds: float) -> Iterator[Watched]:
    """A server with a device that streams and is recorded, and a library with a recording of a minute."""
    (folder / "recordings").mkdir()
    recording(folder / "recordings" / f"{RECORDING}.mcap", frames(0, 60_000))
    with TcpDevice(RATE) as line, ServerProcess(line.source, data=folder) as server:
        with http_client(base_url=server.url) as asking:
            block_until(lambda: asking.get("/api/devices").json()[0]["status"] == "live", "the device streams")
            asking.post("/api/recordings/start", json={"devices": ["1"]}).raise_for_status()
            name = block_until(lambda: asking.get("/api/recorder").json()["id"], "it is recorded")
        path = folder / "recordings" / f"{name}.mcap"
        first = block_until(lambda: received(path)[:1000], "there is something in it")
        yield Watched(Place(server.url, folder, seconds), line, path, line.sent.index(first), server.process.pid)
