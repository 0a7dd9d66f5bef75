"""Agreement of the Xbus decoder with the vendor's, and coverage of the tables."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from imuscope.protocols.events import Batch, Reply
from imuscope.protocols.schema.layouts import Layout
from imuscope.protocols.xbus.data_identifiers import BY_NAME, ITEMS, item
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.protocols.xbus.json_codec import frame_from_json, frame_to_json
from imuscope.protocols.xbus.messages import MESSAGES
from tests.protocols.xbus.xbus_vectors import COMMANDS, COMPUTED, DATA, DEVICE, flat, frame
from tests.support.each_row import each_row

SAMPLES = [v for v in DATA if v.get("kind") is None]
DERIVED = [v for v in DATA if v.get("kind") is not None]

# Names in which the vendor's reader differs from the document, and values that it derives.
IGNORED = {"unknown", "xspublic_sampleTime64", "llcp_BigTimestamp_s", "RawBlob_len"}


def name_of(vector: dict[str, Any]) -> str:
    return vector["what"][:60]


def batch_of(data: bytes) -> Batch:
    decoder = XbusDecoder()
    decoder.feed(data, 1)
    (event,) = decoder.drain()
    assert isinstance(event, Batch)
    assert decoder.buffered == 0
    return event


def first_row(batch: Batch, name: str) -> np.ndarray[Any, Any]:
    """The first row of a column, in wire order."""
    value = batch.columns[name][0]
    field = next(f for f in batch.message.fields if f.name == name)
    return np.asarray(value).swapaxes(0, 1) if field.column_major else np.asarray(value)


def tolerance(vector: dict[str, Any], name: str) -> float:
    """One unit in the last place of the wire type, relative for floats and absolute for fixed point."""
    return {"Fp1220": 2.0**-20, "Fp1632": 2.0**-32}.get(vector.get("precision", ""), 0.0)


@each_row("vector", SAMPLES, ids=name_of)
def test_vendor_values(vector: dict[str, Any]) -> None:
    """Columns hold what the vendor's reader returned, to 1 ulp of the wire type."""
    batch = batch_of(frame(vector))
    for name, expected in vector["values"].items():
        if name in IGNORED:
            continue
        if isinstance(expected, dict) and name in ("GnssPvtData", "GnssSatInfo"):
            compare_record(batch, name, expected)
            continue
        if name in ("acc", "gyr", "mag", "temp_raw", "raw", "temp_C", "bits"):
            continue  # below
        got = first_row(batch, name).ravel()
        target = np.atleast_1d(np.asarray(expected, np.float64))
        ulp = np.spacing(np.abs(target).astype(batch.columns[name].dtype)) if got.dtype.kind == "f" else 0
        assert got.shape == target.shape
        assert (np.abs(got.astype(np.float64) - target) <= np.maximum(ulp, tolerance(vector, name))).all()


def compare_record(batch: Batch, name: str, expected: dict[str, Any]) -> None:
    record = batch.columns[name][0]
    row = BY_NAME[name]
    scaled = expected.get("scaled", {})
    for field in row.fields:
        if field.name in expected and field.scale == 1 and not field.fields:
            assert record[field.name] == expected[field.name]
    for label, value in scaled.items():
        assert record[label.split("_")[0]] == pytest.approx(value, rel=1e-15)
    for k, satellite in enumerate(expected.get("satellites", ())):
        got = record["satellites"][k]
        bits = {b.name: b.of(int(got["flags"])) for b in row.fields[-1].fields[3].bits}
        assert [int(got[n]) for n in ("gnssId", "svId", "cno", "flags")] == [
            satellite[n] for n in ("gnssId", "svId", "cno", "flags")
        ]
        assert list(bits.values())[:4] == [satellite[n] for n in ("quality", "used", "health", "diffCorr")]


