"""Checks during a flood: whether the server answers, and whether another device's recording is whole.

How soon it answers is a question of the machine and of who else uses it (tests/bench/floods.py measures that). Here the
processor time counts that the server itself takes from a question to its answer: whoever asks waits at least as long.
"""

from __future__ import annotations

import contextlib
import http.client
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.bench.support.tcp_device import TcpDevice
from tests.fault_injection.fault_harness import frames
from tests.fault_injection.floods import RECORDING, Place
from tests.fault_injection.recorded_files import recording
from tests.support.processes import seconds_of
from tests.support.recorder_harness import chunks
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, http_client
from tests.support.waiting import block_until

RATE = 200.0  # of the other device, frames/s
FRAMES = 10_000  # of the longer recording
ANSWERS = 2  # during a flood: the first may have been asked for before it began


class Beside:
    """Ask /healthz, again and again, until the block ends.

    Attributes:
        answers: number of answers.
        failed: what went wrong, or "".
        most_s: most processor time that the server took until an answer.
    """

    def __init__(self, there: Watched) -> None:
        self._address = there.place.url.removeprefix("http://")
        self._pid = there.pid
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._request)
        self.answers = 0
        self.failed = ""
        self.most_s = 0.0

    def some_answers(self) -> Callable[[], bool]:
        """How long a flood lasts: until there are so many more answers."""
        enough = self.answers + ANSWERS
        return lambda: self.answers >= enough or bool(self.failed)

    def _request(self) -> None:
        try:
            while not self._stop.is_set():
                before_s = seconds_of(self._pid)
                requesting = http.client.HTTPConnection(self._address, timeout=PATIENCE_S)
                requesting.request("GET", "/healthz")
                status = requesting.getresponse().status
                requesting.close()
                assert status == 200, status
                self.most_s = max(self.most_s, seconds_of(self._pid) - before_s)
                self.answers += 1
        except Exception as error:  # without an answer a flood would have no end
            self.failed = f"{type(error).__name__}: {error}"

    def __enter__(self) -> Beside:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(2 * PATIENCE_S)


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
        block_until(lambda: len(chunks(self.path)) >= size, "what was sent is recorded")
        recorded = chunks(self.path)
        return self.line.sent.startswith(recorded, self.begins)


@contextlib.contextmanager
def watched(folder: Path) -> Iterator[Watched]:
    """A server with a device that streams and is recorded, and a library with a longer recording."""
    (folder / "recordings").mkdir()
    recording(folder / "recordings" / f"{RECORDING}.mcap", frames(0, FRAMES))
    with TcpDevice(RATE) as line, ServerProcess(line.source, data=folder) as server:
        with http_client(base_url=server.url) as requesting:
            block_until(lambda: requesting.get("/api/devices").json()[0]["status"] == "live", "the device streams")
            requesting.post("/api/recordings/start", json={"devices": ["1"]}).raise_for_status()
            name = block_until(lambda: requesting.get("/api/recorder").json()["id"], "it is recorded")
        path = folder / "recordings" / f"{name}.mcap"
        first = block_until(lambda: chunks(path)[:1000], "there is something in it")
        yield Watched(
            Place(server.url, folder, lambda: lambda: True), line, path, line.sent.index(first), server.process.pid
        )
