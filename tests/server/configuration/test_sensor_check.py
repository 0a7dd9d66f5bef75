"""A change, a link and a name reach the sensor that was meant: on any port, after a restart, after a swap."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

import pytest

from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.api.configure import apply, confirmed, wanted_sensor
from imuscope.server.configuration.api_models import ApplyRequest
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.sensor_check import doubts, sensor_of
from imuscope.server.devices.device.device_names import MAX_IDS, DeviceNames
from imuscope.server.errors import DomainError
from imuscope.server.links.simulated_device import SimulatorOptions
from imuscope.server.links.simulated_line import LineFaults
from imuscope.server.links.simulator import SimulatorThread
from tests.support.control_harness import ControlHarness, house, outputs, over
from tests.support.waiting import until

FIRST, SECOND = 0x0080800006, 0x0080800009
OLD, NEW = "0080800006", "0080800009"


@asynccontextmanager
async def plugged(serial: int, at: Path) -> AsyncIterator[None]:
    """A measuring MTi-630 that the path leads to, as udev's links do."""
    options = SimulatorOptions("xbus", faults=LineFaults(baud=115_200))
    there = SimulatorThread(
        lambda start_ns: XbusSimulator("MTi-630", serial, start_ns=start_ns, rate=20, measuring=True), options
    )
    there.start()
    link = at.with_suffix(".new")
    link.symlink_to(there.slave)
    link.replace(at)
    try:
        yield
    finally:
        there.stop()


@asynccontextmanager
async def swapped(tmp_path: Path) -> AsyncIterator[tuple[ControlHarness, DeviceController]]:
    """A server that has read one sensor, and whose port has another one of the same product and settings by now."""
    port = tmp_path / "ttyIMU"
    async with house(tmp_path) as here:
        async with plugged(FIRST, port):
            desk = await here.add(f"{port}?baud=115200")
            assert (await here.read(desk)).state == "done"
            assert desk.member.info.key == f"xbus-{OLD}"
        await until(lambda: desk.member.info.status == "lost", "it is unplugged")
        async with plugged(SECOND, port):
            desk.member.link_session.retry()
            await until(lambda: desk.member.info.status == "live", "another one streams")
            yield here, desk


async def test_a_change_for_one_sensor_is_not_written_to_another(tmp_path: Path) -> None:
    """The other sensor had the same settings, so the check of the base passed."""
    async with swapped(tmp_path) as (here, desk):
        assert desk.member.info.serial_number == OLD  # it was measuring: nothing has told yet
        assert desk.member.info.unconfirmed_since is not None
        base = {"OutputConfiguration": desk.values["OutputConfiguration"]}
        work = partial(
            here.desks.jobs.apply, changes={"OutputConfiguration": outputs(10)}, reason="", base=base, sensor=OLD
        )
        job = await over(desk.add("Write", work))
        assert job.state == "failed"
        assert job.message == f"Another sensor is at this port: {NEW}, not {OLD}. Nothing was written."
        assert "SetOutputConfiguration" not in [entry.name for entry in desk.log.tail(limit=500)]
        assert desk.member.info.serial_number == NEW
        assert desk.member.info.unconfirmed_since is None
        [event] = [one for one in here.telemetry.log if one.data.get("kind") == "replaced"]
        assert event.text == f"Another sensor is here: MTi-630 {NEW}, in place of {OLD}."


async def test_values_of_the_sensor_that_is_gone_are_not_shown_as_those_of_the_next(tmp_path: Path) -> None:
    async with swapped(tmp_path) as (here, desk):
        held = desk.values
        job = await over(desk.add("Read", partial(here.desks.jobs.read, names=["FilterProfile"], reason="")))
        assert job.state == "done"
        assert len(held) > 1
        assert list(desk.values) == ["FilterProfile"]


async def test_a_command_needs_confirmation_while_it_is_not_known_which_sensor_is_there(tmp_path: Path) -> None:
    async with swapped(tmp_path) as (_, desk):
        with pytest.raises(DomainError) as error:
            confirmed(doubts(desk, OLD), is_confirmed=False)
        assert error.value.kind == "confirm"
        assert f"it is not known whether this is still {OLD}" in error.value.message
        assert doubts(desk, "") == []  # asked for whatever is at this port


