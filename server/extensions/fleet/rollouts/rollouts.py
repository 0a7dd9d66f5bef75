"""Rollouts of a fleet server: the profile of a group, applied to its devices in waves, with a stop at a failure.

    plan ─> shown to a user ─> start, with the id of that plan ─> wave 1 ─> wave 2 ─> …
                                       │                              └─ a device failed, or stop: the rest stays
                                       └─ <data>/fleet/rollouts/ID.json, before anything is sent, and with each state

A rollout is a task of this server, independent of viewers. It does not survive the server: after a restart the file
lists the interrupted devices, and nothing is sent again. A user makes a new plan, from the settings of the robots at
that time.
"""

import asyncio
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from imuscope.protocols.commands.transactions import DeviceDriver
from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import read_regular
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.operators import operator_name
from imuscope.server.extensions.fleet.model.reports import RobotDevice
from imuscope.server.extensions.fleet.model.robots import Robots
from imuscope.server.extensions.fleet.model.rollout_models import (
    BAD,
    Rollout,
    RolloutDevice,
    RolloutDeviceState,
    RolloutPlan,
    wave_sizes,
)
from imuscope.server.extensions.fleet.model.summaries import RobotSummary
from imuscope.server.extensions.fleet.rollouts.group_profiles import GroupProfiles
from imuscope.server.extensions.fleet.rollouts.rollout_plan import DeviceChange, GroupPlan, plan_of
from imuscope.server.extensions.fleet.rollouts.rollout_steps import DeviceRollout, RolloutTiming
from imuscope.server.extensions.fleet.tunnel.http_tunnel_server import RobotPages
from imuscope.server.extensions.fleet.tunnel.robot_line import RobotLine

log = logging.getLogger("imuscope.fleet")

MAX_RUNNING = 24  # devices of a wave
MAX_ROLLOUTS = 50
BROKEN = "An internal error of the fleet server ended it; its log has the reason."
Note = Callable[[str, str, str], None]
"""Stores an event: robot or "", level, text."""


