"""The simulated IMX-5 behaves as an IMX-5. Everything it sends is read back by the decoder and is the shared
drive; everything it is told is answered as ISComm answers.
"""

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imuscope.protocols import rotations
from imuscope.protocols.events import ClockStep, Event, RejectedFrame, Reply, batches
from imuscope.protocols.isb import frames
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.isb.messages import ROWS
from imuscope.protocols.isb.simulator.device import BOOT_NS, IsbSimulator
from imuscope.protocols.isb.simulator.signals import FIRST_FIX_NS, SKY, SOURCES, UTC_2026_S
from imuscope.protocols.simulator import trajectory
from tests.protocols.decoding import column, decode_chunks, run
from tests.support.each_row import each_row
from tests.support.faulty_line import FaultyLine

S = 10**9


def decode(data: bytes) -> list[Event]:
    return decode_chunks(IsbDecoder(), [(0, data)])


def replies(data: bytes) -> list[Reply]:
    return [event for event in decode(data) if isinstance(event, Reply)]


def replies_to(device: IsbSimulator, packet: bytes, now: int = 2 * S) -> list[Reply]:
    """The answers to one packet, without the streams around them."""
    device.advance(now)
    return replies(device.receive(packet, now))


def awake(**options: Any) -> IsbSimulator:
    device = IsbSimulator(**options)
    device.advance(2 * S)
    return device


# -- what it sends -----------------------------------------------------------------------------------------------------


def test_everything_is_read_and_the_identity_comes_first() -> None:
    events = decode(run(IsbSimulator(serial=62_123, vibration=1.0), 12))
    assert not [event for event in events if isinstance(event, RejectedFrame)]
    [info] = [event for event in events if isinstance(event, Reply)]
    assert events[0] is info
    assert (info.values["serialNumber"], info.values["hardwareType"]) == (62_123, 3)
    assert (info.values["hardwareVer"], info.values["manufacturer"]) == ([5, 0, 4, 0], "Inertial Sense Inc")
    rates = {58: 100, 4: 100, 5: 50, 52: 50, 53: 50, 13: 5, 30: 5, 15: 1}
    seconds = 12 - BOOT_NS / S
    for did, rate in rates.items():
        count = sum(len(batch) for batch in batches(events) if batch.message.id == did)
        assert abs(count - rate * seconds) <= 1, ROWS[did].name


def test_readings_follow_the_trajectory_in_a_body_frame_with_z_down() -> None:
    events = decode(run(IsbSimulator(), 40))
    time = column(events, "time", 58)
    truth = trajectory.vehicle_motion(time)
    flip = np.array([1, -1, -1])
    assert np.abs(column(events, "I.acc", 58) - truth.force * flip).std(axis=0).max() < 0.02
    assert np.abs(column(events, "I.pqr", 58) - truth.rate * flip).max() < 0.01
    field = trajectory.vehicle_motion(column(events, "time", 52)).field * flip
    assert np.abs(column(events, "mag", 52) - field).max() < 0.01
    pressure = trajectory.pressure(trajectory.vehicle_motion(column(events, "time", 53)).position[:, 2] + 13.0)
    assert np.abs(column(events, "bar", 53) * 1e3 - pressure).max() < 40


def test_attitude_position_and_velocity_follow_the_trajectory_in_ned() -> None:
    events = decode(run(IsbSimulator(), 30))
    fixed = column(events, "week", 4) > 0
    tow_at_power_on = float((UTC_2026_S + 18 - 315_964_800) % 604_800)
    up = (column(events, "timeOfWeek", 4) - tow_at_power_on)[fixed]
    truth = trajectory.vehicle_motion(up)
    theta, ned = column(events, "theta", 4)[fixed], column(events, "ned", 4)[fixed]
    heading = np.pi / 2 - truth.euler[:, 2]  # yaw of the drive counts from east, anticlockwise
    assert np.abs((theta[:, 2] - heading + np.pi) % (2 * np.pi) - np.pi).max() < 0.02
    assert np.abs(theta[:, 0] - truth.euler[:, 0]).max() < 0.02  # left side up is right side down
    assert np.abs(theta[:, 1] + truth.euler[:, 1]).max() < 0.02  # nose up is positive
    assert np.abs(ned - truth.position[:, [1, 0, 2]] * [1, 1, -1]).max() < 4
    assert np.abs(column(events, "lla", 4)[fixed] - trajectory.geodetic(truth.position)).max(axis=0)[2] < 4
    speed = np.linalg.norm(truth.velocity, axis=1)
    assert np.abs(column(events, "uvw", 4)[fixed][:, 0] - speed).max() < 0.3
    velocity = column(events, "vel", 30)
    assert np.linalg.norm(velocity, axis=1).max() == pytest.approx(speed.max(), rel=0.1)


