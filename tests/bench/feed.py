"""A device on a pseudo-terminal for the benchmarks: ten values at a given rate, and when each frame was written.

    python tests/bench/feed.py RATE SECONDS     prints the terminal's path; starts after a line on standard input;
                                                then prints one JSON line: {"first": counter, "written": [unix s, …]}

It is a process of its own so that its processor time is not the server's, and it encodes everything before it starts.
The frames are written by hand here, not by the code that is measured:

    FA FF 36 LEN │ 1020 02 counter │ 1060 04 time │ 2010 10 q0 q1 q2 q3 │ 4020 0C x y z │ 8020 0C x y z │ checksum
"""

from __future__ import annotations

import json
import math
import os
import pty
import struct
import sys
import threading
import time
import tty

ITEMS = struct.Struct(">HBHHBIHB4fHB3fHB3f")
TICKS_PER_S = 10_000  # of SampleTimeFine


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


def main() -> None:
    """The command line."""
    rate, seconds = float(sys.argv[1]), float(sys.argv[2])
    frames = [frame(index, rate) for index in range(round(rate * seconds))]
    master, slave = pty.openpty()
    tty.setraw(slave)
    # What the server sends to its device goes nowhere, and must not fill the terminal's buffer.
    threading.Thread(target=lambda: [None for _ in iter(lambda: os.read(master, 4096), b"")], daemon=True).start()
    print(os.ttyname(slave), flush=True)
    sys.stdin.readline()
    written: list[float] = []
    began = time.monotonic()
    while len(written) < len(frames):
        due = min(len(frames), int((time.monotonic() - began) * rate) + 1)
        for data in frames[len(written) : due]:
            os.write(master, data)
            written.append(time.time())
        time.sleep(max(0.0, began + due / rate - time.monotonic()))
    print(json.dumps({"first": 0, "written": written}), flush=True)
    time.sleep(1)  # the terminal stays until the last bytes have been read


if __name__ == "__main__":
    main()
