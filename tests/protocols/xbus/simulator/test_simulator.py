"""The simulated MTi behaves as an MTi. Everything it sends is read back by the decoder, everything it is told
is answered as sections 4 and 5 of MT0101P 2020.A have it, and what it measures is the drive.
"""

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols import rotations
from imuscope.protocols.events import ClockStep, RejectedFrame, Reply, SampleGap, batches
from imuscope.protocols.simulator import trajectory
from imuscope.protocols.xbus.data_identifiers import item
from imuscope.protocols.xbus.output_configuration import ALWAYS, OUTPUTS, accepted_rates, max_rate, output_of
from imuscope.protocols.xbus.simulator.device import WAKE_UP_WINDOW_NS, XbusSimulator
from imuscope.protocols.xbus.simulator.settings import PRODUCTS
from tests.protocols.decoding import column
from tests.protocols.xbus.xbus_simulation import S, decode, in_config, replies, reply_to, run
from tests.support.each_row import each_row
from tests.support.faulty_line import FaultyLine

# -- what it sends -----------------------------------------------------------------------------------------------------


@each_row("product", PRODUCTS)
def test_every_product_sends_its_configuration(product: str) -> None:
    device = XbusSimulator(product)
    events = decode(run(device, 4.5))
    assert not [event for event in events if isinstance(event, RejectedFrame | SampleGap | ClockStep)]
    assert [event.message.name for event in events if isinstance(event, Reply)] == ["WakeUp", "Configuration"]
    for identifier, rate in device.output:
        name = OUTPUTS[identifier & 0xFFF0].name
        if rate != ALWAYS:
            assert abs(len(column(events, name)) - 4 * rate) <= 1, name
    assert (np.diff(column(events, "PacketCounter").astype(np.int64)) == 1).all()


@each_row("identifier", [i | p | c for i in OUTPUTS for p in range(4) for c in (0, 4, 8)])
def test_every_item_in_every_form_is_what_the_decoder_expects(identifier: int) -> None:
    device = in_config("MTi-680G" if 680 in OUTPUTS[identifier & 0xFFF0].products else "MTi-G-710", seed=3)
    output = output_of(identifier, device.product.model)
    if output is None:
        assert reply_to(device, 0xC0, struct.pack(">HH", identifier, 10)) == (0x42, b"\x21")
        return
    rate = max_rate(output, device.product.model)
    wish = struct.pack(">HHHH", 0x1060, ALWAYS, identifier, 0)
    assert reply_to(device, 0xC0, wish) == (0xC1, struct.pack(">HHHH", 0x1060, ALWAYS, identifier, rate))
    assert reply_to(device, 0x10) == (0x11, b"")
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
    assert reply_to(device, 0xC0, wish)[1] == wish
    reply_to(device, 0x10)
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


@each_row(("wish", "rate"), [(0, 400), (0xFFFF, 400), (1000, 400), (400, 400), (399, 200), (150, 100), (3, 2)])
def test_a_requested_rate_becomes_one_that_divides(wish: int, rate: int) -> None:
    assert accepted_rates(wish, 400) == rate


def test_readings_follow_the_trajectory() -> None:
    """Within the errors of a good sensor: the simulator adds noise and bias, no more."""
    events = decode(run(XbusSimulator(seed=2, rate=400), 60))
    times = column(events, "SampleTimeFine") * 1e-4
    truth = trajectory.vehicle_motion(times)
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
    reply_to(device, 0xC0, struct.pack(">HH", identifier, 100))
    reply_to(device, 0x10)
    return rotations.matrix_of(column(decode(run(device, 1, begin=2)), "Quaternion"))


