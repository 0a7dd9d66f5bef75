"""Benchmark of a single frame, as in every drain of a live stream.

    python tests/bench/single_frame.py [--save]

Each protocol's frames, of about 60 bytes, are fed and drained one at a time: an MTData2 with time, orientation,
acceleration and rate of turn (serial_device.py), the INS solution of the mixed Inertial Sense stream (isb_mixed.py),
and Safety frames of nine axes (idtp_mixed.py). Median of many, best pass; once drained only, and once with every column
read.

The yardstick, in the same run: the same frames with zlib.crc32 as their check, laid under a numpy dtype that somebody
wrote by hand for this one frame, and every field read. It knows where the frame begins and ends, loses nothing, keeps
no time and takes no other frame.

Budget: 8 µs to feed and drain.
"""

from __future__ import annotations

import random
import sys
import time
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from imuscope.protocols.events import Batch  # noqa: E402
from imuscope.protocols.idtp.frames import SAFETY  # noqa: E402
from imuscope.protocols.idtp.simulator import IdtpSimulator  # noqa: E402
from tests.bench.decode import decoder_of  # noqa: E402
from tests.bench.support import isb_mixed, serial_device  # noqa: E402
from tests.bench.support.report import report  # noqa: E402

FRAMES, PASSES = 2000, 7
BUDGET_US = 8

BY_HAND = {  # name:type …, a name with _ is not read
    "xbus": "_head:V4 _1:V3 counter:>u2 _2:V3 time:>u4 _3:V3 q:(4,)>f4 _4:V3 acc:(3,)>f4 _5:V3 turn:(3,)>f4 _check:u1",
    "isb": "_head:V6 week:<u4 tow:<f8 status:(2,)<u4 theta:(3,)<f4 uvw:(3,)<f4 lla:(3,)<f8 ned:(3,)<f4 _check:<u2",
    "idtp": "_head:V4 time:<u4 sequence:<u4 _rest:V8 acc:(3,)<f4 turn:(3,)<f4 field:(3,)<f4 _check:<u4",
}


def frames_of(protocol: str) -> list[bytes]:
    """FRAMES of them, one after the other."""
    if protocol == "xbus":
        return [serial_device.frame(index, 100) for index in range(FRAMES)]
    if protocol == "isb":
        noise = random.Random(1)
        return [isb_mixed.message(4, step * isb_mixed.STEP_S, noise) for step in range(FRAMES)]
    device = IdtpSimulator(7, outputs=(("Imu9", 100),), mode=SAFETY)
    device.advance(0)
    return [device.advance(step * 10_000_000) for step in range(1, FRAMES + 1)]


def median_us(frames: Sequence[bytes], one: Callable[[bytes], Any]) -> float:
    """Of `one` over `frames`, µs."""
    times = []
    for frame in frames:
        start = time.perf_counter()
        one(frame)
        times.append(time.perf_counter() - start)
    return sorted(times)[len(times) // 2] * 1e6


def decoded(protocol: str, *, columns: bool) -> Callable[[bytes], None]:
    """A fresh decoder's feeding and draining."""
    decoder = decoder_of(protocol)

    def one(frame: bytes) -> None:
        decoder.feed(frame, time.time_ns())
        for event in decoder.drain():
            if columns and isinstance(event, Batch):
                for name in event.columns:
                    event.columns[name]

    return one


def by_hand(protocol: str) -> Callable[[bytes], None]:
    """The yardstick."""
    fields = [(name, form) for name, form in (word.split(":") for word in BY_HAND[protocol].split())]
    dtype = np.dtype(fields)
    names = [name for name, _ in fields if not name.startswith("_")]

    def one(frame: bytes) -> None:
        zlib.crc32(frame)
        row = np.frombuffer(frame, dtype)
        for name in names:
            row[name]

    return one


def measure(protocol: str) -> dict[str, float]:
    """Figures of one protocol. The measurements alternate, so that a busy machine slows all of them equally."""
    frames = frames_of(protocol)
    results: dict[str, list[float]] = {"us": [], "us_with_columns": [], "yardstick_us": []}
    for _ in range(PASSES):
        results["us"].append(median_us(frames, decoded(protocol, columns=False)))
        results["us_with_columns"].append(median_us(frames, decoded(protocol, columns=True)))
        results["yardstick_us"].append(median_us(frames, by_hand(protocol)))
    best = {name: min(times) for name, times in results.items()}
    return {"bytes": len(frames[0]), **best, "ratio": best["us"] / best["yardstick_us"]}


def main() -> None:
    """The command line."""
    report("alone", {**{name: measure(name) for name in BY_HAND}, "budget": {"us": BUDGET_US}})


if __name__ == "__main__":
    main()
