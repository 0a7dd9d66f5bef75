"""Profiles of groups: the settings that the devices of a group should have, and how far each robot is from them.

    digest in a status ──> known here?  no ──> the settings are requested once for all robots with this digest
                             │
    profile of the group ────┴──> difference, kept for the pair of digests ──> "as-profile", "drifted" with a number

A profile is for a product: a group with two products has two. It is taken from a robot by a user, and kept in
<data>/fleet/profiles.json with who did so and when. Settings of robots are in memory only, because robots have them.
"""

import logging
import math
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from imuscope.protocols.commands.transactions import DeviceDriver
from imuscope.recordings.system import atomic_write
from imuscope.server.configuration.api_models import Difference
from imuscope.server.configuration.controllers import driver_of
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.device_settings import (
    DeviceSettings,
    decode_settings,
    difference,
)
from imuscope.server.extensions.fleet.model.operators import operator_name
from imuscope.server.extensions.fleet.model.reports import ReportError, RobotDevice
from imuscope.server.extensions.fleet.model.rollout_models import ProfileOrigin
from imuscope.server.extensions.fleet.model.summaries import RobotSummary, SettingsState

log = logging.getLogger("imuscope.fleet")

FILE = "profiles.json"
MAX_PROFILES = 200
MAX_KNOWN = 5000
MAX_DIFFERENCES = 10_000
REQUEST_INTERVAL_S = 5.0


class GroupProfile(msgspec.Struct, frozen=True):
    """A profile.

    Args:
        robot, device: that it was taken from; the device by its displayed name.
        by: the user.
        time: unix s of the fleet server.
    """

    group: str
    robot: str
    device: str
    by: str
    time: float
    settings: DeviceSettings

    @property
    def origin(self) -> ProfileOrigin:
        """Robot, device and operator, as they are shown."""
        return ProfileOrigin(robot=self.robot, device=self.device, by=self.by, time=self.time)


class _ProfileFile(msgspec.Struct):
    profiles: Annotated[list[GroupProfile], Meta(max_length=MAX_PROFILES)] = []
    imuscope: int = 1


@dataclass(frozen=True, slots=True)
class SettingsCheck:
    """A device against the profile of its group.

    Args:
        why: of unknown, as one sentence.
        difference: None if it is unknown; its left side is the robot, its right side the profile.
    """

    state: SettingsState
    why: str = ""
    profile: GroupProfile | None = None
    difference: Difference | None = None


