"""Profiles for other devices, and the link budget check on every way of changing settings."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.isb.driver import IsbDriver
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.products import MODELS
from imuscope.server.configuration.budget import overload, overload_error
from imuscope.server.configuration.preview import DevicePresentState, SerialLine
from imuscope.server.configuration.products import base_name, mismatch, same_product
from imuscope.server.configuration.settings_diff import ComparedValues, compare
from tests.support.control_harness import house, outputs
from tests.support.each_row import each_row

LINE = SerialLine(115_200, 11_520.0)
OVER = outputs(400, 0x2010, 0x4020, 0x8020, 0xC020)


def mti(values: dict[str, Any]) -> DevicePresentState:
    return DevicePresentState(XbusDriver(), DeviceContext(product="MTi-630", baud=115_200), LINE, values)


def test_what_a_product_lacks_is_refused_before_it_is_written() -> None:
    """Outputs of a GNSS receiver and the filter profile of another product were offered, and taken, for an MTi-630."""
    profiles = [{"type": 1, "version": 1, "label": name} for name in ("Responsive", "VRU")]
    here = {
        "OutputConfiguration": outputs(50),
        "FilterProfile": {"profile": "Responsive"},
        "LocationID": {"location_id": 1},
    }
    listed = {"AvailableFilterProfiles": {"profiles": profiles}}
    there = {"OutputConfiguration": outputs(20, 0x4020, 0x7010), "FilterProfile": {"profile": "General_RTK"}}
    there |= {"LocationID": {"location_id": 2}}
    known, sides = (
        DeviceContext(product="MTi-630"),
        (ComparedValues("Now", here | listed), ComparedValues("Profile", there)),
    )
    results = compare(XbusDriver(), known, *sides)
    refused = {row.path: row.why for row in results.rows if row.why}
    assert set(refused) == {"outputs.0x7010", "profile"}
    assert "MTi-630 has no" in refused["outputs.0x7010"]
    assert refused["profile"] == "The device lists Responsive, VRU."
    assert not any(row.take or row.writable for row in results.rows if row.why)
    assert "FilterProfile" not in results.changes
    assert {one["data_identifier"] for one in results.changes["OutputConfiguration"]["outputs"]} == {
        0x1020,
        0x1060,
        0x4020,
    }
    of_itself = compare(XbusDriver(), known, sides[0], replace(sides[1], from_device=True))
    assert not any(row.why for row in of_itself.rows), "what the device reported may be written back"


def test_nothing_is_taken_but_what_was_chosen() -> None:
    """Differences that a page had not shown yet were taken, because those that nobody chose were."""
    here, there = ({"LocationID": {"location_id": n}, "OutputConfiguration": outputs(n)} for n in (20, 50))
    known, sides = DeviceContext(product="MTi-630"), (ComparedValues("Now", here), ComparedValues("Profile", there))
    chosen = {"LocationID/location_id": True}
    assert compare(XbusDriver(), known, *sides, chosen, take_rest=False).changes == {"LocationID": {"location_id": 50}}
    assert compare(XbusDriver(), known, *sides, take_rest=False).changes == {}


async def test_the_job_also_refuses_an_excessive_load(tmp_path: Path) -> None:
    """A profile of 400 Hz once filled a line of 115 200 Bd more than twice, because only the form looked."""
    async with house(tmp_path) as there:
        desk = await there.add("sim:xbus?rate=20")
        job = await there.apply(desk, {"OutputConfiguration": OVER, "LocationID": {"location_id": 7}})
        assert job.state == "failed"
        assert "% of the link (115 200 Bd)" in job.message
        assert "Nothing was written" in job.hint
        assert desk.values["LocationID"] == {"location_id": 0}


def test_an_excessive_load_is_reported_and_a_reduced_one_is_not() -> None:
    low, high = outputs(50), OVER
    assert overload(mti({"OutputConfiguration": low}), {"OutputConfiguration": low}) == ""
    assert "% of the link" in overload(mti({"OutputConfiguration": low}), {"OutputConfiguration": high})
    over_already = mti({"OutputConfiguration": high, "LocationID": {"location_id": 0}})
    assert overload(over_already, {"LocationID": {"location_id": 7}}) == ""
    assert overload(over_already, {"OutputConfiguration": outputs(300, 0x2010, 0x4020, 0x8020, 0xC020)}) == ""
    assert overload(replace(mti({}), line=SerialLine()), {"OutputConfiguration": high}) == "", (
        "a network has no such limit"
    )


def test_a_rate_that_no_line_allows_is_not_refused_for_the_line() -> None:
    """The hint was to use fewer outputs or a higher baud rate, which cannot help."""

    def pimu(period: int) -> dict[str, Any]:
        return {"streams": {"streams": [{"did": 3, "period": period, "size": 40, "source_ms": 10.0}]}}

    imx = DevicePresentState(IsbDriver(), DeviceContext(product="IMX-5", baud=921_600), LINE, pimu(1))
    error = overload_error(imx, pimu(2))
    assert error is not None
    assert error.kind == "bad-value"
    assert "sent at every navigation update" in error.message
    assert "the rate that it had" in error.hint
    assert overload_error(imx, pimu(1)) is None


async def test_a_change_by_another_user_is_not_undone_silently(tmp_path: Path) -> None:
    """Two people had the form open; what the first one wrote was written over by the second one's whole setting."""
    async with house(tmp_path) as there:
        desk = await there.add("sim:xbus?rate=20")
        await there.read(desk)
        counts = {"OutputConfiguration": desk.values["OutputConfiguration"]}
        assert (await there.apply(desk, {"OutputConfiguration": outputs(50)})).state == "done"
        late = partial(there.desks.jobs.apply, changes={"OutputConfiguration": outputs(10)}, reason="", base=counts)
        task = desk.add("Write", late)
        await task.finished.wait()
        assert task.job.state == "failed"
        assert "was changed by another client" in task.job.message
        assert desk.values["OutputConfiguration"] == outputs(50)