def test_quaternion_and_angles_are_the_same_attitude() -> None:
    events = decode(run(IsbSimulator(rate=50), 20))
    q = column(events, "qn2b", 5)
    assert np.abs(np.linalg.norm(q, axis=1) - 1).max() < 1e-6
    assert np.abs(rotations.euler_of(q) - column(events, "theta", 4)).max() < 2e-5


def test_the_first_fix_is_one_step_and_nothing_is_in_1980() -> None:
    events = decode(run(IsbSimulator(), 10))
    [step] = [event for event in events if isinstance(event, ClockStep)]
    assert step.kind == "sync"
    weeks = column(events, "week", 4)
    assert set(weeks.tolist()) == {0, (UTC_2026_S + 18 - 315_964_800) // 604_800}
    for batch in batches(events):
        if batch.time_ns is not None:
            since = batch.time_ns - UTC_2026_S * S
            assert ((batch.time_ns < FIRST_FIX_NS + S) | ((since > 0) & (since <= 10 * S))).all(), batch.message.name


def test_status_goes_from_aligning_to_navigation() -> None:
    events = decode(run(IsbSimulator(), 12))
    solution = column(events, "insStatus", 4) >> 16 & 0xF
    assert (solution[0], solution[-1]) == (1, 3)
    assert (np.diff(solution.astype(int)) != 0).sum() == 1
    fix = column(events, "status", 13) >> 8 & 0x1F
    assert (fix[0], fix[-1]) == (0, 3)
    [*_, satellites] = [batch for batch in batches(events) if batch.message.id == 15]
    assert satellites.columns["sat"].shape[1] == len(SKY)


def test_noise_does_not_depend_on_time_steps() -> None:
    one = run(IsbSimulator(seed=3, vibration=1.0), 3, tick_ns=10_000_000)
    assert run(IsbSimulator(seed=3, vibration=1.0), 3, tick_ns=1_000_000) == one
    assert run(IsbSimulator(seed=3, vibration=1.0), 3, tick_ns=3 * S) == one
    assert run(IsbSimulator(seed=4, vibration=1.0), 3) != one


def test_faults() -> None:
    clean = IsbSimulator(seed=1)
    events = decode(run(FaultyLine("isb", IsbSimulator(seed=1), drop=0.1, corrupt=0.1), 10))
    assert [event for event in events if isinstance(event, RejectedFrame)]
    count = sum(len(batch) for batch in batches(events))
    assert 0.7 < count / sum(len(batch) for batch in batches(decode(run(clean, 10)))) < 0.9
    jumped = decode(run(IsbSimulator(clock_jump=(2.0, 5.0)), 3))
    assert np.diff(column(jumped, "time", 58)).max() == pytest.approx(5.01)
    fast = decode(run(IsbSimulator(clock_drift_ppm=10_000), 10))
    assert len(column(fast, "time", 58)) == pytest.approx(980, abs=2)


def test_a_clock_jump_is_permanent_and_a_restarted_device_keeps_the_date() -> None:
    decoder = IsbDecoder()
    decoder.feed(run(IsbSimulator(clock_jump=(8.0, 10.0)), 12), 0)
    assert [event.kind for event in decoder.drain() if isinstance(event, ClockStep)] == ["sync"]
    decoder.feed(run(IsbSimulator(start_ns=40 * S), 8, begin=40), 0)
    events = decoder.drain()
    assert [event.kind for event in events if isinstance(event, ClockStep)] == ["reset", "sync"]
    last = max(int(batch.time_ns[-1]) for batch in batches(events) if batch.time_ns is not None)
    assert last == UTC_2026_S * S + 48 * S


# -- what it answers ---------------------------------------------------------------------------------------------------


def test_get_is_answered_by_data() -> None:
    device = awake()
    [info] = replies_to(device, frames.get_data(1, period=0))
    assert info.message.name == "DID_DEV_INFO"
    [flash] = replies_to(device, frames.get_data(12, period=0))
    assert flash.values["startupNavDtMs"] == 10
    [part] = replies_to(device, frames.get_data(12, size=8, offset=12, period=0))
    assert dict(part.values) == {"startupImuDtMs": 10, "startupNavDtMs": 10}
    [bits] = replies_to(device, frames.get_data(9, period=0))
    assert bits.values["bits"] == sum(1 << SOURCES[did].bit for did in device.streams)


@each_row("did", [0, 48, 80, 130, 255])
def test_get_of_a_missing_data_set_is_refused(did: int) -> None:
    [refused] = replies_to(awake(), frames.get_data(did, period=0))
    assert refused.message.name == "NACK"
    assert refused.values["body.dataHdr.id"] == did


def test_a_missing_part_is_refused() -> None:
    assert [one.message.name for one in replies_to(awake(), frames.get_data(12, size=600, offset=0, period=0))] == [
        "NACK"
    ]


def test_get_starts_and_ends_streams() -> None:
    device = awake()
    assert not replies_to(device, frames.get_data(3, period=4))
    events = decode(run(device, 4, begin=2.01))
    assert len(column(events, "time", 3)) == 100
    replies_to(device, frames.get_data(3, period=0), 6 * S + S // 2)
    assert not [batch for batch in batches(decode(run(device, 2, begin=6.51))) if batch.message.id == 3]


def test_stops() -> None:
    device = awake()
    device.receive(frames.build(frames.STOP_DID, 58), 2 * S)
    names = {batch.message.name for batch in batches(decode(run(device, 3, begin=2.01)))}
    assert "DID_IMU" not in names
    assert "DID_INS_1" in names
    [ack] = replies_to(device, frames.stop(), 6 * S)
    assert (ack.message.name, ack.values["pktInfo.flags"]) == ("ACK", frames.STOP_CURRENT_PORT)
    assert run(device, 3, begin=6.01) == b""


def test_rmc_chooses_streams_and_keeps_them() -> None:
    device = awake()
    bits = 1 << 5 | 1 << 7
    [ack] = replies_to(device, frames.set_data(9, struct.pack("<QI", bits, 1 << 9)))
    assert (ack.message.name, ack.values["body.dataHdr.id"], ack.values["body.dataHdr.size"]) == ("ACK", 9, 12)
    assert set(device.streams) == {3, 52}
    reset = frames.set_data(7, struct.pack("<II", 99, ~99 & 0xFFFFFFFF))
    assert replies_to(device, reset)[0].message.name == "ACK"
    events = decode(run(device, 3, begin=2.01))
    assert isinstance(events[0], Reply)
    assert {batch.message.name for batch in batches(events)} == {"DID_PIMU", "DID_MAGNETOMETER"}
    assert column(events, "time", 3)[0] < 0.4  # its time restarts


def test_flash_is_written_in_parts_and_periods_act_after_a_reset() -> None:
    device = awake()
    assert replies_to(device, frames.set_data(12, struct.pack("<I", 4), 16))[0].message.name == "ACK"
    [flash] = replies_to(device, frames.get_data(12, period=0))
    assert flash.values["startupNavDtMs"] == 4
    words = np.frombuffer(device.memory.flash, "<u4")
    assert words[1] == np.bitwise_xor.reduce(words[2:])
    device.receive(frames.set_data(7, struct.pack("<II", 99, ~99 & 0xFFFFFFFF)), 2 * S)
    events = decode(run(device, 3, begin=2.01))
    assert np.diff(column(events, "time", 58)).mean() == pytest.approx(0.004, abs=1e-6)


@each_row(
    "packet",
    [
        frames.set_data(1, bytes(4)),  # devices cannot be renamed
        frames.set_data(12, bytes(8), 284),  # beyond its end
        frames.set_data(7, struct.pack("<II", 99, 99)),  # without the inverse
        frames.set_data(200, bytes(4)),
    ],
)
def test_invalid_writes_are_refused(packet: bytes) -> None:
    assert [one.message.name for one in replies_to(awake(), packet)] == ["NACK"]


def test_it_ignores_input_before_it_has_started() -> None:
    device = IsbSimulator()
    assert device.receive(frames.get_data(1, period=0), 1000) == b""


@settings(max_examples=settings.default.max_examples // 3)  # each lets five seconds of it be sent
@given(st.lists(st.binary(max_size=60), max_size=10))
def test_any_input_leaves_it_running(chunks: list[bytes]) -> None:
    device = awake()
    for n, chunk in enumerate(chunks):
        assert not [event for event in decode(device.receive(chunk, 2 * S + n)) if isinstance(event, RejectedFrame)]
    answers = b"".join(device.receive(bytes([byte]), 5 * S) for byte in frames.get_data(1, period=0))
    assert "DID_DEV_INFO" in [one.message.name for one in replies(answers)]


def test_an_unknown_product() -> None:
    with pytest.raises(ValueError, match="IMX-5"):
        IsbSimulator("IMX-6")
