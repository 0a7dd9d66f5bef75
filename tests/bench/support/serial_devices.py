"""Several devices on pseudo-terminals, from one process, with exact counts of the sent bytes.

    with Speakers(4, rate=2000, seconds=600) as speakers:
        speakers.terminals      paths, one a device
        speakers.go()           begin
        speakers.sent()         wait for the end: per device frames, bytes and their CRC-32; how late it was

Frames are those of tests/bench/support/serial_device.py (ten values), made a second at a time with numpy and written
every `TICK_S`, which is how often USB asks an adapter: eight writes of two frames each for four devices at 2 kHz. A
terminal that is full is waited for, so nothing is lost on this side; how late that made a write is told.

`speed` makes time go faster: 50 sends the frames of 50 seconds in each, and their clocks say so.

    python -m tests.bench.support.serial_devices DEVICES RATE SECONDS SPEED     (seconds of the devices' own time)
"""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import sys
import threading
import time
import tty
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.recordings.importers.open_file import open_file
from tests.bench.support import serial_device
from tests.bench.support.serial_device import SendingProcess

TICK_S = 0.001
STUCK_S = 20.0
COUNTER, TICKS = 7, 12  # of the frame's bytes: where the packet counter and the sample time begin
SUM_FROM = 1  # of the checksum: all but the preamble


def frames(first: int, count: int, rate: float) -> NDArray[np.uint8]:
    """(count, size) frames number `first` and after, as they go over the wire. The motion repeats every second."""
    template = np.frombuffer(b"".join(serial_device.frame(n, rate) for n in range(count)), np.uint8).reshape(count, -1)
    return numbered(template, first, rate)


def numbered(template: NDArray[np.uint8], first: int, rate: float) -> NDArray[np.uint8]:
    """The same frames with the counters and clocks of `first` and after."""
    out = template.copy()
    number = first + np.arange(len(out), dtype=np.int64)
    ticks = np.rint(number * (serial_device.TICKS_PER_S / rate)).astype(np.int64) & 0xFFFFFFFF
    out[:, COUNTER : COUNTER + 2] = (number & 0xFFFF).astype(">u2").view(np.uint8).reshape(-1, 2)
    out[:, TICKS : TICKS + 4] = ticks.astype(">u4").view(np.uint8).reshape(-1, 4)
    out[:, -1] = (-out[:, SUM_FROM:-1].astype(np.int64).sum(axis=1)) & 0xFF
    return out


class Speakers(SendingProcess):
    """This file as a process of its own.

    Args:
        devices: how many.
        rate: frames/s of each, in its own time.
        seconds: for how long, in its own time.
        speed: how much faster that goes than ours.

    Attributes:
        terminals: paths of the devices.
    """

    def __init__(self, devices: int, rate: float, seconds: float, speed: float = 1.0) -> None:
        super().__init__("tests.bench.support.serial_devices", *map(str, (devices, rate, seconds, speed)))
        self.terminals: list[str] = json.loads(self.line())
        self.pid = self._process.pid
        self._result: dict[str, Any] | None = None

    def go(self) -> float:
        """Begin to send; when the first frame is due, unix s."""
        self.begin()
        return float(self.line())

    def sent(self) -> dict[str, Any]:
        """Wait for the end; {"devices": [{"frames", "bytes", "crc32"}, …], "late_p99_ms", "late_max_ms"}."""
        if self._result is None:
            self._result = json.loads(self.line())
        return self._result


def received_in(paths: Sequence[Path]) -> dict[str, dict[str, int]]:
    """Contents of a recording, in parts or not, by device: {"1": {"bytes", "crc32"}}; received data only."""
    results: dict[str, dict[str, int]] = {}
    for path in paths:
        for part in open_file(path).parts():
            if part.direction == "rx":
                one = results.setdefault(part.device, {"bytes": 0, "crc32": 0})
                one["bytes"] += len(part.data)
                one["crc32"] = zlib.crc32(part.data, one["crc32"])
    return results


def is_whole(received: dict[str, dict[str, int]], sent: Sequence[dict[str, Any]]) -> bool:
    """Whether a recording has, of each device, the bytes that it has sent."""
    ours, theirs = (sorted((one["bytes"], one["crc32"]) for one in some) for some in (received.values(), sent))
    return ours == theirs


def put(master: int, data: memoryview) -> None:
    """Write all of it; wait while the terminal is full."""
    while data:
        with contextlib.suppress(BlockingIOError):
            data = data[os.write(master, data) :]
        if data and not select.select([], [master], [], STUCK_S)[1]:
            sys.exit(f"speakers: nobody has read a terminal for {STUCK_S:g} s")


def speak(masters: list[int], rate: float, seconds: float, speed: float) -> dict[str, Any]:
    """Send it all; what was sent."""
    second = round(rate)
    template = frames(0, second, rate)
    size = template.shape[1]
    whole = round(rate * seconds)
    crc, late = 0, []
    block, block_first = template.tobytes(), 0
    done = 0
    began = time.monotonic()
    while done < whole:
        due = min(whole, int((time.monotonic() - began) * rate * speed) + 1)
        due = min(due, block_first + second, done + max(2, second // 4))
        if due > done:
            data = block[(done - block_first) * size : (due - block_first) * size]
            for master in masters:
                put(master, memoryview(data))
            crc = zlib.crc32(data, crc)
            late.append(time.monotonic() - began - done / rate / speed)
            done = due
        if done == block_first + second:
            block_first = done
            block = numbered(template, done, rate).tobytes()
        next_due = began + max(done / rate / speed, time.monotonic() - began + TICK_S if speed == 1 else 0)
        time.sleep(max(0.0, next_due - time.monotonic()))
    late.sort()
    one = {"frames": done, "bytes": done * size, "crc32": crc}
    return {
        "devices": [one] * len(masters),
        "late_p99_ms": 1e3 * late[int(0.99 * (len(late) - 1))],
        "late_max_ms": 1e3 * late[-1],
    }


def main() -> None:
    """The command line."""
    devices, (rate, seconds, speed) = int(sys.argv[1]), map(float, sys.argv[2:5])
    pairs = [pty.openpty() for _ in range(devices)]
    for master, slave in pairs:
        tty.setraw(slave)
        os.set_blocking(master, False)
        threading.Thread(target=serial_device.listen, args=(master,), daemon=True).start()
    print(json.dumps([os.ttyname(slave) for _, slave in pairs]), flush=True)
    if not sys.stdin.readline():
        return  # the process that started this one has ended
    print(time.time(), flush=True)
    print(json.dumps(speak([master for master, _ in pairs], rate, seconds, speed)), flush=True)
    sys.stdin.readline()  # the terminals stay until the last bytes have been read


if __name__ == "__main__":
    main()
