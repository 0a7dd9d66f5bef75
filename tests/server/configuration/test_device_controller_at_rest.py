"""A device set to the config state by the user stays there until the user ends it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.commands.transactions import DeviceContext, DeviceRejectedError
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.frames import build
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.devices.device.device_demux import QuietReason
from imuscope.server.wire import Job
from tests.server.configuration.shared_line import both
from tests.support.control_harness import ControlHarness, bench, house, house_of, over
from tests.support.each_row import each_row
from tests.support.transaction_player import PlayedWire, play
from tests.support.waiting import until

DRIVER = XbusDriver()


async def send_command(
    here: ControlHarness, desk: DeviceController, command: str, values: dict[str, Any] | None = None
) -> Job:
    work = partial(
        here.desks.jobs.run, command=command, values=values or {}, changes=False, restarts=command == "Reset"
    )
    return await over(desk.add(command, work))


async def test_a_manual_query_leaves_the_state_of_the_device_unchanged(tmp_path: Path) -> None:
    """Regression: each of these ended the config state that the user had just requested."""
    async with bench() as there, house_of(f"{there.slave}?baud=115200", tmp_path) as (here, desk):
        for command in ("ReqDID", "GoToConfig", "ReqDID", "ReqOutputConfiguration"):
            job = await send_command(here, desk, command)
            assert job.state == "done", job.message
            rests = command != "ReqDID" or desk.at_rest
            assert getattr(there.device, "phase") == ("config" if rests else "measurement")  # noqa: B009
        assert desk.state == "Config"
        assert (await here.read(desk)).state == "done"
        assert (await here.apply(desk, {"LocationID": {"location_id": 5}})).state == "done"
        assert desk.state == "Config"
        assert (await send_command(here, desk, "GoToMeasurement")).state == "done"
        await until(lambda: desk.state == "Measurement" and not desk.at_rest, "it measures")
        assert (await send_command(here, desk, "ReqDID")).state == "done"
        await until(lambda: desk.state == "Measurement", "it measures again")


async def test_the_silence_of_a_device_at_rest_is_explained_by_it(tmp_path: Path) -> None:
    """It was called lost, with its power and cable to be checked."""
    async with bench() as there, house_of(f"{there.slave}?baud=115200", tmp_path) as (here, desk):
        await send_command(here, desk, "GoToConfig")
        await until(lambda: desk.member.info.status != "live", "it is silent")
        info = desk.member.info
        assert (info.status, info.resume) == ("idle", "GoToMeasurement")
        assert info.message == "“GoToConfig” put it into the config state, in which it sends no data."
        assert info.quiet_since is not None
        assert info.hint == "Send GoToMeasurement to resume measuring."
        await send_command(here, desk, "GoToMeasurement")
        await until(lambda: desk.member.info.status == "live", "it measures")
        assert (desk.member.info.hint, desk.member.info.resume) == ("", "")
        there.unplug()
        await until(lambda: desk.member.info.status == "lost", "it is unplugged")
        assert "GoToMeasurement" not in desk.member.info.hint


@each_row(
    ("by_hand", "message"),
    [
        (True, "Send hex put it into the config state, in which it sends no data."),
        (False, "Another program put it into the config state, in which it sends no data."),
    ],
)
async def test_a_device_that_was_put_into_config_by_bytes_is_not_lost(
    tmp_path: Path, by_hand: bool, message: str
) -> None:
    """It was called lost, with its power to be checked, and not confirmed after it measured again."""
    async with bench() as there, house_of(f"{there.slave}?baud=115200", tmp_path) as (here, desk):
        await send_command(here, desk, "ReqDID")
        if by_hand:
            await over(desk.add("Send 5 bytes", partial(here.desks.jobs.raw, data=build(0x30))))
        else:
            await desk.member.access.send(build(0x30))
        await until(lambda: desk.member.info.status != "live", "it is silent")
        info = desk.member.info
        assert (info.status, info.resume, info.message) == ("idle", "GoToMeasurement", message)
        assert info.quiet_since is not None
        await send_command(here, desk, "GoToMeasurement")
        await until(lambda: desk.member.info.status == "live", "it measures")
        now = desk.member.info
        assert (now.message, now.resume, now.quiet_since, now.unconfirmed_since) == ("", "", None, None)


async def test_output_that_bytes_by_hand_ended_is_not_lost(tmp_path: Path) -> None:
    async with house_of("sim:isb?rate=50", tmp_path) as (here, desk):
        stop = desk.driver.frame("STOP_BROADCASTS_ALL_PORTS", {}, desk.context)
        await over(desk.add("Send bytes", partial(here.desks.jobs.raw, data=stop)))
        await until(lambda: desk.member.info.status != "live", "it is silent")
        assert (desk.member.info.status, desk.member.info.message) == ("idle", "Send hex ended its output.")


async def test_streams_that_the_user_stopped_are_not_lost(tmp_path: Path) -> None:
    """An IMX was called lost after "Stop all streams", with its power to be checked."""
    async with house_of("sim:isb?rate=50", tmp_path) as (here, desk):
        assert (await send_command(here, desk, "STOP_BROADCASTS_ALL_PORTS")).state == "done"
        await until(lambda: desk.member.info.status != "live", "it is silent")
        assert desk.member.info.status == "idle"
        assert desk.member.info.message == "“STOP_BROADCASTS_ALL_PORTS” ended its output."


def test_a_silence_that_begins_long_after_a_stop_is_not_explained_by_it() -> None:
    reason = QuietReason("Stopped.", "", "", since=100.0)
    assert reason.explains(None)
    assert reason.explains(101.0)
    assert not reason.explains(160.0)


async def test_a_device_at_rest_beside_others_is_explained_too(tmp_path: Path) -> None:
    async with house(tmp_path) as here:
        for desk in await both(here):
            await send_command(here, desk, "GoToConfig")
            await until(lambda info=desk.member: info.info.status == "idle", "it is silent")
            assert "Send GoToMeasurement" in desk.member.info.hint
            await send_command(here, desk, "GoToMeasurement")
            await until(lambda info=desk.member: info.info.status == "live", "it measures")


async def test_a_restart_ends_the_rest(tmp_path: Path) -> None:
    async with bench() as there, house_of(f"{there.slave}?baud=115200", tmp_path) as (here, desk):
        await send_command(here, desk, "GoToConfig")
        assert desk.at_rest
        assert (await send_command(here, desk, "Reset")).state == "done"
        await until(lambda: desk.state == "Measurement", "it measures")
        assert not desk.at_rest
        assert (await here.read(desk)).state == "done"
        await until(lambda: desk.state == "Measurement", "it measures again")


@each_row("at_rest", [False, True])
def test_a_refusal_leaves_a_device_at_rest_where_it_was(at_rest: bool) -> None:
    device = XbusSimulator(measuring=True)
    wire = PlayedWire(device, "xbus")
    if at_rest:
        play(DRIVER.run("GoToConfig", {}, DeviceContext()), wire)
    known = DeviceContext(at_rest=at_rest)
    with pytest.raises(DeviceRejectedError):
        play(DRIVER.within(DRIVER.run("ReqGnssPlatform", {}, known), known), wire)
    assert device.phase == ("config" if at_rest else "measurement")
