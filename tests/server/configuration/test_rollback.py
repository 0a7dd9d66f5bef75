"""Automatic rollback: absent user, killed server, poor cable, another device, full disk."""

import asyncio
import json
import threading
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from httpx import Client

from imuscope.protocols.commands.transactions import DeviceContext, Transaction
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.system import atomic_write
from imuscope.server.configuration.device_controller import ControlError, DeviceController
from imuscope.server.configuration.rollback import RollbackRecord, RollbackRun, RollbackStore
from imuscope.server.links.base import LinkError
from imuscope.server.links.simulator import SimulatorLink, SimulatorThread
from imuscope.server.wire import PendingRollback
from tests.support.control_harness import (
    LATE,
    SILENT,
    ControlHarness,
    answers_from_now_on,
    at_rate,
    bench,
    house,
    house_of,
    over,
)
from tests.support.each_row import each_row
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, http_client
from tests.support.waiting import block_until, until

FAST = 0x80  # the code of 921 600 Bd
SOURCE = "sim:xbus?baud=115200&rate=20"


async def faster(here: ControlHarness, desk: DeviceController) -> Any:
    """Apply 921 600 Bd, to be confirmed; the task."""
    await here.read(desk)
    new = at_rate(dict(desk.values["PortConfig"]), FAST)
    return desk.add("Write Ports", partial(here.desks.jobs.apply, changes={"PortConfig": new}, reason=""))


def files(data: Path) -> list[Path]:
    return list((data / "rollbacks").glob("*.json"))


async def test_an_unconfirmed_change_is_rolled_back(tmp_path: Path) -> None:
    async with house_of(SOURCE, tmp_path, rollback_s=1.0) as (here, desk):
        task = await faster(here, desk)
        await until(lambda: desk.pending_rollback is not None and desk.pending_rollback.state == "pending", "it asks")
        assert desk.member.access.baud == 921_600
        assert desk.pending_rollback is not None
        assert desk.pending_rollback.words == (
            "The device answers at 921 600 Bd. Unless confirmed, it is rolled back to 115 200 Bd."
        )
        assert desk.pending_rollback.deadline is not None
        assert [json.loads(path.read_text())["state"] for path in files(tmp_path)] == ["pending"]
        job = await over(task)
        assert job.state == "failed"
        assert "because the change was not confirmed in time" in job.message
        assert desk.pending_rollback.state == "rolled-back"
        assert desk.member.access.baud == 115_200
        assert files(tmp_path) == []
        await until(lambda: desk.member.info.status == "live", "it streams again")
        assert (await here.read(desk)).state == "done"


@each_row("keep", [True, False])
async def test_any_change_is_temporary_on_request(tmp_path: Path, keep: bool) -> None:
    async with house_of(SOURCE, tmp_path, is_read=True) as (here, desk):
        before, new, seconds = desk.values["LocationID"], {"location_id": 7}, 30.0 if keep else 1.0
        assert before != new
        task = desk.add(
            "Write", partial(here.desks.jobs.apply, changes={"LocationID": new}, reason="", confirm_s=seconds)
        )
        await until(lambda: desk.pending_rollback is not None and desk.pending_rollback.state == "pending", "it asks")
        assert desk.pending_rollback is not None
        assert (desk.pending_rollback.seconds, desk.values["LocationID"]) == (seconds, new)
        assert len(files(tmp_path)) == 1
        if keep:
            desk.decide(keep=True)
        job = await over(task)
        assert job.state == ("done" if keep else "failed"), job
        await here.read(desk)
        assert desk.values["LocationID"] == (new if keep else before)
        assert files(tmp_path) == []


