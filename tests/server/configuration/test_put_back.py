"""Devices are put back into the state in which they were found, also by the next run of a server that was killed."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import serial

from imuscope.protocols.commands.transactions import DeviceContext, Sleep, Transaction
from imuscope.protocols.events import Event, Reply
from imuscope.protocols.isb.frames import get_data
from imuscope.protocols.xbus.frames import build
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.configuration import put_back, transaction_runner
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.put_back import IS_BACK, UNCONFIRMED, WAITING, PutBackStore
from imuscope.server.links.base import LinkError
from imuscope.server.links.reader_thread import ThreadedLink
from imuscope.server.links.simulator import SimulatorThread
from tests.support.control_harness import BRIEFEST, ControlHarness, bench, house, house_of, over
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import until

GO_TO_CONFIG, GO_TO_MEASUREMENT, REQ_DID = build(0x30), build(0x10), build(0x00)


Measuring = tuple[SimulatorThread, ControlHarness, DeviceController]


def phase(there: SimulatorThread) -> str:
    assert isinstance(there.device, XbusSimulator)
    return there.device.phase


def reported(here: ControlHarness, text: str) -> bool:
    return text in [event.text for event in here.telemetry.log]


@asynccontextmanager
async def measuring(data: Path, **options: Any) -> AsyncIterator[Measuring]:
    """A device that measures on its port, and a house that has it; options as of `house`."""
    async with bench(measuring=True) as there, house_of(f"{there.slave}?baud=115200", data, **options) as (here, desk):
        yield there, here, desk


def test_a_read_stores_how_to_measure_again_before_it_interrupts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored: list[tuple[bytes, ...]] = []

    async def check() -> None:
        async with measuring(tmp_path) as (_, here, desk):

            def keep(source: str, device: str, frames: Sequence[bytes], baud: int | None = None) -> None:
                assert (source, device) == (desk.member.info.source, "")
                sent = [entry.name for entry in desk.log.tail(limit=500)]
                assert ("GoToConfig" in sent) == (not frames)  # stored before, removed after
                stored.append(tuple(frames))

            monkeypatch.setattr(here.desks.put_back, "keep", keep)
            assert (await here.read(desk)).state == "done"

    asyncio.run(check())
    assert stored == [(GO_TO_MEASUREMENT,), ()]


async def test_a_device_of_a_server_that_was_killed_measures_again(tmp_path: Path) -> None:
    """Killed while it read the settings, it left the robot's sensor silent until somebody noticed."""
    async with bench(measuring=True) as there, house(tmp_path) as here:
        source = f"{there.slave}?baud=115200"
        here.desks.put_back.keep(source, "", [GO_TO_MEASUREMENT])
        with serial.Serial(there.slave, 115_200) as port:
            port.write(GO_TO_CONFIG)
            await until(lambda: phase(there) == "config", "the config state, as the kill left it")
        await here.desks.resume()
        await until(lambda: phase(there) == "measurement", "it measures")
        await until(lambda: reported(here, IS_BACK), "it is back")
        await until(lambda: here.desks.put_back.all() == [], "nothing is stored")


async def test_what_was_stored_of_several_devices_of_a_link_is_sent_and_forgotten(tmp_path: Path) -> None:
    """A file under another name than the first device's was kept, and its frames sent at every start."""
    async with measuring(tmp_path, sample_s=0.1) as (_, here, desk):
        source = desk.member.info.source
        written: list[bytes] = []
        desk.member.listeners.sent.add(lambda data, time_ns: written.append(data))
        await desk.member.access.send(GO_TO_CONFIG)
        await until(lambda: desk.state == "Config", "as the kill left it")
        here.desks.put_back.keep(source, "", [REQ_DID])
        here.desks.put_back.keep(source, "7", [GO_TO_MEASUREMENT])
        await here.desks.resume()
        await until(lambda: reported(here, IS_BACK), "it is back")
        await until(lambda: here.desks.put_back.all() == [], "nothing is stored")
        assert set(written) == {GO_TO_CONFIG, REQ_DID, GO_TO_MEASUREMENT}


