"""Time across fix and restart, parts of sets, embedded messages between packets, and named events."""

import datetime
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, Text
from imuscope.protocols.framing.checksums import crc24q, fletcher16
from imuscope.protocols.isb import frames
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.isb.frames import build
from imuscope.protocols.isb.inspect import detection_score
from imuscope.protocols.isb.time_base import leap_seconds, store_offset, update_time, utc_ns
from tests.oracles.foreign import rtcm as rtcm_message
from tests.oracles.foreign import ubx as ubx_message
from tests.protocols.decoding import decode_chunks
from tests.support.each_row import each_row

S = 1_000_000_000
WEEK = 2392  # 2025-11-09
MIDNIGHT = int(datetime.datetime(2025, 11, 9, tzinfo=datetime.UTC).timestamp())


def imu(up: float) -> bytes:
    return build(frames.DATA, 58, struct.pack("<dI6f", up, 0, *range(6)))


def ins(week: int, tow: float, roll: float = 0.0) -> bytes:
    return build(frames.DATA, 4, struct.pack("<IdII6f3d3f", week, tow, 0, 0, roll, *[0.0] * 11))


def velocity(tow_ms: int) -> bytes:
    return build(frames.DATA, 30, struct.pack("<I4fI", tow_ms, 1, 2, 3, 0, 0))


def position(week: int, tow_ms: int, tow_offset: float = 0.0) -> bytes:
    return build(frames.DATA, 13, struct.pack("<III6d5fd4B", week, tow_ms, 0, *[0.0] * 11, tow_offset, 18, 0, 0, 0))


def decode(*chunks: bytes) -> list[Event]:
    return decode_chunks(IsbDecoder(), enumerate(chunks))


def times(events: list[Event], name: str) -> list[float | None]:
    out: list[float | None] = []
    for event in events:
        if isinstance(event, Batch) and event.message.name == name:
            out += [None] * len(event) if event.time_ns is None else (event.time_ns / S).tolist()
    return out


# -- time --------------------------------------------------------------------------------------------------------------


def test_leap_seconds() -> None:
    assert leap_seconds(int(datetime.datetime(2016, 12, 31, tzinfo=datetime.UTC).timestamp())) == 17
    assert leap_seconds(int(datetime.datetime(2017, 1, 1, tzinfo=datetime.UTC).timestamp())) == 18
    assert utc_ns(WEEK, 18 * S) == MIDNIGHT * S


def test_up_time_alone() -> None:
    assert times(decode(imu(10), imu(10.5)), "DID_IMU") == [10, 10.5]


@each_row("split", [True, False])
def test_first_fix_is_a_step_and_nothing_is_in_1980(split: bool) -> None:
    parts = [ins(0, 5.0), imu(5.001), velocity(5002), position(0, 5003), ins(WEEK, 18.0), imu(5.011), velocity(18_020)]
    events = decode(*parts) if split else decode(b"".join(parts))
    assert times(events, "DID_INS_1") == [5.0, MIDNIGHT]
    assert times(events, "DID_GPS1_VEL") == [5.002, MIDNIGHT + 0.02]
    assert times(events, "DID_GPS1_POS") == [5.003]
    assert times(events, "DID_IMU") == pytest.approx([5.001, MIDNIGHT + 0.01])
    (step,) = (event for event in events if isinstance(event, ClockStep))
    assert step.kind == "sync"
    assert step.by_ns == pytest.approx((MIDNIGHT - 5.001) * S, abs=1000)


def test_position_gives_the_exact_shift() -> None:
    events = decode(imu(100.0), position(WEEK, 18_000 + 100, 0.0), imu(100.2), position(WEEK, 18_300, -1.0))
    assert times(events, "DID_IMU")[-1] == pytest.approx(MIDNIGHT + 0.3)
    up, tow = 1000.0, 300_000.0  # up-time + offset = time of week
    parts = [imu(up), position(WEEK, int(tow * 1e3) + 60, tow - up), imu(up + 1)]
    assert times(decode(*parts), "DID_IMU")[-1] == pytest.approx(MIDNIGHT - 18 + tow + 1, abs=1e-6)


