"""Run one command on a device, and read again what it altered.

    command ──> answer
            ──> settings that it alters (Setting.write, Driver.alters): read again, or marked as not read since
            ──> a restart: the link follows the device to the rate that it has stored

A form must not go on showing what the device had before a command, and nothing is written on top of it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection

from protocols.transactions import AT_REST, DeviceRejectedError, NoReplyError, RequiresState, Values
from server.configuration.device_controller import ControlError, DeviceController, JobError, QueuedJob
from server.configuration.reading import SettingsReader
from server.configuration.rollback import RESTORE_HINT
from server.configuration.transaction_runner import group
from server.links.base import LinkError
from server.wire_codec import to_json_safe

LISTEN_S = 1.0  # for what a device answers to bytes that nobody understands here
AWAKE_TRIES = 5  # about a second each: how long a device that restarts is waited for before it is read
NOT_SINCE = "not read since “{}”"


def altered(desk: DeviceController, command: str, values: Values) -> list[str]:
    """The settings that are not what they were once a command has been run, in the order of the tables."""
    more = desk.driver.alters(command, values, desk.known)
    return [name for name, row in desk.rows.items() if row.write == command or name in more]


def run(
    reader: SettingsReader, desk: DeviceController, command: str, values: Values, *, changes: bool, restarts: bool
) -> Callable[[QueuedJob], Awaitable[None]]:
    """One command.

    Args:
        changes: it writes something, so a snapshot is taken first; unless it takes up what an earlier command
            began, which reading everything would discard.
        restarts: the device restarts, and may then speak at a rate that was stored before: the link follows it.
    """

    async def work(task: QueuedJob) -> None:
        driver, known = desk.driver, desk.known
        body = driver.run(command, values, known)
        if changes and not (isinstance(body, RequiresState) and body.continues):
            found = await reader.survey(desk, task, None)
            task.job.snapshot = await reader.keep(desk, found, "Before this change", f"Before {task.job.title}.")
            body = driver.run(command, values, desk.known)
        stale = altered(desk, command, values)
        desk.step(task, command)
        try:
            answer = await desk.run(driver.within(body, known))
        except (NoReplyError, LinkError, asyncio.CancelledError):  # it may have been carried out all the same
            desk.doubt(stale, NOT_SINCE.format(task.job.title))
            raise
        desk.doubt(stale, NOT_SINCE.format(task.job.title))
        if isinstance(body, RequiresState) and body.state == "any" and not restarts:
            desk.rest(desk.state == AT_REST)
        if restarts:
            await _follow(desk, task)
        desk.leave(command, driver.unfinished(command, values))
        task.job.values = to_json_safe(answer)
        task.job.message = task.job.message or ("Answered." if answer else "Done.")
        await _read_again(reader, desk, task, stale, restarts=restarts)

    return work


async def _read_again(
    reader: SettingsReader, desk: DeviceController, task: QueuedJob, names: Collection[str], *, restarts: bool
) -> None:
    """Read what a command altered. What cannot be read now stays marked; the command itself was done."""
    if not names or not desk.read_at or desk.unfinished:
        return  # never read: there is nothing to keep right; unfinished: reading would discard it
    try:
        for _ in range(AWAKE_TRIES if restarts else 0):
            if await desk.run(desk.driver.alive(desk.known)):
                break
        await reader.survey(desk, task, list(names))
    except (NoReplyError, DeviceRejectedError, LinkError) as error:
        desk.log.note(str(error), fault=True)
        task.job.hint = task.job.hint or "What it changed could not be read; read the settings again."


async def _follow(desk: DeviceController, task: QueuedJob) -> None:
    """The link at the rate at which a device speaks after its restart."""
    before = desk.session.baud
    rates = desk.driver.rates(desk.values, desk.known) if before is not None else ()
    for rate in rates:
        if rate != desk.session.baud and not await desk.runner.relink(rate):
            continue
        desk.step(task, f"The device restarts; the link listens at {group(rate)} Bd")
        if await desk.run(desk.driver.alive(desk.known)):
            if rate != before:
                task.job.message = f"The device speaks at {group(rate)} Bd after its restart; the link follows it."
            return
    if rates:
        await desk.runner.relink(before)
        raise JobError("The device does not answer after its restart.", RESTORE_HINT)


def raw(desk: DeviceController, data: bytes) -> Callable[[QueuedJob], Awaitable[None]]:
    """Bytes as they are; what comes back within a second is in the log."""

    async def work(task: QueuedJob) -> None:
        stale = _altered_by_bytes(desk, data)
        desk.log.sent(data, "")
        await desk.session.send(data)
        desk.doubt(stale, NOT_SINCE.format(task.job.title))
        await asyncio.sleep(LISTEN_S)
        task.job.message = f"{len(data)} bytes sent as they are."

    return work


def _altered_by_bytes(desk: DeviceController, data: bytes) -> list[str]:
    """What a frame alters that somebody composed himself; of bytes that are none of the document's, everything."""
    try:
        known = {row.name for row in desk.driver.commands(desk.known)}
    except ControlError:
        return []
    name = desk.driver.name_of(data)
    return altered(desk, name, {}) if name in known else list(desk.values)
