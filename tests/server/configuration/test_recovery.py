"""A device disconnected during a write: it is read after its return, and applied settings are reported."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

from imuscope.server.configuration import recovery
from imuscope.server.configuration.device_controller import DeviceController, RunningJob
from imuscope.server.links.simulator import SimulatorLink
from tests.support.control_harness import ControlHarness, house, outputs, over
from tests.support.waiting import until

SOURCE = "sim:xbus?baud=921600&unplug_s=86400"
BOTH: dict[str, dict[str, object]] = {"LocationID": {"location_id": 7}, "OutputConfiguration": outputs(10)}


def files(data: Path) -> list[Path]:
    return list((data / "rollbacks").glob("*.json"))


def unplug(desk: DeviceController) -> None:
    link = desk.member.access.link
    assert isinstance(link, SimulatorLink)
    assert link._simulator is not None
    link._simulator.unplug()
    link._simulator.join()


def when(desk: DeviceController, step: str, act: Callable[[DeviceController], None]) -> None:
    """Call a function once when a job starts a step."""
    before = desk.notify
    acted: list[str] = []

    def after() -> None:
        before()
        running = desk.job_report.running
        if running is not None and running.step == step and not acted:
            acted.append(step)
            act(desk)

    desk.notify = after  # type: ignore[method-assign]


async def cut(here: ControlHarness, away_s: float) -> tuple[DeviceController, RunningJob]:
    """A device that is unplugged when the second of two settings is written."""
    desk = await here.add(f"{SOURCE}&away_s={away_s}")
    await here.read(desk)
    title = desk.rows["OutputConfiguration"].title
    when(desk, f"Writing {title}", unplug)
    return desk, desk.add("Write", partial(here.desks.jobs.apply, changes=BOTH, reason=""))


async def test_a_device_unplugged_during_a_write_shows_no_old_values(tmp_path: Path) -> None:
    """It had taken the first setting; the page showed the old one, and that the device refused."""
    async with house(tmp_path) as here:
        desk, task = await cut(here, 0.2)
        job = await over(task)
        assert job.state == "failed"
        assert job.message.startswith(
            "The device stopped answering while it was written. Read back: Location identifier has"
        )
        assert "refused" not in job.message
        assert desk.values["LocationID"] == {"location_id": 7}
        assert desk.values["OutputConfiguration"] != outputs(10)
        assert {one.setting for one in job.outcomes} == {"OutputConfiguration"}
        assert files(tmp_path) == []


async def test_the_rollback_of_an_absent_device_is_remembered(tmp_path: Path) -> None:
    """It is on disk for the next server, until this one has read what the device took; old values are not shown."""
    async with house(tmp_path, return_s=0.2) as here:
        desk, task = await cut(here, 1.0)
        job = await over(task)
        assert job.message == "The device stopped answering while it was written, and did not come back."
        assert [json.loads(path.read_text())["state"] for path in files(tmp_path)] == ["applying"]
        assert not {"LocationID", "OutputConfiguration"} & set(desk.values)
        assert desk.missing["LocationID"] == recovery.UNKNOWN
        await until(lambda: desk.member.info.status == "live", "it is plugged in again")
        assert (await here.read(desk)).state == "done"
        assert desk.values["LocationID"] == {"location_id": 7}
        assert files(tmp_path) == []


async def test_a_write_that_a_power_cut_ended_is_not_done_and_writes_no_further(tmp_path: Path) -> None:
    """It was "done, 1 of 4 settings written", and the others were sent to a device that measured."""
    changes: dict[str, dict[str, object]] = {
        **BOTH,
        "LatLonAlt": {"latitude": 1.0, "longitude": 2.0, "altitude": 3.0},
        "OptionFlags": {"flags": 0x2080},
    }
    async with house(tmp_path, sample_s=0.1) as here:
        desk = await here.add("sim:xbus?cut=2&rate=20")
        job = await here.apply(desk, changes)
        assert job.state == "failed"
        assert (
            "stopped answering while it was written. Read back: Location identifier has the new values" in job.message
        )
        assert {one.setting for one in job.outcomes} == set(changes) - {"LocationID"}
        names = [entry.name for entry in desk.log.tail(limit=500)]
        assert "WakeUp" in names
        assert "SetLatLonAlt" not in names[names.index("WakeUp") :]
        assert (await here.apply(desk, changes)).state == "done"


async def test_a_read_that_read_nothing_is_not_done(tmp_path: Path) -> None:
    """It ended "Read all settings, done, 0 settings read"."""
    async with house(tmp_path) as here:
        desk = await here.add("sim:xbus?product=MTi-630&rate=20")
        task = desk.add("Read", partial(here.desks.jobs.read, names=["Nothing"], reason=""))
        assert (await over(task)).state == "failed"
        assert "No setting could be read" in task.job.message