@each_row("lost", [(), (2,), (4,)])
def test_rows_before_the_first_fix_are_shifted_exactly(lost: tuple[int, ...]) -> None:
    """A data set that is alone on its line gets its first date one period after its last up-time, also after lost
    packets.
    """
    ups = [place / 100 for place in range(500, 506)]
    dated = [18 + 0.01 * place for place in range(6)]
    before = [ins(0, up) for place, up in enumerate(ups) if place not in lost]
    events = decode(*before, *(ins(WEEK, tow) for tow in dated))
    (step,) = (event for event in events if isinstance(event, ClockStep))
    assert step.by_ns == pytest.approx((MIDNIGHT - 5.06) * S, abs=1000)


def test_up_time_after_the_first_fix_is_exact_before_a_position_arrives() -> None:
    """DID_IMU after DID_INS_1 in each cycle: when the fix appears, the newest up-time is that of the cycle before."""
    turns = [part for up in (4.98, 4.99, 5.0) for part in (ins(0, up), imu(up + 0.0001))]
    events = decode(*turns, ins(WEEK, 18.0), imu(5.0101), ins(WEEK, 18.01), imu(5.0201))
    assert times(events, "DID_IMU")[-2:] == pytest.approx([MIDNIGHT + 0.0001, MIDNIGHT + 0.0101], abs=1e-6)


def test_a_position_with_the_first_fix_shifts_earlier_rows_exactly() -> None:
    """A GNSS solution is old when it is sent; its offset gives the difference of the clocks."""
    parts = [imu(100.0), imu(100.01), position(WEEK, 299_930, 300.0 - 100.01), imu(100.02)]
    (step,) = (event for event in decode(*parts) if isinstance(event, ClockStep))
    assert step.by_ns == pytest.approx((MIDNIGHT - 18 + 300 - 100.01) * S, abs=1000)


def test_time_of_week_without_a_week_has_no_time_and_follows_the_week_over_its_end() -> None:
    assert times(decode(velocity(1000)), "DID_GPS1_VEL") == [None]
    events = decode(ins(WEEK, 604_799.9), velocity(100), ins(WEEK + 1, 0.2), velocity(604_799_950))
    late = MIDNIGHT - 18 + 604_800
    assert times(events, "DID_GPS1_VEL") == pytest.approx([late + 0.1, late - 0.05])
    assert not [event for event in events if isinstance(event, ClockStep)]


def test_restart() -> None:
    events = decode(imu(500), ins(WEEK, 1000.0), imu(500.1), imu(0.5), ins(0, 0.6))
    assert times(events, "DID_IMU")[-1] == 0.5
    assert times(events, "DID_INS_1")[-1] == pytest.approx(0.6)
    assert [event.kind for event in events if isinstance(event, ClockStep)] == ["sync", "reset"]


def baro(up: float) -> bytes:
    return build(frames.DATA, 53, struct.pack("<d4f", up, *range(4)))


@each_row("split", [True, False])
def test_a_restart_in_the_first_seconds_is_detected(split: bool) -> None:
    """It was taken for late data, and drawn over the seconds before it until the next fix."""
    parts = [imu(5.0), baro(5.9), ins(0, 6.0), imu(6.0), imu(0.3), baro(0.4), ins(0, 0.4), imu(0.5)]
    events = decode(*parts) if split else decode(b"".join(parts))
    assert times(events, "DID_IMU") == [5.0, 6.0, 0.3, 0.5]
    assert times(events, "DID_BAROMETER") == [5.9, 0.4]
    assert times(events, "DID_INS_1") == [6.0, 0.4]
    (step,) = (event for event in events if isinstance(event, ClockStep))
    assert (step.kind, step.by_ns) == ("reset", pytest.approx(-5.7 * S))
    assert step.offset == sum(len(part) for part in parts[:4])


def test_a_restart_soon_after_an_early_fix_is_detected_and_nothing_is_in_1980() -> None:
    """Regression: up-time was shifted by the value before the restart, seconds before the last shown sample."""
    parts = [imu(4.0), ins(WEEK, 18.0), imu(4.1), imu(0.2), ins(0, 0.25), imu(0.3), ins(WEEK, 25.0), imu(0.4)]
    events = decode(*parts)
    assert times(events, "DID_IMU") == pytest.approx([4.0, MIDNIGHT + 0.1, 0.2, 0.3, MIDNIGHT + 7.1])
    assert times(events, "DID_INS_1") == pytest.approx([MIDNIGHT, 0.25, MIDNIGHT + 7])
    assert [event.kind for event in events if isinstance(event, ClockStep)] == ["sync", "reset", "sync"]
    # a set that loses the date reports it too, without any other clock
    events = decode(ins(0, 3.0), ins(WEEK, 18.0), ins(0, 2.5))
    assert times(events, "DID_INS_1") == pytest.approx([3.0, MIDNIGHT, 2.5])
    assert [event.kind for event in events if isinstance(event, ClockStep)] == ["sync", "reset"]


