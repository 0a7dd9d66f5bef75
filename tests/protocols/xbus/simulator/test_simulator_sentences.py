"""Strings that the simulated MTi is configured to send, read back."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest

from imuscope.protocols import rotations
from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.events import Batch, RejectedFrame, Reply, Text
from imuscope.protocols.simulator import trajectory
from imuscope.protocols.xbus.enums import STRING_TYPES
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.protocols.xbus.simulator.strings import LINES
from tests.protocols.xbus.xbus_simulation import S, decode, in_config, reply_to, run
from tests.protocols.xbus.xbus_values import DRIVER
from tests.support.each_row import each_row

EM1000 = "EM1000"  # is believed only where records are near each other, and may look like the start of a frame
WORDS = {name for name in LINES if name != EM1000}


def word(*names: str) -> int:
    """Flag word that selects these strings."""
    return sum(1 << bits.low for bits in STRING_TYPES if bits.name in names)


ALL_TYPES = word(*WORDS)


def sentences_of(device: XbusSimulator, types: int, hertz: int = 10) -> bytes:
    """Output of a device in ten seconds after strings were selected."""
    six = device.product.series == 600
    payload = struct.pack(">IH", types, hertz) if six else struct.pack(">H", types)
    assert reply_to(device, 0x8E, payload) == (0x8F, b"")
    assert reply_to(device, 0x10) == (0x11, b"")
    return run(device, 10, begin=2)


def lines(data: bytes) -> list[Text]:
    events = decode(data)
    assert not [event for event in events if isinstance(event, (Batch, RejectedFrame, Reply))]
    return [event for event in events if isinstance(event, Text)]


@each_row("product", ["MTi-680G", "MTi-G-710"])
def test_every_string_is_sent_and_read(product: str) -> None:
    results = lines(sentences_of(in_config(product), ALL_TYPES))
    assert {line.name for line in results} == WORDS
    ticks = sum(line.name == "HEHDT" for line in results)
    assert ticks == (101 if product == "MTi-680G" else 1001)
    assert len(results) == ticks * len(WORDS)


def test_without_a_receiver_there_are_no_strings_of_one() -> None:
    names = {line.name for line in lines(sentences_of(in_config("MTi-630"), ALL_TYPES))}
    assert names == WORDS - {"GPGGA", "GPZDA", "GPRMC", "XSVEL"}


HEADINGS = {"HEHDT": "headingT", "TSS2": "heading", "PRDID": "headingT", "HCHDM": "headingM", EM1000: "heading"}


def test_strings_follow_the_trajectory() -> None:
    """Heading, pitch and roll are within the filter's errors in all strings that contain them."""
    data = sentences_of(in_config("MTi-680G"), word(*HEADINGS))
    results = [event for event in decode(data) if isinstance(event, Text)]
    times = np.arange(101) / 10 + 2
    axes = rotations.matrix_of(trajectory.vehicle_motion(times).q_enu_from_body_wxyz)
    truth = np.degrees(np.arctan2(axes[:, 0, 0], axes[:, 1, 0]))
    for name, key in HEADINGS.items():
        heading = np.array([line.fields[key] for line in results if line.name == name])
        assert len(heading) == 101, name
        assert np.abs((heading - truth + 180) % 360 - 180).max() < 2, name
    for name in ("PRDID", "TSS2", EM1000):
        pitch, roll = (
            np.array([line.fields[key] for line in results if line.name == name]) for key in ("pitch", "roll")
        )
        assert np.abs(pitch - np.degrees(np.arcsin(axes[:, 2, 0]))).max() < 2, name
        assert np.abs(roll - np.degrees(np.arctan2(axes[:, 2, 1], axes[:, 2, 2]))).max() < 2, name


@each_row("product", ["MTi-680G", "MTi-630", "MTi-30"])
def test_lines_are_at_most_as_long_as_the_computed_load(product: str) -> None:
    device = in_config(product)
    hertz = 10
    length = len(sentences_of(device, ALL_TYPES, hertz))
    setting: dict[str, Any] = {"string_types": ALL_TYPES}
    if product != "MTi-30":
        setting["frequency"] = hertz
    load = DRIVER.load({"StringOutputType": setting}, DeviceContext(product=product)).total
    assert 0.5 * load * 10 < length <= load * 10.1


def test_zero_string_types_return_to_data() -> None:
    device = in_config()
    sentences_of(device, 1 << 8)
    request_again = device.receive(bytes.fromhex("FAFF3000D1"), 13 * S)
    assert request_again.endswith(bytes.fromhex("FAFF3100D0"))
    assert reply_to(device, 0x8E, bytes(6), now=13 * S) == (0x8F, b"")
    assert reply_to(device, 0x10, now=13 * S) == (0x11, b"")
    assert any(isinstance(event, Batch) for event in decode(run(device, 1, begin=13)))


def test_period_and_skip_factor_make_the_rate_of_older_devices() -> None:
    device = in_config("MTi-30")
    assert reply_to(device, 0x04, struct.pack(">H", 576)) == (0x05, b"")
    assert reply_to(device, 0xD4, struct.pack(">H", 3)) == (0xD5, b"")
    assert len(lines(sentences_of(device, 1 << 8))) == pytest.approx(500, abs=1)
    device = in_config("MTi-30")
    assert reply_to(device, 0xD4, b"\xff\xff") == (0xD5, b"")
    assert sentences_of(device, 1 << 8) == b""
