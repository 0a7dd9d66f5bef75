"""Read back a device that was cut off, or fell silent, while it was written: wait until it is back, then ask it.

    write ──x link gone, or silence ──> its settings count as unknown ──> wait for it ──> read back ──> what it took
                                                                              │ not back
                                                                              v
                                                the way back stays on disk until the device is read again

Nothing is assumed: a plug that is pulled in the middle leaves old values, new ones, or some of each.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from protocols.transactions import DeviceRejectedError, NoReplyError, Values, WriteResult
from server.configuration import settings_procedures
from server.configuration.device_controller import DeviceController, JobError, QueuedJob
from server.links.base import LinkError

RETURN_S = 120.0  # for a person who looks for the plug
REOPEN_S = 0.05  # a device hears a call for a moment only after it has got power
UNKNOWN = "not known: the device stopped answering while it was written"
AWAY_HINT = "Connect it and switch it on, then read its settings: some may be new and some old."
AGAIN_HINT = "Apply again what is missing."


async def opened(desk: DeviceController) -> bool:
    """The link closed and opened again; False where it cannot be yet."""
    try:
        await desk.session.relink()
    except LinkError:
        return False
    return True


async def read_back(desk: DeviceController, task: QueuedJob, names: Sequence[str]) -> Mapping[str, Values]:
    """What the device has when it is back.

    Raises:
        JobError: it did not come back in time, or another one did.
    """
    ours = desk.known.serial_number
    desk.doubt(names, UNKNOWN)
    desk.step(task, "The device stopped answering; waiting for it")
    end = time.monotonic() + RETURN_S
    while time.monotonic() < end:
        found: settings_procedures.SettingsSnapshot | None = None
        try:
            if await desk.run(desk.driver.alive(desk.known)):
                body = settings_procedures.read_settings(
                    desk.driver, desk.known, names, lambda words: desk.step(task, words)
                )
                found = await desk.run(desk.driver.within(body, desk.known))
        except LinkError:
            desk.step(task, "Its port is gone: connect the device again")
            while not await opened(desk) and time.monotonic() < end:
                await asyncio.sleep(REOPEN_S)
        except (NoReplyError, DeviceRejectedError) as error:
            desk.log.note(str(error), fault=True)
        if found is not None:
            desk.learn(found.known, found.values, found.missing)
            told = found.known.serial_number
            if ours and told and ours not in (told, *desk.driver.formerly(told)):
                raise JobError(f"Another device is at this port: {told}, not {ours}. It was left as it is.", AWAY_HINT)
            return found.values
        await asyncio.sleep(REOPEN_S)
    raise JobError("The device stopped answering while it was written, and did not come back.", AWAY_HINT)


def merged(
    todo: Mapping[str, Mapping[str, Any]], written: Sequence[WriteResult], back: Mapping[str, Values]
) -> list[WriteResult]:
    """What came of each setting: refusals as they were told, the rest as it was read back."""
    told = {one.setting: one for one in written}
    every = [told.get(name, WriteResult(name, values)) for name, values in todo.items()]
    return [one if one.refused else replace(one, got=back.get(one.setting)) for one in every]


def account(desk: DeviceController, written: Sequence[WriteResult]) -> str:
    """ "Location ID has the new values, Baud rate not." """
    rows = desk.rows
    lacking = {one.setting for one in settings_procedures.outcomes(desk.driver, rows, written)}
    titles = {one.setting: rows[one.setting].title or one.setting for one in written}
    new = [title for name, title in titles.items() if name not in lacking]
    old = [title for name, title in titles.items() if name in lacking]
    has = f"{', '.join(new)} {'has' if len(new) == 1 else 'have'} the new values, " if new else ""
    verb = "not" if new else "does not have the new values" if len(old) == 1 else "do not have the new values"
    return f"{has}{', '.join(old)} {verb}."