async def test_a_request_may_name_a_device_by_its_key(tmp_path: Path) -> None:
    async with house(tmp_path) as here, plugged(FIRST, tmp_path / "a"), plugged(SECOND, tmp_path / "b"):
        one = await here.add(f"{tmp_path / 'a'}?baud=115200")
        two = await here.add(f"{tmp_path / 'b'}?baud=115200")
        for desk in (one, two):
            await here.read(desk)
        # what a script held before the number was known names it still, and so does its topic
        assert [here.sessions.id_of(name) for name in (f"{tmp_path / 'b'}?baud=115200", "imu_2")] == [two.device] * 2
        key = f"xbus-{NEW}"
        assert here.desks.get(key) is two
        assert here.sessions.get(key) is two.member.link_session
        assert wanted_sensor(key, two) == NEW
        assert sensor_of(two, two.device) == ""
        body = ApplyRequest({"OutputConfiguration": outputs(10)}, devices=[f"xbus-{OLD}"], confirmed=True)
        await apply(body, here.desks.get(key), NEW, here.desks)
        await until(lambda: one.job_report.done[0].id > 1 and two.job_report.done[0].id > 1, "both are written")
        assert [desk.job_report.done[0].state for desk in (one, two)] == ["done", "done"]
        with pytest.raises(KeyError):
            here.desks.get("xbus-0080800001")


def test_sources_in_another_order_have_the_ids_of_the_run_before(tmp_path: Path) -> None:
    """A tab that was open over a restart wrote the draft for one sensor to the other."""
    first = DeviceNames(tmp_path)
    left, right = first.id_of("/dev/ttyUSB0", []), first.id_of("/dev/ttyUSB1", ["1"])
    second = DeviceNames(tmp_path)
    assert second.id_of("/dev/ttyUSB1", []) == right
    assert second.id_of("/dev/ttyUSB0", [right]) == left
    assert second.id_of("/dev/ttyUSB2", [right, left]) not in (left, right)


def test_an_id_is_never_given_to_another_source(tmp_path: Path) -> None:
    names = DeviceNames(tmp_path)
    assert names.id_of("sim:xbus", []) == "1"
    assert names.id_of("sim:xbus", ["1"]) == "2"  # simulators of one source are different devices
    assert names.id_of("/dev/ttyUSB0", []) == "3"
    assert DeviceNames(tmp_path).id_of("/dev/ttyUSB1", []) == "4"
    file = tmp_path / "devices.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "next": 1}))
    assert DeviceNames(tmp_path).id_of("/dev/ttyUSB2", []) == "5"


def test_a_source_that_comes_and_goes_ten_thousand_times_does_not_fill_the_file(tmp_path: Path) -> None:
    """Each time added one more id to the file, which was then written as a whole."""
    names, used = DeviceNames(tmp_path), set[str]()
    for _ in range(300):
        used.add(names.id_of("/dev/ttyUSB0", used))
    assert len(used) == 300
    file = tmp_path / "devices.json"
    content = json.loads(file.read_text())
    assert len(content["ids"]["/dev/ttyUSB0"]) == MAX_IDS
    later = DeviceNames(tmp_path)
    assert later.id_of("/dev/ttyUSB0", []) == "1"
    assert later.id_of("/dev/ttyUSB1", []) == "301"
    file.write_text(json.dumps({**content, "ids": {"/dev/ttyUSB0": [str(one) for one in range(1, 301)]}}))
    assert DeviceNames(tmp_path).id_of("/dev/ttyUSB1", []) == "301"  # a file of an earlier version is cut


def test_a_damaged_file_of_names_counts_as_absent(tmp_path: Path) -> None:
    for content in ("", "[]", '{"ids": 3, "names": [1]}', '{"ids": {"a": [1, "x", "2"]}, "next": "9"}', "[" * 100_000):
        (tmp_path / "devices.json").write_text(content)
        assert DeviceNames(tmp_path).id_of("b", []) in ("1", "3")


async def test_a_name_of_ones_own_follows_the_sensor(tmp_path: Path) -> None:
    port, other = tmp_path / "ttyIMU", tmp_path / "ttyIMU2"

    async with house(tmp_path) as here, plugged(FIRST, port):
        desk = await here.add(f"{port}?baud=115200")
        here.sessions.names.rename(desk.member.info.key, "left  wheel ")  # named before its number is known
        assert desk.member.info.own_name == "left wheel"
        await here.read(desk)
        assert (desk.member.info.key, desk.member.info.own_name) == (f"xbus-{OLD}", "left wheel")
        await here.sessions.remove(desk.device)
        other.symlink_to(port.readlink())
        moved = await here.add(f"{other}?baud=115200")
        assert moved.member.info.own_name == ""
        await here.read(moved)
        assert moved.member.info.own_name == "left wheel"


def test_a_name_that_cannot_be_shown_is_refused(tmp_path: Path) -> None:
    names = DeviceNames(tmp_path)
    for name, why in {"x" * 61: "61 characters", "a\0b": "cannot be shown"}.items():
        with pytest.raises(DomainError, match=why):
            names.rename("xbus-1", name)
    names.rename("xbus-1", "mast")
    assert DeviceNames(tmp_path).name_of("xbus-1") == "mast"
    names.rename("xbus-1", "")
    assert DeviceNames(tmp_path).name_of("xbus-1") == ""
