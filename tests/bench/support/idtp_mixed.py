"""A stream for the decoding benchmark: Lite and Safety frames of nine axes and of orientation, from the shared drive.

    python tests/bench/support/idtp_mixed.py OUT

Two devices take turns, one in each mode, at 100 samples/s of each type, for two minutes.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from imuscope.protocols.idtp.frames import LITE, SAFETY
from imuscope.protocols.idtp.simulator import IdtpSimulator

OUTPUTS = (("Imu9", 100), ("ImuQuat", 100))


def mixed(seconds: float) -> bytes:
    """The bytes of so much of the drive."""
    devices = [IdtpSimulator(7 + mode, seed=mode, outputs=OUTPUTS, mode=mode) for mode in (LITE, SAFETY)]
    ticks = range(0, int(seconds * 1e9), 10_000_000)
    return b"".join(device.advance(tick) for tick in ticks for device in devices)


if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(mixed(120))
