"""Jobs that are stopped while others wait, while they are stopped already, or while their device is removed."""

import asyncio
import threading
from functools import partial
from pathlib import Path

import pytest

from imuscope.server.configuration.device_controller import DeviceController, RunningJob
from imuscope.server.configuration.rollback import RollbackRecord, RollbackStore
from tests.support.control_harness import house, house_of
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import until


class SlowJob:
    """A job that goes on until it is stopped, and then takes a while to put its device back."""

    def __init__(self) -> None:
        self.may_end, self.is_back = asyncio.Event(), False

    async def work(self, task: RunningJob) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            await self.may_end.wait()
            self.is_back = True


async def endless(task: RunningJob) -> None:
    await asyncio.Event().wait()


async def running(desk: DeviceController, slow: SlowJob) -> RunningJob:
    task = desk.add("Slow", slow.work)
    await until(lambda: task.job.state == "running", "it runs")
    return task


async def test_a_job_that_was_added_while_another_was_stopped_can_be_stopped(tmp_path: Path) -> None:
    """Two tasks ran one queue, and the one that was stopped was not that of the job."""
    async with house(tmp_path) as here:
        desk, slow = await here.add("sim:xbus"), SlowJob()
        first = await running(desk, slow)
        stopping = asyncio.create_task(desk.drop(first.job.id))
        await asyncio.sleep(0)
        second, third = desk.add("Second", endless), desk.add("Third", endless)
        slow.may_end.set()
        await stopping
        for task in (second, third):
            await until(lambda task=task: task.job.state == "running", "it runs")
            await desk.drop(task.job.id)
            assert task.job.state == "stopped"


async def test_a_job_that_is_stopped_twice_puts_its_device_back(tmp_path: Path) -> None:
    async with house(tmp_path) as here:
        desk, slow = await here.add("sim:xbus"), SlowJob()
        first = await running(desk, slow)
        second = desk.add("Second", endless)
        drops = [asyncio.create_task(desk.drop(first.job.id)) for _ in range(2)]
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        slow.may_end.set()
        await asyncio.gather(*drops)
        assert slow.is_back
        await until(lambda: second.job.state == "running", "it runs")
        await desk.drop(second.job.id)
        assert second.job.state == "stopped"


async def test_a_device_that_is_removed_while_its_job_is_stopped_is_put_back_first(tmp_path: Path) -> None:
    """Its link was closed while the job still put it back."""
    async with house(tmp_path) as here:
        desk, slow = await here.add("sim:xbus"), SlowJob()
        first = await running(desk, slow)
        stopping = asyncio.create_task(desk.drop(first.job.id))
        await asyncio.sleep(0)
        removing = asyncio.create_task(here.sessions.remove(desk.device))
        asyncio.get_running_loop().call_later(0.05, slow.may_end.set)
        await removing
        assert slow.is_back
        await stopping


async def test_a_job_that_is_stopped_before_it_writes_leaves_nothing_to_roll_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next start of the server rolled back a change that was never made."""
    begun, may_write, written, save = threading.Event(), threading.Event(), threading.Event(), RollbackStore.save

    def slow(store: RollbackStore, record: RollbackRecord) -> None:
        begun.set()
        may_write.wait(PATIENCE_S)
        save(store, record)
        written.set()

    monkeypatch.setattr(RollbackStore, "save", slow)
    async with house_of("sim:xbus", tmp_path) as (here, desk):
        task = desk.add("Write", partial(here.desks.jobs.apply, changes={"LocationID": {"location_id": 7}}, reason=""))
        await until(begun.is_set, "it is being stored")
        stopping = asyncio.create_task(desk.drop(task.job.id))
        asyncio.get_running_loop().call_later(0.05, may_write.set)
        await stopping
        await until(written.is_set, "it is stored")
        assert task.job.state == "stopped"
        assert await asyncio.to_thread(here.desks.rollbacks.all) == []
