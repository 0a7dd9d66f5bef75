"""A rollback restores the values read, even if the tables do not allow them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.isb.driver import IsbDriver
from imuscope.protocols.isb.messages import places
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.isb.simulator.settings import FLASH, summed
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.recordings.system import atomic_write
from imuscope.server.configuration import rollback
from imuscope.server.configuration.change_plan import plan_changes
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.settings_diff import ComparedValues, compare
from imuscope.server.errors import DomainError
from imuscope.server.links.simulator import SimulatorLink
from tests.support.control_harness import BRIEFEST, ControlHarness, house, over
from tests.support.waiting import until

MODEL = 213  # of motion; not in the table
SOURCE = "sim:isb?baud=921600&rate=20"


def device_of(desk: DeviceController) -> IsbSimulator:
    link = desk.member.access.link
    assert isinstance(link, SimulatorLink)
    assert link._simulator is not None
    device = link._simulator.device
    assert isinstance(device, IsbSimulator)
    return device


def at(name: str) -> int:
    return next(offset for field, offset in places(FLASH, 0, 2040) if field.name == name)


def has(device: IsbSimulator, name: str, size: int = 4) -> int:
    return int.from_bytes(device.memory.flash[at(name) : at(name) + size], "little")


async def strange(here: ControlHarness) -> tuple[DeviceController, IsbSimulator]:
    """A device with a value that the table does not allow."""
    desk = await here.add(SOURCE)
    device = device_of(desk)
    flash = bytearray(device.memory.flash)
    flash[at("dynamicModel")] = MODEL
    device.memory.flash = summed(bytes(flash))
    await here.read(desk)
    assert desk.values["DID_FLASH_CONFIG"]["dynamicModel"] == MODEL
    return desk, device


CHANGES: Mapping[str, dict[str, Any]] = {"DID_FLASH_CONFIG": {"dynamicModel": 4, "ser0BaudRate": 460_800}}


async def test_a_rollback_restores_a_value_that_the_table_does_not_allow(tmp_path: Path) -> None:
    """Regression: the rollback was refused by the range check; both new values stayed, and the rollback hung in
    "rolling-back".
    """
    async with house(tmp_path, rollback_s=0.2, listening=BRIEFEST) as here:
        desk, device = await strange(here)
        job = await over(desk.add("Write", partial(here.desks.jobs.apply, changes=CHANGES, reason="")))
        assert "rolled back to the old settings" in job.message
        assert desk.pending_rollback is not None
        assert desk.pending_rollback.state == "rolled-back"
        assert (has(device, "dynamicModel", 1), has(device, "ser0BaudRate")) == (MODEL, 921_600)


async def test_a_snapshot_is_restored_with_a_value_that_the_table_does_not_allow(tmp_path: Path) -> None:
    """Only values reported by the device are exempt; values typed by users or read from files are checked."""
    async with house(tmp_path, listening=BRIEFEST) as here:
        desk, device = await strange(here)
        await here.apply(desk, {"DID_FLASH_CONFIG": {"dynamicModel": 4}})
        assert has(device, "dynamicModel", 1) == 4
        back = {"DID_FLASH_CONFIG": {"dynamicModel": MODEL}}
        with pytest.raises(DomainError, match="dynamicModel"):
            plan_changes(desk, back)
        first = next(iter(here.desks.snapshots.describe("isb", desk.serial_number)))
        now = ComparedValues("now", desk.values)
        for report in (True, False):
            result = compare(desk.driver, desk.context, now, ComparedValues("before", first, from_device=report))
            assert bool(result.changes) == report
            assert bool(result.problems) != report
        wish = plan_changes(desk, back, lambda: here.desks.snapshots.describe("isb", desk.serial_number))
        job = await over(
            desk.add("Write", partial(here.desks.jobs.apply, changes=wish.values, reason="", held=wish.current))
        )
        assert (job.state, job.outcomes) == ("done", [])
        assert has(device, "dynamicModel", 1) == MODEL
        other = {"DID_FLASH_CONFIG": {"dynamicModel": MODEL + 1}}
        with pytest.raises(DomainError, match="dynamicModel"):
            plan_changes(desk, other, lambda: here.desks.snapshots.describe("isb", desk.serial_number))


async def test_a_failed_rollback_ends_and_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: it stayed in "rolling-back", where neither confirming nor rolling back is accepted."""
    write = IsbDriver.write

    def broken(self: IsbDriver, setting: str, values: Any, known: DeviceContext, *, held: bool = False) -> Any:
        if held:
            raise RuntimeError("a fault")
        return (yield from write(self, setting, values, known))

    monkeypatch.setattr(IsbDriver, "write", broken)

    async with house(tmp_path, rollback_s=0.2, rounds=1, listening=BRIEFEST) as here:
        desk, _ = await strange(here)
        job = await over(desk.add("Write", partial(here.desks.jobs.apply, changes=CHANGES, reason="")))
        assert job.state == "failed"
        assert desk.pending_rollback is not None
        assert (desk.pending_rollback.state, desk.pending_rollback.words) == ("unreachable", rollback.BROKEN)
        assert [one.state for one in here.desks.rollbacks.all()] == ["unreachable"]


async def test_a_value_that_cannot_be_encoded_is_reported_and_the_others_are_restored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = IsbDriver.write

    def broken(self: IsbDriver, setting: str, values: Any, known: DeviceContext, *, held: bool = False) -> Any:
        if held:
            raise EncodeError("dynamicModel does not fit", "dynamicModel")
        return (yield from write(self, setting, values, known))

    monkeypatch.setattr(IsbDriver, "write", broken)

    async with house(tmp_path, rollback_s=0.2, rounds=1, listening=BRIEFEST) as here:
        desk, _ = await strange(here)
        job = await over(desk.add("Write", partial(here.desks.jobs.apply, changes=CHANGES, reason="")))
        assert job.message == rollback.NOT_ACCEPTED
        notes = [entry.text for entry in desk.log.tail(limit=2000) if entry.direction == "note"]
        assert any("not sent: dynamicModel does not fit" in text for text in notes)


async def test_a_disk_that_is_full_by_now_does_not_keep_a_device_from_going_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = atomic_write.write_atomic

    def full(path: Path, text: str) -> None:
        if path.parent.name == "rollbacks" and '"applying"' not in text:
            raise OSError(28, "No space left on device")
        write(path, text)

    async with house(tmp_path, rollback_s=0.2, listening=BRIEFEST) as here:
        desk, device = await strange(here)
        monkeypatch.setattr(atomic_write, "write_atomic", full)
        task = desk.add("Write", partial(here.desks.jobs.apply, changes=CHANGES, reason=""))
        await until(task.finished.is_set, "it is over")
        assert desk.pending_rollback is not None
        assert desk.pending_rollback.state == "rolled-back"
        assert has(device, "dynamicModel", 1) == MODEL