@contextmanager
def held(
    store: PutBackStore, monkeypatch: pytest.MonkeyPatch, which: Callable[[Sequence[bytes]], bool]
) -> Iterator[tuple[threading.Event, threading.Event]]:
    """Let the first writing of such frames wait for the second event, as on a slow disk; the first: it has begun."""
    keep, begun, may_write, ended = store.keep, threading.Event(), threading.Event(), threading.Event()

    def slow(source: str, device: str, frames: Sequence[bytes], baud: int | None = None) -> None:
        is_held = which(frames) and not begun.is_set()
        if is_held:
            begun.set()
            may_write.wait(PATIENCE_S)
        keep(source, device, frames, baud)
        if is_held:
            ended.set()

    monkeypatch.setattr(store, "keep", slow)
    try:
        yield begun, may_write
    finally:
        may_write.set()
        if begun.is_set():
            ended.wait(PATIENCE_S)


async def turns() -> None:
    """Let other tasks and threads go on."""
    for _ in range(10):
        await asyncio.sleep(0.01)


async def test_what_is_stored_slowly_does_not_outlast_what_came_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two threads overtook each other: the frames stayed stored, and the next start sent them to a device in use."""
    async with measuring(tmp_path, sample_s=0.1) as (_, here, desk):
        with held(here.desks.put_back, monkeypatch, bool) as (begun, may_write):
            saving = asyncio.create_task(desk.put_back.keep([GO_TO_MEASUREMENT]))
            await until(begun.is_set, "the writing begins")
            desk.put_back.transaction_ended()
            await until(lambda: reported(here, IS_BACK), "it is back")
            await turns()  # in which the removal would overtake it
            may_write.set()
            await saving
        await until(lambda: here.desks.put_back.all() == [], "nothing is stored")


async def test_a_job_that_is_stopped_while_its_frames_are_stored_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread went on when its job was stopped, and wrote the frames after their removal."""
    async with measuring(tmp_path, sample_s=0.1) as (_, here, desk):
        with held(here.desks.put_back, monkeypatch, bool) as (begun, may_write):
            saving = asyncio.create_task(desk.put_back.keep([GO_TO_MEASUREMENT]))
            await until(begun.is_set, "the writing begins")
            saving.cancel()
            await asyncio.gather(saving, return_exceptions=True)
            removing = asyncio.create_task(desk.put_back.keep(()))
            await turns()  # in which the removal would overtake it
            may_write.set()
            await removing
        await until(lambda: here.desks.put_back.all() == [], "nothing is stored")


