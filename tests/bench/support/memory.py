"""Benchmark of memory over time: a curve, sampled every few seconds, and its slope."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.support.processes import resident_mb

EVERY_S = 5.0
MAX_POINTS = 240  # points of a curve that is kept


def curve(points: Sequence[tuple[float, float]], unit: str = "min") -> dict[str, Any]:
    """Of (time, MB) points: the curve, thinned; its slope over the second half, MB for each `unit` of time; beginning
    and end.
    """
    late = [point for point in points if point[0] >= points[-1][0] / 2] if points else []
    slope = 0.0
    if len(late) >= 3:
        times, megabytes = np.array(late).T
        slope = float(np.polyfit(times, megabytes, 1)[0])
    thin = points[:: max(1, -(-len(points) // MAX_POINTS))]
    return {
        f"mb_per_{unit}": slope,
        "first_mb": points[0][1] if points else None,
        "last_mb": points[-1][1] if points else None,
        "max_mb": max((mb for _, mb in points), default=None),
        unit: [round(time, 2) for time, _ in thin],
        "mb": [round(mb, 1) for _, mb in thin],
    }


class Memory:
    """The curve of one process."""

    def __init__(self, pid: int, every_s: float = EVERY_S) -> None:
        self._pid, self._every_s = pid, every_s
        self.points: list[tuple[float, float]] = []
        self._began = time.monotonic()

    def sample(self) -> None:
        """One point more."""
        self.points.append(((time.monotonic() - self._began) / 60, resident_mb(self._pid)))

    async def watch(self) -> None:
        """Look again and again."""
        while True:
            self.sample()
            await asyncio.sleep(self._every_s)

    def curve(self) -> dict[str, Any]:
        return curve(self.points)