@each_row("vector", [v for v in SAMPLES if v.get("wire_ints")], ids=name_of)
def test_fixed_point_integers(vector: dict[str, Any]) -> None:
    """Fixed point is exact: the value times 2^20 or 2^32 is the integer on the wire."""
    batch = batch_of(frame(vector))
    (field,) = batch.message.fields
    scale = {"fp1220": 2**20, "fp1632": 2**32}[field.dtype]
    assert (first_row(batch, field.name).ravel() * scale).astype(object).tolist() == vector["wire_ints"]


@each_row("vector", [v for v in SAMPLES if "bits" in v["values"]], ids=lambda v: v["message_hex"])
def test_status_bits(vector: dict[str, Any]) -> None:
    """Every bit of the status word has the vendor's name and value."""
    batch = batch_of(frame(vector))
    word = int(batch.columns["StatusWord"][0])
    bits = {bits.name: bits.of(word) for bits in batch.message.fields[0].bits}
    for name, value in vector["values"]["bits"].items():
        assert bits[name] == value, name


def test_raw_sensor_values() -> None:
    by_what = {v["what"]: v for v in SAMPLES}
    raw = by_what["XDI_RawAccGyrMagTemp"]
    record = batch_of(frame(raw)).columns["RawAccGyrMagTemp"][0]
    for name in ("acc", "gyr", "mag"):
        assert record[name].tolist() == raw["values"][name]
    assert record["temp"] == raw["values"]["temp_C"]
    gyro = by_what["XDI_RawGyroTemp"]
    assert batch_of(frame(gyro)).columns["RawGyroTemp"][0].tolist() == gyro["values"]["temp_C"]


def test_unknown_identifier_is_kept() -> None:
    vector = next(v for v in SAMPLES if "unknown" in v["values"])
    batch = batch_of(frame(vector))
    assert list(batch.columns) == ["PacketCounter", "0x4FF0", "StatusWord"]
    assert bytes(batch.columns["0x4FF0"][0]).hex().upper() == vector["values"]["unknown"][0]["hex"]


def test_chained_blob_is_one() -> None:
    vector = next(v for v in SAMPLES if "RawBlob_len" in v["values"])
    blob = batch_of(frame(vector)).columns["RawBlob"]
    assert blob.shape == (1, 300)
    assert blob[0].tolist() == [i % 255 if i >= 255 else i for i in range(300)] or blob[0, 254] == 254


@each_row("vector", DERIVED, ids=name_of)
def test_frame_of_derived_vectors(vector: dict[str, Any]) -> None:
    """Their values belong to the page's maths; here: the identifier names the frame they start from."""
    batch = batch_of(frame(vector))
    if "from" in vector:
        assert batch.message.fields[0].frame.startswith(vector["from"])


@each_row("vector", COMPUTED["items"], ids=lambda v: v["xdi"])
def test_computed_items(vector: dict[str, Any]) -> None:
    batch = batch_of(frame(vector))
    ((name, expected),) = vector["values"].items()
    (field,) = batch.message.fields
    assert field.name == name
    wire = flat(frame_to_json(frame(vector))["fields"])
    assert (list(bytes.fromhex(wire[0])) if field.dtype == "bytes" else wire) == expected


# -- messages ----------------------------------------------------------------------------------------------------------

SIMULATORS = {"ReqOutputConfigurationAck": "SetOutputConfigurationAck", "SetCanOutputConfigAck": "CanOutputConfig"}
ARGUMENTS = {  # the vectors' words for a field, where they differ
    "rev": "revision", "scm": "scm_reference", "bits": "flags", "code": ("code", "baudrate_code"), "set": "set_flags",
    "clear": "clear_flags", "id": "location_id", "ticks": ("delay", "correction"), "seconds": "duration",
    "lat": "latitude", "lon": "longitude", "alt": "altitude", "nano": "nanoseconds", "valid": "flags", "deg": "heading",
    "types": "string_types", "skip": ("skip_factor", "output_skip_factor"), "state": "representative_motion_active",
    "period": ("period", "sampling_period"), "devices": "num_devices",
}  # fmt: skip