def test_the_pothole_clips_and_sets_the_flag() -> None:
    events = decode(run(XbusSimulator(rate=400), 54, tick_ns=S // 20))
    status, force = column(events, "StatusWord").astype(np.int64), column(events, "Acceleration")
    clipped = (status >> 10 & 1) == 1
    assert 1 <= clipped.sum() < 40
    assert (np.abs(force[clipped][:, 2]) > 98).all()
    assert ((status >> 19 & 1) == clipped).all()
    assert ((status >> 1 & 1) == ~clipped).all()  # the filter's input is not complete then


def test_satellites_come_late_with_an_older_time() -> None:
    device = XbusSimulator("MTi-680G")
    events = decode(run(device, 20))
    pvt = column(events, "GnssPvtData")
    assert (pvt["fixtype"][:8] == 0).all()
    assert (pvt["fixtype"][-8:] == 3).all()
    assert pvt["year"][-1] == 2026
    ticks = column(events, "SampleTimeFine").astype(np.int64)
    fixed = np.diff(ticks)[500:]
    assert set(fixed.tolist()) == {100, -800, 0, 900}  # back by 80 ms, satellites as well, and on
    assert (fixed == -800).sum() == pytest.approx(4 * 15, abs=4)
    assert not set(np.diff(ticks)[:300].tolist()) <= {100, -800, 0, 900}  # without a fix their clock is arbitrary
    rtk = column(events, "StatusWord").astype(np.int64) >> 27 & 3
    assert sorted(set(rtk.tolist())) == [0, 1, 2]
    place = column(events, "LatLon")
    assert np.abs(place - [45, 0]).max() < 0.01


def test_time_wraps_after_a_day_in_the_older_series() -> None:
    device = XbusSimulator("MTi-30", measuring=True, clock_jump=(1.0, 86_398.0))
    ticks = column(decode(run(device, 3)), "SampleTimeFine").astype(np.int64)
    assert ticks.max() < 864_000_000
    assert (np.diff(ticks) == 100).sum() >= len(ticks) - 3


# -- time and faults ---------------------------------------------------------------------------------------------------


@given(st.lists(st.integers(0, 120_000_000), max_size=30))
def test_output_does_not_depend_on_time_steps(cuts: list[int]) -> None:
    whole, cut = XbusSimulator(seed=9), XbusSimulator(seed=9)
    now, parts = 0, b""
    for step in cuts:
        now += step
        parts += cut.advance(now)
    assert parts + cut.advance(2 * S) == whole.advance(2 * S)


def test_samples_are_sent_once_and_in_order() -> None:
    device = XbusSimulator()
    assert len(device.advance(2 * S)) > 10_000
    assert device.advance(2 * S) == device.advance(1 * S) == b""


def test_drift_is_in_the_rate_and_in_the_time() -> None:
    device = XbusSimulator(clock_drift_ppm=1000)
    device.advance(1 * S)
    ticks = column(decode(device.advance(101 * S)), "SampleTimeFine").astype(np.int64)
    assert abs(len(ticks) - 10_010) <= 1
    assert ticks[-1] >= 1_010_900


def test_a_jump_of_the_clock_is_a_step() -> None:
    events = decode(run(XbusSimulator(clock_jump=(2.0, 300.0)), 4))
    assert [(event.kind, event.by_ns) for event in events if isinstance(event, ClockStep)] == [("jump", 300 * S)]


def test_faults_are_counted_by_the_decoder_as_made() -> None:
    clean, worn = XbusSimulator(seed=4), FaultyLine("xbus", XbusSimulator(seed=4), drop=0.02, corrupt=0.02)
    good, events = decode(run(clean, 60)), decode(run(worn, 60))
    sent = len(column(good, "PacketCounter"))
    lost = sum(event.missing for event in events if isinstance(event, SampleGap))
    assert len(column(events, "PacketCounter")) + lost == sent
    assert 0.03 * sent < lost < 0.05 * sent
    assert [event for event in events if isinstance(event, RejectedFrame)]


# -- states ------------------------------------------------------------------------------------------------------------


def test_power_up_without_a_request_leads_to_measurement() -> None:
    device = XbusSimulator(start_ns=5 * S)
    assert device.advance(5 * S - 1) == b""
    assert device.advance(5 * S).hex() == "faff3e00c3"
    assert device.advance(5 * S + WAKE_UP_WINDOW_NS - 1) == b""
    assert replies(device.advance(6 * S))[0][0] == 0x0D
    assert device.phase == "measurement"


def test_a_wake_up_ack_leads_to_config() -> None:
    device = XbusSimulator()
    device.advance(0)
    assert device.receive(bytes.fromhex("FAFF3F00C2"), 400_000_000) == b""
    assert device.phase == "config"
    assert device.advance(5 * S) == b""


def test_config_and_back() -> None:
    device = XbusSimulator()
    run(device, 1)
    data = device.receive(bytes.fromhex("FAFF3000D1"), 1_500_000_000)
    assert data.endswith(bytes.fromhex("FAFF3100D0"))
    assert len(column(decode(data), "PacketCounter")) == 50  # due messages are sent first
    assert device.advance(9 * S) == b""
    assert device.receive(bytes.fromhex("FAFF3000D1"), 9 * S).hex() == "faff3100d0"
    assert device.receive(bytes.fromhex("FAFF1000F1"), 9 * S).hex() == "faff1100f0"
    assert len(device.advance(10 * S)) > 5000


def test_reset_restarts_and_applies_the_new_baud_rate() -> None:
    device = in_config()
    assert reply_to(device, 0x18) == (0x19, b"\x02")
    assert reply_to(device, 0x18, b"\x80") == (0x19, b"")
    assert (device.baud, reply_to(device, 0x18)) == (115_200, (0x19, b"\x80"))
    assert reply_to(device, 0x40) == (0x41, b"")
    assert device.baud == 115_200  # while it boots, for the restore procedure
    assert device.advance(2 * S + 200_000_000) == b""
    assert device.receive(bytes.fromhex("FAFF3000D1"), 2 * S + 200_000_000) == b""  # no host is connected yet
    events = decode(run(device, 2, begin=2.25))
    assert device.baud == 921_600
    assert [event.message.name for event in events if isinstance(event, Reply)] == ["WakeUp", "Configuration"]
    assert column(events, "SampleTimeFine")[0] == 5000
    assert column(events, "PacketCounter")[0] == 0
