"""Content of UBX messages against pyubx2's (tests/golden/ubx/make.py), and what it becomes."""

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.embedded.quantities import NmeaQuantities
from imuscope.protocols.embedded.ubx import SYNC, message_at
from imuscope.protocols.embedded.ubx_content import fields_of, samples_of, table, values_of
from imuscope.protocols.events import Text
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

GOLDEN: list[dict[str, Any]] = json.loads((ROOT / "tests" / "golden" / "ubx" / "values.json").read_text())
SAMPLES: list[dict[str, Any]] = json.loads((ROOT / "tests" / "golden" / "ubx" / "samples.json").read_text())
TYPES = {  # u-blox M8 and F9 ADR interface descriptions, "ESF measurement data types"
    **{5: ("gyroZ", 2**-12), 12: ("gyroTemperature", 1e-2), 13: ("gyroY", 2**-12), 14: ("gyroX", 2**-12)},
    **{16: ("accelX", 2**-10), 17: ("accelY", 2**-10), 18: ("accelZ", 2**-10)},
}
FACTORS = {"m": (1e-3, 1e-2, 1e-4, 1.0), "m/s": (1e-3, 1e-2)}  # of millimetres, centimetres; a sum of both is metres
IN_METRES_TOO = {"NAV-HPPOSLLH", "NAV-HPPOSECEF", "NAV-RELPOSNED", "NAV-SVIN"}


def content(frame: bytes) -> dict[str, float]:
    result = message_at(frame, 0, final=True)
    assert result is not None
    assert result != "wait"
    return dict(result.fields)


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
    result = values_of("ESF-MEAS", payload)
    assert result == {
        **{"gyroX": 1.0, "gyroY": -2.0, "gyroZ": 0.5, "gyroTemperature": 25.12},
        **{"accelX": 1.0, "accelY": -1.0, "accelZ": 10_045 / 1024},
    }
    batches = NmeaQuantities().batches([Text("ubx", "ESF-MEAS", "", 0, 0, 0, result)])
    (turn,) = (batch.columns["RateOfTurn"].tolist() for batch in batches if "RateOfTurn" in batch.columns)
    assert turn == [[1.0, -2.0, 0.5]]
    units = {field.name: field.unit for batch in batches for field in batch.message.fields}
    assert units == {"RateOfTurn": "°/s", "Acceleration": "m/s²", "gyroTemperature": "°C"}


def test_samples_of_a_raw_message_are_those_that_another_reader_finds() -> None:
    rows = 0
    for case in SAMPLES:
        words, fields = case["words"], content(bytes.fromhex(case["frame"]))
        theirs: dict[int, dict[str, float]] = {}
        for number in range(1, len(words) // 2 + 1):
            word, tag = words[f"data_{number:02d}"], words[f"sTag_{number:02d}"]
            if (known := TYPES.get(word >> 24)) is not None:
                raw = word & 0xFFFFFF
                theirs.setdefault(tag, {"sTtag": tag})[known[0]] = (raw - (raw >> 23 << 24)) * known[1]
        mine = samples_of("ESF-RAW", fields)
        joined: dict[int, dict[str, float]] = {}
        for one in mine:
            joined.setdefault(int(one["sTtag"]), {}).update(one)
        assert [*joined] == [*theirs]
        for one, other in zip(joined.values(), theirs.values(), strict=True):
            assert {name: value for name, value in one.items() if not math.isnan(value)} == pytest.approx(other)
        rows += len(joined)
        batches = NmeaQuantities().batches([Text("ubx", "ESF-RAW", "", 7, 0, 5, fields)])
        for batch in batches:
            assert (set(batch.offset), set(batch.arrival_ns)) == ({7}, {5})
            assert {*batch.columns["sTtag"].tolist()} <= {*theirs}
            assert "not documented" in batch.message.doc
        assert sum(map(len, batches)) == len(mine)
    assert rows == 18


def test_a_sample_that_lacks_a_number_has_none_there() -> None:
    raw = {"sTtag_01": 1, "gyroX_01": 2.0, "gyroZ_01": 3.0, "sTtag_02": 2, "gyroX_02": 4.0}
    samples = samples_of("ESF-RAW", raw)
    assert samples[1] == pytest.approx({"sTtag": 2, "gyroX": 4.0, "gyroY": math.nan, "gyroZ": math.nan}, nan_ok=True)
    assert content_of_raw([]) == {}
    assert len(samples_of("ESF-RAW", content_of_raw([(14, n % 2, n) for n in range(500)]))) == 99


def content_of_raw(items: list[tuple[int, int, int]]) -> dict[str, float]:
    words = ((kind << 24 | number).to_bytes(4, "little") + tag.to_bytes(4, "little") for kind, number, tag in items)
    return values_of("ESF-RAW", bytes(4) + b"".join(words))


@given(st.binary(max_size=300))
def test_no_raw_message_raises(payload: bytes) -> None:
    names = {name.rpartition("_")[0] for name in values_of("ESF-RAW", payload)}
    assert names <= {*fields_of("ESF-RAW")}


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
