"""Read-back of a device that was cut off, or stopped answering, while it was written: wait for it, then read it.

    write ──x link gone, or silence ──> its settings count as unknown ──> wait for it ──> read back ──> outcomes
                                                                              │ not back
                                                                              v
                                                the rollback record stays on disk until the device is read again

Nothing is assumed: after a plug was pulled, the device may have old values, new values, or some of each.
"""

import asyncio
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from imuscope.protocols.commands.transactions import DeviceRejectedError, NoReplyError, Values, WriteResult
from imuscope.protocols.schema.plural import plural
from imuscope.server.configuration import settings_procedures
from imuscope.server.configuration.device_controller import DeviceController, JobError, RunningJob
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.links.base import LinkError

UNKNOWN = "not known: the device stopped answering while it was written"
AWAY_HINT = "Connect it and switch it on, then read its settings: some may be new and some old."
AGAIN_HINT = "Apply the missing settings again."


async def reopened(controller: DeviceController) -> bool:
    """Close and reopen the link; False if that is not possible yet."""
    try:
        await controller.member.access.reopen()
    except LinkError:
        return False
    return True


async def read_back(running: RunningJob, names: Sequence[str], timings: ConfigurationTimings) -> Mapping[str, Values]:
    """Values of the device after its return.

    Raises:
        JobError: the device did not return in time, or another one is at the port.
    """
    controller = running.controller
    ours = controller.context.serial_number
    controller.invalidate(names, UNKNOWN)
    running.step("The device stopped answering; waiting for it")
    end = time.monotonic() + timings.return_s
    while time.monotonic() < end:
        snapshot: settings_procedures.SettingsSnapshot | None = None
        try:
            if await controller.run(controller.driver.is_alive(controller.context)):
                body = settings_procedures.read_settings(controller.driver, controller.context, names, running.step)
                snapshot = await controller.run(controller.driver.within(body, controller.context))
        except LinkError:
            running.step("Its port is gone: connect the device again")
            while not await reopened(controller) and time.monotonic() < end:
                await asyncio.sleep(timings.reopen_s)
        except (NoReplyError, DeviceRejectedError) as error:
            controller.log.add_note(str(error), error=True)
        if snapshot is not None:
            controller.update(snapshot.known, snapshot.values, snapshot.missing)
            reported = snapshot.known.serial_number
            if ours and reported and ours not in (reported, *controller.driver.formerly(reported)):
                raise JobError(
                    f"Another device is at this port: {reported}, not {ours}. It was not changed.", AWAY_HINT
                )
            return snapshot.values
        await asyncio.sleep(timings.reopen_s)
    raise JobError("The device stopped answering while it was written, and did not come back.", AWAY_HINT)


def merged(
    todo: Mapping[str, Mapping[str, Any]], written: Sequence[WriteResult], restored: Mapping[str, Values]
) -> list[WriteResult]:
    """Outcome of each setting: refusals as reported by the device, the others as read back."""
    reported = {one.setting: one for one in written}
    every = [reported.get(name, WriteResult(name, values)) for name, values in todo.items()]
    return [one if one.refused else replace(one, actual=restored.get(one.setting)) for one in every]


def summary(controller: DeviceController, written: Sequence[WriteResult]) -> str:
    """Summarise the outcome: "Location ID has the new values, Baud rate not"."""
    rows = controller.rows
    lacking = {one.setting for one in settings_procedures.outcomes(controller.driver, rows, written)}
    titles = {one.setting: rows[one.setting].title or one.setting for one in written}
    new = [title for name, title in titles.items() if name not in lacking]
    old = [title for name, title in titles.items() if name in lacking]
    has = f"{', '.join(new)} {plural(len(new), 'has', 'have')} the new values, " if new else ""
    verb = "not" if new else f"{plural(len(old), 'does', 'do')} not have the new values"
    return f"{has}{', '.join(old)} {verb}."