class RolloutFiles:
    """The folder of rollouts.

    Args:
        folder: of the fleet within the data folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "rollouts"

    def all(self) -> list[Rollout]:
        """Stored rollouts, the oldest first. A file that cannot be read is logged, and stays."""
        rollouts = []
        for path in sorted(self._folder.glob("*.json")) if self._folder.is_dir() else []:
            try:
                rollouts.append(Rollout.model_validate_json(read_regular(path)))
            except (OSError, ValueError) as error:
                log.error("%s cannot be read: %s", path, type(error).__name__)
        return sorted(rollouts, key=lambda one: one.id)

    def next_id(self) -> int:
        """A number that no file has."""
        names = [path.stem for path in self._folder.glob("*.json")] if self._folder.is_dir() else []
        return max((int(name) for name in names if name.isdecimal()), default=0) + 1

    def save(self, number: int, text: str) -> None:
        """Write a rollout durably.

        Raises:
            DomainError: it cannot be written.
        """
        try:
            atomic_write.write_atomic(self._folder / f"{number:06d}.json", text)
        except OSError as error:
            message = f"The state of the rollout cannot be stored: {error.strerror or error}."
            raise DomainError("disk", message, "Free space in the data folder, or make it writable.") from None

    def remove(self, number: int) -> None:
        try:
            atomic_write.remove(self._folder / f"{number:06d}.json")
        except OSError as error:
            log.warning("Rollout %d cannot be removed: %s", number, error.strerror or error)


@dataclass
class _Run:
    """A rollout that is under way.

    Args:
        changed, stored: numbers of the present state, and of the newest one on disk.
    """

    rollout: Rollout
    plan: GroupPlan
    driver: DeviceDriver
    is_halted: bool = False
    changed: int = 0
    stored: int = 0
    lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    task: asyncio.Task[None] | None = None


class Rollouts:
    """Rollouts. To be used in the event loop.

    Args:
        note: stores an event.
    """

    def __init__(
        self,
        files: RolloutFiles,
        robots: Robots,
        profiles: GroupProfiles,
        pages: RobotPages,
        note: Note,
        timing: RolloutTiming | None = None,
    ) -> None:
        self._files, self._robots, self._profiles, self._pages = files, robots, profiles, pages
        self._note, self._timing = note, timing or RolloutTiming()
        self._all = {one.id: one for one in files.all()}
        self._next = files.next_id()
        self._runs: dict[int, _Run] = {}

    def start(self) -> None:
        """Mark rollouts that the last shutdown interrupted."""
        for one in self._all.values():
            if one.state == "running":
                self._interrupt(one)

    def _interrupt(self, rollout: Rollout) -> None:
        rollout.interrupt(time.time())
        for one in rollout.devices:
            if one.state == "unknown":
                self._log(rollout, one)
        text = f"Rollout {rollout.id} of {rollout.by} was interrupted: the fleet server ended."
        self._note("", "warning", text)
        log.warning("%s", text)
        try:
            self._files.save(rollout.id, rollout.model_dump_json())
        except DomainError as error:
            log.error("%s", error.message)

    # ── for requests ─────────────────────────────────────────────────────────────────────────────────────────────────

    def all(self) -> list[Rollout]:
        """Rollouts, the newest first."""
        return sorted(self._all.values(), key=lambda one: -one.id)

    def get(self, number: int) -> Rollout:
        """A rollout.

        Raises:
            DomainError: there is none of this number.
        """
        rollout = self._all.get(number)
        if rollout is None:
            raise DomainError("not-found", f"Rollout {number} not found.", "Choose one of the list.")
        return rollout

    def plan(self, robot: RobotSummary, device: RobotDevice, waves: str) -> RolloutPlan:
        """Plan of a rollout of the profile that a device is compared with.

        Raises:
            DomainError: there is no profile, or the waves are not valid.
        """
        plan, _ = self._plan(robot, device)
        return RolloutPlan(
            id=plan.id,
            group=plan.profile.group,
            product=plan.target.product,
            profile=plan.profile.origin,
            devices=[one.shown for one in plan.devices],
            changes=list(plan.changes),
            left_out=list(plan.left_out),
            same=plan.same,
            waves=wave_sizes(waves, len(plan.devices)),
            running=self._running(plan),
        )

    def _plan(self, robot: RobotSummary, device: RobotDevice) -> tuple[GroupPlan, DeviceDriver]:
        profile, driver = self._profiles.profile_of(robot.group, device)
        return plan_of(self._profiles, self._robots.summaries.values(), profile, driver), driver

    def _running(self, plan: GroupPlan) -> int | None:
        key = plan.profile.group, plan.target.protocol, plan.target.product
        for number, run in self._runs.items():
            is_same = (run.rollout.group, run.rollout.protocol, run.rollout.product) == key
            if is_same and run.rollout.state == "running":  # otherwise only its end is still being stored
                return number
        return None

    async def begin(
        self, robot: RobotSummary, device: RobotDevice, by: str, *, plan_id: str, waves: str, watch_s: float
    ) -> Rollout:
        """Start a rollout from a reviewed plan.

        Raises:
            DomainError: something else would be done by now, one is under way already, there is nothing to do, the
                name is missing, or the state cannot be stored.
        """
        name = operator_name(by)
        plan, driver = self._plan(robot, device)
        sizes = wave_sizes(waves, len(plan.devices))
        running = self._running(plan)
        if running is not None:
            raise DomainError(
                "busy", f"Rollout {running} of this profile is under way.", "Wait for its end, or stop it."
            )
        if plan.id != plan_id:
            hint = "Look at the new plan, and start that one."
            raise DomainError("changed", "The plan has changed since it was shown; nothing was sent.", hint)
        if not plan.devices:
            hint = "The plan says why the others are left out."
            raise DomainError("not-now", "There is no device to write to.", hint)
        numbers = [number for number, size in enumerate(sizes, 1) for _ in range(size)]
        rollout = Rollout(
            id=self._next,
            group=plan.profile.group,
            product=plan.target.product,
            protocol=plan.target.protocol,
            profile=plan.profile.origin,
            by=name,
            started=time.time(),
            watch_s=watch_s,
            waves=sizes,
            devices=[
                RolloutDevice(**one.shown.model_dump(), wave=number)
                for one, number in zip(plan.devices, numbers, strict=True)
            ],
            changes=list(plan.changes),
        )
        self._next += 1
        run = self._runs[rollout.id] = _Run(rollout, plan, driver)  # before the disk is waited for: no second one
        try:
            await self._save(run)
        except DomainError:
            del self._runs[rollout.id]
            raise
        self._all[rollout.id] = rollout
        text = f"Rollout {rollout.id} to {len(plan.devices)} devices of {_group(rollout)} was started by {name}."
        self._note("", "info", text)
        log.warning("%s", text)
        run.task = asyncio.create_task(self._carry_out(run), name=f"rollout {rollout.id}")
        return rollout

    def stop(self, number: int, by: str) -> Rollout:
        """Begin with no further device. Those that are under way are finished: confirmed, or rolled back.

        Raises:
            DomainError: it is not under way, or the name is missing.
        """
        name = operator_name(by)
        rollout, run = self.get(number), self._runs.get(number)
        if run is None or rollout.state != "running":
            raise DomainError("not-now", f"Rollout {number} is not under way.", "It has ended.")
        if not rollout.stopped_by:
            rollout.stopped_by = name
            self._note("", "info", f"Rollout {number} was stopped by {name}.")
            log.warning("Rollout %d was stopped by %s.", number, name)
        run.is_halted = True
        return rollout

    async def close(self) -> None:
        """Cancel running rollouts. Robots complete or roll back their pending change."""
        tasks = [run.task for run in self._runs.values() if run.task is not None]
        await end_tasks(*tasks)

    # ── the task ─────────────────────────────────────────────────────────────────────────────────────────────────────

    async def _carry_out(self, run: _Run) -> None:
        rollout = run.rollout
        changes = {(one.shown.robot, one.shown.device): one for one in run.plan.devices}
        try:
            for number in range(1, len(rollout.waves) + 1):
                rollout.wave = number
                gate = asyncio.Semaphore(MAX_RUNNING)
                mine = [one for one in rollout.devices if one.wave == number]
                async with asyncio.TaskGroup() as group:
                    for one in mine:
                        group.create_task(self._device(run, one, changes[one.robot, one.device], gate))
                if any(one.state in BAD for one in mine) or run.is_halted:
                    break
            self._end(run)
            await self._save_quietly(run)
        except asyncio.CancelledError:
            self._interrupt(rollout)
            raise
        except Exception:
            log.exception("rollout %d failed", rollout.id)
            rollout.end("failed", BROKEN, time.time())
            await self._save_quietly(run)
        finally:
            del self._runs[rollout.id]
            self._forget_old()

    def _end(self, run: _Run) -> None:
        rollout = run.rollout
        bad = [one for one in rollout.devices if one.state in BAD]
        waiting = sum(one.state == "waiting" for one in rollout.devices)
        now = time.time()
        if bad:
            more = f" So did {len(bad) - 1} more." if len(bad) > 1 else ""
            rest = "" if not waiting else f" {waiting} {'was' if waiting == 1 else 'were'} not started."
            rollout.end("failed", f"{bad[0].robot}, {bad[0].name}: {bad[0].words}{more}{rest}", now)
        elif waiting:
            rollout.end("stopped", f"Stopped by {rollout.stopped_by}: {waiting} not started.", now)
        else:
            left = sum(one.state == "left" for one in rollout.devices)
            words = f"{left} of {len(rollout.devices)} left out." if left else ""
            rollout.end("done", words, now)
        text = f"Rollout {rollout.id} of {rollout.by} to {_group(rollout)}: {rollout.state}. {rollout.words}".strip()
        self._note("", "error" if bad else "info", text)
        log.warning("%s", text)

    async def _device(self, run: _Run, one: RolloutDevice, change: DeviceChange, gate: asyncio.Semaphore) -> None:
        async with gate:
            if run.is_halted:
                return
            robot = self._robots.get(one.robot)
            if robot is None or robot.state == "lost" or robot.pages != "control":
                why = "The robot was lost" if robot is None or robot.state == "lost" else "The robot did not allow it"
                one.state, one.words, one.time = "left", f"{why} before anything was sent.", time.time()
            else:
                await self._write(run, one, change)
            self._log(run.rollout, one)
            run.is_halted |= one.state in BAD
            await self._save_quietly(run)

    async def _write(self, run: _Run, one: RolloutDevice, change: DeviceChange) -> None:
        rollout = run.rollout

        async def report(state: RolloutDeviceState, words: str) -> None:
            one.state, one.words, one.time = state, words, time.time()
            await self._save(run)

        who = f"{rollout.by}, rollout {rollout.id}"
        device = DeviceRollout(
            RobotLine(self._pages, one.robot, who),
            change,
            run.plan.target,
            run.driver,
            watch_s=rollout.watch_s,
            reason=f"Before the profile of {_group(rollout)}, by {who}.",
            report=report,
            timing=self._timing,
        )
        try:
            outcome = await device.carry_out()
            one.state, one.words = outcome.state, outcome.words
        except Exception:
            log.exception("rollout %d: %s", rollout.id, one.robot)
            one.state, one.words = "unknown", BROKEN
        one.time = time.time()

    def _log(self, rollout: Rollout, one: RolloutDevice) -> None:
        level = {"done": "info", "failed": "error", "unknown": "error"}.get(one.state, "warning")
        text = f"Rollout {rollout.id} of {rollout.by}, {one.name}: {one.state}. {one.words}"
        self._note(one.robot, level, text)
        log.info("%s: %s", one.robot, text)

    async def _save(self, run: _Run) -> None:
        """Store the present state, together with other changes of this moment.

        Raises:
            DomainError: it cannot be written.
        """
        run.changed += 1
        mine = run.changed
        async with run.lock:
            if run.stored >= mine:
                return
            number = run.changed
            await asyncio.to_thread(self._files.save, run.rollout.id, run.rollout.model_dump_json())
            run.stored = number

    async def _save_quietly(self, run: _Run) -> None:
        try:
            await self._save(run)
        except DomainError as error:
            log.error("%s", error.message)

    def _forget_old(self) -> None:
        ended = [number for number in sorted(self._all) if number not in self._runs]
        for number in ended[:-MAX_ROLLOUTS]:
            del self._all[number]
            self._files.remove(number)


def _group(rollout: Rollout) -> str:
    return f"the group {rollout.group}" if rollout.group else "the robots without a group"