async def test_what_is_left_while_the_end_of_the_earlier_is_stored_is_sent_as_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was added to a task that had done its work, and never sent."""
    async with measuring(tmp_path, sample_s=0.1) as (there, here, desk):
        await desk.put_back.keep([GO_TO_MEASUREMENT])
        with held(here.desks.put_back, monkeypatch, lambda frames: not frames) as (_, may_write):
            desk.put_back.transaction_ended()
            await until(lambda: not desk.put_back._frames, "it is back, and its end is being stored")
            await desk.member.access.send(GO_TO_CONFIG)
            await until(lambda: desk.state == "Config", "interrupted again")
            desk.put_back.begin([GO_TO_MEASUREMENT])
            may_write.set()
        await until(lambda: phase(there) == "measurement", "it measures")
        await until(lambda: here.desks.put_back.all() == [], "nothing is stored")


def cut_at(desk: DeviceController, answer: str, then: Callable[[], None] = lambda: None) -> None:
    """Let the link break when the device answers so."""

    def on_event(event: Event) -> None:
        if isinstance(event, Reply) and event.message.name == answer:
            off()
            link = desk.member.access.link
            assert isinstance(link, ThreadedLink)
            link.fail(LinkError("gone", "The adapter was unplugged.", "Plug it in."))
            then()

    off = desk.member.listeners.listen(on_event)


async def test_a_device_whose_link_broke_measures_again_when_the_link_is_back(tmp_path: Path) -> None:
    """It stayed silent until the server was restarted: only the next start put it back."""
    async with measuring(tmp_path) as (there, here, desk):
        cut_at(desk, "GoToConfigAck")
        assert (await here.read(desk)).state == "failed"
        await until(lambda: phase(there) == "measurement", "it measures")
        await until(lambda: reported(here, IS_BACK), "it is said")
        await until(lambda: here.desks.put_back.all() == [], "nothing is stored")


async def test_a_device_that_measures_by_itself_again_is_sent_nothing(tmp_path: Path) -> None:
    async with measuring(tmp_path, sample_s=PATIENCE_S) as (there, here, desk):
        written: list[bytes] = []
        desk.member.listeners.sent.add(lambda data, time_ns: written.append(data))
        cut_at(desk, "GoToConfigAck", there.cycle)  # its adapter feeds it
        assert (await here.read(desk)).state == "failed"
        await until(lambda: reported(here, IS_BACK), "it is back")
        assert GO_TO_MEASUREMENT not in written


async def test_a_device_that_another_program_configures_is_left_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with measuring(tmp_path, sample_s=0.1) as (there, here, desk):
        with serial.Serial(there.slave, 115_200) as port:
            port.write(GO_TO_CONFIG)
            await until(lambda: phase(there) == "config", "the program stops it")

        async def refuse(data: bytes) -> int:
            raise LinkError("busy", "xda_host is configuring the device.", "Wait.")

        monkeypatch.setattr(desk.member.access, "send", refuse)
        await desk.put_back.keep([GO_TO_MEASUREMENT])
        desk.put_back.transaction_ended()
        await until(lambda: here.desks.put_back.all() == [], "nothing is stored")
        assert "It is left to that program." in desk.log.tail()[-1].text
        assert phase(there) == "config"


async def test_a_device_that_a_person_stops_stays_stopped(tmp_path: Path) -> None:
    async with measuring(tmp_path) as (there, here, desk):
        await desk.put_back.keep([GO_TO_MEASUREMENT])
        desk.put_back.transaction_ended()
        work = partial(here.desks.jobs.run, command="GoToConfig", values={}, changes=False, restarts=False)
        assert (await over(desk.add("Stop", work))).state == "done"
        await until(lambda: here.desks.put_back.all() == [], "nothing is stored")
        assert phase(there) == "config"


async def test_a_device_that_was_found_in_the_config_state_stays_there(tmp_path: Path) -> None:
    async with measuring(tmp_path) as (there, here, desk):
        await desk.member.access.send(GO_TO_CONFIG)
        await until(lambda: phase(there) == "config", "another program stops it")
        assert (await here.read(desk)).state == "done"
        assert phase(there) == "config"
        assert "GoToMeasurement" not in [entry.name for entry in desk.log.tail(limit=500)]


def test_streams_that_a_read_may_end_are_stored(tmp_path: Path) -> None:
    stored: list[tuple[bytes, ...]] = []

    async def check() -> None:
        async with house_of("sim:isb?rate=50", tmp_path, listening=BRIEFEST) as (_, desk):
            desk.runner._put_back = lambda frames: _noted(stored, frames)
            driver = desk.driver
            body = driver.run("GET_DATA", {"id": 4, "size": 0, "offset": 0, "period": 0}, DeviceContext())
            await desk.run(driver.within(body, DeviceContext()))

    asyncio.run(check())
    assert all(frame[:2] == get_data(4)[:2] for frames in stored for frame in frames)
    assert not stored or stored[-1] == ()


async def _noted(stored: list[tuple[bytes, ...]], frames: Sequence[bytes]) -> None:
    stored.append(tuple(frames))


def test_a_damaged_file_costs_that_device_only(tmp_path: Path) -> None:
    store = PutBackStore(tmp_path)
    store.keep("/dev/ttyUSB0", "", [GO_TO_MEASUREMENT])
    for name, content in {"a": "", "b": "[]", "c": '{"source": "x", "device": "", "frames": ["zz"]}'}.items():
        (tmp_path / f"{name}.json").write_text(content)
    assert [(one.source, one.frames) for one in store.all()] == [("/dev/ttyUSB0", (GO_TO_MEASUREMENT.hex(),))]
    assert len(list(tmp_path.glob("*.json"))) == 1
    store.keep("/dev/ttyUSB0", "", ())
    assert store.all() == []


@pytest.mark.parametrize("frames", [[GO_TO_MEASUREMENT], []])
def test_a_disk_that_is_full_does_not_stop_a_read(tmp_path: Path, frames: list[bytes]) -> None:
    (tmp_path / "file").write_text(json.dumps([]))
    PutBackStore(tmp_path / "file").keep("/dev/ttyUSB0", "", frames)


async def test_a_device_that_a_kill_stopped_on_a_port_without_a_rate_measures_again(tmp_path: Path) -> None:
    """It was silent at every rate, so the port was never opened, and nothing owed to it was ever sent."""
    async with bench(measuring=True, baud=460_800) as there, house(tmp_path, sample_s=0.3) as here:
        here.desks.put_back.keep(there.slave, "", [GO_TO_MEASUREMENT], 460_800)
        with serial.Serial(there.slave, 460_800) as port:
            port.write(GO_TO_CONFIG)
            await until(lambda: phase(there) == "config", "the config state, as the kill left it")
        await here.desks.resume()
        session = here.sessions.at(there.slave)
        assert session is not None
        await until(lambda: phase(there) == "measurement", "it measures")
        await until(lambda: reported(here, IS_BACK), "it is back")
        await until(lambda: session.info.status == "live", "it is decoded")
        assert session.info.baud == 460_800
        assert any(WAITING in one.outcome for one in session.info.attempts)  # why it was silent


async def test_a_device_that_does_not_confirm_is_not_reported_to_be_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever arrived counted as its answer, so it was said to be back, and was left silent."""
    monkeypatch.setattr(put_back, "LONGEST_S", 0.1)
    async with measuring(tmp_path, sample_s=0.1) as (there, here, desk):
        await desk.member.access.send(GO_TO_CONFIG)
        await until(lambda: desk.state == "Config", "as the kill left it")
        await desk.put_back.keep([REQ_DID])  # is answered, by DeviceID
        desk.put_back.transaction_ended()
        await until(lambda: reported(here, UNCONFIRMED), "it is said")
        assert not reported(here, IS_BACK)
        await until(lambda: here.desks.put_back.all() == [], "nothing is stored")
        assert phase(there) == "config"


async def test_a_stopped_job_whose_device_is_not_back_leaves_what_is_owed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last frames of a stopped job were taken for carried out, and the file was removed."""
    monkeypatch.setattr(transaction_runner, "CONFIRM_S", 0.05)
    async with measuring(tmp_path) as (there, here, desk):
        send = desk.member.access.send

        async def lose(data: bytes) -> int:
            return await send(data) if data != GO_TO_MEASUREMENT else round(desk.bus.now() * 1e9)

        def never() -> Transaction[None]:
            yield from desk.driver.within(_waits(), desk.context)

        monkeypatch.setattr(desk.member.access, "send", lose)
        task = desk.add("Wait", lambda task: desk.run(never()))
        await until(lambda: phase(there) == "config", "it is interrupted")
        await desk.drop(task.job.id)
        assert [one.frames for one in here.desks.put_back.all()] == [(GO_TO_MEASUREMENT.hex(),)]
        monkeypatch.setattr(desk.member.access, "send", send)
        await until(lambda: phase(there) == "measurement", "it measures")
        await until(lambda: reported(here, IS_BACK), "it is back")


def _waits() -> Transaction[None]:
    yield Sleep(PATIENCE_S)
