"""Equality of the frames that are announced and those that are sent: each setting and command of each family.

Besides reads, and the states of an MTi in which it is read and written, a device that logs receives the frames of the
preview.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from imuscope.server.configuration.api_models import PreviewResult
from imuscope.server.configuration.change_plan import plan_changes, plan_command
from imuscope.server.configuration.device_controller import RunningJob
from imuscope.server.configuration.jobs import Jobs
from imuscope.server.configuration.preview import preview_command, preview_setting
from imuscope.server.configuration.rollback import RollbackRun
from imuscope.server.configuration.settings_procedures import SettingsSnapshot
from imuscope.server.configuration.settings_reader import SettingsReader
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.errors import DomainError
from tests.server.configuration.logging_device import DEVICES, LoggingDevice, first_value, other_values
from tests.support.control_harness import BRIEFEST, house_of, over

TOGETHER: Mapping[str, Mapping[str, float]] = {"q0": {"q0": 0.0, "q1": 1.0, "q2": 0.0, "q3": 0.0}}
MOST_FIELDS = 3  # of one setting: a flash configuration has sixty, and each is written and read back alike


async def _compare(device: LoggingDevice, what: Any, announced: PreviewResult, work: Any) -> bool:
    """Whether a job had something to write. One that the device refuses may end earlier."""
    job = await over(device.desk.add("Write", work))
    expected = [one.hex for one in announced.frames if not device.is_harmless(bytes.fromhex(one.hex))]
    received = device.changed
    if "Nothing to change" in job.message:
        return False
    is_over = job.state == "failed" and received == expected[: len(received)]
    assert received == expected or is_over, (what, job.message)
    return job.state == "done"


async def _write_each_setting(device: LoggingDevice) -> set[str]:
    """Settings that were written, field after field."""
    desk, written = device.desk, set[str]()
    before = desk.values
    for name, row in desk.rows.items():
        fields = [one for one in row.fields if not one.read_only and one.name in before.get(name, {})]
        for field in fields[:MOST_FIELDS] if row.write else ():
            for value in other_values(field, before[name][field.name]):
                device.begin()
                desk.values = dict(before)
                new = {field.name: value, **TOGETHER.get(field.name, {})}
                new = new if row.partial else {**before[name], **new}
                announced = preview_setting(desk.present, name, new)
                try:
                    request = plan_changes(desk, {name: new})
                except DomainError:  # a value that cannot be, or more than the line carries
                    continue
                work = partial(device.here.desks.jobs.apply, changes=request.values, reason="")
                if await _compare(device, (name, new), announced, work):
                    written.add(name)
                    break
    desk.values = before
    return written


class KnownSettings(SettingsReader):
    """It takes the settings as they are known: what is read before a command is not the subject here."""

    async def read_settings(self, running: RunningJob, names: Sequence[str] | None) -> SettingsSnapshot:
        controller = running.controller
        return SettingsSnapshot(controller.context, dict(controller.values))


async def _run_each_command(device: LoggingDevice) -> set[str]:
    """Commands that were run."""
    desk, desks, run = device.desk, device.here.desks, set[str]()
    reader = KnownSettings(desks.snapshots, desks.rollbacks)
    jobs = Jobs(reader, desks.rollbacks, ConfigurationTimings())
    before = desk.values
    for row in sorted(desk.driver.commands(desk.context), key=lambda one: one.kind):  # those that ask first
        if row.kind != "ask":
            device.begin()
        device.wire.sent.clear()
        desk.values = dict(before)
        setting = desk.present.setting_of(row.name)
        held = before.get(setting.name, {}) if setting is not None else {}
        values = {one.name: held[one.name] if one.name in held else first_value(one) for one in row.arguments}
        announced = preview_command(desk.present, row.name, values)
        try:
            request = plan_command(desk, row.name, values)
        except DomainError:
            continue
        options = {"changes": request.changes, "restarts": request.restarts}
        work = partial(jobs.run, command=row.name, values=values, **options)
        if request.setting:
            work = partial(desks.jobs.apply, changes=request.values, reason="")
        await _compare(device, (row.name, values), announced, work)
        run.add(row.name)
    return run


@pytest.mark.parametrize("source", DEVICES)
async def test_what_is_sent_is_what_was_announced(source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def confirmed(self: RollbackRun) -> bool:
        return True

    monkeypatch.setattr(RollbackRun, "_is_confirmed", confirmed)
    async with house_of(source, tmp_path, listening=BRIEFEST) as (here, desk):
        device = await LoggingDevice.behind(here, desk, DEVICES[source])
        written = await _write_each_setting(device)
        run = await _run_each_command(device)
        left = {name for name, row in desk.rows.items() if row.write and name in desk.values} - written
        assert left <= {"DID_NMEA_BCAST_PERIOD", "DID_GPX_RMC"}  # a list of them is not changed field by field
        assert len(run) > 0.9 * len(desk.driver.commands(desk.context))
