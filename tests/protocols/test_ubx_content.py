"""Content of UBX messages against pyubx2's (tests/golden/ubx/make.py), and what it becomes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.events import Text
from imuscope.protocols.nmea_quantities import NmeaQuantities
from imuscope.protocols.ubx import SYNC, message_at
from imuscope.protocols.ubx_content import fields_of, table, values_of
from tests.each_row import each_row

GOLDEN: list[dict[str, Any]] = json.loads((Path(__file__).parents[1] / "golden" / "ubx" / "values.json").read_text())
FACTORS = {"m": (1e-3, 1e-2, 1e-4, 1.0), "m/s": (1e-3, 1e-2)}  # of millimetres, centimetres; a sum of both is metres
IN_METRES_TOO = {"NAV-HPPOSLLH", "NAV-HPPOSECEF", "NAV-RELPOSNED", "NAV-SVIN"}


def content(frame: bytes) -> dict[str, float]:
    found = message_at(frame, 0, final=True)
    assert found is not None
    assert found != "wait"
    return dict(found.fields)


def test_every_message_has_the_numbers_that_another_reader_finds() -> None:
    compared = 0
    for case in GOLDEN:
        mine, name = content(bytes.fromhex(case["frame"])), case["name"]
        described = fields_of(name)
        assert mine.keys() == described.keys()
        for field, value in mine.items():
            theirs, unit = case["values"][field], described[field].unit
            factors = FACTORS.get(unit, (1.0, 2.0**-32) if field == "towSubMS" else (1.0,))
            close = [math.isclose(value, theirs * factor, rel_tol=1e-9, abs_tol=1e-9) for factor in factors]
            if name in IN_METRES_TOO and unit == "m" and not any(close):
                close = [abs(value - theirs * factor) <= 0.02 for factor in factors]  # by its finer digits
            assert any(close), (name, field, value, theirs)
            compared += 1
    assert compared > 900


@each_row(
    ("name", "field", "raw", "value"),
    [
        ("NAV-PVT", "lat", -1_234_567_890, -123.456789),
        ("NAV-PVT", "hMSL", 12_345, 12.345),
        ("NAV-PVT", "velD", -1_500, -1.5),
        ("NAV-VELNED", "velN", 150, 1.5),
        ("NAV-POSECEF", "ecefX", -100, -1.0),
        ("ESF-INS", "zAngRate", 90_000, 90.0),
        ("ESF-INS", "zAccel", 981, 9.81),
    ],
)
def test_units_are_those_of_the_interface_description(name: str, field: str, raw: int, value: float) -> None:
    at = 0
    for word in table()[name]:
        own, kind, *_ = word.split(":")
        if own == field:
            break
        at += int(kind) if own == "-" else int(kind[1])
    payload = bytearray(200)
    payload[at : at + 4] = raw.to_bytes(4, "little", signed=True)
    assert values_of(name, bytes(payload))[field] == value


def test_measurements_have_their_types() -> None:
    words = [(14, 4096), (13, -8192), (5, 2048), (16, 1024), (17, -1024), (18, 10_045), (12, 2_512), (63, 5)]
    data = b"".join((kind << 24 | number & 0xFFFFFF).to_bytes(4, "little") for kind, number in words)
    payload = bytes(4) + (len(words) << 11).to_bytes(2, "little") + bytes(2) + data
    found = values_of("ESF-MEAS", payload)
    assert found == {
        **{"gyroX": 1.0, "gyroY": -2.0, "gyroZ": 0.5, "gyroTemperature": 25.12},
        **{"accelX": 1.0, "accelY": -1.0, "accelZ": 10_045 / 1024},
    }
    (batch,) = NmeaQuantities().batches([Text("ubx", "ESF-MEAS", "", 0, 0, 0, found)])
    assert batch.columns["RateOfTurn"].tolist() == [[1.0, -2.0, 0.5]]
    units = {field.name: field.unit for field in batch.message.fields}
    assert units == {"RateOfTurn": "°/s", "Acceleration": "m/s²", "gyroTemperature": "°C"}


@given(
    name=st.sampled_from([*(one for one in table() if "-" in one), "NAV2-PVT", "RXM-RAWX"]),
    payload=st.binary(max_size=120),
)
def test_no_payload_raises(name: str, payload: bytes) -> None:
    assert values_of(name, payload).keys() <= {*fields_of(name)}


def test_a_message_without_content_is_named_and_counted() -> None:
    frame = bytes.fromhex(GOLDEN[0]["frame"])
    assert frame.startswith(SYNC)
    body = bytes([0x02, 0x15, 2, 0, 1, 2])
    first = second = 0
    for byte in body:
        first = (first + byte) & 255
        second = (second + first) & 255
    assert content(SYNC + body + bytes([first, second])) == {"class": 2, "id": 0x15, "length": 2}
    with pytest.raises(KeyError):
        table()["RXM-RAWX"]