def test_sets_interleaved_by_a_logger_are_no_restart() -> None:
    up = [0.5, 1.5, 2.5, 3.5]
    parts = [*map(imu, up), *map(baro, up), *(imu(4 + t) for t in up), *(baro(4 + t) for t in up), ins(0, 1.0)]
    events = decode(*parts)
    assert times(events, "DID_BAROMETER") == [*up, *(4 + t for t in up)]
    assert times(events, "DID_INS_1") == [1.0]
    assert not [event for event in events if isinstance(event, ClockStep)]


def test_a_set_with_swapped_rows_is_not_a_restart() -> None:
    events = decode(imu(1.0), imu(1.2), imu(0.9), imu(1.3))
    assert times(events, "DID_IMU") == [1.0, 1.2, 0.9, 1.3]
    assert not [event for event in events if isinstance(event, ClockStep)]


def test_a_second_receiver_without_fix_disturbs_nothing() -> None:
    second = bytearray(position(0, 0))
    second = bytearray(build(frames.DATA, 14, bytes(second[6:-2])))
    events = decode(imu(500), ins(WEEK, 1000.0), bytes(second), imu(500.1), bytes(second))
    assert times(events, "DID_GPS2_POS") == [None, None]
    assert len([event for event in events if isinstance(event, ClockStep)]) == 1


@each_row("clock", [float("nan"), float("inf"), -1.0, 1e300, 5e-324])
def test_invalid_clocks(clock: float) -> None:
    expected = 0.0 if clock == 5e-324 else None
    assert times(decode(imu(clock)), "DID_IMU") == [expected]
    assert times(decode(ins(WEEK, clock)), "DID_INS_1") == ([MIDNIGHT - 18] if clock == 5e-324 else [None])
    assert times(decode(ins(5, 100.0)), "DID_INS_1") == [None]  # a week of 1980


def test_update_time_is_pure() -> None:
    state = store_offset()
    (known, *message), again = update_time(state, 1, 5 * S, -1), update_time(state, 1, 5 * S, -1)
    assert message == [5 * S, 1, 0, 0]
    assert again[0] == known != state


# -- parts -------------------------------------------------------------------------------------------------------------


def theta(values: tuple[float, float, float]) -> bytes:
    return build(frames.DATA, 4, struct.pack("<3f", *values), offset=20)


@each_row("split", [True, False])
def test_parts_merge_into_the_last_value(split: bool) -> None:
    parts = [
        theta((9, 9, 9)),
        ins(WEEK, 18.0, 1.0),
        theta((2, 0, 0)),
        theta((3, 0, 0)),
        ins(WEEK, 19.0),
        theta((4, 0, 0)),
    ]
    events = decode(*parts) if split else decode(b"".join(parts))
    batches = [event for event in events if isinstance(event, Batch)]
    alone = next(batch for batch in batches if "week" not in batch.columns)
    assert (len(alone), alone.time_ns) == (1, None)
    rows = [
        (int(o), float(b.columns["theta"][i][0]), int(b.columns["week"][i]))
        for b in batches if "week" in b.columns
        for i, o in enumerate(b.offset.tolist())
    ]  # fmt: skip
    assert [(round(roll, 6), week) for _, roll, week in sorted(rows)] == [(r, WEEK) for r in (1, 2, 3, 0, 4)]
    timed = {int(o) for b in batches if b.time_ns is not None for o in b.offset.tolist()}
    starts = [sum(map(len, parts[:i])) for i in range(len(parts))]
    assert timed == {starts[1], starts[4]}  # a part has none: the clock in its row is the last value's


def test_a_stream_of_parts_advances_its_time() -> None:
    """Regression: if only a part of the set was requested, all rows had the time of an old value."""
    events = decode(ins(WEEK, 18.0), *(theta((i, 0, 0)) for i in range(5)))
    assert times(events, "DID_INS_1") == [MIDNIGHT, *[None] * 5]


