"""A device on a pseudo-terminal for the benchmarks: ten values at a given rate, and when each frame was written.

    python -m tests.bench.support.serial_device RATE SECONDS

It prints the terminal's path, starts after a line on standard input, and then prints one JSON line: {"first": counter,
"written": [unix s, …]} (or ends with a word on standard error when nobody reads).

It is a process of its own so that its processor time is not the server's, and it encodes everything before it starts.
The frames are written by hand here, not by the code that is measured:

    FA FF 36 LEN │ 1020 02 counter │ 1060 04 time │ 2010 10 q0 q1 q2 q3 │ 4020 0C x y z │ 8020 0C x y z │ checksum
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import pty
import select
import struct
import subprocess
import sys
import threading
import time
import tty
import urllib.request
from typing import Self

from tests.support.server_process import ROOT, tied

ITEMS = struct.Struct(">HBHHBIHB4fHB3fHB3f")
TICKS_PER_S = 10_000  # of SampleTimeFine
STUCK_S = 5.0  # a terminal holds 4 kB, 30 ms at 2 kHz; a server that compiles meanwhile has its port open first


def frame(index: int, rate: float) -> bytes:
    """One MTData2 frame: packet counter, sample time, orientation, acceleration, rate of turn."""
    angle = 0.4 * index / rate
    payload = ITEMS.pack(
        *(0x1020, 2, index & 0xFFFF),
        *(0x1060, 4, round(index * TICKS_PER_S / rate) & 0xFFFFFFFF),
        *(0x2010, 16, math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)),
        *(0x4020, 12, 0.3 * math.sin(9 * angle), 0.2 * math.cos(7 * angle), 9.81),
        *(0x8020, 12, 0.01 * math.sin(5 * angle), 0.01 * math.cos(3 * angle), 0.4),
    )
    body = bytes([0xFF, 0x36, len(payload)]) + payload
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])


class SendingProcess:
    """A module of this folder as a process that sends once it is told to, ended with the block."""

    def __init__(self, module: str, *words: str) -> None:
        command = tied([sys.executable, "-m", module, *words])
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT)

    def begin(self) -> None:
        """Begin to send."""
        assert self._process.stdin
        self._process.stdin.write("go\n")
        self._process.stdin.flush()

    def line(self) -> str:
        """The next line that it prints.

        Raises:
            RuntimeError: it ended early, for the reason that it printed.
        """
        assert self._process.stdout
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError("the process that sends ended early; see above")
        return line

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()


class Feed(SendingProcess):
    """This file as a process of its own: `with Feed(2000, 10) as feed: … feed.begin() …`.

    Args:
        rate, seconds: frames per second, and for how long.

    Attributes:
        terminal: path of the device.
    """

    def __init__(self, rate: float, seconds: float) -> None:
        super().__init__("tests.bench.support.serial_device", str(rate), str(seconds))
        self.terminal = self.line().strip()

    def written(self) -> list[float]:
        """Wait for the end; when each frame was written, unix s."""
        return list(json.loads(self.line())["written"])


def must_be_live(url: str) -> None:
    """Check that the server at `url` receives the data; figures of a server without its port would be meaningless.

    Raises:
        RuntimeError: it does not; with the message of its page.
    """
    with urllib.request.urlopen(f"{url}/api/devices", timeout=5) as answer:
        for device in json.load(answer):
            if device["status"] != "live":
                raise RuntimeError(f"{device['source']} is {device['status']}: {device['message']} {device['hint']}")


def put(master: int, data: bytes) -> None:
    """Write one frame to the terminal, with a time-out if it is not read.

    Raises:
        SystemExit: nothing was read for `STUCK_S`.
    """
    while data:
        if not select.select([], [master], [], STUCK_S)[1]:
            sys.exit(f"feed: nobody has read the terminal for {STUCK_S:g} s")
        with contextlib.suppress(BlockingIOError):
            data = data[os.write(master, data) :]


def listen(master: int) -> None:
    """Discard what the server sends, so that it does not fill the terminal's buffer."""
    with contextlib.suppress(OSError):
        while select.select([master], [], [])[0] and os.read(master, 4096):
            pass


def main() -> None:
    """The command line."""
    rate, seconds = float(sys.argv[1]), float(sys.argv[2])
    frames = [frame(index, rate) for index in range(round(rate * seconds))]
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    threading.Thread(target=listen, args=(master,), daemon=True).start()
    print(os.ttyname(slave), flush=True)
    if not sys.stdin.readline():
        return  # the process that started this one has ended
    written: list[float] = []
    began = time.monotonic()
    while len(written) < len(frames):
        due = min(len(frames), int((time.monotonic() - began) * rate) + 1)
        for data in frames[len(written) : due]:
            put(master, data)
            written.append(time.time())
        time.sleep(max(0.0, began + due / rate - time.monotonic()))
    print(json.dumps({"first": 0, "written": written}), flush=True)
    time.sleep(1)  # the terminal stays until the last bytes have been read


if __name__ == "__main__":
    main()