@each_row("keep", [True, False])
async def test_the_user_confirms_or_rolls_back(tmp_path: Path, keep: bool) -> None:
    async with house_of(SOURCE, tmp_path, rollback_s=30.0) as (here, desk):
        task = await faster(here, desk)
        with pytest.raises(ControlError, match="No change is waiting to be confirmed"):
            desk.decide(keep=True)
        await until(lambda: desk.pending_rollback is not None and desk.pending_rollback.state == "pending", "it asks")
        with pytest.raises(ControlError, match="cannot be stopped now"):
            await desk.drop(task.job.id)
        desk.decide(keep=keep)
        job = await over(task)
        assert desk.pending_rollback is not None
        assert desk.pending_rollback.state == ("confirmed" if keep else "rolled-back")
        assert job.state == ("done" if keep else "failed")
        assert desk.member.access.baud == (921_600 if keep else 115_200)
        if keep:
            assert job.hint == "Open it as sim:xbus?baud=921600&rate=20 when this server is started again."
        assert files(tmp_path) == []
        assert (await here.read(desk)).state == "done"


@each_row(("confirm_s", "held", "late"), [(0.1, "save", True), (30.0, "forget", False)])
async def test_an_answer_that_is_too_late_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, confirm_s: float, held: str, late: bool
) -> None:
    """It was accepted while the disk was waited for, and nothing came of it."""
    begun, may_write, method = threading.Event(), threading.Event(), getattr(RollbackStore, held)

    def slow(store: RollbackStore, record: RollbackRecord) -> None:
        if held == "forget" or record.state == "rolling-back":
            begun.set()
            may_write.wait(PATIENCE_S)
        method(store, record)

    monkeypatch.setattr(RollbackStore, held, slow)
    async with house_of(SOURCE, tmp_path) as (here, desk):
        new = {"LocationID": {"location_id": 7}}
        task = desk.add("Write", partial(here.desks.jobs.apply, changes=new, reason="", confirm_s=confirm_s))
        if held == "forget":
            await until(lambda: desk.pending_rollback and desk.pending_rollback.state == "pending", "it asks")
            desk.decide(keep=True)
        await until(begun.is_set, "it is decided")
        with pytest.raises(ControlError, match="No change is waiting"):
            desk.decide(keep=late)
        may_write.set()
        assert (await over(task)).state == ("failed" if late else "done")


