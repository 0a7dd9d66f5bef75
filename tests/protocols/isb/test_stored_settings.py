"""Settings and commands of ISB: wire units, the vendor's ranges, readable texts."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator

import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.isb.commands import COMMAND_ROWS
from imuscope.protocols.isb.dataset_loader import VERSIONS
from imuscope.protocols.isb.driver import IsbDriver
from imuscope.protocols.isb.field_docs import BAUD_RATES, CAN_RATES
from imuscope.protocols.isb.stored_settings import fields_of, settings_of
from imuscope.protocols.schema import validation
from imuscope.protocols.schema.fields import Field
from imuscope.server.configuration.form_builder import field_form
from imuscope.server.configuration.value_format import words
from tests.support.each_row import each_row
from tests.vendor.inertial_sense import CONSTANTS_FILE

FLASH = 12


def flat(fields: Iterable[Field]) -> Iterator[Field]:
    for field in fields:
        yield field
        yield from flat(field.fields)


def flash(name: str) -> Field:
    return next(field for field in fields_of(FLASH) if field.name == name)


@each_row("version", VERSIONS[:-1])
def test_input_has_the_unit_of_the_wire(version: str) -> None:
    """magDeclination=2.5 was listed in degrees and stored 143: it was taken as radians."""
    rows = [*settings_of(version).values()]
    for field in (field for row in rows for field in flat(row.fields)):
        assert (field.scale, field.bias) == (1, 0), field.name
    for field in (field for row in COMMAND_ROWS.values() for field in flat(row.arguments)):
        assert (field.scale, field.bias) == (1, 0), field.name


@each_row("name", ["insRotation", "zeroVelRotation", "magDeclination", "gpsMinimumElevation"])
def test_angles_are_typed_in_degrees_in_a_form(name: str) -> None:
    """A form asked for radians, beside plots in degrees; the list of the command line has the unit of the wire."""
    field = flash(name)
    form = field_form(field)
    assert (field.unit, field.scale, form.unit) == ("rad", 1, "°")
    assert form.scale * math.pi == pytest.approx(180)
    assert (form.low, form.high) == (field.low, field.high)
    assert words(field, math.pi / 2) == "90 °"


def test_ranges_are_the_vendors() -> None:
    constants = json.loads(CONSTANTS_FILE.read_text(encoding="utf-8"))["constants"]
    rates = {value for name, value in constants["baud_rate_t"].items() if name.rpartition("_")[2].isdigit()}
    assert set(BAUD_RATES) == set(flash("ser0BaudRate").choices) == rates  # 10 MBd too, and not 1, 2 or 3 MBd
    kilobits = {value for name, value in constants["can_baudrate_t"].items() if name.endswith("_KBPS")}
    assert set(CAN_RATES) == kilobits
    fields = fields_of(FLASH)
    for good in (
        {"magInterferenceThreshold": 1000.0},  # switches the detection off
        {"magCalibrationQualityThreshold": 1000.0},
        {"startupGPSDtMs": 200},
        {"startupNavDtMs": 500},
        {"insRotation": [-math.pi, math.pi, 4.7]},
    ):
        validation.require_valid(fields, good, partial=True)
    with pytest.raises(ValueError, match="startupGPSDtMs lies between 200 and"):
        validation.require_valid(fields, {"startupGPSDtMs": 100}, partial=True)


def test_every_field_and_command_is_documented() -> None:
    for row in settings_of().values():
        for field in row.fields:
            assert field.doc, f"{row.name}.{field.name}"
            assert field.title, f"{row.name}.{field.name}"
            assert field.title.lower() not in ("nf", "gpsmodear", "cbf", "ru", "rb"), field.title
    assert [row.name for row in COMMAND_ROWS.values() if not row.doc or not row.title] == []


def test_choices_are_not_in_capitals() -> None:
    """Names stay as they are for the command line; a form has GROUND_VEHICLE as "Ground vehicle"."""
    assert flash("dynamicModel").choices[4] == "GROUND_VEHICLE"
    assert field_form(flash("dynamicModel")).choices["4"] == "Ground vehicle"
    source = next(bits for bits in field_form(flash("ioConfig")).bits if bits.name == "GPS1_TYPE")
    assert source.choices == {"0": "Unused", "1": "UBX F9P", "2": "NMEA", "3": "GPX"}
    for row in settings_of().values():
        for field in flat(row.fields):
            form = field_form(field)
            words = [*form.choices.values(), *(text for bits in form.bits for text in bits.choices.values())]
            assert not [text for text in words if "_" in text and text.isupper() and not text.startswith("DID_")]


def test_commands_are_not_offered_as_sentences() -> None:
    """SRST, which restarts the device, and STPB stood in the list of sentences."""
    stored = settings_of()["DID_NMEA_BCAST_PERIOD"].fields[1].fields[0].choices
    chosen = COMMAND_ROWS["ASCE"].arguments[1].fields[0].choices
    for names in (set(stored.values()), set(chosen.values())):
        assert {"PIMU", "GNGGA", "POWTLV"} <= names
        assert not {"SRST", "STPB", "PERS", "ASCE", "NELB", "SPECIAL_CASE_START", "GNGSV_START"} & names
    assert max(stored) < 256, "a number of one byte"
    assert "GPGSV_1" in chosen.values()


def test_a_navigation_period_that_the_product_cannot_keep_is_reported() -> None:
    """3 ms was written to an IMX-5 without a word, while the help said at least 7 ms; all streams rose to 333 Hz."""
    driver, old = IsbDriver(), {"startupNavDtMs": 20, "startupImuDtMs": 20}

    def report(product: str, **new: int) -> list[str]:
        results = driver.risks("DID_FLASH_CONFIG", old, new, DeviceContext(product=product))
        return [harm.consequence for harm in results]

    short = "An IMX-5 with a GNSS receiver needs a navigation period of at least 7 ms, given 3 ms."
    faster = "Every stream that follows the navigation period rises from 50 to 333.3 Hz."
    sampling = "The sampling period of 20 ms is longer than the navigation period: the device shortens it to 3 ms."
    assert report("IMX-5.1", startupNavDtMs=3) == [short, sampling, faster]
    assert report("GPX-1", startupNavDtMs=3) == [sampling, faster]
    assert report("IMX-5.1", startupNavDtMs=40) == []
    slower = "The sampling period of 30 ms is longer than the navigation period: the device shortens it to 20 ms."
    assert report("IMX-5.1", startupImuDtMs=30) == [slower]
    assert report("IMX-5.1", startupImuDtMs=30, startupNavDtMs=40) == []
