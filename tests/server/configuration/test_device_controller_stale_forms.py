"""Settings changed by a command: forms do not show outdated values."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.preview import load_of
from tests.support.control_harness import ControlHarness, house_of, outputs, over
from tests.support.each_row import each_row
from tests.support.waiting import until

IMX, MTI = "sim:isb?rate=20", "sim:xbus?baud=921600&rate=20"


def dids(desk: DeviceController) -> set[int]:
    return {one["did"] for one in desk.values["streams"]["streams"]}


async def command(
    here: ControlHarness, desk: DeviceController, name: str, restarts: bool = False, **values: object
) -> None:
    work = partial(here.desks.jobs.run, command=name, values=values, changes=False, restarts=restarts)
    job = await over(desk.add(name, work))
    assert job.state == "done", job.message


async def test_a_preset_of_streams_updates_the_form(tmp_path: Path) -> None:
    """Regression: six streams were on, but the form showed the replaced ones; a restart updated it."""
    async with house_of(IMX, tmp_path, is_read=True) as (here, desk):
        before = dids(desk)
        await command(here, desk, "DID_RMC.INS", options=0)
        assert dids(desk) != before
        await command(here, desk, "DID_SYS_CMD.SOFTWARE_RESET", restarts=True)
        assert dids(desk) == before
        await command(here, desk, "STOP_BROADCASTS_CURRENT_PORT")
        assert dids(desk) == set()


async def test_factory_settings_update_every_form(tmp_path: Path) -> None:
    async with house_of(MTI, tmp_path, is_read=True) as (here, desk):
        assert (await here.apply(desk, {"LocationID": {"location_id": 7}})).state == "done"
        await command(here, desk, "RestoreFactoryDef")
        assert desk.values["LocationID"] == {"location_id": 0}


async def test_values_changed_by_a_command_are_marked_stale_if_unreadable(tmp_path: Path) -> None:
    """After user-composed bytes, the setting that they write is unknown until it is read again."""
    async with house_of(MTI, tmp_path, is_read=True) as (here, desk):
        frame = desk.driver.frame("SetLocationID", {"location_id": 9}, desk.context)
        job = await over(desk.add("Send 7 bytes", partial(here.desks.jobs.raw, data=frame)))
        assert job.state == "done"
        assert "LocationID" not in desk.values
        assert desk.missing["LocationID"] == "not read since “Send 7 bytes”"
        assert "OutputConfiguration" in desk.values
        request = desk.driver.frame("ReqDID", {}, desk.context)
        await over(desk.add("Ask", partial(here.desks.jobs.raw, data=request)))
        assert "OutputConfiguration" in desk.values
        await over(desk.add("Send 2 bytes", partial(here.desks.jobs.raw, data=b"\x00\x01")))
        assert not desk.values
        await here.read(desk)
        assert not desk.missing


async def test_a_new_navigation_period_updates_the_streams_form(tmp_path: Path) -> None:
    async with house_of(IMX, tmp_path, is_read=True) as (here, desk):
        change = {"DID_FLASH_CONFIG": {"startupNavDtMs": 40, "startupImuDtMs": 40}}
        assert (await here.apply(desk, change)).state == "done"
        assert desk.values["DID_SYS_PARAMS"]["navOutputPeriodMs"] == 40
        row = next(one for one in desk.values["streams"]["streams"] if one["did"] == 4)
        assert row["source_ms"] == pytest.approx(40, rel=0.05)


async def test_unread_outputs_are_not_treated_as_empty(tmp_path: Path) -> None:
    """Regression: the link budget was 0 B/s beside the measured rate."""
    async with house_of(MTI, tmp_path) as (here, desk):
        await over(desk.add("Read", partial(here.desks.jobs.read, names=["LocationID"], reason="")))
        assert load_of(desk.present, desk.values, 921_600) is None
        merged = {**desk.values, "OutputConfiguration": outputs(100)}
        load = load_of(desk.present, merged, 921_600)
        assert load is not None
        assert load.total > 0


@each_row(
    ("protocol", "name", "values", "some"),
    [
        ("isb", "DID_RMC.IMX_PPD", {"options": 0}, {"streams"}),
        ("isb", "SET_DID_RMC", {"bits": 0, "options": 0}, {"streams"}),
        ("isb", "GET_DID_INS_1", {"period": 4}, {"streams"}),
        ("isb", "GET_DID_INS_1", {"period": 0}, set()),
        ("isb", "STOP_DID_BROADCAST", {"id": 4}, {"streams"}),
        ("isb", "STPB", {}, {"streams", "DID_NMEA_BCAST_PERIOD"}),
        ("isb", "ASCE", {}, {"DID_NMEA_BCAST_PERIOD"}),
        ("isb", "SRST", {}, {"streams", "DID_NMEA_BCAST_PERIOD", "DID_MAG_CAL"}),
        ("isb", "DID_MAG_CAL.MULTI_AXIS", {}, {"DID_MAG_CAL"}),
        ("isb", "DID_SYS_CMD.MANF_CHIP_ERASE", {}, {"DID_FLASH_CONFIG", "streams"}),
        ("isb", "SET_DID_SYS_CMD", {"command": 99}, {"streams", "DID_NMEA_BCAST_PERIOD"}),
        ("isb", "SET_DID_SYS_CMD", {"command": 97}, set()),
        ("isb", "DID_SYS_CMD.SAVE_FLASH", {}, set()),
        ("xbus", "RestoreFactoryDef", {}, {"LocationID", "OutputConfiguration", "AlignmentRotation.RotLocal"}),
        ("xbus", "ResetOrientation.Stored", {"code": 4}, {"AlignmentRotation.RotSensor", "AlignmentRotation.RotLocal"}),
        ("xbus", "ResetOrientation", {"code": 4}, set()),
        ("xbus", "Reset", {}, set()),
    ],
)
def test_settings_changed_by_a_command(protocol: str, name: str, values: dict[str, object], some: set[str]) -> None:
    driver = PROTOCOLS[protocol].configuration.driver
    known = DeviceContext(product="IMX-5" if protocol == "isb" else "MTi-630")
    assert name in {row.name for row in driver.commands(known)}
    results = set(driver.alters(name, values, known))
    assert results <= {row.name for row in driver.settings(known)}
    assert (some <= results) if some else not results


@each_row(
    ("source", "silence", "change", "speech"),
    [
        (IMX, "STOP_BROADCASTS_CURRENT_PORT", {"streams": {"streams": [{"did": 4, "period": 2}]}}, ""),
        (MTI, "GoToConfig", {"OutputConfiguration": outputs(50)}, "GoToMeasurement"),
    ],
)
async def test_a_silent_device_is_not_reported_unreachable(
    tmp_path: Path, source: str, silence: str, change: dict[str, dict[str, object]], speech: str
) -> None:
    """Its link is open all the while, and it answers. Streams that are written make it speak again; a device that was
    sent to the config state stays there until it is sent back.
    """
    async with house_of(source, tmp_path, is_read=True) as (here, desk):
        await command(here, desk, silence)
        await until(lambda: desk.member.info.status != "live", "it is silent")
        assert desk.member.info.is_open
        assert (await here.read(desk)).state == "done"
        job = await here.apply(desk, change)
        assert (job.state, job.outcomes) == ("done", []), job.message
        if speech:
            await command(here, desk, speech)
        await until(lambda: desk.member.info.status == "live", "it streams again")
