"""Plan of a rollout: which devices of a group differ from its profile, what would be written, and who is left out."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from protocols.transactions import DeviceDriver
from server.configuration.dangers import dangers_of_write
from server.errors import DomainError
from server.fleet.device_settings import DeviceSettings
from server.fleet.group_profiles import GroupProfile, GroupProfiles, SettingsCheck
from server.fleet.rollout_models import DeviceLeftOut, PlannedDevice, ProfileOrigin, RolloutChange
from server.fleet.summaries import RobotDevice, RobotSummary
from server.wire_codec import to_json_safe

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
    """

    id: str
    profile: GroupProfile
    wanted: DeviceSettings
    devices: tuple[DeviceChange, ...]
    left_out: tuple[DeviceLeftOut, ...]
    same: int

    @property
    def origin(self) -> ProfileOrigin:
        """Origin of the profile."""
        one = self.profile
        return ProfileOrigin(robot=one.robot, device=one.device, by=one.by, time=one.time)


def plan_of(
    profiles: GroupProfiles, robots: Iterable[RobotSummary], profile: GroupProfile, driver: DeviceDriver
) -> GroupPlan:
    """The plan of a profile.

    Raises:
        DomainError: it concerns too many devices.
    """
    wanted = profile.settings
    found: list[DeviceChange] = []
    left_out: list[DeviceLeftOut] = []
    same = 0
    for robot in sorted((one for one in robots if one.group == profile.group), key=lambda one: one.name):
        for device in robot.devices:
            if (device.protocol, device.product) != (wanted.protocol, wanted.product):
                continue
            check = profiles.check(robot.group, device)
            if check.state == "as-profile":
                same += 1
                continue
            change = _change(profiles, device, robot.name, check, driver)
            why = _obstacle(robot, device, check, change)
            if change is None or why:
                named = {"robot": robot.name, "device": device.id, "name": device.name}
                left_out.append(DeviceLeftOut(**named, why=why))
            else:
                found.append(change)
    if len(found) > MAX_DEVICES:
        hint = "Split the group, or write to some of the robots on their own pages first."
        raise DomainError("full", f"A rollout can have {MAX_DEVICES} devices; this one has {len(found)}.", hint)
    parts = [profile.time, *([one.shown.robot, one.shown.device, one.changes, one.base] for one in found)]
    digest = hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]
    settings = DeviceSettings(wanted.protocol, wanted.product, wanted.firmware, wanted.values)
    return GroupPlan(digest, profile, settings, tuple(found), tuple(left_out), same)


def _obstacle(robot: RobotSummary, device: RobotDevice, check: SettingsCheck, change: DeviceChange | None) -> str:
    if robot.state == "lost":
        return "The robot is lost."
    if robot.pages != "control":
        return 'The robot does not allow it: set pages = "control" in the table [fleet] of its configuration file.'
    if check.state == "unknown":
        return check.why
    if device.status != "live":
        return f"The device is {device.status}."
    return "" if change is not None else "What differs cannot be written."


def _change(
    profiles: GroupProfiles, device: RobotDevice, robot: str, check: SettingsCheck, driver: DeviceDriver
) -> DeviceChange | None:
    known, found = profiles.settings_of(device), check.difference
    if known is None or found is None or not found.changes:
        return None
    rows = {row.name: row for row in driver.settings(known.context)}
    risks: list[str] = []
    for name, values in found.changes.items():
        try:
            dangers = dangers_of_write(driver, rows[name], known.values.get(name), values, known.context)
        except Exception:  # values from the bus can have any shape below the names; the robot checks them again
            return None
        risks += [one.consequence for one in dangers]
    shown = PlannedDevice(
        robot=robot,
        device=device.id,
        name=device.name or device.product,
        changes=[RolloutChange(title=row.title, now=row.left, profile=row.right) for row in found.rows],
        risks=list(dict.fromkeys(risks)),
    )
    base = {name: known.values[name] for name in found.changes if name in known.values}
    return DeviceChange(shown, to_json_safe(found.changes), to_json_safe(base))
