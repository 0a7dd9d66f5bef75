"""Values out of range are refused at their field; values in range read back unchanged."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.schema.fields import Command, Field
from imuscope.protocols.schema.layouts import EncodeError, is_open
from imuscope.protocols.schema.shown_values import is_scaled, shown_number
from imuscope.protocols.schema.validation import bounds, find_problems, is_whole
from imuscope.protocols.xbus.json_codec import frame_to_json
from imuscope.protocols.xbus.products import model_of
from tests.protocols.xbus.xbus_values import DRIVER, KNOWN, SWEEP, sensible, sync
from tests.support.each_row import each_row


def numbers(command: Command) -> list[tuple[str, Field]]:
    """Paths of the single numbers of a command's sensible values."""
    results = []
    for field in command.arguments:
        if field.fields and field.shape:
            results += [(f"{field.name}.0.{part.name}", part) for part in field.fields]
        elif not field.shape and field.dtype not in ("bytes", "ascii"):
            results.append((field.name, field))
    return results


def put(values: dict[str, Any], path: str, value: Any) -> None:
    where: Any = values
    *front, last = path.split(".")
    for step in front:
        where = where[int(step)] if step.isdigit() else where[step]
    where[last] = value


NUMBERS = [
    (name, command, path, field)
    for name, command in SWEEP
    if name in ("MTi-680G", "MTi-G-710", "MTi-3")
    for path, field in numbers(command)
]


@given(st.sampled_from(NUMBERS), st.data())
def test_a_value_beyond_its_range_is_refused_with_field_value_and_range(
    case: tuple[str, Command, str, Field], data: st.DataObject
) -> None:
    name, command, path, field = case
    low, high = bounds(field)
    if field.choices:
        wrong: Any = data.draw(st.integers(0, 70_000).filter(lambda number: number not in field.choices))
    elif is_whole(field):
        wrong = data.draw(st.integers(int(high) + 1, 2**70) | st.integers(-(2**70), int(low) - 1))
    else:
        wrong = data.draw(st.sampled_from([float("nan"), float("inf"), -float("inf"), high * 1.5, "one", None, True]))
    values = sensible(command, KNOWN[name])
    put(values, path, wrong)
    with pytest.raises(EncodeError) as refused:
        DRIVER.frame(command.name, values, KNOWN[name])
    assert refused.value.path == path
    assert field.name in str(refused.value)
    shown = f"{shown_number(field, wrong):.9g} {field.unit}" if is_scaled(field) else repr(wrong)
    assert shown in str(refused.value)


# Rules beyond ranges (flags of other products, periods between two multiples) are tested below.
BEYOND_A_RANGE = {"SetOptionFlags", "SetPeriod", "SetPortConfig", "SetUTCTime"}


@given(st.sampled_from(NUMBERS), st.data())
def test_a_value_within_its_range_comes_back_from_the_frame(
    case: tuple[str, Command, str, Field], data: st.DataObject
) -> None:
    name, command, path, field = case
    if command.name in ("SetOutputConfiguration", "SetSyncSettings", "SetAlignmentRotation", "AdjustUTCTime"):
        return  # their fields depend on each other; held below
    low, high = bounds(field)
    if field.choices:
        right: Any = data.draw(st.sampled_from(list(field.choices)))
    elif is_whole(field):
        right = data.draw(st.integers(int(low), int(high)))
    else:
        right = data.draw(st.floats(low, high, width=32 if field.dtype == ">f4" else 64))
    values = sensible(command, KNOWN[name])
    put(values, path, right)
    try:
        frame = DRIVER.frame(command.name, values, KNOWN[name])
    except EncodeError:
        if command.name not in BEYOND_A_RANGE:
            raise
        return
    got: Any = frame_to_json(frame)["fields"]
    for step in path.split("."):
        got = got[int(step)] if step.isdigit() else got[step]
    assert got == right


DELAY = "settings.0.delay_offset_or_clock_period"


def entry(**values: int) -> dict[str, Any]:
    """A list of one sync setting."""
    return sync({"list": [{"polarity": 1, **values}]})


def request_of(identifier: int, times: int = 1) -> dict[str, Any]:
    """An output configuration of one output, or of the same one several times."""
    return {"outputs": [{"data_identifier": identifier, "output_frequency": 1}] * times}


def utc(**parts: int) -> dict[str, Any]:
    """A moment of 2026."""
    usual = {"nanoseconds": 0, "year": 2026, "month": 1, "day": 1, "hour": 0, "minute": 0, "second": 0, "flags": 7}
    return usual | parts


