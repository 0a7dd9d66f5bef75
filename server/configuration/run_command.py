"""Run one command on a device, and read the altered settings again.

    command ──> answer
            ──> settings that it alters (Setting.write, Driver.alters): read again, or marked as not read since
            ──> a restart: the link follows the device to its stored baud rate

A form must not show values from before a command, and changes must not be based on them.
"""

import asyncio
import contextlib
from collections.abc import Collection

from imuscope.protocols.commands.transactions import AT_REST, DeviceRejectedError, NoReplyError, RequiresState, Values
from imuscope.server.configuration.device_controller import ControlError, DeviceController, JobError, RunningJob
from imuscope.server.configuration.rollback import RESTORE_HINT
from imuscope.server.configuration.sensor_check import check_sensor
from imuscope.server.configuration.settings_reader import SettingsReader
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.configuration.transaction_runner import group
from imuscope.server.links.base import LinkError
from imuscope.server.wire.codec import to_json_safe

LISTEN_S = 1.0  # for replies to raw bytes
AWAKE_TRIES = 5  # about a second each: wait for a restarting device before reading it
STOPPED_HINT = "Choose its outputs under Configure and apply them, or restart it."
BY_HAND = "Send hex"
NOT_SINCE = "not read since “{}”"


def altered(controller: DeviceController, command: str, values: Values) -> list[str]:
    """The settings that a command alters, in the order of the tables."""
    more = controller.driver.alters(command, values, controller.context)
    return [name for name, row in controller.rows.items() if row.write == command or name in more]


async def run(
    reader: SettingsReader,
    timings: ConfigurationTimings,
    running: RunningJob,
    command: str,
    values: Values,
    *,
    changes: bool,
    restarts: bool,
    sensor: str = "",
) -> None:
    """Run one command.

    Args:
        timings: how long a restarting device is waited for.
        changes: the command writes something, so a snapshot is taken first, unless it continues the work of an earlier
            command, which reading everything would discard.
        restarts: the device restarts, perhaps at a baud rate that was stored before; the link follows it.
        sensor: serial number of the sensor that is meant, checked if it is read before; "": whichever is there.
    """
    controller = running.controller
    driver, known = controller.driver, controller.context
    body = driver.run(command, values, known)
    if changes and not (isinstance(body, RequiresState) and body.continues):
        snapshot = await reader.read_settings(running, None)
        check_sensor(controller, sensor, snapshot.known)
        running.job.snapshot = await reader.save_snapshot(
            controller, snapshot, "Before this change", f"Before {running.job.title}."
        )
        body = driver.run(command, values, controller.context)
    stale = altered(controller, command, values)
    running.step(command)
    try:
        answer = await controller.run(driver.within(body, known))
    except (NoReplyError, LinkError, asyncio.CancelledError):  # it may have been carried out anyway
        controller.invalidate(stale, NOT_SINCE.format(running.job.title))
        raise
    controller.invalidate(stale, NOT_SINCE.format(running.job.title))
    if isinstance(body, RequiresState) and body.state == "any" and not restarts:
        controller.rest(controller.state == AT_REST, f"“{running.job.title}”")
    if restarts:
        await _follow(running, timings.rounds)
    _explain_end_of_output(controller, command, f"“{running.job.title}”")
    controller.note_unfinished(command, driver.unfinished(command, values))
    running.job.values = to_json_safe(answer)
    running.job.message = running.job.message or ("Answered." if answer else "Done.")
    await _read_again(reader, running, stale, restarts=restarts)


def _explain_end_of_output(controller: DeviceController, command: str, who: str) -> None:
    row = next((one for one in controller.driver.commands(controller.context) if one.name == command), None)
    if row is not None and row.caution == "stops-output" and not controller.at_rest:
        controller.explain_quiet(f"{who} ended its output.", STOPPED_HINT)


async def _read_again(reader: SettingsReader, running: RunningJob, names: Collection[str], *, restarts: bool) -> None:
    """Read the settings that a command altered. Those that cannot be read stay marked; the command itself was done."""
    controller = running.controller
    if not names or not controller.read_at or controller.unfinished:
        return  # never read: no values to update; unfinished: reading would discard it
    try:
        if restarts:
            await answers(controller, AWAKE_TRIES)
        await reader.read_settings(running, list(names))
    except (NoReplyError, DeviceRejectedError, LinkError) as error:
        controller.log.add_note(str(error), error=True)
        running.job.hint = running.job.hint or "The changed settings could not be read; read them again."


async def _follow(running: RunningJob, rounds: int) -> None:
    """Set the link to the baud rate of the device after its restart.

    Args:
        rounds: number of attempts at each rate: a slow device, or one at a busy host, is missed at first.
    """
    controller = running.controller
    before = controller.member.access.baud
    rates = tuple(controller.driver.rates(controller.values, controller.context)) if before is not None else ()
    for rate in rates * rounds:
        if rate != controller.member.access.baud and not await controller.runner.reopen(rate):
            continue
        running.step(f"The device restarts; trying {group(rate)} Bd")
        if await controller.run(controller.driver.is_alive(controller.context)):
            if rate != before:
                running.job.message = f"The device uses {group(rate)} Bd after its restart; the link was changed to it."
            return
    if rates:
        await controller.runner.reopen(before)
        raise JobError("The device does not answer after its restart.", RESTORE_HINT)


async def answers(controller: DeviceController, rounds: int) -> bool:
    """Whether a device that restarts answers at the present rate, in one of some attempts."""
    for _ in range(rounds):
        if await controller.run(controller.driver.is_alive(controller.context)):
            return True
    return False


async def raw(running: RunningJob, data: bytes) -> None:
    """Send raw bytes; replies within a second are in the log."""
    controller = running.controller
    stale = _altered_by_bytes(controller, data)
    controller.log.sent(data, "", await controller.member.access.send(data))
    controller.invalidate(stale, NOT_SINCE.format(running.job.title))
    await asyncio.sleep(LISTEN_S)
    if controller.state == AT_REST and not controller.at_rest:
        controller.rest(True, BY_HAND)
    with contextlib.suppress(ControlError):  # its protocol is not known
        _explain_end_of_output(controller, controller.driver.name_of(data), BY_HAND)
    running.job.message = f"{len(data)} bytes sent unchanged."


def _altered_by_bytes(controller: DeviceController, data: bytes) -> list[str]:
    """Settings that a user-composed frame alters; all settings for bytes that match no table."""
    try:
        known = {row.name for row in controller.driver.commands(controller.context)}
    except ControlError:
        return []
    name = controller.driver.name_of(data)
    return altered(controller, name, {}) if name in known else list(controller.values)