def test_parts_of_configuration_merge_too() -> None:
    whole = build(frames.DATA, 12, bytes(288))
    part = build(frames.DATA, 12, (16).to_bytes(4, "little"), offset=16)
    replies = [event for event in decode(whole, part) if isinstance(event, Reply)]
    assert [reply.values["startupNavDtMs"] for reply in replies] == [0, 16]
    assert len(replies[1].values) == len(replies[0].values) > 40


# -- others in the stream ----------------------------------------------------------------------------------------------


def test_check_values() -> None:
    digits = np.frombuffer(b"123456789", np.uint8)
    assert crc24q(digits, 0, 9) == 0xCDE703
    assert fletcher16(np.frombuffer(bytes.fromhex("ef4908000000"), np.uint8), 0, 6) == 0x2740


@given(st.binary(max_size=300), st.integers(1, 300), st.integers(0, 9))
def test_the_checksum_of_long_data_is_that_of_its_definition(data: bytes, times: int, start: int) -> None:
    whole = data * times
    sums = fletcher16(np.frombuffer(whole, np.uint8), min(start, len(whole)), len(whole))
    assert sums == frames.fletcher16_of(whole[start:])


def test_foreign_messages_are_named() -> None:
    stream = imu(1) + ubx_message(1, 7, bytes(92)) + rtcm_message(1077, bytes(18)) + b"$HCHDM,123.45,M*18\r\n" + imu(2)
    events = decode(stream)
    texts = [(event.protocol, event.name) for event in events if isinstance(event, Text)]
    assert texts == [("ubx", "NAV-PVT"), ("rtcm3", "1077"), ("nmea", "HCHDM")]
    assert times(events, "DID_IMU") == [1, 2]
    assert not [event for event in events if isinstance(event, RejectedFrame)]


@each_row("false_start", [b"\xb5\x62\x01\x07\xff\x1f", b"\xb5\x62\x01\x07\xff\xff", b"\xd3\x03\xff", b"$GPGGA,"])
def test_a_false_length_costs_no_packet(false_start: bytes) -> None:
    decoder = IsbDecoder()
    decoder.feed(imu(1) + false_start + imu(2), 0)
    events = decoder.drain()
    assert times(events, "DID_IMU") == [1, 2]
    decoder.feed(imu(3), 1)
    assert times(decoder.drain(), "DID_IMU") == [3]


def test_packets_inside_a_failed_candidate_survive() -> None:
    data = bytearray(imu(1))
    data[4:6] = (1000).to_bytes(2, "little")
    assert times(decode(bytes(data) + imu(2) * 30), "DID_IMU") == [2.0] * 30


# -- likeness ----------------------------------------------------------------------------------------------------------


def test_detection_scores() -> None:
    score, words = detection_score(imu(1) * 3 + ins(0, 1))
    assert score == 1
    assert "4 ISB packets (DID_IMU, DID_INS_1)" in words
    assert detection_score(bytes(1000))[0] == 0
    assert 0 < detection_score(b"$HCHDM,123.45,M*18\r\n")[0] <= 0.5


def test_protocol_1_is_reported_by_name() -> None:
    body = bytes([4, 0, 5, 0, 0, 0, 80, 0, 0, 0, 0, 0, 0, 0]) + b"\xfd\x00" + bytes(70)
    score, words = detection_score((b"\xff" + body + b"\xfe") * 5)
    assert score < 0.5
    assert "protocol 1.x" in words


@each_row("bits", ["0000a07f", "ffff7f7f", "0000807f", "0000c0ff"])  # NaN that signals, largest, inf, NaN
def test_any_float_is_a_value(bits: str) -> None:
    """Scaled columns of floats that are not finite raise no warning (warnings are errors here)."""
    events = decode(build(frames.DATA, 58, bytes(12) + bytes.fromhex(bits) * 6))
    (batch,) = (event for event in events if isinstance(event, Batch))
    assert batch.columns["I.pqr"].shape == (1, 3)
    assert batch.columns["I.acc"].shape == (1, 3)


def test_a_part_of_a_list_alone() -> None:
    """Found by random streams: the count of a list is in another part."""
    (batch,) = decode(build(frames.DATA, 45, bytes(range(250)) * 2, offset=100))
    assert isinstance(batch, Batch)
    assert batch.columns["sig"].shape == (1, 70)
