"""Plan of a rollout: which devices of a group differ from its profile, the changes to write, and devices that are left
out.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from imuscope.protocols.commands.transactions import DeviceDriver
from imuscope.server.configuration.risks import dangers_of_write
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.device_settings import DeviceSettings
from imuscope.server.extensions.fleet.model.reports import RobotDevice
from imuscope.server.extensions.fleet.model.rollout_models import (
    DeviceLeftOut,
    PlannedDevice,
    RolloutChange,
    RolloutChanges,
)
from imuscope.server.extensions.fleet.model.summaries import RobotSummary
from imuscope.server.extensions.fleet.rollouts.group_profiles import GroupProfile, GroupProfiles, SettingsCheck
from imuscope.server.wire.codec import to_json_safe

MAX_DEVICES = 5000


@dataclass(frozen=True, slots=True)
class DeviceChange:
    """Change of a device.

    Args:
        changes: settings to write.
        base: their values as the plan was made; if the device has others by then, it writes nothing.
    """

    shown: PlannedDevice
    changes: Mapping[str, Any]
    base: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class GroupPlan:
    """A plan.

    Args:
        id: digest of all that it would do.
        changes: the different ones, as they are shown.
    """

    id: str
    profile: GroupProfile
    devices: tuple[DeviceChange, ...]
    changes: tuple[RolloutChanges, ...]
    left_out: tuple[DeviceLeftOut, ...]
    same: int

    @property
    def target(self) -> DeviceSettings:
        return self.profile.settings


@dataclass(frozen=True, slots=True)
class _Change:
    """Change of all devices with the same settings.

    Args:
        place: of the shown change.
    """

    place: int
    changes: Mapping[str, Any]
    base: Mapping[str, Any]


class _Changes:
    """Cache of changes by settings digest; a large fleet has few distinct configurations."""

    def __init__(self, profiles: GroupProfiles, driver: DeviceDriver) -> None:
        self.shown: list[RolloutChanges] = []
        self._profiles, self._driver = profiles, driver
        self._made: dict[str, _Change | None] = {}

    def of(self, device: RobotDevice, check: SettingsCheck) -> _Change | None:
        """Change of a device; None if nothing that differs can be written."""
        if device.settings not in self._made:
            self._made[device.settings] = self._make(device, check)
        return self._made[device.settings]

    def _make(self, device: RobotDevice, check: SettingsCheck) -> _Change | None:
        known, difference = self._profiles.settings_of(device), check.difference
        if known is None or difference is None or not difference.changes:
            return None
        rows = {row.name: row for row in self._driver.settings(known.context)}
        risks: list[str] = []
        for name, values in difference.changes.items():
            try:
                dangers = dangers_of_write(self._driver, rows[name], known.values.get(name), values, known.context)
            except Exception:  # values from the bus can have any shape below the names; the robot checks them again
                return None
            risks += [one.consequence for one in dangers]
        shown = RolloutChanges(
            rows=[
                RolloutChange(title=row.title, now=row.left, profile=row.right) for row in difference.rows if row.take
            ],
            risks=list(dict.fromkeys(risks)),
        )
        if shown not in self.shown:
            self.shown.append(shown)
        base = {name: known.values[name] for name in difference.changes if name in known.values}
        return _Change(self.shown.index(shown), to_json_safe(difference.changes), to_json_safe(base))


def plan_of(
    profiles: GroupProfiles, robots: Iterable[RobotSummary], profile: GroupProfile, driver: DeviceDriver
) -> GroupPlan:
    """The plan of a profile.

    Raises:
        DomainError: it concerns too many devices.
    """
    target = profile.settings
    devices: list[DeviceChange] = []
    left_out: list[DeviceLeftOut] = []
    changes = _Changes(profiles, driver)
    parts: list[Any] = [profile.by, profile.time]
    same = 0
    for robot in sorted((one for one in robots if one.group == profile.group), key=lambda one: one.name):
        for device in robot.devices:
            if (device.protocol, device.product) != (target.protocol, target.product):
                continue
            check = profiles.check(robot.group, device)
            if check.state == "as-profile":
                same += 1
                continue
            why = _obstacle(robot, device, check)
            change = None if why else changes.of(device, check)
            named = {"robot": robot.name, "device": device.id, "name": device.name or device.product}
            if change is None:
                left_out.append(DeviceLeftOut(**named, why=why or "What differs cannot be written."))
            else:
                shown = PlannedDevice(**named, change=change.place)
                devices.append(DeviceChange(shown, change.changes, change.base))
                parts.append([robot.name, device.id, device.settings])
    if len(devices) > MAX_DEVICES:
        hint = "Split the group, or write to some of the robots on their own pages first."
        raise DomainError("full", f"A rollout can have {MAX_DEVICES} devices; this one has {len(devices)}.", hint)
    digest = hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]
    return GroupPlan(digest, profile, tuple(devices), tuple(changes.shown), tuple(left_out), same)


def _obstacle(robot: RobotSummary, device: RobotDevice, check: SettingsCheck) -> str:
    if robot.state == "lost":
        return "The robot is lost."
    if robot.pages != "control":
        return 'The robot does not allow it: set pages = "control" in the table [fleet] of its configuration file.'
    if check.state == "unknown":
        return check.why
    return "" if device.status == "live" else f"The device is {device.status}."
