"""Steps of a rollout at one device, through the robot's own HTTP API.

    apply, temporary for watch_s + confirm_more_s   the robot snapshots, writes, reads back; its record is on its disk
    watch                                           samples at the rate of the profile for watch_s
    read the values that were read back             equal to the profile
    confirm, or roll back                           without either the robot rolls back by itself, line or no line

A write is sent once. A line that fails while the device is only read does no harm; whether a write whose answer
was lost has arrived is looked up, never guessed.
"""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeVar
from urllib.parse import quote

import msgspec

from imuscope.protocols.commands.transactions import DeviceDriver
from imuscope.server.configuration.value_format import numbers
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.device_settings import DeviceSettings, difference, writable_settings
from imuscope.server.extensions.fleet.model.reports import ReportError
from imuscope.server.extensions.fleet.model.rollout_models import UNKNOWN, RolloutDeviceState
from imuscope.server.extensions.fleet.rollouts.rollout_plan import DeviceChange
from imuscope.server.extensions.fleet.tunnel.robot_line import LineError, RobotLine
from imuscope.server.text.printable import printable

RATE_SHARE, RATE_MESSAGES = 0.05, 2.0
"""How far the number of messages may be from the expected one: the larger of a share and a number."""
T = TypeVar("T")
Report = Callable[[RolloutDeviceState, str], Awaitable[None]]


@dataclass(frozen=True, slots=True)
class RolloutTiming:
    """Times, s.

    Args:
        poll_s: between two polls of a device.
        lost_s: a robot that answers nothing for this long is left.
        write_s: time to read, write and read back.
        back_s: time to roll back.
        confirm_more_s: beyond the time of watching: samples have to begin again, and the confirmation has to arrive.
        watch_more_s: beyond it, for a device that does not deliver yet.
    """

    poll_s: float = 1.0
    lost_s: float = 20.0
    write_s: float = 300.0
    back_s: float = 180.0
    confirm_more_s: float = 40.0
    watch_more_s: float = 20.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """End of the steps."""

    state: RolloutDeviceState
    words: str


class _Job(msgspec.Struct):
    id: int
    state: str
    message: str = ""


class _Pending(msgspec.Struct):
    state: str


class _Jobs(msgspec.Struct):
    running: _Job | None = None
    queue: Sequence[_Job] = ()
    done: Sequence[_Job] = ()
    pending_rollback: _Pending | None = None


class _Message(msgspec.Struct):
    name: str
    count: int


class _Health(msgspec.Struct):
    time: float
    messages: Sequence[_Message] = ()


class _Identity(msgspec.Struct):
    product: str = ""
    firmware: str = ""


class _SettingValues(msgspec.Struct):
    info: _Identity
    values: dict[str, dict[str, Any]]


class _EndedError(Exception):
    """The device has reached its end."""

    def __init__(self, state: RolloutDeviceState, words: str) -> None:
        super().__init__(words)
        self.outcome = Outcome(state, words)


