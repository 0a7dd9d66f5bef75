"""A file of mixed Inertial Sense messages for decode.py, as a device sends them.

    python tests/bench/support/isb_mixed.py OUT [SECONDS]

INS and IMU at 250 Hz, PIMU, magnetometer and barometer at 62.5 Hz, GNSS position, velocity, satellites and system
parameters at 12.5 Hz, and one device information; the payloads are random but for their clocks.
"""

from __future__ import annotations

import random
import struct
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from imuscope.protocols.isb.dataset_loader import SETS
from imuscope.protocols.isb.frames import DATA, build

WEEK, TOW, UP = 2392, 432_000.0, 100.0
STEP_S = 0.004
EVERY = {4: 1, 58: 1, 3: 4, 52: 4, 53: 4, 13: 20, 30: 20, 15: 20, 10: 20}  # data set → steps between two


def message(did: int, t: float, noise: random.Random) -> bytes:
    """One whole data set at time `t`."""
    row = SETS[did]
    assert row.struct is not None
    payload = bytearray(noise.randbytes(row.struct.size))
    clock = {
        "week+timeOfWeek": struct.pack("<Id", WEEK, TOW + t),
        "week+timeOfWeekMs": struct.pack("<II", WEEK, int((TOW + t) * 1000)),
        "timeOfWeekMs": struct.pack("<I", int((TOW + t) * 1000)),
        "time": struct.pack("<d", UP + t),
    }[row.clock]
    payload[: len(clock)] = clock
    if did == 15:
        payload[4:8] = struct.pack("<I", 20)
        del payload[8 + 20 * 8 :]
    if did == 13:
        payload[80:88] = struct.pack("<d", TOW - UP)
    return build(DATA, did, bytes(payload))


def stream(seconds: float) -> bytes:
    """All of it."""
    noise = random.Random(1)
    parts = [build(DATA, 1, bytes(12) + bytes([2, 7, 1, 0]) + bytes(68))]
    for step in range(round(seconds / STEP_S)):
        parts += [message(did, step * STEP_S, noise) for did, every in EVERY.items() if step % every == 0]
    return b"".join(parts)


if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(stream(float(sys.argv[2]) if len(sys.argv) > 2 else 60))
