"""The simulated IDTP sensor: its output follows the trajectory, in every mode, with every fault."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from imuscope.protocols.events import Batch, ClockStep, RejectedFrame, SampleGap
from imuscope.protocols.idtp.decoder import IdtpDecoder
from imuscope.protocols.idtp.messages import MESSAGES
from imuscope.protocols.idtp.simulator import EARTH_UT, IdtpSimulator
from imuscope.protocols.simulator import trajectory
from tests.protocols.decoding import column, decode_chunks
from tests.protocols.idtp.idtp_vectors import KEY
from tests.support.each_row import each_row
from tests.support.faulty_line import FaultyLine

S = 1_000_000_000


def events_of(data: bytes, **options: Any) -> list[Any]:
    return decode_chunks(IdtpDecoder(**options), [(0, data)], stalled=False)


def test_readings_follow_the_trajectory() -> None:
    events = events_of(IdtpSimulator(rate=50).advance(20 * S - 1))
    assert not [event for event in events if not isinstance(event, Batch)]
    t = np.arange(1000) / 50
    truth = trajectory.vehicle_motion(t)
    times = next(event.time_ns for event in events if isinstance(event, Batch) and event.message.name == "Imu10")
    assert times.tolist() == (np.arange(1000) * 20_000_000).tolist()
    for name, expected, tolerance in (
        ("Acceleration", truth.force, 1.5),
        ("RateOfTurn", truth.rate, 0.05),
        ("MagneticField", EARTH_UT * truth.field, 0.5),
    ):
        error = column(events, name, "Imu10") - expected
        assert np.abs(error).max() < tolerance, name
        assert np.abs(error).max() > 0, name
    assert np.abs(column(events, "BaroPressure", "Imu10") - 101_100).max() < 200
    q = column(events, "Quaternion", "ImuQuat").astype(float)
    assert np.abs((q * truth.q_enu_from_body_wxyz).sum(axis=1)).min() > 0.9999
    assert column(events, "ImuQuatStatus", "ImuQuat").tolist() == [1] * 1000


@each_row("mode", [0, 1, 2])
def test_every_type_in_every_mode(mode: int) -> None:
    outputs = [(row.name, 20) for row in MESSAGES]
    events = events_of(IdtpSimulator(outputs=outputs, mode=mode, key=KEY).advance(S), key=KEY, min_mode=mode)
    assert {event.message.name for event in events if isinstance(event, Batch)} == {row.name for row in MESSAGES}
    assert sum(len(event) for event in events if isinstance(event, Batch)) == 7 * 21


def test_results_do_not_depend_on_time_steps() -> None:
    whole = IdtpSimulator(seed=3).advance(2 * S)
    device = IdtpSimulator(seed=3)
    assert b"".join(device.advance(now) for now in range(0, 2 * S + 1, 7_000_000)) + device.advance(2 * S) == whole
    other = IdtpSimulator(seed=3, start_ns=5 * S)
    assert other.advance(4 * S) == b""
    assert other.receive(b"IDTP?", 7 * S) == whole


def test_faults() -> None:
    dropped = events_of(FaultyLine("idtp", IdtpSimulator(), drop=0.1).advance(5 * S))
    lost = sum(event.missing for event in dropped if isinstance(event, SampleGap))
    assert 60 < lost < 140
    spoiled = events_of(FaultyLine("idtp", IdtpSimulator(), corrupt=0.1).advance(5 * S))
    reasons = {event.reason for event in spoiled if isinstance(event, RejectedFrame)}
    assert {"bad_crc8", "bad_crc32"} <= reasons
    jumped = events_of(IdtpSimulator(clock_jump=(2.0, 10.0)).advance(5 * S))
    (step,) = [event for event in jumped if isinstance(event, ClockStep)]
    assert (step.kind, round(step.by_ns / S)) == ("jump", 10)
    fast = events_of(IdtpSimulator(clock_drift_ppm=10_000).advance(10 * S))
    assert column(fast, "ImuQuatStatus", "ImuQuat").shape == (1011,)


def test_invalid_options() -> None:
    with pytest.raises(ValueError, match="needs a key"):
        IdtpSimulator(mode=2)
    with pytest.raises(ValueError, match="an output is one of Imu3Acc"):
        IdtpSimulator(outputs=[("Imu7", 10)])
    with pytest.raises(ValueError, match="1 to 2000 Hz"):
        IdtpSimulator(outputs=[("Imu6", 0)])
