"""Routes of a fleet server: settings of robots against the profiles of their groups."""

import time
from typing import Annotated

from fastapi import Query
from pydantic import BaseModel, Field

from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.reports import RobotDevice
from imuscope.server.extensions.fleet.model.rollout_models import ProfileOrigin
from imuscope.server.extensions.fleet.model.summaries import RobotSummary, SettingsState
from imuscope.server.extensions.fleet.rollouts.group_profiles import SettingsCheck
from imuscope.server.extensions.fleet.server.fleet_server import FleetServer
from imuscope.server.extensions.fleet.server.robot_routes import TheFleetServer

router = lazy_router(prefix="/api/fleet/robots", tags=["fleet"])


class SettingDifference(BaseModel):
    """A setting whose value differs from the profile, with both values."""

    title: str = Field(description="as on the page Configure")
    unit: str
    profile: str = Field(description="as text; empty if the profile does not have it")
    robot: str = Field(description="the same for the robot")


class DeviceSettingsCheck(BaseModel):
    """A device against the profile of its group."""

    device: str = Field(description="id")
    name: str
    state: SettingsState
    why: str = Field(description="why it is unknown; empty otherwise")
    read: float | None = Field(description="clock of the robot, unix s: when its settings were read; null if unknown")
    profile: ProfileOrigin | None
    same: int = Field(description="number of fields that are as in the profile")
    rows: list[SettingDifference]
    missing: dict[str, str] = Field(description="setting → why it could not be compared")


class ProfileRequest(BaseModel):
    """A device, and the name of the operator."""

    device: str = Field(max_length=100, description="id of the robot's device")
    by: str = Field(max_length=200, description="name of the person")


def _robot(server: FleetServer, name: str) -> RobotSummary:
    robot = server.robots.get(name)
    if robot is None:
        raise DomainError("not-found", f"Robot {name:.80} not found.", "Choose one of the list.")
    return robot


def device_of(server: FleetServer, robot: str, device: str) -> tuple[RobotSummary, RobotDevice]:
    """A robot and a device of it; DomainError if there is none."""
    summary = _robot(server, robot)
    for one in summary.devices:
        if one.id == device:
            return summary, one
    raise DomainError("not-found", f"Device {device:.80} not found.", "The robot may have another one by now.")


def _answer(device: RobotDevice, check: SettingsCheck) -> DeviceSettingsCheck:
    difference, profile = check.difference, check.profile
    return DeviceSettingsCheck(
        device=device.id,
        name=device.name,
        state=check.state,
        why=check.why,
        read=device.settings_read,
        profile=None if profile is None else profile.origin,
        same=0 if difference is None else difference.same,
        rows=[
            SettingDifference(title=row.title, unit=row.unit, profile=row.right, robot=row.left)
            for row in (() if difference is None else difference.rows)
        ],
        missing={} if difference is None else difference.missing,
    )


@router.get("/{robot}/settings", responses=responses(404, 409, 422))
async def compare_settings(robot: str, server: TheFleetServer) -> list[DeviceSettingsCheck]:
    """Settings of a robot's devices against the profiles of its group."""
    summary = _robot(server, robot)
    return [_answer(one, server.profiles.check(summary.group, one)) for one in summary.devices]


@router.post("/{robot}/profile", responses=responses(404, 409, 422, 507))
async def use_profile(robot: str, body: ProfileRequest, server: TheFleetServer) -> list[DeviceSettingsCheck]:
    """Make the settings of a device the profile of its group, for its product. Nothing is written to any robot."""
    summary, device = device_of(server, robot, body.device)
    profile = server.profiles.use(summary, device, body.by, time.time())
    server.profile_changed(
        summary, f"The settings of {device.name} are the profile of {_group(summary)} now", profile.by
    )
    return await compare_settings(robot, server)


@router.delete("/{robot}/profile", responses=responses(404, 409, 422, 507))
async def remove_profile(
    robot: str,
    server: TheFleetServer,
    device: Annotated[str, Query(max_length=100, description="id of the robot's device")],
    by: Annotated[str, Query(max_length=200, description="name of the person")],
) -> list[DeviceSettingsCheck]:
    """Remove the profile that a device is compared with."""
    summary, one = device_of(server, robot, device)
    server.profiles.remove(summary, one, by)
    server.profile_changed(summary, f"The profile of {_group(summary)} for {one.product} was removed", by)
    return await compare_settings(robot, server)


def _group(robot: RobotSummary) -> str:
    return f"the group {robot.group}" if robot.group else "the robots without a group"
