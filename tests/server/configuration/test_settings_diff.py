"""A comparison covers settings only, not temperatures, counters and momentary states."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.api.snapshots import compare_sides
from imuscope.server.configuration.api_models import CompareRequest, SideRef
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.form_builder import forms_of
from imuscope.server.configuration.settings_diff import ComparedValues, compare
from imuscope.server.errors import DomainError
from tests.support.control_harness import house, house_of

IMX = DeviceContext(product="IMX-5", serial_number="1", firmware="2.7.1.0")


async def test_temperatures_and_up_time_are_no_differences(tmp_path: Path) -> None:
    """Two readings of one device without a change between them have no differences."""
    async with house_of("sim:isb?rate=20", tmp_path, is_read=True) as (here, desk):
        first = ComparedValues("First", desk.values)
        await asyncio.sleep(0.02)
        await here.read(desk)
        assert first.values["DID_SYS_PARAMS"] != desk.values["DID_SYS_PARAMS"]
        results = compare(desk.driver, desk.context, ComparedValues("Now", desk.values), first)
        assert results.rows == []
        assert results.same > 50
        assert "DID_SYS_PARAMS" not in {*results.missing, *results.profile, *results.changes}


def test_a_profile_saved_during_a_calibration_does_not_start_one() -> None:
    """The state of a calibration starts it when it is written."""
    driver = PROTOCOLS["isb"].configuration.driver
    rest = {"DID_MAG_CAL": {"state": 0, "progress": 0.0, "declination": 0.0}}
    rest |= {"DID_SURVEY_IN": {"state": 0, "maxDurationSec": 60, "minAccuracy": 1.0}}
    busy = {"DID_MAG_CAL": {"state": 1, "progress": 7.0, "declination": 0.1}}
    busy |= {"DID_SURVEY_IN": {"state": 2, "maxDurationSec": 90, "minAccuracy": 1.0}}
    results = compare(driver, IMX, ComparedValues("Now", rest), ComparedValues("Profile", busy))
    assert results.changes == {"DID_SURVEY_IN": {"maxDurationSec": 90}}
    assert [row.path for row in results.rows] == ["maxDurationSec"]
    assert "DID_MAG_CAL" not in results.profile
    assert "state" not in results.profile["DID_SURVEY_IN"]


async def test_unknown_factory_settings_are_not_compared(tmp_path: Path) -> None:
    """An empty side was shown as "No difference, 0 values agree"."""

    async def refusal(desk: DeviceController, here: Any) -> DomainError | None:
        try:
            await compare_sides(CompareRequest(SideRef("device"), SideRef("factory")), desk, here.desks)
        except DomainError as error:
            return error
        return None

    async with house(tmp_path) as here:
        imx, mti = await here.add("sim:isb?rate=20"), await here.add("sim:xbus?baud=921600&rate=20")
        for desk in (imx, mti):
            await here.read(desk)
        error = await refusal(imx, here)
        assert error is not None
        assert error.kind == "no-defaults"
        assert "IMX-5" in error.message
        assert await refusal(mti, here) is None
        assert [forms_of(desk.driver, "x", desk.context).factory for desk in (imx, mti)] == [False, True]


def streams(*entries: tuple[int, int, float]) -> dict[str, Any]:
    """Streams by data set, multiple and period of the source, ms."""
    return {"streams": [dict(zip(("did", "period", "source_ms"), one, strict=True), size=80) for one in entries]}


def test_streams_were_compared_by_their_place_in_the_list() -> None:
    """A stream more at the beginning made each that follows a difference: "Streams 2, did: DID_IMU / DID_INS_2"."""
    driver = PROTOCOLS["isb"].configuration.driver
    here = {"streams": streams((58, 1, 20.0), (4, 1, 20.0), (5, 1, 20.0))}
    here |= {
        "DID_NMEA_BCAST_PERIOD": {"nmeaBroadcastMsgs": [{"msgID": 6, "msgPeriod": 5}, {"msgID": 0, "msgPeriod": 0}]}
    }
    there = {"streams": streams((5, 2, 20.0), (4, 1, 20.0))}
    there |= {"DID_NMEA_BCAST_PERIOD": {"nmeaBroadcastMsgs": [{"msgID": 7, "msgPeriod": 1}]}}
    results = compare(driver, IMX, ComparedValues("Now", here), ComparedValues("Profile", there))
    assert [(row.title, row.left, row.right) for row in results.rows] == [
        ("IMU", "50 Hz", "off"),
        ("INS 2", "50 Hz", "25 Hz"),
        ("NMEA PGPSP", "1 in 5", "off"),
        ("NMEA GNGGA", "off", "at the rate of its source"),
    ]
    assert results.changes == there


def test_single_differences_are_taken_or_left() -> None:
    """A profile was written as a whole or not at all."""
    driver = PROTOCOLS["isb"].configuration.driver
    here = {
        "streams": streams((58, 1, 20.0), (5, 1, 20.0)),
        "DID_SURVEY_IN": {"maxDurationSec": 60, "minAccuracy": 1.0},
    }
    wifi = [dict(zip(("ssid", "psk"), (name, ""), strict=True)) for name in "abcdef"]
    here |= {"DID_EVB_FLASH_CFG": {"wifi": wifi[:3]}}
    there = {
        "streams": streams((4, 1, 20.0), (5, 2, 20.0)),
        "DID_SURVEY_IN": {"maxDurationSec": 90, "minAccuracy": 2.0},
    }
    there |= {"DID_EVB_FLASH_CFG": {"wifi": wifi[3:]}}
    sides = ComparedValues("Now", here), ComparedValues("Profile", there)
    assert all(row.take for row in compare(driver, IMX, *sides).rows)
    keys = {row.key for row in compare(driver, IMX, *sides).rows}
    left_out = {"streams/streams.0x003A", "streams/streams.0x0005"}
    left_out |= {"DID_SURVEY_IN/minAccuracy", "DID_EVB_FLASH_CFG/wifi.1.ssid"}
    assert left_out < keys
    results = compare(driver, IMX, *sides, dict.fromkeys(left_out, False))
    assert {row.key for row in results.rows if not row.take} == left_out
    assert results.changes == {
        "streams": streams((4, 1, 20.0), (58, 1, 20.0), (5, 1, 20.0)),
        "DID_SURVEY_IN": {"maxDurationSec": 90},
        "DID_EVB_FLASH_CFG": {"wifi": [wifi[3], wifi[1], wifi[5]]},
    }
    assert compare(driver, IMX, *sides, dict.fromkeys(keys, False)).changes == {}


def test_the_number_given_to_another_sensor_is_not_taken_unasked() -> None:
    """A LocationID travelled with a profile from one sensor to the next."""
    driver, known = PROTOCOLS["xbus"].configuration.driver, DeviceContext(product="MTi-630")
    here, there = ({"LocationID": {"location_id": number}} for number in (1, 2))
    own, other = (ComparedValues("Profile", there, of_another=of_another) for of_another in (False, True))
    left = ComparedValues("Now", here)
    assert compare(driver, known, left, own).changes == there
    assert compare(driver, known, left, other).changes == {}
    (row,) = compare(driver, known, left, other).rows
    assert compare(driver, known, left, other, {row.key: True}).changes == there


SYNC = {"line": 2, "polarity": 1, "trigger_once": 0, "skip_first": 0, "skip_factor": 0, "pulse_width": 0}
SYNC |= {"delay_offset_or_clock_period": 0}


def test_an_entry_that_one_side_has_is_one_difference() -> None:
    """Each of its fields was a difference, by its name in the document: "Sync in and out 3, skip_factor"."""
    driver, known = PROTOCOLS["xbus"].configuration.driver, DeviceContext(product="MTi-630")
    first, second, third = (dict(SYNC, function=function) for function in (3, 8, 9))
    changed = dict(second, skip_factor=4)
    fewer, more = ({"SyncSettings": {"settings": entries}} for entries in ([first, second], [first, changed, third]))
    added, removed = (
        compare(driver, known, ComparedValues("Now", here), ComparedValues("File", there), dict.fromkeys(take, False))
        for here, there, take in (
            (fewer, more, ["SyncSettings/settings.2"]),
            (more, fewer, ["SyncSettings/settings.2"]),
        )
    )
    assert [row.title for row in added.rows] == ["Sync in and out 3", "Sync in and out 2, Skip factor"]
    assert added.rows[0].left == ""
    assert added.rows[0].right.startswith("Function ClockBiasEstimation, Line In1, Polarity rising edge")
    assert added.changes["SyncSettings"]["settings"] == [first, changed]
    assert removed.changes["SyncSettings"]["settings"] == [first, second, third]