class GroupProfiles:
    """Profiles and settings. To be used in one thread.

    Args:
        folder: of the fleet within the data folder.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE
        self._profiles: dict[tuple[str, str, str], GroupProfile] = {}
        self._known: OrderedDict[str, DeviceSettings] = OrderedDict()
        # robot, device → digest of settings that are not known here
        self._unknown_digests: dict[tuple[str, str], str] = {}
        self._requested_at: OrderedDict[str, float] = OrderedDict()
        self._differences: OrderedDict[tuple[str, str], Difference | None] = OrderedDict()
        self.problem = ""
        try:
            stored = msgspec.json.decode(self._path.read_bytes(), type=_ProfileFile)
        except FileNotFoundError:
            return
        except (OSError, msgspec.MsgspecError, UnicodeDecodeError) as error:
            self.problem = f"The profiles of groups cannot be read, and are not applied: {error!s:.200}."
            log.error("%s Repair or remove %s.", self.problem, self._path)
            return
        for one in stored.profiles:
            self._profiles[one.group, one.settings.protocol, one.settings.product] = one

    def judged(self, robot: RobotSummary) -> RobotSummary:
        """A summary with how far the robot is from the profiles of its group. Unknown settings are requested later."""
        there = {device.id for device in robot.devices}
        for key in [key for key in self._unknown_digests if key[0] == robot.name and key[1] not in there]:
            del self._unknown_digests[key]  # it would be requested for ever
        for device in robot.devices:
            if robot.state == "live" and device.settings and device.settings not in self._known:
                self._unknown_digests[robot.name, device.id] = device.settings
        if not self._profiles:
            return robot
        checks = [self.check(robot.group, one) for one in robot.devices]
        rows = sum(len(one.difference.rows) for one in checks if one.difference is not None)
        relevant = {one.state for one in checks if one.profile is not None}
        state: SettingsState = "drifted" if rows else "as-profile" if relevant == {"as-profile"} else "unknown"
        devices = [self._with_rate(robot.group, one) for one in robot.devices]
        return robot.model_copy(update={"settings": state, "drifted": rows, "devices": devices})

    def check(self, group: str, device: RobotDevice) -> SettingsCheck:
        """A device against the profile of its group."""
        profile = self._profiles.get((group, device.protocol, device.product))
        if profile is None:
            return SettingsCheck("unknown", "Its group has no profile for this product.")
        if not device.settings:
            why = "The robot does not know its settings: read them once on its page Configure."
            return SettingsCheck("unknown", why, profile)
        if device.settings not in self._known:
            return SettingsCheck("unknown", "The settings were requested from the robot.", profile)
        difference = self._difference(device.settings, profile.settings)
        if difference is None:
            return SettingsCheck("unknown", "Its settings cannot be compared; the log has details.", profile)
        return SettingsCheck("drifted" if difference.rows else "as-profile", "", profile, difference)

    def applies(self, robot: RobotSummary) -> bool:
        return any((robot.group, one.protocol, one.product) in self._profiles for one in robot.devices)

    def profile_of(self, group: str, device: RobotDevice) -> tuple[GroupProfile, DeviceDriver]:
        """The profile of a group for a device's product, and what it is written with.

        Raises:
            DomainError: there is none, or this version cannot use it.
        """
        profile = self._profiles.get((group, device.protocol, device.product))
        if profile is None:
            hint = "Make the settings of a device the profile first."
            raise DomainError("not-found", f"The group has no profile for {device.product:.80}.", hint)
        protocol = profile.settings.protocol
        driver = driver_of(protocol)
        if driver is None:
            raise DomainError(
                "no-driver", f"Devices of {protocol:.40} cannot be configured.", "Update the fleet server."
            )
        return profile, driver

    def settings_of(self, device: RobotDevice) -> DeviceSettings | None:
        """Settings of a device; None if they are not known here."""
        return self._known.get(device.settings)

    def _difference(self, digest: str, target: DeviceSettings) -> Difference | None:
        key = digest, target.digest
        if key not in self._differences:
            driver = driver_of(target.protocol)
            result = None
            if driver is not None:
                try:
                    result = difference(driver, target, self._known[digest])
                except ReportError as error:
                    log.warning("%s", error)
            self._differences[key] = result
            while len(self._differences) > MAX_DIFFERENCES:
                self._differences.popitem(last=False)
        return self._differences[key]

    def _with_rate(self, group: str, device: RobotDevice) -> RobotDevice:
        """A device whose rate by its settings is unknown is expected to have that of the profile."""
        profile = self._profiles.get((group, device.protocol, device.product))
        driver = None if profile is None else driver_of(profile.settings.protocol)
        if device.expected_rate is not None or profile is None or driver is None:
            return device
        rate = None
        with suppress(Exception):  # values that came from the bus
            rate = driver.message_rate(profile.settings.values, profile.settings.context)
        return device if rate is None else replace(device, expected_rate=rate)

    def questions(self, now: float, limit: int) -> Iterator[tuple[str, str]]:
        """Robots and devices whose settings are to be requested now: one for each digest, another one if no answer
        comes.
        """
        for (robot, device), digest in list(self._unknown_digests.items()):
            if digest in self._known:
                del self._unknown_digests[robot, device]
            elif limit > 0 and self._requested_at.get(digest, -math.inf) + REQUEST_INTERVAL_S <= now:
                limit -= 1
                del self._unknown_digests[robot, device]  # to the end
                self._unknown_digests[robot, device] = digest
                self._requested_at[digest] = now
                self._requested_at.move_to_end(digest)
                while len(self._requested_at) > MAX_KNOWN:
                    self._requested_at.popitem(last=False)
                yield robot, device

    def forget_question(self, robot: str, device: str) -> None:
        """Drop a question to a robot that is lost; it is repeated when the robot reports again."""
        self._unknown_digests.pop((robot, device), None)

    def learn(self, data: bytes) -> str:
        """Take settings that a robot sent; returns their digest.

        Raises:
            ReportError: they are invalid.
        """
        settings = decode_settings(data)
        self._known[settings.digest] = settings
        self._known.move_to_end(settings.digest)
        while len(self._known) > MAX_KNOWN:
            self._known.popitem(last=False)
        return settings.digest

    def use(self, robot: RobotSummary, device: RobotDevice, by: str, time: float) -> GroupProfile:
        """Make the settings of a device the profile of its robot's group.

        Raises:
            DomainError: they are unknown, the name is missing, there are too many profiles, or the disk is full.
        """
        name = operator_name(by)
        known = self._known.get(device.settings)
        if known is None:
            hint = "Read them once on the page Configure of the robot, and try again when it is live."
            raise DomainError("not-now", f"The settings of {device.name:.80} are not known.", hint)
        key = robot.group, device.protocol, device.product
        if (known.protocol, known.product) != key[1:]:
            raise DomainError(
                "not-now", f"The settings of {device.name:.80} are of another device.", "Read them again."
            )
        if len(self._profiles) >= MAX_PROFILES and key not in self._profiles:
            raise DomainError("full", f"There are {MAX_PROFILES} profiles already.", "Remove one first.")
        profile = GroupProfile(robot.group, robot.name, device.name, name, time, known)
        self._change({**self._profiles, key: profile})
        return profile

    def remove(self, robot: RobotSummary, device: RobotDevice, by: str) -> None:
        """Remove the profile for a device's product of its robot's group.

        Raises:
            DomainError: there is none, the name is missing, or the disk is full.
        """
        operator_name(by)
        key = robot.group, device.protocol, device.product
        if key not in self._profiles:
            raise DomainError("not-found", "There is no such profile.", "It may have been removed already.")
        self._change({other: one for other, one in self._profiles.items() if other != key})

    def _change(self, profiles: dict[tuple[str, str, str], GroupProfile]) -> None:
        text = msgspec.json.encode(_ProfileFile([*profiles.values()]))
        try:
            atomic_write.write_atomic(self._path, msgspec.json.format(text, indent=1))
        except OSError as error:
            message = f"The profile cannot be stored: {error.strerror or error}."
            raise DomainError("disk", message, "Free space in the data folder, or make it writable.") from None
        self._profiles = profiles
        self.problem = ""
