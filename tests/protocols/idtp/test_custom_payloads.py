"""The vendor's own types of IDTP, and composed frames."""

import struct
from typing import Any

import pytest

from imuscope.protocols.events import Batch
from imuscope.protocols.idtp.custom_payloads import SchemaError, parse
from imuscope.protocols.idtp.decoder import IdtpDecoder
from imuscope.protocols.idtp.family import FAMILY
from imuscope.protocols.idtp.frames import build
from imuscope.protocols.idtp.json_codec import frame_from_json, frame_to_json
from imuscope.protocols.schema.layouts import EncodeError, size_of
from tests.protocols.decoding import decode_chunks
from tests.support.each_row import each_row

SCHEMA = """
[[message]]
type = 0x80
name = "Wheels"
doc = "Wheel odometry."
[[message.field]]
name = "Speed"
type = "i16"
count = 4
axes = ["fl", "fr", "rl", "rr"]
unit = "m/s"
scale = 0.001
[[message.field]]
name = "Steering"
type = "f32"
unit = "rad"
bias = 1.0
"""


def test_user_schema() -> None:
    schema = parse(SCHEMA)
    payload = struct.pack("<4hf", 1000, -1000, 0, 32767, 0.5)
    (batch,) = decode_chunks(IdtpDecoder(schema=schema), [(0, build(0x80, payload))])
    assert isinstance(batch, Batch)
    assert batch.columns["Speed"].tolist() == [[1.0, -1.0, 0.0, 32.767]]
    assert batch.columns["Steering"].tolist() == [1.5]
    assert [field.unit for field in batch.message.fields[:2]] == ["m/s", "rad"]
    record = frame_to_json(build(0x80, payload + b"\1"), schema)
    assert record["message"] == "Wheels"
    assert record["fields"]["Speed"] == [1000, -1000, 0, 32767]
    assert record["wire"] == {"trailing": "01"}
    assert frame_from_json(record, schema=schema) == build(0x80, payload + b"\1")
    (short,) = [
        e for e in decode_chunks(IdtpDecoder(schema=schema), [(0, build(0x80, payload[:5]))]) if isinstance(e, Batch)
    ]
    assert short.message.name == "WheelsBytes"


@each_row(("kind", "count"), [("i16", 3), ("u8", 5)])
def test_the_initial_definition_is_a_schema(kind: str, count: int) -> None:
    definition = FAMILY.decoding.payload_definition
    assert definition is not None
    [row] = parse(definition.template.format(size=0, id="9A", type=kind, count=count)).values()
    assert (row.id, row.name, size_of(row.fields[0])) == (0x9A, "Vendor9A", count * dict(definition.types)[kind])


@each_row(
    ("change", "words"),
    [
        (("0x80", "300"), "message Wheels: type is a whole number from 0 to 255, given 300"),
        (('"i16"', '"int"'), "message Wheels, field Speed: type is one of .*, given 'int'"),
        (('["fl", "fr", "rl", "rr"]', '["a"]'), "field Speed: axes is a list of 4 names, given"),
        (('["fl", "fr", "rl", "rr"]', '["fl", "fr", "fl", "rr"]'), "field Speed: axes are 4 different names"),
        (("count = 4\n", ""), "field Speed: axes needs count"),
        (('"Wheels"', '"Imu9"'), "message 1: Imu9 is a standard type of IDTP; choose another name"),
        (("0.001", "0"), "field Speed: scale is a number other than 0"),
        (("count = 4", "count = 0"), "field Speed: count is a whole number from 1 to 972, given 0"),
        (("count = 4", "colour = 4"), "field Speed: 'colour' is not known; there are name, type"),
        (('"Steering"', '"Speed"'), "message Wheels: the field name 'Speed' is used twice"),
        (('"Steering"', '"sequence"'), "name is none of timestamp, sequence"),
        (('"Wheels"', '"0 wheels"'), "message 1: name is letters, digits and _"),
        (("bias = 1.0", "bias = nan"), "field Steering: bias is a number, given nan"),
        (("[[message]]", "[message"), "the schema is not valid TOML"),
        (("[[message.field]]", "[[message.fields]]"), "message Wheels: 'fields' is not known"),
    ],
)
def test_schema_errors_name_the_place(change: tuple[str, str], words: str) -> None:
    with pytest.raises(SchemaError, match=words):
        parse(SCHEMA.replace(*change))
    with pytest.raises(SchemaError, match="described twice"):
        parse(SCHEMA + SCHEMA.replace("Wheels", "Again"))


# -- composing ---------------------------------------------------------------------------------------------------------


@each_row(
    ("record", "words"),
    [
        ({"message": "Imu3Acc", "fields": {"acc_x": 1, "acc_y": 2}}, "acc_z is missing"),
        ({"message": "Imu3Acc", "fields": {"acc_x": 1, "acc_y": 2, "acc_z": 3, "w": 4}}, "no field is called 'w'"),
        ({"message": "Imu3Acc", "fields": {"acc_x": "a", "acc_y": 2, "acc_z": 3}}, "Acceleration is a number"),
        ({"message": "ImuX"}, "no message is called 'ImuX'; there are: Imu3Acc"),
        ({"message": "0x90", "fields": {"mode": 3}}, "mode is a whole number from 0 to 2, given 3"),
        ({"message": "0x90", "fields": {"mode": 2}}, "Secure frames need a key: start with --key"),
        ({"message": "0x90", "fields": {"version": 16}}, "version is a whole number from 32 to 47"),
        ({"message": "0x90", "fields": {"data": "zz"}}, "data is hex"),
        ({"message": "0x90", "fields": {"data": "00" * 973}}, "payload size is 0 to 972, given 973"),
    ],
)
def test_compose_errors(record: dict[str, Any], words: str) -> None:
    with pytest.raises(EncodeError, match=words):
        frame_from_json(record)
