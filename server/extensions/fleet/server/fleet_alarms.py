"""Alarms of a fleet server: conditions that it detects itself, also of robots that are disconnected.

    robots, once a second ──> code of each condition ──> AlarmMachine (alarms/machine.py) of robot and condition
                                                              └──> event, webhook, an alarm in the robot's summary

A condition has a limit and a lower one at which it ends, so that a figure at the limit does not raise an alarm each
second. Of a robot that is lost only "lost" is judged: its other alarms stay as they are. Who acknowledged an alarm is
kept over a restart, in <data>/fleet/alarms.json.
"""

import asyncio
import json
import logging
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.recordings.system import atomic_write
from imuscope.server import wire
from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms.machine import (
    BETWEEN,
    BEYOND,
    UNKNOWN,
    WITHIN,
    AlarmMachine,
    AlarmTiming,
    AlarmTransition,
)
from imuscope.server.extensions.alarms.webhooks import Webhooks, checked_url
from imuscope.server.extensions.fleet.model.fleet_settings import FleetServerSettings
from imuscope.server.extensions.fleet.model.operators import operator_name
from imuscope.server.extensions.fleet.model.summaries import RobotAlarm, RobotSummary

log = logging.getLogger("imuscope.fleet")

FILE = "alarms.json"
ENDS_AT = 0.8  # of a loss: share of the limit below which the alarm ends
DISK_ENDS_AT = 1.1

Judge = Callable[[RobotSummary, float], tuple[int, float]]
"""Summary and unix s → code and value."""
Note = Callable[[str, wire.Level, str], None]
"""Stores an event about a robot."""


@dataclass(frozen=True, slots=True)
class FleetCondition:
    """A condition.

    Args:
        title: name of the alarm.
        words: the value as a sentence.
    """

    id: str
    title: str
    level: wire.Level
    judge: Judge
    words: Callable[[float], str]


def conditions_of(
    settings: FleetServerSettings, has_profile: Callable[[RobotSummary], bool] = lambda robot: True
) -> list[FleetCondition]:
    """The conditions that are switched on.

    Args:
        has_profile: whether the group of a robot has a profile for one of its devices.
    """

    def lost(robot: RobotSummary, now: float) -> tuple[int, float]:
        seconds = max(0.0, now - robot.since)
        if robot.state != "lost":
            return WITHIN, 0.0
        return (BEYOND if seconds > settings.alarm_lost_s else BETWEEN), seconds

    def loss(robot: RobotSummary, now: float) -> tuple[int, float]:
        percent = max((100 * one.loss for one in robot.devices if one.loss is not None), default=0.0)
        return _code(percent, settings.alarm_loss_percent, ENDS_AT * settings.alarm_loss_percent), percent

    def differ(robot: RobotSummary, now: float) -> tuple[int, float]:
        code = {"drifted": BEYOND, "as-profile": WITHIN}.get(robot.settings, UNKNOWN)
        if code == UNKNOWN and not has_profile(robot):
            code = WITHIN
        return code, float(robot.drifted)

    def disk(robot: RobotSummary, now: float) -> tuple[int, float]:
        if robot.disk_free_bytes is None:
            return UNKNOWN, math.nan
        free = robot.disk_free_bytes / 1e9
        return _code(-free, -settings.alarm_disk_gb, -DISK_ENDS_AT * settings.alarm_disk_gb), free

    rows = [
        (
            settings.alarm_lost_s,
            FleetCondition(
                *("lost", f"Lost for longer than {settings.alarm_lost_s:g} s", "error", lost),
                lambda seconds: f"has been lost for {seconds:.0f} s",
            ),
        ),
        (
            settings.alarm_loss_percent,
            FleetCondition(
                *("loss", f"Loss above {settings.alarm_loss_percent:g} %", "warning", loss),
                lambda percent: f"lost {percent:.2g} % of its samples in the last minute",
            ),
        ),
        (
            settings.alarm_settings,
            FleetCondition(
                *("settings", "Settings differ from the profile", "warning", differ),
                lambda n: f"has {n:.0f} setting{'s' * (n != 1)} not as in the profile of its group",
            ),
        ),
        (
            settings.alarm_disk_gb,
            FleetCondition(
                *("disk", f"Less than {settings.alarm_disk_gb:g} GB free", "warning", disk),
                lambda free: f"has {free:.2g} GB free for recordings",
            ),
        ),
    ]
    return [condition for limit, condition in rows if limit]


def _code(value: float, limit: float, end: float) -> int:
    return BEYOND if value > limit else WITHIN if value <= end else BETWEEN


