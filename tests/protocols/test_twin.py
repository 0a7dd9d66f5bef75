"""Does the twin say what an MTi would say? Everything it sends is read back by the decoder, everything it is told is
answered as sections 4 and 5 of MT0101P 2020.A have it, and what it measures is the drive.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols import motion
from protocols.events import Event, Gap, Reject, Reply, Step, batches
from protocols.xbus import frames
from protocols.xbus.decoder import XbusDecoder
from protocols.xbus.device import WAKE_UP_WINDOW_NS, XbusDevice
from protocols.xbus.items import item
from protocols.xbus.measurement import granted, source_of
from protocols.xbus.quantities import ALWAYS, SOURCES
from protocols.xbus.settings import PRODUCTS, SETTINGS

S = 10**9
VECTORS = Path(__file__).parents[3] / "shared" / "vectors" / "xbus"


def run(device: XbusDevice, seconds: float, *, begin: float = 0, tick_ns: int = 10_000_000) -> bytes:
    """Everything that the device sends in some seconds."""
    times = range(int(begin * S), int((begin + seconds) * S) + 1, tick_ns)
    return b"".join(device.advance(now) for now in times)


def decode(data: bytes) -> list[Event]:
    decoder = XbusDecoder()
    decoder.feed(data, 0)
    return decoder.drain(stalled=True)


def replies(data: bytes) -> list[tuple[int, bytes]]:
    """Message number and payload of all frames but MTData2."""
    found, at = [], 0
    while at < len(data):
        head = 6 if data[at + 3] == 0xFF else 4
        size = data[at + 3] if head == 4 else struct.unpack_from(">H", data, at + 4)[0]
        assert sum(data[at + 1 : at + head + size + 1]) & 0xFF == 0
        if data[at + 2] != frames.MTDATA2:
            found.append((data[at + 2], data[at + head : at + head + size]))
        at += head + size + 1
    return found


def column(events: list[Event], name: str) -> np.ndarray[Any, Any]:
    """One item of all batches, in stream order."""
    holding = [batch for batch in batches(events) if name in batch.columns]
    values = np.concatenate([batch.columns[name] for batch in holding])
    return values[np.argsort(np.concatenate([batch.offset for batch in holding]), kind="stable")]


def ask(device: XbusDevice, mid: int, payload: bytes = b"", now: int = 2 * S) -> tuple[int, bytes]:
    """Send one message; the one answer."""
    answers = replies(device.receive(frames.build(mid, payload), now))
    assert len(answers) == 1, answers
    return answers[0]


def in_config(product: str = "MTi-630", **options: Any) -> XbusDevice:
    device = XbusDevice(product, **options)
    run(device, 1)
    assert ask(device, 0x30, now=1 * S) == (0x31, b"")
    return device


# -- what it sends -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("product", PRODUCTS)
def test_every_product_sends_its_configuration(product: str) -> None:
    device = XbusDevice(product)
    events = decode(run(device, 4.5))
    assert not [event for event in events if isinstance(event, Reject | Gap | Step)]
    assert [event.message.name for event in events if isinstance(event, Reply)] == ["WakeUp", "Configuration"]
    for identifier, rate in device.output:
        name = SOURCES[identifier & 0xFFF0].name
        if rate != ALWAYS:
            assert abs(len(column(events, name)) - 4 * rate) <= 1, name
    assert (np.diff(column(events, "PacketCounter").astype(np.int64)) == 1).all()


@pytest.mark.parametrize("identifier", [i | p | c for i in SOURCES for p in range(4) for c in (0, 4, 8)])
def test_every_item_in_every_form_is_what_the_decoder_expects(identifier: int) -> None:
    device = in_config("MTi-680G", seed=3)
    source = source_of(identifier, device.product.abilities)
    if source is None:
        assert ask(device, 0xC0, struct.pack(">HH", identifier, 10)) == (0x42, b"\x21")
        return
    rate = granted(source, 0, 400)
    wish = struct.pack(">HHHH", 0x1060, ALWAYS, identifier, 0)
    assert ask(device, 0xC0, wish) == (0xC1, struct.pack(">HHHH", 0x1060, ALWAYS, identifier, rate))
    assert ask(device, 0x10) == (0x11, b"")
    data = run(device, 2.9, begin=2)
    known = 0
    for batch in batches(decode(data)):
        for field in batch.message.fields:
            assert not field.name.startswith("0x")
            known += len(batch) * (field.id == identifier)
    assert known >= (2.9 * (100 if rate == ALWAYS else rate)) - 1
    assert item(identifier, 4).name or True


def test_items_come_in_the_messages_in_which_they_are_due() -> None:
    device = in_config()
    wish = struct.pack(">8H", 0x1020, ALWAYS, 0x2010, 100, 0x4020, 400, 0x0810, 1)
    assert ask(device, 0xC0, wish)[1] == wish
    ask(device, 0x10)
    events = decode(run(device, 3, begin=2))
    assert [len(column(events, name)) for name in ("PacketCounter", "Acceleration", "Quaternion", "Temperature")] == [
        1201,
        1201,
        301,
        4,
    ]
    layouts = {tuple(field.name for field in batch.message.fields): len(batch) for batch in batches(events)}
    assert layouts == {
        ("PacketCounter", "Acceleration"): 900,
        ("PacketCounter", "Quaternion", "Acceleration"): 297,
        ("PacketCounter", "Quaternion", "Acceleration", "Temperature"): 4,
    }


@pytest.mark.parametrize(
    ("wish", "rate"), [(0, 400), (0xFFFF, 400), (1000, 400), (400, 400), (399, 200), (150, 100), (3, 2)]
)
def test_a_wish_becomes_a_rate_that_divides(wish: int, rate: int) -> None:
    assert granted(SOURCES[0x4020], wish, 400) == rate


def test_it_measures_the_drive() -> None:
    """Within the errors of a good sensor: the twin adds noise and bias, no more."""
    events = decode(run(XbusDevice(seed=2, rate=400), 60))
    times = column(events, "SampleTimeFine") * 1e-4
    truth = motion.drive(times)
    assert np.abs(column(events, "RateOfTurn") - truth.rate).max() < np.radians(1)
    off = column(events, "Acceleration") - truth.force
    assert np.abs(off[np.abs(truth.force).max(axis=1) < 98]).max() < 0.1
    same = np.abs((column(events, "Quaternion") * truth.q_enu_from_body_wxyz).sum(axis=1))
    assert np.degrees(2 * np.arccos(np.minimum(same, 1))).max() < 1.5


def test_coordinate_systems_are_one_attitude() -> None:
    enu, ned, nwu = (attitude(identifier) for identifier in (0x2013, 0x2017, 0x201B))
    north, east, up = enu[:, 1], enu[:, 0], enu[:, 2]
    assert np.allclose(ned, np.stack([north, east, -up], axis=1), atol=1e-9)
    assert np.allclose(nwu, np.stack([north, -east, up], axis=1), atol=1e-9)


def attitude(identifier: int) -> np.ndarray[Any, Any]:
    """Rotation matrices of a second, sent as quaternions of one kind."""
    device = in_config()
    ask(device, 0xC0, struct.pack(">HH", identifier, 100))
    ask(device, 0x10)
    return motion.matrix(column(decode(run(device, 1, begin=2)), "Quaternion"))


def test_the_pothole_clips_and_says_so() -> None:
    events = decode(run(XbusDevice(rate=400), 54, tick_ns=S // 20))
    status, force = column(events, "StatusWord").astype(np.int64), column(events, "Acceleration")
    clipped = (status >> 10 & 1) == 1
    assert 1 <= clipped.sum() < 40
    assert (np.abs(force[clipped][:, 2]) > 98).all()
    assert ((status >> 19 & 1) == clipped).all()
    assert ((status >> 1 & 1) == ~clipped).all()  # the filter's input is not complete then


def test_satellites_come_late_with_an_older_time() -> None:
    device = XbusDevice("MTi-680G")
    events = decode(run(device, 20))
    pvt = column(events, "GnssPvtData")
    assert (pvt["fixtype"][:8] == 0).all()
    assert (pvt["fixtype"][-8:] == 3).all()
    assert pvt["year"][-1] == 2026
    ticks = column(events, "SampleTimeFine").astype(np.int64)
    assert set(np.diff(ticks).tolist()) == {100, -800, 900}  # back by 80 ms, and on
    assert (np.diff(ticks) == -800).sum() == len(pvt)
    rtk = column(events, "StatusWord").astype(np.int64) >> 27 & 3
    assert sorted(set(rtk.tolist())) == [0, 1, 2]
    place = column(events, "LatLon")
    assert np.abs(place - [45, 0]).max() < 0.01


def test_time_wraps_after_a_day_in_the_older_series() -> None:
    device = XbusDevice("MTi-30", measuring=True, clock_jump=(1.0, 86_398.0))
    ticks = column(decode(run(device, 3)), "SampleTimeFine").astype(np.int64)
    assert ticks.max() < 864_000_000
    assert (np.diff(ticks) == 100).sum() >= len(ticks) - 3


# -- time and faults ---------------------------------------------------------------------------------------------------


@given(st.lists(st.integers(0, 120_000_000), max_size=30))
def test_how_time_is_cut_changes_nothing(cuts: list[int]) -> None:
    whole, cut = XbusDevice(seed=9), XbusDevice(seed=9)
    now, parts = 0, b""
    for step in cuts:
        now += step
        parts += cut.advance(now)
    assert parts + cut.advance(2 * S) == whole.advance(2 * S)


def test_nothing_is_sent_twice_or_back_in_time() -> None:
    device = XbusDevice()
    assert len(device.advance(2 * S)) > 10_000
    assert device.advance(2 * S) == device.advance(1 * S) == b""


def test_drift_is_in_the_rate_and_in_the_time() -> None:
    device = XbusDevice(clock_drift_ppm=1000)
    device.advance(1 * S)
    ticks = column(decode(device.advance(101 * S)), "SampleTimeFine").astype(np.int64)
    assert abs(len(ticks) - 10_010) <= 1
    assert ticks[-1] >= 1_010_900


def test_a_jump_of_the_clock_is_a_step() -> None:
    events = decode(run(XbusDevice(clock_jump=(2.0, 300.0)), 4))
    assert [(event.kind, event.by_ns) for event in events if isinstance(event, Step)] == [
        ("jump", 300 * S + 10_000_000)
    ]


def test_faults_are_counted_by_the_decoder_as_made() -> None:
    clean, faulty = XbusDevice(seed=4), XbusDevice(seed=4, drop=0.02, corrupt=0.02)
    good, events = decode(run(clean, 60)), decode(run(faulty, 60))
    sent = len(column(good, "PacketCounter"))
    lost = sum(event.missing for event in events if isinstance(event, Gap))
    assert len(column(events, "PacketCounter")) + lost == sent
    assert 0.03 * sent < lost < 0.05 * sent
    assert [event for event in events if isinstance(event, Reject)]
    assert run(XbusDevice(seed=4, drop=0.02, corrupt=0.02), 60) == run(XbusDevice(seed=4, drop=0.02, corrupt=0.02), 60)


# -- states ------------------------------------------------------------------------------------------------------------


def test_power_up_without_a_word_leads_to_measurement() -> None:
    device = XbusDevice(start_ns=5 * S)
    assert device.advance(5 * S - 1) == b""
    assert device.advance(5 * S).hex() == "faff3e00c3"
    assert device.advance(5 * S + WAKE_UP_WINDOW_NS - 1) == b""
    assert replies(device.advance(6 * S))[0][0] == 0x0D
    assert device.phase == "measurement"


def test_a_wake_up_ack_leads_to_config() -> None:
    device = XbusDevice()
    device.advance(0)
    assert device.receive(bytes.fromhex("FAFF3F00C2"), 400_000_000) == b""
    assert device.phase == "config"
    assert device.advance(5 * S) == b""


def test_config_and_back() -> None:
    device = XbusDevice()
    run(device, 1)
    data = device.receive(bytes.fromhex("FAFF3000D1"), 1_500_000_000)
    assert data.endswith(bytes.fromhex("FAFF3100D0"))
    assert len(column(decode(data), "PacketCounter")) == 50  # what was due is sent first
    assert device.advance(9 * S) == b""
    assert device.receive(bytes.fromhex("FAFF3000D1"), 9 * S).hex() == "faff3100d0"
    assert device.receive(bytes.fromhex("FAFF1000F1"), 9 * S).hex() == "faff1100f0"
    assert len(device.advance(10 * S)) > 5000


def test_reset_begins_anew_and_the_new_baud_rate_acts() -> None:
    device = in_config()
    assert ask(device, 0x18) == (0x19, b"\x02")
    assert ask(device, 0x18, b"\x80") == (0x19, b"")
    assert (device.baud, ask(device, 0x18)) == (115_200, (0x19, b"\x80"))
    assert ask(device, 0x40) == (0x41, b"")
    assert device.baud == 921_600
    assert device.advance(2 * S + 200_000_000) == b""
    assert device.receive(bytes.fromhex("FAFF3000D1"), 2 * S + 200_000_000) == b""  # nobody listens yet
    events = decode(run(device, 2, begin=2.25))
    assert [event.message.name for event in events if isinstance(event, Reply)] == ["WakeUp", "Configuration"]
    assert column(events, "SampleTimeFine")[0] == 5000
    assert column(events, "PacketCounter")[0] == 0


# -- answers -----------------------------------------------------------------------------------------------------------


def vectors() -> list[dict[str, Any]]:
    path = VECTORS / "commands.json"
    return json.loads(path.read_text()) if path.exists() else []


@pytest.mark.parametrize("vector", [v for v in vectors() if v.get("message_hex")], ids=lambda v: str(v["what"])[:60])
def test_no_message_of_the_vectors_is_left_without_an_answer(vector: dict[str, Any]) -> None:
    """Requests are acknowledged by the next number, or refused with a code; what only a device says is refused."""
    data = bytes.fromhex(vector["message_hex"])
    mid, bid = data[2], data[1]
    device = in_config("MTi-680G")
    if mid in (0x22, 0xE2):
        ask(device, 0x10)
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


@pytest.mark.parametrize("what", AGREEING)
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


def test_who_it_is() -> None:
    device = in_config(serial=0x801234AB)
    assert ask(device, 0x00) == (0x01, bytes.fromhex("00000000801234AB"))
    assert ask(device, 0x1C) == (0x1D, b"MTi-630-8A1G6".ljust(20))
    assert len(ask(device, 0x12)[1]) == 11
    assert ask(device, 0x24) == (0x25, b"\x01\xff")
    older = in_config("MTi-30", serial=0x0368248C)
    assert ask(older, 0x00) == (0x01, bytes.fromhex("0368248C"))
    assert len(ask(older, 0x0C)[1]) == len(ask(device, 0x0C)[1]) == 118


def test_it_answers_to_both_of_its_addresses_and_to_no_other() -> None:
    device = in_config()
    for bid in (0xFF, 0x01):
        assert device.receive(frames.build(0x00, bid=bid), 2 * S)[:3] == bytes([0xFA, bid, 0x01])
    assert device.receive(frames.build(0x00, bid=0x07), 2 * S) == b""


@pytest.mark.parametrize(
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
def test_what_is_wrong_is_refused_with_its_code(mid: int, payload: bytes, code: int) -> None:
    assert ask(in_config(), mid, payload) == (0x42, bytes([code]))


def test_measuring_refuses_configuration() -> None:
    device = XbusDevice()
    run(device, 1)
    assert ask(device, 0xC0, now=S) == (0x42, b"\x04")
    assert device.phase == "measurement"


@pytest.mark.parametrize("mid", SETTINGS)
def test_every_setting_is_returned_as_it_was_set(mid: int) -> None:
    device = in_config("MTi-G-710" if mid in (0x86, 0xDC, 0x04, 0xD4, 0x76) else "MTi-680G")
    values = {
        0x18: b"\x0a",
        0x04: b"\x00\xe1",
        0x64: b"GeneralMag_RTK",
        0x8C: bytes.fromhex("000100020001010200050005"),
        0x6E: struct.pack(">3d", -33.5, 151.25, 12),
        0xD6: struct.pack(">f", -179.5),
    }
    before = ask(device, mid)[1]
    value = values.get(mid, bytes(range(1, 1 + min(SETTINGS[mid].sizes))))
    assert ask(device, mid, value) == (mid + 1, b"")
    assert ask(device, mid) == (mid + 1, value)
    assert ask(device, 0x0E) == (0x0F, b"")
    assert ask(device, mid) == (mid + 1, before)


def test_a_600_series_has_one_baud_rate() -> None:
    device = in_config()
    ask(device, 0x18, b"\x0a")
    assert ask(device, 0x8C)[1][:4] == bytes.fromhex("0001000A")
    ask(device, 0x8C, bytes.fromhex("0001000C0001000200000000"))
    assert ask(device, 0x18) == (0x19, b"\x0c")


def test_option_flags_are_set_and_cleared() -> None:
    device = in_config()
    ask(device, 0x48, struct.pack(">II", 0xC0, 0))
    ask(device, 0x48, struct.pack(">II", 0, 0x40))
    assert ask(device, 0x48) == (0x49, struct.pack(">I", 0x80))


def test_a_no_rotation_update_shows_in_the_status_word() -> None:
    """Begun at a stop it runs until the vehicle turns, and then says so until the next one."""
    device = XbusDevice(measuring=True)
    device.advance(35 * S)
    data = device.receive(frames.build(0x22, b"\x00\x0a"), 35 * S) + run(device, 20, begin=35)
    status = column(decode(data), "StatusWord").astype(np.int64) >> 3 & 3
    assert status[100] == 3
    assert status[-1] == 2
    assert (np.diff(status[2:]) <= 0).all()


def test_utc_is_set_adjusted_and_sent() -> None:
    device = in_config()
    assert ask(device, 0x60)[1][-1] == 0
    ask(device, 0x60, struct.pack(">IH6B", 250_000_000, 2020, 6, 11, 19, 20, 18, 7), now=2 * S)
    ask(device, 0xA8, struct.pack(">i", -5000), now=2 * S)
    assert struct.unpack(">IH6B", ask(device, 0x60, now=3 * S)[1]) == (750_000_000, 2020, 6, 11, 19, 20, 18, 7)


def test_sync_settings_mark_samples() -> None:
    device = in_config()
    pulse = bytes([4, 7, 1, 0, 0, 0, 0, 4, 0, 5, 0, 0])
    trigger = bytes([3, 2, 1, 0]) + bytes(8)
    assert ask(device, 0x2C, pulse + trigger) == (0x2D, b"")
    assert ask(device, 0x2C) == (0x2D, pulse + trigger)
    ask(device, 0x10)
    status = column(decode(run(device, 5, begin=2)), "StatusWord").astype(np.int64)
    assert (status >> 22 & 1).sum() == pytest.approx(100, abs=2)
    assert (status >> 21 & 1).sum() == pytest.approx(5, abs=1)
    device.receive(frames.build(0x30), 8 * S)
    assert ask(device, 0x2C, bytes(12), now=8 * S) == (0x2D, b"")
    assert ask(device, 0x2C, now=8 * S) == (0x2D, b"")


@given(st.binary(max_size=60) | st.builds(frames.build, st.integers(0, 255), st.binary(max_size=40)), st.booleans())
def test_whatever_it_hears_it_goes_on(data: bytes, config: bool) -> None:
    device = XbusDevice(measuring=True)
    device.advance(S // 10)
    if config:
        device.receive(frames.build(0x30), S // 10)
    replies(device.receive(data, S // 10))
    device.advance(S)
    answer = device.receive(frames.build(0x30), 2 * S)
    assert answer.endswith(bytes.fromhex("FAFF3100D0")) or device.phase in ("boot", "wake-up", "measurement")


def test_a_request_in_pieces_between_noise_is_heard() -> None:
    device = in_config()
    data = b"\x00\xfa\xff" + frames.build(0x1E) + b"\xfa"
    answers = b"".join(device.receive(data[at : at + 1], 2 * S + at) for at in range(len(data)))
    assert [number for number, _ in replies(answers)] == [0x1F]


def test_an_unknown_product_is_our_callers_mistake() -> None:
    with pytest.raises(ValueError, match="MTi-630"):
        XbusDevice("MTi-9000")
