"""Rollouts as they are stored and shown: a profile, applied to the devices of a group in waves.

A device:
    waiting ─> applying ─> watching ─> confirming ─> done
       │           └───────────┴────────────┴──────> failed     refused, or rolled back
       │                                        └──> unknown    the line or this server ended before
       ├─> left          lost, or not to be controlled any more, before anything was sent
       └─> not-started   the rollout ended before

A rollout:
    running ─> done │ failed │ stopped │ interrupted (this server ended)
"""

import math
import re
from typing import Literal

from pydantic import BaseModel, Field

from imuscope.server.errors import DomainError

RolloutState = Literal["running", "done", "failed", "stopped", "interrupted"]
RolloutDeviceState = Literal[
    "waiting", "applying", "watching", "confirming", "done", "failed", "unknown", "left", "not-started"
]
BUSY = ("applying", "watching", "confirming")
BAD = ("failed", "unknown")

DEFAULT_WAVES = "1, 5, 25 %"
MAX_PARTS = 20
_PART = re.compile(r"(\d{1,5})\s*(%?)")
UNKNOWN = "The robot rolls back by itself unless the settings were confirmed; compare its settings when it is live."


class ProfileOrigin(BaseModel):
    """Robot, device and operator from which the profile was taken."""

    robot: str
    device: str = Field(description="displayed name")
    by: str = Field(description="name of the person")
    time: float = Field(description="clock of the fleet server, unix s")


class RolloutChange(BaseModel):
    """A setting that the rollout changes, with the old and the new value."""

    title: str = Field(description="as on the page Configure")
    now: str = Field(description="value of the device as text; empty if it has none")
    profile: str = Field(description="value of the profile as text; empty if it has none")


class RolloutChanges(BaseModel):
    """Settings that are changed, of all devices that have the same."""

    rows: list[RolloutChange]
    risks: list[str] = Field(description="consequences, one sentence each")


class PlannedDevice(BaseModel):
    """A device that a rollout would write to."""

    robot: str
    device: str = Field(description="id")
    name: str
    change: int = Field(description="place in `changes`")


class DeviceLeftOut(BaseModel):
    """A device that differs, or may differ, and would not be written to."""

    robot: str
    device: str = Field(description="id")
    name: str
    why: str


class RolloutPlan(BaseModel):
    """Plan of a rollout, as of now."""

    id: str = Field(description="to be sent with the start; another one as soon as something else would be done")
    group: str
    product: str
    profile: ProfileOrigin
    devices: list[PlannedDevice] = Field(description="in the order in which they would be written to")
    changes: list[RolloutChanges]
    left_out: list[DeviceLeftOut]
    same: int = Field(description="number of devices that have the settings of the profile already")
    waves: list[int] = Field(description="number of devices in each wave")
    running: int | None = Field(description="id of the rollout of this profile that is under way")


class RolloutDevice(BaseModel):
    """Progress of a rollout on one device: its wave, state and last message."""

    robot: str
    device: str = Field(description="id")
    name: str
    wave: int = Field(description="from 1")
    state: RolloutDeviceState = "waiting"
    words: str = Field(default="", description="what happened, in words")
    time: float | None = Field(
        default=None, description="clock of the fleet server, unix s: since when it is in this state"
    )
    change: int = Field(description="place in `changes`")


class RolloutHead(BaseModel):
    """A rollout without its devices."""

    id: int
    group: str
    product: str
    protocol: str
    profile: ProfileOrigin
    by: str = Field(description="name of the person who started it")
    state: RolloutState = "running"
    words: str = Field(default="", description="why it ended, in words")
    stopped_by: str = Field(default="", description="name of the person who stopped it")
    started: float = Field(description="clock of the fleet server, unix s")
    ended: float | None = None
    watch_s: float = Field(description="time for which a device has to deliver before it is confirmed, s")
    waves: list[int] = Field(description="number of devices in each wave")
    wave: int = Field(default=1, description="the present one, from 1")


class Rollout(RolloutHead):
    """Application of a profile to the devices of a group, in waves."""

    devices: list[RolloutDevice]
    changes: list[RolloutChanges]

    def interrupt(self, now: float) -> None:
        """This server ended. Nothing goes on by itself: devices under way are unknown, and waiting ones never begin."""
        for one in self.devices:
            if one.state in BUSY:
                one.words = f"The fleet server ended while this device was {one.state}. {UNKNOWN}"
                one.state, one.time = "unknown", now
        self.end("interrupted", "The fleet server ended. A new plan shows the remaining work.", now)

    def end(self, state: RolloutState, words: str, now: float) -> None:
        """End it: waiting devices are not started."""
        for one in self.devices:
            if one.state == "waiting":
                one.state, one.time = "not-started", now
        self.state, self.words, self.ended = state, words, now


def wave_sizes(text: str, count: int) -> list[int]:
    """Sizes of waves, such as "1, 5, 25 %" for so many devices: a percentage is of the rest, the last part is repeated.

    Raises:
        DomainError: the text is not valid.
    """
    parts = [_PART.fullmatch(one.strip()) for one in text.split(",")]
    waves = [(int(one[1]), bool(one[2])) for one in parts if one is not None]
    if len(waves) != len(parts) or len(parts) > MAX_PARTS or any(n < 1 or (share and n > 100) for n, share in waves):
        hint = f"Give sizes and percentages of the rest, such as {DEFAULT_WAVES}; up to {MAX_PARTS}."
        raise DomainError("bad-value", f"waves: {text[:80]!r} cannot be used.", hint)
    sizes: list[int] = []
    while count > 0:
        number, is_share = waves[min(len(sizes), len(waves) - 1)]
        size = min(count, math.ceil(count * number / 100) if is_share else number)
        sizes.append(size)
        count -= size
    return sizes
