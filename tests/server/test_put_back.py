"""Devices are put back into the state in which they were found, also by the next run of a server that was killed."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from pathlib import Path

import pytest
import serial

from imuscope.protocols.isb.frames import get_data
from imuscope.protocols.transactions import DeviceContext
from imuscope.protocols.xbus.frames import build
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.configuration.put_back import PutBackStore
from imuscope.server.links.simulator import SimulatorThread
from tests.server.control_harness import BRIEFEST, bench, house
from tests.waiting import until

GO_TO_CONFIG, GO_TO_MEASUREMENT = build(0x30), build(0x10)


def phase(there: SimulatorThread) -> str:
    assert isinstance(there.device, XbusSimulator)
    return there.device.phase


def test_a_read_stores_how_to_measure_again_before_it_interrupts(tmp_path: Path) -> None:
    stored: list[tuple[bytes, ...]] = []

    async def check() -> None:
        async with bench(measuring=True) as there, house(tmp_path) as here:
            desk = await here.add(f"{there.slave}?baud=115200")

            def keep(source: str, device: str, frames: Sequence[bytes]) -> None:
                assert (source, device) == (desk.session.info.source, "")
                sent = [entry.name for entry in desk.log.tail(limit=500)]
                assert ("GoToConfig" in sent) == (not frames)  # stored before, removed after
                stored.append(tuple(frames))

            desk._put_back = keep
            assert (await here.read(desk)).state == "done"

    asyncio.run(check())
    assert stored == [(GO_TO_MEASUREMENT,), ()]


def test_a_device_of_a_server_that_was_killed_measures_again(tmp_path: Path) -> None:
    """Killed while it read the settings, it left the robot's sensor silent until somebody noticed."""

    async def check() -> None:
        async with bench(measuring=True) as there, house(tmp_path) as here:
            source = f"{there.slave}?baud=115200"
            here.desks.put_back.keep(source, "", [GO_TO_MEASUREMENT])
            with serial.Serial(there.slave, 115_200) as port:
                port.write(GO_TO_CONFIG)
                await until(lambda: phase(there) == "config", "the config state, as the kill left it")
            await here.desks.resume()
            await until(lambda: phase(there) == "measurement", "it measures")
            (desk,) = here.desks._controllers.values()
            await until(lambda: desk.job_report.done, "the job is over")
            assert desk.job_report.done[0].state == "done"
            assert here.desks.put_back.all() == []

    asyncio.run(check())


def test_a_device_that_was_found_in_the_config_state_stays_there(tmp_path: Path) -> None:
    async def check() -> None:
        async with bench(measuring=True) as there, house(tmp_path) as here:
            desk = await here.add(f"{there.slave}?baud=115200")
            await desk.session.send(GO_TO_CONFIG)
            await until(lambda: phase(there) == "config", "another program stops it")
            assert (await here.read(desk)).state == "done"
            assert phase(there) == "config"
            assert "GoToMeasurement" not in [entry.name for entry in desk.log.tail(limit=500)]

    asyncio.run(check())


def test_streams_that_a_read_may_end_are_stored(tmp_path: Path) -> None:
    stored: list[tuple[bytes, ...]] = []

    async def check() -> None:
        async with house(tmp_path, listening=BRIEFEST) as here:
            desk = await here.add("sim:isb?rate=50")
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