class DeviceRollout:
    """One device.

    Args:
        target: the profile.
        reason: stored with the robot's snapshot.
        report: takes the state, and returns when it is on disk; DomainError: it is not.
    """

    def __init__(
        self,
        line: RobotLine,
        change: DeviceChange,
        target: DeviceSettings,
        driver: DeviceDriver,
        *,
        watch_s: float,
        reason: str,
        report: Report,
        timing: RolloutTiming,
    ) -> None:
        self._line, self._change, self._target, self._driver = line, change, target, driver
        self._watch_s, self._reason, self._report, self._timing = watch_s, reason, report, timing
        self._at = f"/api/devices/{quote(change.shown.device, safe='')}"
        self._job = -1

    async def carry_out(self) -> Outcome:
        """Run all steps."""
        try:
            await self._report("applying", "Its settings are read and written.")
        except DomainError as error:
            return Outcome("failed", f"{error.message} Nothing was sent.")
        try:
            await self._check_supported()
            await self._apply()
            if await self._is_temporary():
                await self._keep()
            return Outcome("done", await self._checked())
        except _EndedError as ended:
            return ended.outcome

    async def _check_supported(self) -> None:
        """Check that the robot supports temporary changes before anything is written."""
        try:
            await self._line.get(f"{self._at}/health", _Health)
        except LineError as error:
            raise _EndedError("left", f"{error} Nothing was written.") from None
        except DomainError as error:
            state: RolloutDeviceState = "left" if error.kind == "gone" else "failed"
            raise _EndedError(state, f"{_sentence(error)} Nothing was written.") from None

    async def _apply(self) -> None:
        body = {
            "changes": self._change.changes,
            "base": self._change.base,
            "product": self._target.product,
            "reason": self._reason,
            "confirmed": True,
            "confirm_s": self._watch_s + self._timing.confirm_more_s,
        }
        try:
            self._job = (await self._line.post(f"{self._at}/apply", body, _Job)).id
        except LineError as error:
            raise _EndedError("unknown", f"{error} {UNKNOWN}") from None
        except DomainError as error:
            raise _EndedError("failed", f"{_sentence(error)} Nothing was written.") from None

    async def _is_temporary(self) -> bool:
        """True if the new settings are pending confirmation; False if they are already permanent."""
        end = _now() + self._timing.write_s
        while _now() < end:
            jobs = await self._jobs()
            if self._is_pending(jobs):
                return True
            if (job := self._ended(jobs)) is not None:
                if job.state == "done":
                    return False
                raise _EndedError("failed", _clipped(job.message))
            await asyncio.sleep(self._timing.poll_s)
        raise _EndedError("failed", f"It was not written within {self._timing.write_s:.0f} s. {UNKNOWN}")

    async def _keep(self) -> None:
        """Watch a device with temporary settings, and confirm them."""
        await self._try_report("watching", f"It has to deliver for {self._watch_s:g} s.")
        why = await self._watched() or await self._difference()
        if why:
            await self._roll_back(why)
        await self._try_report("confirming", "The settings are confirmed.")
        end = _now() + self._timing.write_s
        is_sent = False
        while _now() < end:
            jobs = await self._jobs()
            if (job := self._ended(jobs)) is not None:
                if job.state == "done":
                    return
                raise _EndedError("failed", _clipped(job.message))
            if self._is_pending(jobs) and not is_sent:
                is_sent = True
                try:
                    await self._line.post(f"{self._at}/confirm", {}, _Jobs)
                except LineError:
                    is_sent = False  # the next poll shows whether it has arrived
                except DomainError:
                    pass  # it has just been rolled back; the next poll shows it
            await asyncio.sleep(self._timing.poll_s)
        raise _EndedError("unknown", f"The robot did not finish. {UNKNOWN}")

    async def _checked(self) -> str:
        """Result message after verifying that the settings match the profile."""
        why = await self._difference()
        if why:
            raise _EndedError("failed", f"{why} These settings stay.")
        return "It has the settings of the profile; they were read back."

    # ── polls ────────────────────────────────────────────────────────────────────────────────────────────────────────

    async def _watched(self) -> str:
        """Reason why the data rate is too low; empty if it is as expected."""
        rate = None
        with suppress(Exception):  # values that came from the bus
            rate = self._driver.message_rate(self._target.values, self._target.context)
        if rate == 0:
            return ""
        figures: deque[tuple[float, dict[str, int]]] = deque()
        actual_rate = 0.0
        end = _now() + self._watch_s + self._timing.watch_more_s
        while _now() < end:
            if (job := self._ended(await self._jobs())) is not None:  # a user at the robot has decided
                if job.state == "done":
                    return ""
                raise _EndedError("failed", _clipped(job.message))
            health = await self._poll("health", _Health)
            counts = {one.name: one.count for one in health.messages}
            if figures and (
                health.time < figures[-1][0] or any(counts.get(name, 0) < n for name, n in figures[-1][1].items())
            ):
                figures.clear()  # its session was reopened
            if not figures or health.time > figures[-1][0]:
                figures.append((health.time, counts))
            while len(figures) > 1 and figures[1][0] <= health.time - self._watch_s:
                figures.popleft()
            span = health.time - figures[0][0]
            arrived = max((n - figures[0][1].get(name, 0) for name, n in counts.items()), default=0)
            actual_rate = arrived / span if span > 0 else 0.0
            expected = None if rate is None else rate * span
            is_well = arrived > 0 if expected is None else _is_near(arrived, expected)
            if span >= self._watch_s and is_well:
                return ""
            await asyncio.sleep(self._timing.poll_s)
        should = "" if rate is None else f" instead of {rate:g}"
        return f"It delivered {actual_rate:.3g} samples/s{should}."

    async def _difference(self) -> str:
        """Difference of the settings from the profile, in words; empty if there is none."""
        answer = await self._poll("values", _SettingValues)
        robot = DeviceSettings(self._target.protocol, answer.info.product, answer.info.firmware, {})
        try:
            rows = {row.name: row for row in self._driver.settings(robot.context)}
            values = {name: numbers(rows[name].fields, raw) for name, raw in answer.values.items() if name in rows}
            robot = DeviceSettings(
                robot.protocol, robot.product, robot.firmware, writable_settings(self._driver, robot.context, values)
            )
            changes = difference(self._driver, self._target, robot)
        except ReportError as error:
            return str(error)
        except Exception as error:  # values that came from the bus can have any shape
            return f"Its settings cannot be compared ({type(error).__name__})."
        if not changes.rows:
            return ""
        row = changes.rows[0]
        more = f", and {len(changes.rows) - 1} more" if len(changes.rows) > 1 else ""
        return f"{row.title} is {row.left or 'none'} instead of {row.right or 'none'}{more}."

    async def _jobs(self) -> _Jobs:
        return await self._poll("jobs", _Jobs)

    async def _poll(self, what: str, answer: type[T]) -> T:
        """Read a part of the device's state; lost requests are repeated until `lost_s` has passed."""
        end = _now() + self._timing.lost_s
        while True:
            try:
                return await self._line.get(f"{self._at}/{what}", answer)
            except (LineError, DomainError) as error:
                if _now() > end:
                    raise _EndedError("unknown", f"{error} {UNKNOWN}") from None
            await asyncio.sleep(self._timing.poll_s)

    def _is_pending(self, jobs: _Jobs) -> bool:
        is_ours = jobs.running is not None and jobs.running.id == self._job
        return is_ours and jobs.pending_rollback is not None and jobs.pending_rollback.state == "pending"

    def _ended(self, jobs: _Jobs) -> _Job | None:
        """Our job, if it has ended."""
        under_way = [*jobs.queue, *([] if jobs.running is None else [jobs.running])]
        if any(one.id == self._job for one in under_way):
            return None
        for one in jobs.done:
            if one.id == self._job:
                return one
        raise _EndedError("unknown", f"The robot has no record of the change: it was restarted. {UNKNOWN}")

    # ── roll-back ────────────────────────────────────────────────────────────────────────────────────────────────────

    async def _roll_back(self, why: str) -> None:
        """Roll back immediately instead of waiting for the robot's timeout. Always raises."""
        with suppress(LineError, DomainError):
            await self._line.post(f"{self._at}/roll-back", {}, _Jobs)
        end = _now() + self._watch_s + self._timing.confirm_more_s + self._timing.back_s
        while _now() < end:
            try:
                job = self._ended(await self._jobs())
            except _EndedError as ended:
                raise _EndedError("unknown", f"{why} {ended.outcome.words}") from None
            if job is not None:
                raise _EndedError("failed", f"{why} {_clipped(job.message)}")
            await asyncio.sleep(self._timing.poll_s)
        raise _EndedError("unknown", f"{why} {UNKNOWN}")

    async def _try_report(self, state: RolloutDeviceState, words: str) -> None:
        """Report a state; a full disk does not stop the change that is under way."""
        with suppress(DomainError):
            await self._report(state, words)


def _is_near(arrived: int, expected: float) -> bool:
    return abs(arrived - expected) <= max(RATE_SHARE * expected, RATE_MESSAGES)


def _now() -> float:
    return asyncio.get_running_loop().time()


def _sentence(error: DomainError) -> str:
    return _clipped(error.text)


def _clipped(text: str) -> str:
    return printable(text[:500])
