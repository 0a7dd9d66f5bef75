"""Conditions on figures of a link: rate, loss, silence, uncertainty of its clock, connection.

A figure is judged only while it is known what it presupposes:

    rate       the device is connected, decoding keeps up, and it has been so for 2 s, over which a rate is counted
    loss       the same, for 10 s; samples arrive; and they are numbered
    silence    something has arrived, its source has not ended, and decoding keeps up
    clock      the device sends, and its clock has been observed for long enough to know its drift
    link       an attempt to connect has succeeded or failed, and its source has not ended

Else its code is UNKNOWN, and `obstacle` says why and what to do.
"""

import math
from collections.abc import Iterable

from imuscope.server import wire
from imuscope.server.devices.device.losses import LossWindow
from imuscope.server.extensions.alarms.definitions import HealthCondition
from imuscope.server.extensions.alarms.machine import BETWEEN, BEYOND, UNKNOWN, WITHIN

LOSS_S = 10.0
RATE_S = 2.0  # of a rate: server/concurrency/rate_meter.py
STALL_S = 3.0  # after so long without samples the rate is 0; before, those of a link that stalls may all come yet
BEHIND_S = 0.5  # as on the page
UNITS = {"rate": "Hz", "loss": "%", "silence": "s", "clock": "ms", "link": ""}
SUBJECTS = {
    "rate": "rate",
    "loss": "share of lost samples",
    "silence": "silence",
    "clock": "uncertainty of the clock",
    "link": "link",
}
LOST = ("lost", "denied")
UNCOUNTED = "The device does not number its samples: lost ones cannot be counted. Enable its counter, if it has one."
DRIFT_UNKNOWN = "The drift of the clock is not known yet. Wait until the device has sent for half a minute."


class HealthJudge:
    """A figure of one device.

    Attributes:
        channels: names of what the device sends.
        direction, unit, limit, subject: as of conditions on samples.
        obstacle: what prevents a verdict at present, and what to do; "" if nothing does.
    """

    def __init__(self, condition: HealthCondition, channels: Iterable[str] = ()) -> None:
        self._condition = condition
        self.channels = frozenset(channels)
        self.direction = -1 if condition.figure == "rate" else 1
        self.unit = UNITS[condition.figure]
        self.subject = SUBJECTS[condition.figure]
        self.limit = math.nan if condition.figure == "link" else condition.limit
        self.obstacle = ""
        self._losses = LossWindow(LOSS_S)
        self._rate = 0.0  # as of the newest samples
        self._known_since: float | None = None  # unix s: connected, and decoding has kept up since

    def judge(self, info: wire.DeviceInfo, health: wire.DeviceHealth | None, now: float) -> tuple[int, float]:
        """Code and value at present.

        Args:
            health: None before the first figures.
        """
        figure = self._condition.figure
        value = self._note_counts(info, health, now)
        self.obstacle = self._obstacle(info, health, now)
        if self.obstacle:
            return UNKNOWN, math.nan
        if figure == "link":
            is_lost = info.status in LOST
            return BEYOND if is_lost else WITHIN, float(is_lost)
        value = value if figure == "loss" else self._value(info, health, now)
        if value is None or not math.isfinite(value):
            self.obstacle = f"The {self.subject} is not known yet. Wait for samples of the device."
            return UNKNOWN, math.nan
        clear = self._condition.limit if self._condition.clear is None else self._condition.clear
        if (value - self._condition.limit) * self.direction > 0:
            return BEYOND, value
        return (BETWEEN if (value - clear) * self.direction > 0 else WITHIN), value

    def _obstacle(self, info: wire.DeviceInfo, health: wire.DeviceHealth | None, now: float) -> str:
        """Obstacle to a verdict, and what to do."""
        figure = self._condition.figure
        if info.status == "ended":
            return "The source has ended. Play it again, or disable the alarm."
        if figure == "link":
            return "The link is being opened. Wait for it." if info.status == "connecting" else ""
        behind = behind_words(health)
        if behind and figure != "clock":
            return behind
        if figure == "silence":
            return ""
        if info.status == "connecting":
            return "The link is being opened. Wait for the first samples of the device."
        if figure == "clock":
            if info.status != "live":
                return "The device does not send, so that its clock is not observed. Reconnect it, or start it."
            return DRIFT_UNKNOWN if health is not None and health.drift_ppm is None else ""
        if figure == "loss" and not (health and health.lost):
            from imuscope.server.devices.decode.protocol_set import (
                device_counts_losses,  # late: previews, which are without, start sooner
            )

            if not device_counts_losses(info, self.channels):
                return UNCOUNTED
        needed = LOSS_S if figure == "loss" else RATE_S
        known = 0.0 if self._known_since is None else now - self._known_since
        if known < needed:
            words = "lost samples are counted" if figure == "loss" else "the rate is counted"
            return f"Since the device sends, {max(0.0, known):.0f} s of {needed:.0f} s have passed over which {words}."
        return ""

    def _value(self, info: wire.DeviceInfo, health: wire.DeviceHealth | None, now: float) -> float | None:
        if self._condition.figure == "silence":
            last = info.last_arrival if health is None or health.last_arrival is None else health.last_arrival
            return None if last is None else max(0.0, now - last)
        if health is None:
            return None
        if self._condition.figure != "rate":
            return health.uncertainty_ms
        if health.rate or health.last_arrival is None or now - health.last_arrival >= STALL_S:
            self._rate = health.rate
        return self._rate

    def _note_counts(self, info: wire.DeviceInfo, health: wire.DeviceHealth | None, now: float) -> float | None:
        """Share of the samples of the last seconds that were lost, %; None if none arrived or was lost."""
        if info.status in ("connecting", "ended") or health is None or behind_words(health):
            self._known_since = None
            self._losses.clear()
            return None
        if not self._losses.add(health) or self._known_since is None:
            self._known_since = now
        return None if (share := self._losses.share) is None else 100 * share


def behind_words(health: wire.DeviceHealth | None) -> str:
    """By how much decoding is behind, and what to do; "" while it keeps up."""
    if health is None or health.behind.decoding <= BEHIND_S:
        return ""
    return f"Decoding is {health.behind.decoding:.3g} s behind the data received. Reduce the load of this computer."