def reply_of(data: bytes) -> Reply:
    decoder = XbusDecoder()
    decoder.feed(data, 1)
    (event,) = decoder.drain()
    assert isinstance(event, Reply)
    return event


@each_row("vector", [v for v in COMMANDS if v["what"] != "MTData2"], ids=name_of)
def test_commands(vector: dict[str, Any]) -> None:
    """The message has the name the vector gives, its fields the arguments, and it is built again byte for byte."""
    data = frame(vector)
    reply = reply_of(data)
    words = vector["what"].split()
    assert reply.message.name == words[0] or words[0] in ("WakeUp",)
    values = dict(reply.values)
    for argument, expected in vector["args"].items():
        names = ARGUMENTS.get(argument, argument)
        results = [values[n] for n in ([names] if isinstance(names, str) else names) if n in values]
        if argument in ("list", "quaternion", "data_hex", "data_len", "fill", "bid", "bps", "words"):
            continue  # below
        (got,) = results
        if argument in ("device_id", "master_device_id"):
            expected = int(expected, 16)
        assert got == (pytest.approx(expected, rel=1e-7) if isinstance(expected, float) else expected), argument
    if "list" in vector["args"]:
        (records,) = values.values()
        assert records == [expected_record(entry, record) for entry, record in zip(vector["args"]["list"], records)]  # noqa: B905
        assert len(records) == len(vector["args"]["list"])
    if "quaternion" in vector["args"]:
        assert [values[f"q{i}"] for i in range(4)] == pytest.approx(vector["args"]["quaternion"], rel=1e-7)
    if "data_hex" in vector["args"]:
        assert values["data"].hex().upper() == vector["args"]["data_hex"]
    assert frame_from_json(frame_to_json(data)) == data


def expected_record(entry: Any, record: dict[str, int]) -> dict[str, int]:
    if isinstance(entry, list):
        return {"data_identifier": int(entry[0], 16), "output_frequency": entry[1]}
    names = {"once": "trigger_once", "pulse_width_100us": "pulse_width"}
    delays = {"delay_100us", "offset_100us"}
    expected = {
        names.get(n, "delay_offset_or_clock_period" if n in delays else n): v & 0xFFFF for n, v in entry.items()
    }
    return {**dict.fromkeys(record, 0), **expected}


@each_row("vector", COMPUTED["messages"], ids=lambda v: f"{v['message']}-{v['message_hex'][4:12]}")
def test_computed_messages(vector: dict[str, Any]) -> None:
    data = frame(vector)
    record = frame_to_json(data)
    assert record["message"] == SIMULATORS.get(vector["message"], vector["message"])
    assert record["fields"] == vector["fields"]
    assert frame_from_json(record) == data


def test_device_frames() -> None:
    """Frames quoted from real devices."""
    for vector in DEVICE:
        data = frame(vector)
        assert frame_from_json(frame_to_json(data)) == data
        assert frame_to_json(data)["message"] in ("MTData2", "Configuration", "DeviceID", "ProductCode")


def test_rows_are_documented() -> None:
    """Documentation is data: every row, field and bit has a sentence; every row a source."""
    for row in (*MESSAGES, *ITEMS):
        assert row.doc.endswith("."), row.name
        assert row.source, row.name
        for field in row.fields:
            assert field.doc.endswith("."), (row.name, field.name)
            for bits in field.bits:
                assert bits.doc.endswith("."), (row.name, bits.name)


def test_item_formats() -> None:
    """Precision and coordinate system are given by the identifier's low bits; the fourth coordinate
    system is invalid.
    """
    assert item(0x2016, 24).dtype == "fp1632"
    assert item(0x2016, 24).frame == "NED from body"
    assert item(0x201C, 16).name == "0x201C"
    assert item(0x3011, 4).name == "BaroPressure"
    assert item(0x2010, 12).name == "0x2010"
    fixed_point = item(0x0811, 4)
    rows = np.frombuffer(bytes.fromhex("00180000"), np.uint8).reshape(1, 4)
    assert Layout.of([fixed_point]).columns(rows)[fixed_point.name] == 1.5
