"""Robots at a glance: the summaries that the page of a fleet shows, and how far a figure must move to be a change.

A figure that wobbles, such as a rate of 99.98, 100.03, 99.97 Hz, would make a robot that is well a change each second.
So a figure keeps its value until it differs from it by a step: 1 % of a rate, 0.5 °C, 20 % of a latency. Zero and
"unknown" are never kept: the first lost sample is seen at once.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import msgspec
from pydantic import BaseModel, Field

from imuscope.server.extensions.fleet.model.reports import RobotDevice, RobotStatus

RobotState = Literal["live", "lost"]
SettingsState = Literal["unknown", "as-profile", "drifted"]
PagesAllowed = Literal["off", "view", "control"]


class RobotAlarm(BaseModel):
    """An alarm of a robot that is raised."""

    name: str
    level: str = Field(description="info, warning or error, or another one of a later version")
    state: str = Field(description="raised, acknowledged, missing (raised, and at present without data), or another")
    device: str = Field(description="id of the robot's device; empty if it is for none")
    condition: str = Field("", description="of the fleet server's own: lost, loss, settings or disk; else empty")
    acknowledged_by: str = Field("", description="of the fleet server's own: name of the person")


class RobotSummary(BaseModel):
    """Row of the fleet page: link, recorder, disk, alarms and devices of one robot."""

    name: str
    group: str = Field(description="empty if it is in none")
    state: RobotState
    since: float = Field(description="unix s of the fleet server: when it came, or was lost")
    latency_ms: float | None = Field(description="round trip between robot and fleet server; null if unknown")
    version: str = Field(description="of its imuscope")
    address: str = Field(description="of its own page; empty if it gave none")
    pages: str = Field(
        description="what the fleet server may do with its pages at /robots/NAME/: off, view, control, or another word"
    )
    recording: bool
    disk_free_bytes: int | None = Field(description="of its data folder; null if unknown")
    settings: SettingsState = Field(description="compared with the profile of its group")
    drifted: int = Field(description="number of settings that differ from the profile")
    alarms: list[RobotAlarm] = Field(description="those that are raised")
    devices: list[RobotDevice]
    same_name: int = Field(0, description="other live robots that have this name, shown as `NAME (2)` and so on")
    more: dict[str, str] = Field(default_factory=dict, description="what a later version reports, by name")


class FleetRobots(BaseModel):
    """Robots of a fleet: all, or those that changed after a revision."""

    revision: int = Field(description="to be sent as `after` with the next request")
    time: float = Field(description="clock of the fleet server, unix s")
    complete: bool = Field(description="all robots are listed: any other that the client knows has gone")
    gone: list[str] = Field(description="names of robots that were removed since")
    robots: list[RobotSummary]


_STEPS: Mapping[str, tuple[int, float]] = {
    "rate": (3, 0.1),
    "expected_rate": (4, 0.01),
    "loss": (2, 0.0001),
    "temperature": (3, 0.5),
    "clock_ppm": (2, 1.0),
    "clock_ppm_uncertainty": (2, 0.5),
    "clock_uncertainty_ms": (2, 0.02),
}
"""Figure of a device → its digits, and the least step; the larger step counts."""


def with_hysteresis(new: RobotSummary, shown: RobotSummary | None) -> RobotSummary:
    """`new`, with the figures of `shown` where they differ by less than a step; others are rounded to a step."""
    before = {} if shown is None else {one.id: one for one in shown.devices}
    free = _with_hysteresis(new.disk_free_bytes, None if shown is None else shown.disk_free_bytes, 3, 1e7)
    return new.model_copy(
        update={
            "latency_ms": _with_hysteresis(new.latency_ms, None if shown is None else shown.latency_ms, 2, 5.0),
            "disk_free_bytes": None if free is None else int(free),
            "devices": [_device(one, before.get(one.id)) for one in new.devices],
        }
    )


def _device(new: RobotDevice, shown: RobotDevice | None) -> RobotDevice:
    changes: dict[str, Any] = {
        name: _with_hysteresis(getattr(new, name), None if shown is None else getattr(shown, name), *steps)
        for name, steps in _STEPS.items()
    }
    return replace(new, **changes)


def _with_hysteresis(new: float | None, shown: float | None, digits: int, least: float) -> float | None:
    if new is None or not math.isfinite(new):
        return None
    if shown is not None and (new == 0) == (shown == 0) and abs(new - shown) < _step(shown, digits, least):
        return shown
    step = _step(new, digits, least)
    return float(f"{round(new / step) * step or new:.{digits + 1}g}")


def _step(value: float, digits: int, least: float) -> float:
    return max(10.0 ** (math.floor(math.log10(abs(value))) - digits + 1), least) if value else least


def summary_of(name: str, status: RobotStatus, since: float, *, is_live: bool = True) -> RobotSummary:
    """A status as the page shows it."""
    return RobotSummary(
        name=name,
        group=status.group,
        state="live" if is_live else "lost",
        since=since,
        latency_ms=status.latency_ms,
        version=status.version,
        address=status.address,
        pages=status.pages,
        recording=status.recording,
        disk_free_bytes=status.disk_free_bytes,
        settings="unknown",
        drifted=0,
        same_name=0,
        alarms=[RobotAlarm.model_validate(msgspec.structs.asdict(one)) for one in status.alarms],
        devices=list(status.devices),
        more=status.more,
    )
