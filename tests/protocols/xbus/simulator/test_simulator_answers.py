"""Answers of the simulated IMX-5. Everything that it is told is answered as section 5 of MT0101P 2020.A has it."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.events import SampleGap, Text
from imuscope.protocols.xbus import frames
from imuscope.protocols.xbus.enums import SYNC_FUNCTIONS, SYNC_LINES
from imuscope.protocols.xbus.product_options import functions_of, lines_of, problems_beyond
from imuscope.protocols.xbus.products import MODELS, model_of
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.protocols.xbus.simulator.faults import FaultInjection
from imuscope.protocols.xbus.simulator.handlers import accepts
from imuscope.protocols.xbus.simulator.settings import SETTINGS
from tests.protocols.decoding import column
from tests.protocols.xbus.xbus_simulation import S, decode, in_config, replies, reply_to, run
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

VECTORS = ROOT / "tests" / "golden" / "xbus"


def vectors() -> list[dict[str, Any]]:
    path = VECTORS / "commands.json"
    return json.loads(path.read_text()) if path.exists() else []


@each_row("vector", [v for v in vectors() if v.get("message_hex")], ids=lambda v: str(v["what"])[:60])
def test_no_message_of_the_vectors_is_left_without_an_answer(vector: dict[str, Any]) -> None:
    """Requests are acknowledged with the next message number or refused with a code; messages of a
    device are refused.
    """
    data = bytes.fromhex(vector["message_hex"])
    mid, bid = data[2], data[1]
    device = in_config("MTi-680G")
    if mid in (0x22, 0xE2):
        reply_to(device, 0x10)
    answer = device.receive(data, 3 * S)
    *_, (number, payload) = replies(answer)
    if number == 0x42:
        assert payload[0] in (3, 4, 32, 33)
    else:
        assert number == mid + 1
        assert answer[-len(frames.build(number, payload)) :] == frames.build(number, payload, bid)


AGREEING = {  # requests whose answers are among the vectors: what to set first, if anything
    "GoToConfigAck": (0x30, b""),
    "SetBaudrateAck": (0x18, b"\x02"),
    "SetOutputConfigurationAck": (0xC0, None),
    "SetFilterProfileAck": (0x64, b"General_RTK"),
    "SetInitialHeadingAck": (0xD6, struct.pack(">f", 90)),
    "ReqLatLonAltAck": (0x6E, struct.pack(">3d", 52.2389123, 6.8562345, 67.125)),
    "ReqAlignmentRotationAck": (0xEC, b"\x01" + struct.pack(">4f", 1, 0, 0, 0)),
    "ReqGnssLeverArmAck": (0x68, struct.pack(">3f", 0.25, -1.5, 0.75)),
    "ReqOptionFlagsAck (4-byte flags)": (0x48, struct.pack(">II", 640, 0xFFFFFFFF)),
}


@each_row("what", AGREEING)
def test_answers_are_those_of_the_vectors(what: str) -> None:
    known = {vector["what"]: vector for vector in vectors()}
    if what not in known:
        pytest.skip("no vectors beside the project")
    expected = bytes.fromhex(known[what]["message_hex"])
    mid, payload = AGREEING[what]
    device = in_config("MTi-680G")
    if payload is None:
        payload = bytes.fromhex(known["SetOutputConfiguration"]["message_hex"])[4:-1]
    answer = device.receive(frames.build(mid, payload), 3 * S)
    if what.startswith("Req"):
        answer = device.receive(frames.build(mid, payload[:1] if mid == 0xEC else b""), 3 * S)
    assert answer == expected


def test_the_identity_is_read() -> None:
    device = in_config(serial=0x801234AB)
    assert reply_to(device, 0x00) == (0x01, bytes.fromhex("00000000801234AB"))
    assert reply_to(device, 0x1C) == (0x1D, b"MTi-630-8A1G6".ljust(20))
    assert len(reply_to(device, 0x12)[1]) == 11
    assert reply_to(device, 0x24) == (0x25, b"\x01\xff")
    older = in_config("MTi-30", serial=0x0368248C)
    assert reply_to(older, 0x00) == (0x01, bytes.fromhex("0368248C"))
    assert len(reply_to(older, 0x0C)[1]) == len(reply_to(device, 0x0C)[1]) == 118


def test_it_answers_to_both_of_its_addresses_and_to_no_other() -> None:
    device = in_config()
    for bid in (0xFF, 0x01):
        assert device.receive(frames.build(0x00, bid=bid), 2 * S)[:3] == bytes([0xFA, bid, 0x01])
    assert device.receive(frames.build(0x00, bid=0x07), 2 * S) == b""


@each_row(
    ("mid", "payload", "code"),
    [
        (0x07, b"", 4),  # unknown
        (0x10, b"\x00", 4),  # no payload is allowed
        (0x22, b"\x00\x02", 4),  # measurement only
        (0xE2, b"\xd3", 4),  # not in this product
        (0x18, b"\x77", 32),
        (0x18, b"\x02\x02", 4),
        (0xC0, b"\x40\x20\x00", 4),
        (0xC0, struct.pack(">HH", 0x5042, 100), 33),  # no GNSS
        (0xC0, struct.pack(">HH", 0x1021, 100), 33),  # no such precision
        (0xEC, b"\x02", 33),
        (0xEC, b"\x00" + bytes(16), 33),  # no rotation
        (0x64, b"Robust/Nonsense", 33),
        (0xA4, b"\x00\x03", 33),  # only while measuring
        (0xA8, struct.pack(">i", 10_001), 33),
        (0x60, struct.pack(">IH6B", 0, 2020, 2, 30, 0, 0, 0, 0), 33),
        (0x6E, struct.pack(">3d", 91, 0, 0), 33),
    ],
)
def test_invalid_requests_are_refused_with_their_code(mid: int, payload: bytes, code: int) -> None:
    assert reply_to(in_config(), mid, payload) == (0x42, bytes([code]))


def test_measuring_refuses_configuration() -> None:
    device = XbusSimulator()
    run(device, 1)
    assert reply_to(device, 0xC0, now=S) == (0x42, b"\x04")
    assert device.phase == "measurement"


VALUES = {  # of settings that are not just bytes
    0x18: b"\x0a",
    0xDC: b"\x02\x4e",
    0x04: b"\x00\xe1",
    0x8E: b"\x00\x00\x40\x00\x00\x05",
    0x64: b"GeneralMag_RTK",
    0x76: b"\x00\x08",
    0x8C: bytes.fromhex("000100020001010200050005"),
    0x6E: struct.pack(">3d", -33.5, 151.25, 12),
    0x68: struct.pack(">3f", 0.25, -1.5, 0.75),
    0xE8: bytes.fromhex("0501000001230064"),
}


@each_row("mid", [mid for mid, setting in SETTINGS.items() if setting.readable])
def test_every_setting_is_returned_as_it_was_set(mid: int) -> None:
    device = in_config("MTi-680G" if 680 in SETTINGS[mid].products else "MTi-G-710")
    before = reply_to(device, mid)[1]
    value = VALUES.get(mid, bytes(range(1, 1 + min(SETTINGS[mid].sizes))))
    assert reply_to(device, mid, value) == (mid + 1, b"")
    assert reply_to(device, mid) == (mid + 1, value)
    assert reply_to(device, 0x0E) == (0x0F, b"")
    assert reply_to(device, mid) == (mid + 1, before)


def test_a_profile_of_the_document_that_is_not_listed_is_taken() -> None:
    device = in_config("MTi-630")
    for heading in (b"VRUAHS", b"FixedMagRef"):
        assert reply_to(device, 0x64, b"Robust/" + heading) == (0x65, b"")
    assert len(reply_to(device, 0x62)[1]) == 110


def test_an_entry_of_zeros_clears_the_outputs_on_can() -> None:
    device = in_config("MTi-630")
    reply_to(device, 0xE8, VALUES[0xE8])
    assert reply_to(device, 0xE8, bytes(8)) == (0xE9, b"")
    assert reply_to(device, 0xE8) == (0xE9, b"")


def test_other_data_than_rtcm_reach_the_receiver() -> None:
    device = in_config("MTi-680G")
    reply_to(device, 0x10)
    assert reply_to(device, 0xE2, bytes.fromhex("B5620A0400000E34"), now=3 * S) == (0xE3, b"")


def test_a_sync_line_accepts_functions_of_its_direction_only() -> None:
    """The sync out was taken as a line on which the device is triggered."""
    entry = bytes([3, 7, 1, 0]) + bytes(8)
    assert reply_to(in_config("MTi-630"), 0x2C, entry) == (0x42, b"\x21")
    assert reply_to(in_config("MTi-630"), 0x2C, bytes([4, 7]) + entry[2:]) == (0x2D, b"")


@each_row(
    ("product", "lines"),
    [("MTi-7", {8}), ("MTi-G-710", {4}), ("MTi-670", {2, 7, 9}), ("MTi-680G", {7, 10}), ("MTi-630", set())],
)
def test_the_pulse_of_the_receiver_goes_to_the_lines_of_the_product(product: str, lines: set[int]) -> None:
    """Note 5 of table 12: on the MTi-670 it is enabled on In1 or In2, which was refused."""
    model = model_of(product)
    assert model is not None
    for line in SYNC_LINES:
        entry = bytes([14, line, 1, 0]) + bytes(8)
        answer, _ = reply_to(in_config(product), 0x2C, entry)
        assert (answer == 0x2D) == (line in lines), line
        values = {"function": 14, "line": line, "polarity": 1, "trigger_once": 0, "skip_first": 0, "skip_factor": 0}
        values |= {"pulse_width": 0, "delay_offset_or_clock_period": 0}
        problems = list(problems_beyond("SetSyncSettings", {"settings": [values]}, model))
        assert (not problems and line in lines_of(model)) == (line in lines), line


@each_row("number", list(MODELS))
def test_simulator_and_form_agree_on_sync_lines(number: int) -> None:
    """Both are transcribed from the document, each for itself."""
    model = MODELS[number]
    for function in SYNC_FUNCTIONS:
        for line in SYNC_LINES:
            values = {"function": function, "line": line, "polarity": 1, "delay_offset_or_clock_period": 0}
            offered = function in functions_of(model) and line in lines_of(model)
            fits = offered and not list(problems_beyond("SetSyncSettings", {"settings": [values]}, model))
            assert accepts(model, function, line) == fits, (model.name, function, line)


def test_an_initial_heading_is_set_and_never_read() -> None:
    assert reply_to(in_config("MTi-680G"), 0xD6, struct.pack(">f", -179.5)) == (0xD7, b"")
    assert reply_to(in_config("MTi-680G"), 0xD6) == (0x42, b"\x04")
    assert reply_to(in_config("MTi-7"), 0xD6, struct.pack(">f", 10)) == (0x42, b"\x04")


def test_stored_values_outlive_power() -> None:
    device = in_config()
    reply_to(device, 0x84, b"\x12\x34")
    again = device.repowered(10 * S)
    assert again.advance(10 * S + 200_000_000) == b""
    assert replies(again.advance(10 * S + 300_000_000)) == [(0x3E, b"")]
    again.advance(12 * S)
    assert reply_to(again, 0x30, now=12 * S) == (0x31, b"")
    assert reply_to(again, 0x84, now=12 * S) == (0x85, b"\x12\x34")


def test_without_auto_store_a_reset_forgets() -> None:
    device = in_config("MTi-3")
    reply_to(device, 0x48, struct.pack(">II", 1, 0))
    reply_to(device, 0x84, b"\x12\x34")
    assert reply_to(device, 0x84) == (0x85, b"\x12\x34")
    reply_to(device, 0x40)
    run(device, 2, begin=2.1)
    reply_to(device, 0x30, now=5 * S)
    assert reply_to(device, 0x84, now=5 * S) == (0x85, bytes(2))
    assert reply_to(device, 0x48, now=5 * S) == (0x49, struct.pack(">I", 1))


def test_without_auto_measurement_it_stays_in_config() -> None:
    device = in_config("MTi-3")
    reply_to(device, 0x48, struct.pack(">II", 2, 0))
    reply_to(device, 0x40)
    assert [number for number, _ in replies(run(device, 3, begin=2.1))] == [0x3E]
    assert device.phase == "config"


def test_restore_bytes_at_boot_restore_the_factory_baud_rate() -> None:
    """Section 7.2: the baud rate and the outputs return, an alignment stays."""
    device = in_config()
    alignment = b"\x00" + struct.pack(">4f", 0, 1, 0, 0)
    for mid, payload in ((0x8C, bytes.fromhex("0001000C0001000200000000")), (0xC0, bytes(4)), (0xEC, alignment)):
        reply_to(device, mid, payload)
    again = device.repowered(10 * S)
    assert again.receive(b"\xde", 10 * S + 100_000_000) == b""
    assert replies(again.receive(b"\xde", 10 * S + 400_000_000)) == [(0x3E, b"")]
    assert again.baud == 115_200
    again.receive(frames.build(0x3F), 10 * S + 400_000_000)
    assert reply_to(again, 0x18, now=12 * S) == (0x19, b"\x02")
    assert len(reply_to(again, 0xC0, now=12 * S)[1]) > 4
    assert reply_to(again, 0xEC, b"\x00", now=12 * S) == (0xED, alignment)


def test_the_counter_counts_sent_samples_only() -> None:
    """5.3.6: it counts MTData2 messages; strings, and samples that SendLatest held back, made gaps of it."""
    device = XbusSimulator("MTi-670", measuring=True)
    begun = run(device, 1)
    for now, types in ((1, 1 << 3), (3, 0)):  # GPGGA for two seconds
        begun += device.receive(frames.build(0x30), now * S)
        begun += device.receive(frames.build(0x8E, struct.pack(">IH", types, 10 if types else 0)), now * S)
        begun += device.receive(frames.build(0x10), now * S)
        begun += run(device, 1.9, begin=now + 0.01)
    begun += device.receive(frames.build(0x30), 5 * S)
    assert reply_to(device, 0x2C, bytes([8, 6, 1]) + bytes(9), now=5 * S)[0] == 0x2D
    device.receive(frames.build(0x10), 5 * S)
    for tenth in range(51, 60):  # a request in 100 ms
        now = tenth * S // 10
        begun += device.advance(now) + device.receive(frames.build(0x34), now)
    events = decode(begun)
    assert sum(event.protocol == "nmea" for event in events if isinstance(event, Text)) > 15
    assert [event.missing for event in events if isinstance(event, SampleGap)] == []
    assert len(column(events, "PacketCounter")) > 250


def test_send_latest_waits_for_a_request() -> None:
    device = in_config()
    software = bytes([8, 6, 1, 0]) + bytes(8)
    assert reply_to(device, 0x2C, software) == (0x2D, b"")
    assert reply_to(device, 0x34) == (0x42, b"\x04")  # measurement only
    reply_to(device, 0x10)
    assert run(device, 1, begin=2) == b""
    data = device.receive(frames.build(0x34), 3 * S + 5_000_000)
    assert len(column(decode(data), "PacketCounter")) == 1
    assert device.receive(frames.build(0x34), 3 * S + 6_000_000) == b""  # nothing new yet


def test_a_stubborn_device_responds_after_a_reset() -> None:
    device = XbusSimulator(moods=FaultInjection(ignores_goto_config=True))
    run(device, 1)
    assert replies(device.receive(frames.build(0x30), S)) == []
    assert reply_to(device, 0x40, now=S) == (0x41, b"")
    run(device, 1, begin=1.1)
    assert reply_to(device, 0x30, now=3 * S) == (0x31, b"")


def test_a_600_series_has_one_baud_rate() -> None:
    device = in_config()
    reply_to(device, 0x18, b"\x0a")
    assert reply_to(device, 0x8C)[1][:4] == bytes.fromhex("0001000A")
    reply_to(device, 0x8C, bytes.fromhex("0001000C0001000200000000"))
    assert reply_to(device, 0x18) == (0x19, b"\x0c")


def test_option_flags_are_set_and_cleared() -> None:
    device = in_config()
    reply_to(device, 0x48, struct.pack(">II", 0xC0, 0))
    reply_to(device, 0x48, struct.pack(">II", 0, 0x40))
    assert reply_to(device, 0x48) == (0x49, struct.pack(">I", 0x80))


def test_a_no_rotation_update_shows_in_the_status_word() -> None:
    """Started at rest, the update runs until the vehicle turns, and then reports the rotation until the next one."""
    device = XbusSimulator(measuring=True)
    device.advance(35 * S)
    data = device.receive(frames.build(0x22, b"\x00\x0a"), 35 * S) + run(device, 20, begin=35)
    status = column(decode(data), "StatusWord").astype(np.int64) >> 3 & 3
    assert status[100] == 3
    assert status[-1] == 2
    assert (np.diff(status[2:]) <= 0).all()


def test_utc_is_set_adjusted_and_sent() -> None:
    device = in_config()
    assert reply_to(device, 0x60)[1][-1] == 0
    reply_to(device, 0x60, struct.pack(">IH6B", 250_000_000, 2020, 6, 11, 19, 20, 18, 7), now=2 * S)
    reply_to(device, 0xA8, struct.pack(">i", -5000), now=2 * S)
    assert struct.unpack(">IH6B", reply_to(device, 0x60, now=3 * S)[1]) == (750_000_000, 2020, 6, 11, 19, 20, 18, 7)


def test_sync_settings_mark_samples() -> None:
    device = in_config()
    pulse = bytes([4, 7, 1, 0, 0, 0, 0, 4, 0, 5, 0, 0])
    trigger = bytes([3, 2, 1, 0]) + bytes(8)
    assert reply_to(device, 0x2C, pulse + trigger) == (0x2D, b"")
    assert reply_to(device, 0x2C) == (0x2D, pulse + trigger)
    reply_to(device, 0x10)
    status = column(decode(run(device, 5, begin=2)), "StatusWord").astype(np.int64)
    assert (status >> 22 & 1).sum() == pytest.approx(100, abs=2)
    assert (status >> 21 & 1).sum() == pytest.approx(5, abs=1)
    device.receive(frames.build(0x30), 8 * S)
    assert reply_to(device, 0x2C, bytes(12), now=8 * S) == (0x2D, b"")
    assert reply_to(device, 0x2C, now=8 * S) == (0x2D, b"")


@given(st.binary(max_size=60) | st.builds(frames.build, st.integers(0, 255), st.binary(max_size=40)), st.booleans())
def test_any_received_bytes_leave_it_running(data: bytes, config: bool) -> None:
    device = XbusSimulator(measuring=True)
    device.advance(S // 10)
    if config:
        device.receive(frames.build(0x30), S // 10)
    replies(device.receive(data, S // 10))
    device.advance(S)
    answer = device.receive(frames.build(0x30), 2 * S)
    assert answer.endswith(bytes.fromhex("FAFF3100D0")) or device.phase in ("boot", "wake-up", "measurement")


def test_a_request_in_pieces_between_noise_is_received() -> None:
    device = in_config()
    data = b"\x00\xfa\xff" + frames.build(0x1E) + b"\xfa"
    answers = b"".join(device.receive(data[at : at + 1], 2 * S + at) for at in range(len(data)))
    assert [number for number, _ in replies(answers)] == [0x1F]


def test_an_unknown_product_raises_a_value_error() -> None:
    with pytest.raises(ValueError, match="MTi-630"):
        XbusSimulator("MTi-9000")


def test_the_vendors_software_finds_what_it_requests_first() -> None:
    """InitBus, a padded GotoConfig of the scan for RS-485, the calibration: each was answered with Error."""
    device = in_config("MTi-680G")
    for request, number, size in (
        (frames.build(0x30, bytes(30)), 0x31, 0),
        (frames.build(0x02), 0x03, 8),
        (frames.build(0x90, b"\0\xff"), 0x91, 256),
    ):
        *_, (answer, payload) = replies(device.receive(request, 3 * S))
        assert (answer, len(payload)) == (number, size)


@each_row(
    ("product", "begins"),
    [("MTi-3", "0388"), ("MTi-7", "0788"), ("MTi-30", "0368"), ("MTi-300", "0378"), ("MTi-G-710", "0778")],
)
def test_an_identifier_begins_as_the_vendors_do_for_the_product(product: str, begins: str) -> None:
    assert XbusSimulator(product).identifier().hex().startswith(begins)


@each_row("rates", [(80, 100), (400, 100), (50, 40)])
def test_the_packet_counter_counts_messages_where_rates_do_not_divide(rates: tuple[int, int]) -> None:
    """Regression: ticks without output were counted, which appeared as thousands of lost messages."""
    device = in_config("MTi-630")
    first, second = rates
    pairs = [(0x1020, 0xFFFF), (0x1060, 0xFFFF), (0x2010, first), (0x4020, second)]
    reply_to(device, 0xC0, b"".join(struct.pack(">HH", *pair) for pair in pairs))
    reply_to(device, 0x10)
    counters = column(decode(device.advance(6 * S)), "PacketCounter")
    assert len(counters) > 100
    assert set(np.diff(counters.astype(np.int64))) == {1}
