"""Statements on loss, restarts, steps and attitude, against streams whose truth is exact."""

from pathlib import Path

import numpy as np
import pytest

from imuscope.protocols.events import Batch, RejectedFrame
from imuscope.protocols.xbus.decoder import XbusDecoder
from tests.support.truth_frames import even_ticks, opened, xbus, xbus_stream


@pytest.mark.parametrize(("by", "rate"), [(-0.3, 100.0), (-2.0, 10.0), (-3.0, 100.0), (-12.0, 100.0)])
def test_the_size_of_a_step_back_is_that_of_the_step(tmp_path: Path, by: float, rate: float) -> None:
    ticks = even_ticks(600, rate)
    ticks[300:] += round(by * 10_000)
    with opened(tmp_path / "a.bin", xbus_stream(range(600), ticks)) as recording:
        [step] = [event for event in recording.events if event.kind == "clock" and event.level == "warning"]
        assert step.data["by_ns"] == round(by * 1e9)
        assert step.text == f"The device's clock was set back by {f'{-by * 1000:.0f} ms' if by > -1 else f'{-by:g} s'}."


def test_a_restart_with_its_first_frames_lost_has_no_number_of_lost_samples(tmp_path: Path) -> None:
    counters = np.concatenate((60_000 + np.arange(300), 5 + np.arange(300)))
    ticks = np.concatenate((even_ticks(300), even_ticks(300, start=0.05)))
    with opened(tmp_path / "a.bin", xbus_stream(counters, ticks)) as recording:
        assert [event.data.get("by") for event in recording.events if event.kind == "gap"] == ["restart"]
        assert recording._store.manifest["figures"]["1"]["lost"] == 0


@pytest.mark.parametrize(("ahead", "clock_s", "lost"), [(5000, 0.01, 0), (5000, 50.01, 5000), (40, 0.41, 40)])
def test_a_counter_is_believed_as_far_as_the_clock_agrees(
    tmp_path: Path, ahead: int, clock_s: float, lost: int
) -> None:
    counters = np.concatenate((np.arange(500), 500 + ahead + np.arange(500)))
    first = even_ticks(500)
    ticks = np.concatenate((first, first[-1] + round(clock_s * 10_000) + even_ticks(500, start=0)))
    with opened(tmp_path / "a.bin", xbus_stream(counters, ticks)) as recording:
        [gap] = [event for event in recording.events if event.kind == "gap"]
        assert ("not known" in gap.text) == (lost == 0)
        assert recording._store.manifest["figures"]["1"]["lost"] == lost


def test_a_frame_that_came_twice_is_one_sample(tmp_path: Path) -> None:
    counters = np.arange(1000)
    twice = np.sort(np.concatenate((counters, counters[20::50])))
    data = xbus_stream(twice, even_ticks(1000)[twice])
    with opened(tmp_path / "a.bin", data) as recording:
        acceleration = recording["Acceleration"]
        assert len(acceleration) == 1000
        assert np.diff(acceleration.time) == pytest.approx(0.01, abs=1e-6)
        assert sum(event.data["reasons"]["repeated"] for event in recording.events if event.kind == "reject") == 20


@pytest.mark.parametrize("cut", [1, 7, 32, 64, 100_000])
def test_what_came_twice_does_not_depend_on_how_the_bytes_were_cut(cut: int) -> None:
    counters = [
        65_530,
        65_531,
        65_531,
        65_533,
        65_532,
        65_532,
        65_533,
        *range(65_534, 65_537),
        65_536,
        *range(65_537, 65_640),
        65_620,
    ]
    frames = xbus_stream(counters, np.array(counters) * 100)
    decoder = XbusDecoder()
    rejected, decoded = 0, []
    for at in range(0, len(frames), cut):
        decoder.feed(frames[at : at + cut], at)
        for event in decoder.drain():
            rejected += isinstance(event, RejectedFrame) and event.reason == "repeated"
            decoded += event.columns["PacketCounter"].tolist() if isinstance(event, Batch) else []
    assert sorted(decoded) == sorted({number % 65_536 for number in counters})
    assert rejected == len(counters) - len(decoded) == 5


@pytest.mark.parametrize("norm", [0.5, 1.3])
def test_a_quaternion_that_is_no_rotation_gives_no_attitude(tmp_path: Path, norm: float) -> None:
    def frame(number: int) -> bytes:
        size = norm if number >= 50 else 1.0
        return xbus(number, 100 * number, (0x2010, "4f", (size * np.sqrt(0.5), 0.0, 0.0, size * np.sqrt(0.5))))

    with opened(tmp_path / "a.bin", b"".join(map(frame, range(100)))) as recording:
        angles = recording["EulerAngles"].values
        assert angles[:50, 2] == pytest.approx(90.0, abs=1e-4)
        assert np.isnan(angles[50:]).all()
        [event] = [event for event in recording.events if "norm" in event.data]
        assert event.data["norm"] == pytest.approx(norm)
