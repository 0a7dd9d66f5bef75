"""Conditions on figures of a link: rate, loss, silence, uncertainty of its clock, connection."""

from __future__ import annotations

import math
from collections import deque

from server import wire
from server.alarms.definitions import HealthCondition
from server.alarms.machine import BETWEEN, BEYOND, UNKNOWN, WITHIN

LOSS_S = 10.0
UNITS = {"rate": "Hz", "loss": "%", "silence": "s", "clock": "ms", "link": ""}
SUBJECTS = {
    "rate": "rate",
    "loss": "lost samples",
    "silence": "silence",
    "clock": "uncertainty of the clock",
    "link": "link",
}
LOST = ("lost", "denied")


class HealthJudge:
    """A figure of one device.

    Attributes:
        direction, unit, limit, subject: as of conditions on samples.
    """

    def __init__(self, condition: HealthCondition) -> None:
        self._condition = condition
        self.direction = -1 if condition.figure == "rate" else 1
        self.unit = UNITS[condition.figure]
        self.subject = SUBJECTS[condition.figure]
        self.limit = math.nan if condition.figure == "link" else condition.limit
        self._counts: deque[tuple[float, int, int]] = deque()  # time, lost, received

    def judge(self, info: wire.DeviceInfo, health: wire.DeviceHealth | None, now: float) -> tuple[int, float]:
        """Code and value at present.

        Args:
            health: None before the first figures.
        """
        figure = self._condition.figure
        if figure == "link":
            is_lost = info.status in LOST
            return BEYOND if is_lost else WITHIN, float(is_lost)
        value = self._value(info, health, now)
        if value is None or not math.isfinite(value):
            return UNKNOWN, math.nan
        clear = self._condition.limit if self._condition.clear is None else self._condition.clear
        if (value - self._condition.limit) * self.direction > 0:
            return BEYOND, value
        return (BETWEEN if (value - clear) * self.direction > 0 else WITHIN), value

    def _value(self, info: wire.DeviceInfo, health: wire.DeviceHealth | None, now: float) -> float | None:
        if self._condition.figure == "silence":
            last = info.last_arrival if health is None or health.last_arrival is None else health.last_arrival
            return None if last is None else max(0.0, now - last)
        if health is None:
            return None
        if self._condition.figure == "rate":
            return health.rate
        if self._condition.figure == "clock":
            return health.uncertainty_ms
        return self._loss(health)

    def _loss(self, health: wire.DeviceHealth) -> float | None:
        """Share of the samples of the last seconds that were lost, %; None before the first sample."""
        received = max((message.count for message in health.messages), default=0)
        if not self._counts or health.time > self._counts[-1][0]:
            if self._counts and (health.lost < self._counts[-1][1] or received < self._counts[-1][2]):
                self._counts.clear()  # counted anew
            self._counts.append((health.time, health.lost, received))
        while len(self._counts) > 2 and self._counts[1][0] <= health.time - LOSS_S:
            self._counts.popleft()
        lost, arrived = health.lost - self._counts[0][1], received - self._counts[0][2]
        return 100 * lost / (lost + arrived) if lost + arrived > 0 else None
