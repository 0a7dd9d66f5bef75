"""Faults of a simulated line: frames that are lost, and bits that are turned."""

from __future__ import annotations

import numpy as np


def through_faults(frame: bytes, number: int, seed: int, drop: float, corrupt: float) -> bytes | None:
    """A frame as it leaves the simulator; None if it is lost.

    Args:
        number: of the frame; with the seed it decides, so that a run can be repeated.
        drop, corrupt: shares of the frames that are lost, and that have one bit turned.
    """
    if not drop and not corrupt:
        return frame
    random = np.random.default_rng([seed, number])
    chance = random.random()
    if chance < drop:
        return None
    if chance >= drop + corrupt:
        return frame
    at, bit = random.integers(len(frame)), random.integers(8)
    return frame[:at] + bytes([frame[at] ^ 1 << bit]) + frame[at + 1 :]