@each_row("model", MODELS.values(), ids=lambda model: model.name)
def test_every_product_is_itself_whatever_the_version_of_its_hardware(model: Any) -> None:
    assert base_name(f"{model.name}-8A1G6") == model.name
    assert same_product(f"{model.name}-8A1G6", f"{model.name}-2A8G4")
    assert [other.name for other in MODELS.values() if same_product(other.name, model.name)] == [model.name]


def test_a_profile_of_another_product_is_reported() -> None:
    """A profile of an MTi-300 once took position and velocity from an MTi-680G without a word."""
    assert "“MTi-680G” has" in mismatch("MTi-300-2A8G4", "MTi-680G-8A1G6")
    assert mismatch("", "MTi-680G-8A1G6") == ""
    assert same_product("IMX-5.0.4", "IMX-5.0.6")
    assert not same_product("IMX-5.0.4", "uINS-4.0.0")


def test_file_errors_are_reported_before_applying() -> None:
    """Misspelt names once stood among what "could not be compared", and wrong values were met at Apply only."""
    position = {"latitude": 51.0, "longitude": 6.0, "altitude": 30.0}
    present = {"LocationID": {"location_id": 0}, "LatLonAlt": position}
    wrong = {
        "LocationId": {"location_id": 1},
        "LocationID": {"location": 1},
        "LatLonAlt": {**position, "latitude": 99.0},
    }
    results = compare(
        XbusDriver(), DeviceContext(product="MTi-630"), ComparedValues("Now", present), ComparedValues("File", wrong)
    )
    texts = {problem.path: problem.hint for problem in results.problems}
    assert texts["LocationId"] == "Did you mean LocationID?"
    assert texts["LocationID.location"] == "Did you mean location_id?"
    assert "LatLonAlt.latitude" in texts
    assert results.changes == results.profile == {}


def test_a_profile_holds_all_that_can_be_written_not_only_what_differs() -> None:
    """Only what differed on the selected device was sent to the others, so they kept the rest of what they had."""
    left = {"LocationID": {"location_id": 7}, "OutputConfiguration": outputs(50)}
    right = {"LocationID": {"location_id": 7}, "OutputConfiguration": outputs(100)}
    result = compare(
        XbusDriver(), DeviceContext(product="MTi-630"), ComparedValues("Now", left), ComparedValues("Profile", right)
    )
    assert set(result.changes) == {"OutputConfiguration"}
    assert result.profile == right


def test_a_setting_of_another_product_is_not_an_error() -> None:
    sides = ComparedValues("Now", {}), ComparedValues("File", {"LatLonAlt": {"latitude": 1.0}})
    known = DeviceContext(product="MTi-610")
    if "LatLonAlt" not in {row.name for row in XbusDriver().settings(known)}:
        assert compare(XbusDriver(), known, *sides).problems == []
    assert compare(IsbDriver(), DeviceContext(), ComparedValues("", {}), ComparedValues("", {"Nonsense": {}})).problems