def test_old_and_new_are_on_disk_before_the_first_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And they are forced there: a power cut after that byte must leave a way back."""
    steps: list[str] = []
    write = atomic_write.write_atomic

    def noting(path: Path, text: str) -> None:
        write(path, text)
        if path.parent.name == "rollbacks":
            steps.append(f"disk {json.loads(text)['state']}")

    monkeypatch.setattr(atomic_write, "write_atomic", noting)

    async def check() -> None:
        async with house_of(SOURCE, tmp_path, rollback_s=1.0) as (here, desk):
            desk.member.listeners.sent.add(lambda data, time: steps.append(f"sent {data[2]:02x}"))
            await over(await faster(here, desk))

    asyncio.run(check())
    assert steps.index("disk applying") < steps.index("sent 8c", steps.index("disk applying"))
    record = steps[: steps.index("disk applying")]
    assert "disk asking" not in record
    assert record.count("sent 8c") <= 2  # ReqPortConfig, which has the number of the setting


async def test_a_full_disk_stops_it_before_anything_is_sent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, text: str) -> None:
        if path.parent.name == "rollbacks":
            raise OSError(28, "No space left on device")

    async with house_of(SOURCE, tmp_path, is_read=True) as (here, desk):
        monkeypatch.setattr(atomic_write, "write_atomic", full)
        task = await faster(here, desk)
        job = await over(task)
        assert job.state == "failed"
        assert "could not be saved" in job.message
        assert "SetPortConfig" not in [entry.name for entry in desk.log.tail(limit=500)]


async def test_a_rate_that_the_cable_cannot_carry(tmp_path: Path) -> None:
    """Neither end receives the other at either rate: this is reported, stored on disk, and repaired by restoring
    communication.
    """
    async with (
        bench(dead_baud=921_600) as there,
        house_of(f"serial://{there.slave}?baud=115200", tmp_path, rounds=1, times=SILENT, patience=1.0) as (here, desk),
    ):
        job = await over(await faster(here, desk))
        assert desk.pending_rollback is not None
        assert desk.pending_rollback.state == "unreachable"
        assert "unreachable until its power is cycled" in job.message
        assert "Restore communication" in job.hint
        assert [json.loads(path.read_text())["state"] for path in files(tmp_path)] == ["unreachable"]
        answers_from_now_on(desk)
        restore = desk.add("Restore", here.desks.jobs.restore)
        await until(lambda: is_called(desk), "it calls for a device that gets power")
        cycle(there)
        job = await over(restore)
        assert job.state == "done", job.message
        assert "has its old settings" in job.message
        assert desk.pending_rollback.state == "rolled-back"
        assert files(tmp_path) == []
        assert desk.member.access.baud == 115_200


async def test_a_device_that_its_cable_powers_takes_the_port_with_it(tmp_path: Path) -> None:
    """Restoring communication ended when the plug was pulled, which is how such a device is switched off."""
    async with house_of(
        f"{SOURCE}&dead_baud=921600&unplug_s=86400&away_s=1", tmp_path, rounds=1, times=SILENT, patience=1.0
    ) as (here, desk):
        await over(await faster(here, desk))
        assert desk.pending_rollback is not None
        assert desk.pending_rollback.state == "unreachable"
        answers_from_now_on(desk)
        restore = desk.add("Restore", here.desks.jobs.restore)
        await until(lambda: is_called(desk), "it calls for a device that gets power")
        link = desk.member.access.link
        assert isinstance(link, SimulatorLink)
        assert link._simulator is not None
        link._simulator.unplug()
        job = await over(restore)
        assert (job.state, job.message) == ("done", "The device answers again and has its old settings.")
        assert files(tmp_path) == []


@each_row(("port", "rate"), [(0, 115_200), (1, 921_600)])
async def test_a_port_that_may_be_ours_changes_on_trial_and_the_device_is_found_at_either_rate(
    tmp_path: Path, port: int, rate: int
) -> None:
    """Regression: only the first port was guarded; a host on the UART, whose rate alone changed, lost the device
    permanently.
    """
    async with (
        bench(port) as there,
        house_of(f"serial://{there.slave}?baud=115200", tmp_path, is_read=True, rollback_s=1.0) as (here, desk),
    ):
        change = {"PortConfig": {"words": [0x10002, 0x10000 | FAST, 0]}}
        task = desk.add("Write Ports", partial(here.desks.jobs.apply, changes=change, reason=""))
        await until(lambda: desk.pending_rollback is not None and desk.pending_rollback.state == "pending", "it asks")
        assert desk.member.access.baud == rate
        await over(task)
        assert desk.pending_rollback is not None
        assert (desk.pending_rollback.state, desk.member.access.baud) == ("rolled-back", 115_200)
        assert desk.values["PortConfig"]["words"][1] == 0x10002


async def test_the_link_follows_a_device_that_restarts_at_the_factorys_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regression: each rate was tried once, for as long as a device takes that is neither slow nor at a busy host."""
    missed = [921_600, 115_200]
    is_alive = XbusDriver.is_alive

    def late(driver: XbusDriver, known: DeviceContext) -> Transaction[bool]:
        if known.baud in missed:
            missed.remove(known.baud)
            return False
        return (yield from is_alive(driver, known))

    monkeypatch.setattr(XbusDriver, "is_alive", late)
    async with house_of("sim:xbus?product=MTi-300&baud=921600&rate=20", tmp_path) as (here, desk):
        jobs = here.desks.jobs
        await over(desk.add("Restore", partial(jobs.run, command="RestoreFactoryDef", values={}, changes=True)))
        assert desk.member.access.baud == 921_600
        job = await over(desk.add("Reset", partial(jobs.run, command="Reset", values={}, changes=False, restarts=True)))
        assert (job.state, desk.member.access.baud) == ("done", 115_200), job
        assert job.message == "The device uses 115 200 Bd after its restart; the link was changed to it."
        assert not missed