class FleetAlarms:
    """Alarms by robot and condition. To be used in the event loop.

    Args:
        folder: of the fleet within the data folder.
        has_profile: whether the group of a robot has a profile for one of its devices.

    Raises:
        DomainError: the address of the webhook is not valid.
    """

    def __init__(
        self,
        folder: Path,
        settings: FleetServerSettings,
        has_profile: Callable[[RobotSummary], bool] = lambda robot: True,
    ) -> None:
        self.webhooks = Webhooks()
        if settings.alarm_webhook:
            self.webhooks.allowed = (checked_url(settings.alarm_webhook).hostname or "",)  # a setting names it
        self._path = folder / FILE
        self._url = settings.alarm_webhook
        self._conditions = {one.id: one for one in conditions_of(settings, has_profile)}
        self._machines: dict[tuple[str, str], AlarmMachine] = {}
        self.is_changed = False  # since `saved_text`
        self._is_failing = False
        for (robot, condition), saved in _stored(self._path):
            if condition in self._conditions:
                with suppress(TypeError, ValueError):
                    self._machine(robot, condition).restore(saved)

    def _machine(self, robot: str, condition: str) -> AlarmMachine:
        machine = self._machines.get((robot, condition))
        if machine is None:
            direction = -1 if condition == "disk" else 1
            machine = self._machines[robot, condition] = AlarmMachine(AlarmTiming(missing_s=math.inf), direction)
        return machine

    def turn(self, robots: Mapping[str, RobotSummary], now: float, note: Note) -> set[str]:
        """Judge all robots; returns the names of those whose alarms have changed."""
        changed: set[str] = set()
        for name, robot in robots.items():
            for condition in self._conditions.values():
                if robot.state == "lost" and condition.id != "lost":
                    continue
                code, value = condition.judge(robot, now)
                machine = self._machines.get((name, condition.id))
                if code in (BETWEEN, UNKNOWN) or (code == BEYOND) == (machine is not None and machine.is_on):
                    continue
                transitions = self._machine(name, condition.id).feed(
                    np.array([now]), np.array([code], np.int8), np.array([value])
                )
                for transition in transitions:
                    if transition.kind != "data":
                        changed.add(name)
                        self._report(robot, condition, transition, value, note)
        for key in [key for key, one in self._machines.items() if key[0] not in robots or not one.is_active]:
            changed |= {key[0]} & robots.keys()
            del self._machines[key]
            self.is_changed = True
        return changed

    def _report(
        self, robot: RobotSummary, condition: FleetCondition, change: AlarmTransition, value: float, note: Note
    ) -> None:
        self.is_changed = True
        is_raised = change.kind == "raised"
        text = f"{robot.name} {condition.words(value)}." if is_raised else f"{condition.title}: no longer."
        note(robot.name, condition.level if is_raised else "info", text)
        if not self._url:
            return
        body: dict[str, Any] = {
            **{"imuscope": 1, "alarm": condition.id, "name": condition.title, "change": change.kind},
            **{"level": condition.level, "time": change.time, "text": text},
            "robot": {"name": robot.name, "group": robot.group},
        }
        self.webhooks.send(
            condition.id,
            self._url,
            body,
            lambda level, words: note("", level, f"The webhook of “{condition.title}” {words}"),
        )

    def with_alarms(self, robot: RobotSummary) -> RobotSummary:
        """A summary with the alarms that this server has raised for the robot, before those of the robot itself."""
        own = list(self._raised(robot.name))
        return robot.model_copy(update={"alarms": [*own, *robot.alarms]}) if own else robot

    def _raised(self, robot: str) -> Iterator[RobotAlarm]:
        for condition in self._conditions.values():
            machine = self._machines.get((robot, condition.id))
            if machine is not None and machine.is_active:
                ack = machine.acknowledgement
                yield RobotAlarm(
                    name=condition.title,
                    level=condition.level,
                    state="raised" if ack is None else "acknowledged",
                    device="",
                    condition=condition.id,
                    acknowledged_by="" if ack is None else ack.by,
                )

    def acknowledge(self, robot: str, condition: str, by: str, now: float) -> None:
        """Acknowledge an alarm of this server.

        Raises:
            DomainError: it is not raised, or the name is missing.
        """
        name = operator_name(by)
        machine = self._machines.get((robot, condition))
        if machine is None or not machine.is_active:
            hint = "Alarms of the robot itself are acknowledged on its own page."
            raise DomainError("not-now", f"{robot:.80} has no alarm {condition!r:.40} of the fleet server.", hint)
        machine.acknowledge(name, now)
        self.is_changed = True

    def title_of(self, condition: str) -> str:
        return self._conditions[condition].title

    def saved_text(self) -> str:
        """The states as they are stored."""
        self.is_changed = False
        rows = [
            {"robot": robot, "condition": condition, "state": machine.saved()}
            for (robot, condition), machine in self._machines.items()
            if machine.is_active
        ]
        return json.dumps({"imuscope": 1, "alarms": rows})

    def save(self, text: str) -> None:
        """Write the states, in a thread; again later if the disk refuses them."""
        try:
            atomic_write.write_atomic(self._path, text)
        except OSError as error:
            if not self._is_failing:
                log.error("The alarms of the fleet cannot be stored: %s. Free space.", error.strerror or error)
            self._is_failing = self.is_changed = True
        else:
            self._is_failing = False

    async def close(self) -> None:
        """End the webhooks, and store the changes."""
        await self.webhooks.close()
        if self.is_changed:
            await asyncio.to_thread(self.save, self.saved_text())


def _stored(path: Path) -> Iterator[tuple[tuple[str, str], dict[str, Any]]]:
    """Robot, condition and state; nothing of a file that is damaged."""
    try:
        for row in json.loads(path.read_text())["alarms"]:
            yield (str(row["robot"]), str(row["condition"])), dict(row["state"])
    except FileNotFoundError:
        return
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        log.warning("%s is damaged (%s): raised alarms of the fleet are reset.", path, type(error).__name__)