TOGETHER = [
    ("SetOutputConfiguration", request_of(0x5042), "outputs.0.data_identifier", "MTi-630 has no LatLon"),
    ("SetOutputConfiguration", request_of(0x1021), "outputs.0.data_identifier", "no such form"),
    ("SetOutputConfiguration", request_of(0x4FF0), "outputs.0.data_identifier", "no such data"),
    ("SetOutputConfiguration", request_of(0x2010, 2), "outputs.1.data_identifier", "twice"),
    ("SetOutputConfiguration", request_of(0x1020, 33), "outputs", "at most 32 entries, given 33"),
    ("SetSyncSettings", entry(function=4, line=7, offset_100us=30_001), DELAY, "3000.1 ms"),
    ("SetSyncSettings", entry(function=3, line=2, delay_100us=60_001), DELAY, "0 and 6000 ms"),
    ("SetSyncSettings", entry(function=3, line=6), "settings.0.line", "SendLatest"),
    ("SetSyncSettings", entry(function=3, line=4), "settings.0.line", "one of 2"),
    ("SetSyncSettings", entry(function=3, line=7), "settings.0.line", "TriggerIndication goes with an input"),
    ("SetSyncSettings", entry(function=4, line=2), "settings.0.line", "Measurement goes with an output"),
    ("SetOptionFlags", {"set_flags": 0x10, "clear_flags": 0}, "set_flags", "MTi-630 has no option flag EnableAhs"),
    ("SetUTCTime", utc(month=2, day=31), "day", "between 1 and 28 in 2026-02"),
    ("SetUTCTime", utc(month=2, day=29, year=2028) | {"hour": 24}, "hour", "0 and 23"),
    ("SetAlignmentRotation", {"parameter": 0, "q0": 1.0, "q1": 1.0, "q2": 0.0, "q3": 0.0}, "q0", "1.414"),
    ("SetPortConfig", {"words": [0x10002]}, "words", "RS-232, UART, RTCM input"),
    ("SetPortConfig", {"words": [0x10002, 0x20002, 0]}, "words.1", "UART: the protocol"),
    ("SetPortConfig", {"words": [0x10077, 0x10002, 0]}, "words.0", "RS-232: choose one of the baud rates"),
    ("SetFilterProfile", {"profile": ""}, "profile", "at least 1"),
    ("SetFilterProfile", {"profile": "x" * 63}, "profile", "at most 62"),
    ("AdjustUTCTime", {"correction": 0}, "correction", "not 0"),
    ("SetLocationID", {}, "location_id", "missing"),
    ("SetLocationID", {"location_id": 1, "more": 2}, "more", "no field is called"),
]


@each_row(("command", "values", "path", "words"), TOGETHER)
def test_inconsistent_values_are_refused(command: str, values: Any, path: str, words: str) -> None:
    with pytest.raises(EncodeError, match=words) as refused:
        DRIVER.frame(command, values, KNOWN["MTi-630"])
    assert refused.value.path == path


def test_missing_features_of_a_product_are_named() -> None:
    with pytest.raises(EncodeError, match="MTi-630 has no command 'ForwardGnssData'"):
        DRIVER.frame("ForwardGnssData", {"data": "d3"}, KNOWN["MTi-630"])
    with pytest.raises(EncodeError, match="no setting 'Period'"):
        DRIVER.setting_frames("Period", {"period": 1152}, KNOWN["MTi-630"])
    with pytest.raises(EncodeError, match="cannot be written"):
        DRIVER.setting_frames("DeviceID", {"device_id": 1}, KNOWN["MTi-630"])


def test_february_29_exists_in_leap_years_only() -> None:
    assert DRIVER.frame("SetUTCTime", utc(month=2, day=29, year=2028), KNOWN["MTi-630"])


def test_a_compass_calibration_offers_what_the_document_has() -> None:
    """4 is a command of the vendor's own software; devices of this document refuse it."""
    (row,) = [row for row in DRIVER.commands(KNOWN["MTi-630"]) if row.name == "IccCommand"]
    assert list(row.arguments[0].choices) == [0, 1, 2, 3]


def test_an_older_gnss_product_has_what_its_successor_has() -> None:
    """The MTi-G-700 was an unknown product: it was offered what no MTi of its series has."""
    old, new = model_of("MTi-G-700-2A5G4"), model_of("MTi-G-710-2A8G4")
    assert old is not None
    assert new is not None
    assert (old.name, old.number, old.kind) == ("MTi-G-700", new.number, new.kind)
    old_rows, new_rows = (DRIVER.settings(DeviceContext(product=f"{model.name}-2A5G4")) for model in (old, new))
    assert old_rows == new_rows


def test_fields_are_those_of_the_product() -> None:
    def field(product: str, setting: str, name: str) -> Field:
        row = next(row for row in DRIVER.settings(KNOWN[product]) if row.name == setting)
        results = [field for field in row.fields if field.name == name]
        results += [part for field in row.fields for part in field.fields if part.name == name]
        return results[0]

    assert [bits.name for bits in field("MTi-630", "OptionFlags", "flags").bits] == [
        "EnableConfigurableBusId",
        "EnableInRunCompassCalibration",
    ]
    assert list(field("MTi-3", "FilterProfile", "profile").choices) == [50, 51, 52, 53, 54]
    assert list(field("MTi-G-710", "SyncSettings", "line").choices) == [2, 0, 1, 5, 4, 6]
    assert list(field("MTi-1", "SyncSettings", "function").choices) == [8]
    assert field("MTi-630", "FilterProfile", "profile").dtype == "ascii"
    assert "NorthReference" in field("MTi-630", "FilterProfile", "profile").doc
    assert is_open(field("MTi-630", "OutputConfiguration", "outputs"))


def test_a_period_between_two_multiples_is_refused() -> None:
    with pytest.raises(EncodeError, match="multiple of 1152"):
        DRIVER.frame("SetPeriod", {"period": 1153}, KNOWN["MTi-G-710"])


def test_an_error_about_a_choice_of_a_hundred_does_not_list_them() -> None:
    """The refusal of a data set outside the table was a sentence of four screens."""
    field = Field("id", "u1", choices={number: f"DID_{number}" for number in range(100)})
    [problem] = find_problems((field,), {"id": 250})
    assert problem.message == "id is one of 100 known values, given 250"
