"""Frames of any type and mode, with a key; errors of a protocol without settings."""

from __future__ import annotations

import json

import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.events import batches
from imuscope.protocols.idtp.custom_payloads import parse
from imuscope.protocols.idtp.decoder import IdtpDecoder
from imuscope.protocols.idtp.driver import IdtpDriver
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.schema.layouts import EncodeError
from tests.support.each_row import each_row
from tests.support.source_files import ROOT
from tests.support.transaction_player import PlayedWire, play

DRIVER = IdtpDriver()
KEY = bytes(range(32))
VECTORS = json.loads((ROOT / "tests" / "golden" / "idtp" / "vectors.json").read_text())["vectors"]
SCHEMA = parse(
    '[[message]]\ntype = 0x90\nname = "Wheels"\n[[message.field]]\nname = "Speed"\ntype = "i16"\ncount = 2\n'
)


@each_row("mode", [0, 1, 2])
def test_every_standard_type_in_every_mode_is_read_back(mode: int) -> None:
    for number, command in enumerate(DRIVER.commands(DeviceContext())[:7], 1):
        readings = {field.name: 0.5 for field in command.arguments if field.dtype == "<f4"}
        values = {"timestamp": 1000, "sequence": number, "device_id": 7, "mode": mode, **readings}
        frame = DRIVER.frame(command.name, values, DeviceContext(settings={"key": KEY}))
        decoder = IdtpDecoder(key=KEY, min_mode=0)
        decoder.feed(frame, 0)
        [batch] = batches(decoder.drain(stalled=True))
        assert (batch.message.name, batch.device, len(batch)) == (command.name, "7", 1)
        assert DRIVER.name_of(frame) == command.name


def test_spans_cover_every_golden_frame_in_order() -> None:
    for row in VECTORS:
        frame = bytes.fromhex(row["frame_hex"])
        spans = DRIVER.annotate(frame)
        ends = [span.offset + span.size for span in spans]
        assert [span.offset for span in spans] == [0, *ends[:-1]], row["what"]
        assert ends[-1] == len(frame)


def test_a_vendor_defined_type() -> None:
    driver = IdtpDriver(SCHEMA)
    frame = driver.frame("Wheels", {"Speed": [1, -2], "mode": 0}, DeviceContext())
    assert frame.hex().endswith("0100feff")
    assert frame == driver.frame("Frame", {"type": 0x90, "data": "0100feff", "mode": 0}, DeviceContext())
    assert driver.name_of(frame) == "Wheels"
    assert [span.path for span in driver.annotate(frame)][-1] == "Speed"
    assert DRIVER.name_of(frame) == "0x90"


@each_row(
    ("command", "values", "message"),
    [
        ("Imu3Acc", {"acc_x": 0.0, "acc_y": 0.0}, "acc_z is missing"),
        ("Imu3Acc", {"acc_x": 0.0, "acc_y": 0.0, "acc_z": 0.0, "mode": 2}, "need a key"),
        ("Frame", {"type": 256}, "from 0 to 255"),
        ("Frame", {"data": "00" * 973}, "972"),
        ("Nothing", {}, "no message is called"),
    ],
)
def test_unsendable_values_are_reported(command: str, values: dict[str, object], message: str) -> None:
    with pytest.raises(EncodeError, match=message):
        DRIVER.frame(command, values, DeviceContext())


def test_a_device_is_received_and_a_frame_sent() -> None:
    wire = PlayedWire(IdtpSimulator(), "idtp")
    assert play(DRIVER.is_alive(DeviceContext()), wire)
    assert play(DRIVER.run("ImuQuat", {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}, DeviceContext()), wire) == {}
    assert wire.sent[-1].what == "ImuQuat"
    assert DRIVER.settings(DeviceContext()) == ()
    assert play(DRIVER.identify(DeviceContext(device="7")), wire) == DeviceContext(device="7")
    with pytest.raises(EncodeError, match="no settings"):
        play(DRIVER.read("any", DeviceContext()), wire)