def is_called(desk: DeviceController) -> bool:
    """Whether bytes that restore communication are being sent."""
    return "restore communication" in [entry.name for entry in desk.log.tail(limit=500)]


def cycle(there: SimulatorThread) -> None:
    """Switch the device off and on."""
    device = there.device
    assert isinstance(device, XbusSimulator)
    there.cycle()


async def test_another_device_at_the_port_is_left_alone(tmp_path: Path) -> None:
    """Regression: its settings would have been overwritten with those of the previous device."""
    async with bench() as there, house(tmp_path) as here:
        source = f"serial://{there.slave}?baud=115200"
        old = {"PortConfig": {"words": [65538, 65538, 0]}}
        record = RollbackRecord(source, "xbus", "MTi-630", "00FFFFFF", "", old, old, 115_200, 115_200, False)
        here.desks.rollbacks.save(record)
        await here.desks.resume()
        desk = next(iter(here.desks._controllers.values()))
        await until(lambda: desk.job_report.done, "it gave up")
        assert "Another device is at this port: 0080800001, not 00FFFFFF" in desk.job_report.done[0].message
        assert "SetPortConfig" not in [entry.name for entry in desk.log.tail(limit=500)]
        assert files(tmp_path) == []


async def test_settings_that_cannot_be_read_back_are_not_called_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The device "does not have its old settings", although nobody knew."""

    async def nothing(run: RollbackRun, names: object) -> None:
        return None

    monkeypatch.setattr(RollbackRun, "_read", nothing)
    async with bench() as there, house(tmp_path, rounds=1) as here:
        source = f"serial://{there.slave}?baud=115200"
        old = {"PortConfig": {"words": [65538, 65538, 0]}}
        here.desks.rollbacks.save(
            RollbackRecord(source, "xbus", "MTi-630", "0080800001", "", old, old, 115_200, 115_200, False)
        )
        await here.desks.resume()
        desk = next(iter(here.desks._controllers.values()))
        await until(lambda: desk.job_report.done, "it gave up")
        notes = [entry.text for entry in desk.log.tail(limit=500)]
        assert "The device answered, but its settings cannot be read back." in notes


@each_row("text", ['{"source": "twi', "[" * 100_000, "null"])
def test_a_damaged_file_does_not_keep_the_server_from_starting(tmp_path: Path, text: str) -> None:
    folder = tmp_path / "rollbacks"
    folder.mkdir()
    (folder / "xbus-1.json").write_text(text)
    assert RollbackStore(folder).all() == []
    assert (folder / "xbus-1.json").exists()


def test_a_server_killed_in_the_middle_of_a_trial_goes_back_when_it_starts_again(tmp_path: Path) -> None:
    async def check() -> None:
        async with bench() as there:
            there.hold_open()  # the port outlives the server
            await asyncio.to_thread(killed, there)

    def killed(there: SimulatorThread) -> None:
        source = f"serial://{there.slave}?baud=115200"
        with ServerProcess(source, data=tmp_path) as first, http_client(base_url=first.url) as http:
            answers(http, lambda: http.get("/api/devices").json()[0]["status"] == "live")
            http.post("/api/devices/1/read", json={})
            answers(http, lambda: http.get("/api/devices/1/values").json()["values"])
            values = http.get("/api/devices/1/values").json()["values"]["PortConfig"]
            body = {"changes": {"PortConfig": at_rate(values, FAST)}, "confirm_s": 25}
            question = http.post("/api/devices/1/apply", json=body).json()["message"]
            assert "is rolled back unless confirmed within 25 s of the device's answer." in question
            assert http.post("/api/devices/1/apply", json={**body, "confirmed": True}).status_code == 202
            answers(http, lambda: rollback_state(http) == "pending")
            first.process.kill()
        assert there.device is not None
        assert there.device.baud == 921_600
        assert len(files(tmp_path)) == 1
        with ServerProcess(source, data=tmp_path) as second, http_client(base_url=second.url) as http:
            answers(http, lambda: rollback_state(http) == "rolled-back")
            answers(http, lambda: http.get("/api/devices").json()[0]["status"] == "live")
        assert there.device.baud == 115_200
        assert files(tmp_path) == []

    asyncio.run(check())


def rollback_state(http: Client) -> str:
    state = http.get("/api/devices/1/jobs").json()["pending_rollback"]
    return state["state"] if state else ""


def answers(http: Client, condition: Any) -> None:
    block_until(condition, lambda: http.get("/api/devices/1/jobs").text)


@each_row("state", ["applying", "rolling-back"])
async def test_a_trial_that_was_cut_off_before_the_device_changed_ends_with_the_old_settings(
    tmp_path: Path, state: str
) -> None:
    """The device still has the old rate and may be in the config state: it is found there and measures again."""
    async with bench() as there, house(tmp_path, times=replace(SILENT, config_s=LATE.config_s)) as here:
        there.hold_open()
        source = f"serial://{there.slave}?baud=115200"
        desk = await here.add(source)
        await here.read(desk)
        await desk.member.access.send(bytes.fromhex("faff3000d1"))
        await until(lambda: desk.state == "Config", "the device is in Config")
        await here.sessions.remove(desk.device)
        old = {"PortConfig": dict(desk.values["PortConfig"])}
        new = {"PortConfig": at_rate(old["PortConfig"], FAST)}
        record = RollbackRecord(source, "xbus", "MTi-630", "0080800001", "", old, new, 115_200, 921_600, True)
        record.state = "applying" if state == "applying" else "rolling-back"
        here.desks.rollbacks.save(record)
        await here.desks.resume()
        desk = next(iter(here.desks._controllers.values()))
        await until(lambda: desk.job_report.done, "it is over")
        assert desk.job_report.done[0].state == "done", desk.job_report.done[0].message
        assert desk.pending_rollback is not None
        assert desk.pending_rollback.state == "rolled-back"
        assert files(tmp_path) == []
        await until(lambda: desk.member.info.status == "live", "it streams")


async def test_a_rollback_of_a_port_under_another_path_adds_it_once(tmp_path: Path) -> None:
    """A server that was started with another text for the same port opened it once more, which failed as "in use"."""
    async with bench(measuring=True) as there, house(tmp_path) as here:
        there.hold_open()
        desk = await here.add(str(there.slave))
        await here.read(desk)
        old = {"PortConfig": dict(desk.values["PortConfig"])}
        source = f"serial://{there.slave}?baud=115200"
        here.desks.rollbacks.save(
            RollbackRecord(source, "xbus", "MTi-630", "0080800001", "", old, old, 115_200, 115_200, False)
        )
        await here.desks.resume()
        assert [one.info.id for one in here.sessions.all] == [desk.device]
        await until(
            lambda: desk.pending_rollback is not None and desk.pending_rollback.state == "rolled-back",
            "it was rolled back",
        )
        with pytest.raises(LinkError, match="already open"):
            here.sessions.add(source)


async def test_a_device_that_answers_is_no_longer_reported_unreachable(tmp_path: Path) -> None:
    async with bench() as there, house_of(f"serial://{there.slave}?baud=115200", tmp_path) as (here, desk):
        desk.pending_rollback = PendingRollback(desk.device, "unreachable", [], "gone")
        task = desk.add("Restore communication", here.desks.jobs.restore)
        await until(lambda: is_called(desk), "it calls for a device that gets power")
        cycle(there)
        await over(task)
        assert task.job.state == "done", task.job.message
        assert desk.job_report.pending_rollback is None
