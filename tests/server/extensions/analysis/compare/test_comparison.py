"""Comparison of two sides: differences against a slow oracle and closed forms, attitudes, and the routes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from imuscope.protocols.arrays import Floats
from imuscope.protocols.rotations import quaternion_columns, slerp
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.compare.comparison import (
    attitude_difference,
    difference,
    difference_figures,
    outline,
)
from imuscope.server.extensions.analysis.signals.signals import Signal
from tests.support.each_row import each_row
from tests.support.in_process_server import InProcessServer, table_server
from tests.support.problems import assert_problem
from tests.support.server_process import ServerProcess
from tests.support.timeouts import http_client
from tests.support.waiting import block_until

URL = "/api/comparison"
START = 1_760_000_000.0
STEP = 1 / 128  # exact in binary: the oracle adds it up


def signal(time: Any, values: Any, unit: str = "m", period: float = 0.0) -> Signal:
    return Signal("y", unit, period, np.asarray(time, np.float64), np.asarray(values, np.float64))


def slow(a: Signal, b: Signal, offset: float, holes: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Each difference by a search through B; none within one of the holes."""
    results = []
    for time, value in zip(a.time, a.values, strict=True):
        at = time - offset
        for (t, y), (u, z) in zip(
            zip(b.time, b.values, strict=True), zip(b.time[1:], b.values[1:], strict=True), strict=False
        ):
            if t <= at <= u and (at in (t, u) or not any(t == begin and u == end for begin, end in holes)):
                results.append((float(time), float(y + (at - t) / (u - t) * (z - y) - value)))
                break
    return results


@given(
    st.lists(st.floats(-100, 100), min_size=4, max_size=30),
    st.lists(st.floats(-100, 100), min_size=6, max_size=30),
    st.integers(-20, 20),
    st.booleans(),
)
def test_differences_agree_with_a_search(first: list[float], second: list[float], quarters: int, cut: bool) -> None:
    a = signal(np.arange(len(first)) * STEP, first)
    times = np.arange(len(second)) * STEP
    holes = []
    if cut:
        times = np.where(np.arange(len(second)) > 3, times + 10 * STEP, times)
        holes = [(float(times[3]), float(times[4]))]
    b, offset = signal(times, second), quarters * STEP / 4
    expected = slow(a, b, offset, holes)
    if not expected:
        with pytest.raises(DomainError, match="do not overlap"):
            difference(a, b, offset)
        return
    result = difference(a, b, offset)
    assert result.time.tolist() == [time for time, _ in expected]
    assert result.values.tolist() == pytest.approx([value for _, value in expected], abs=1e-9)


def test_the_difference_of_shifted_lines_is_a_constant() -> None:
    a, b = signal(np.arange(100) * 0.1, np.arange(100) * 0.2), signal(np.arange(80) * 0.125, np.arange(80) * 0.25 + 3)
    figures = difference_figures(difference(a, b, 1.0).values)
    assert figures["mean"] == pytest.approx(1.0)  # 3, and 2 m/s for 1 s less
    assert figures["sigma"] == pytest.approx(0.0, abs=1e-9)
    assert figures["rms"] == pytest.approx(1.0)


def test_figures_of_normal_differences() -> None:
    values = np.random.default_rng(1).normal(0.5, 2.0, 200_000)
    figures = difference_figures(values)
    assert figures["mean"] == pytest.approx(0.5, abs=0.02)
    assert figures["sigma"] == pytest.approx(2.0, abs=0.02)
    assert figures["rms"] == pytest.approx(math.hypot(2.0, 0.5), abs=0.02)
    assert figures["low"] == pytest.approx(0.5 - 1.96 * 2, abs=0.05)
    assert figures["high"] == pytest.approx(0.5 + 1.96 * 2, abs=0.05)
    assert (figures["min"], figures["max"]) == (values.min(), values.max())


def test_angles_differ_by_the_shorter_way() -> None:
    time = np.arange(0, 10, 0.1)
    a, b = signal(time, np.full(100, 179.0), "°", 360.0), signal(time, np.full(100, -179.0), "°", 360.0)
    assert difference(a, b, 0.0).values == pytest.approx(2.0)
    turning = signal(time, (170 + 5 * time + 180) % 360 - 180, "°", 360.0)
    assert difference(turning, turning, 0.5).values == pytest.approx(-2.5)


def test_a_gap_is_not_bridged_but_reported() -> None:
    time = np.arange(0, 10, 0.1)
    a, b = signal(time, 0 * time), signal(np.delete(time, slice(30, 50)), np.zeros(80))
    result = difference(a, b, 0.05)
    assert result.left_out == 21
    assert not np.any((result.time > 2.96) & (result.time < 5.04))
    assert result.notes == ["21 samples of A in a gap of B: nothing is compared across a gap."]


def test_other_units_are_not_compared() -> None:
    with pytest.raises(DomainError, match="different units: m and °"):
        difference(signal([0, 1], [0, 1]), signal([0, 1], [0, 1], "°"), 0.0)


# ── attitude ─────────────────────────────────────────────────────────────────────────────────────────────────────────


def wxyz(rotation: Rotation) -> Floats:
    return np.roll(np.atleast_2d(rotation.as_quat()), 1, axis=-1)


def test_euler_angles_and_slerp_agree_with_scipy() -> None:
    random = np.random.default_rng(2)
    euler = np.stack([random.uniform(-180, 180, 50), random.uniform(-89, 89, 50), random.uniform(-180, 180, 50)])
    result, expected = (
        np.stack(quaternion_columns(list(euler)), -1),
        wxyz(Rotation.from_euler("ZYX", euler[::-1].T, degrees=True)),
    )
    assert np.abs(np.sum(result * expected, -1)) == pytest.approx(1.0)
    first, second = Rotation.random(50, random_state=1), Rotation.random(50, random_state=2)
    part = random.uniform(0, 1, 50)
    between = first * Rotation.from_rotvec(part[:, np.newaxis] * (first.inv() * second).as_rotvec())
    assert np.abs(np.sum(slerp(wxyz(first), wxyz(second), part) * wxyz(between), -1)) == pytest.approx(1.0)


def test_an_attitude_differs_by_one_angle_and_a_mounting_is_recognised() -> None:
    time = np.arange(0, 20, 0.01)
    moves = Rotation.from_euler("ZYX", np.stack([20 * time, 10 * np.sin(time), 5 * np.cos(time)], -1), degrees=True)
    mounting = Rotation.from_euler("x", 7, degrees=True)
    wobble = Rotation.from_euler("y", np.where(np.arange(len(time)) % 2, 1.0, -1.0)[:, np.newaxis], degrees=True)
    sign = np.where(np.arange(len(time)) % 3 == 0, -1.0, 1.0)[:, np.newaxis]  # q and −q are one attitude
    result, figures = attitude_difference((time, wxyz(moves)), (time - 3, sign * wxyz(moves * mounting * wobble)), 3.0)
    both = math.cos(math.radians(3.5)) * math.cos(math.radians(0.5))  # of half the angles, about perpendicular axes
    assert result.values == pytest.approx(math.degrees(2 * math.acos(both)), abs=1e-4)
    assert figures["mounting"] == pytest.approx(7.0, abs=0.01)
    assert figures["remaining"] == pytest.approx(1.0, abs=0.01)


# ── for display ──────────────────────────────────────────────────────────────────────────────────────────────────────


def test_an_outline_keeps_peaks_and_gaps() -> None:
    time = np.delete(np.arange(0, 100, 0.01), slice(4000, 5000))
    values = np.zeros(9000)
    values[1234], values[7777] = 5.0, -6.0
    drawn = outline(signal(time, values), 500)
    assert len(drawn["time"]) <= 502
    assert max(one for one in drawn["high"] if one is not None) == 5.0
    assert min(one for one in drawn["low"] if one is not None) == -6.0
    assert drawn["time"].count(None) == 1
    at = drawn["time"].index(None)
    assert drawn["time"][at - 1] == pytest.approx(39.9, abs=0.2)
    assert drawn["time"][at + 1] == pytest.approx(50.1, abs=0.2)


# ── over HTTP ────────────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[InProcessServer]:
    """Recordings "first" and "second" of one motion, 100 s apart by their clocks; a live device "7" with it too."""
    time = np.arange(0, 20, 0.01)
    random = np.random.default_rng(3)
    waves = [(random.uniform(0.1, 3), random.uniform(0, 7)) for _ in range(20)]

    def y(t: Floats) -> Floats:
        values: Floats = np.sum([np.sin(2 * np.pi * f * t + p) for f, p in waves], axis=0)
        return values

    tables = {}
    for name, begin in (("first", 0.0), ("second", 98.75)):
        rows = zip(START + begin + time, y(time) + (0.5 if begin else 0.0), strict=True)
        tables[name] = "time,y (m)\n" + "".join(f"{t:.3f},{v:.6f}\n" for t, v in rows)
    with table_server(tmp_path_factory.mktemp("data"), **tables) as running:
        live = running.services.telemetry.bus.now() - 22 + time
        running.publish("7", "Line", "m", [live, live, y(time)])
        paths = [f"/api/recordings/{name}" for name in ("first", "second")]
        block_until(lambda: all(running.client.get(path).status_code == 200 for path in paths), "both are opened")
        yield running


def named(running: InProcessServer, recording: str) -> str:
    [channel] = running.client.get(f"/api/recordings/{recording}").json()["channels"]
    return f"{channel['name']}.{channel['columns'][0]['name']}"


def send_request(running: InProcessServer, a: str, b: str, **body: Any) -> Any:
    names = {"signals": [named(running, a)], "signals_b": ["Line.y" if b == "7" else named(running, b)]}
    sides: dict[str, Any] = {"a": {"source": a}, "b": {"source": b}}
    return running.client.post(URL, json={**sides, **names, **body})


def test_two_recordings_are_aligned_by_correlation(running: InProcessServer) -> None:
    answer = send_request(running, "first", "second", align="correlation").json()
    assert answer["offset"] == pytest.approx(-98.75, abs=1e-3)
    assert 0 < answer["uncertainty"] < 0.01
    assert answer["correlation"] == pytest.approx(1.0, abs=1e-4)
    [row] = answer["signals"]
    assert row["figures"]["mean"] == pytest.approx(0.5, abs=1e-3)
    assert row["figures"]["rms"] == pytest.approx(0.5, abs=1e-2)
    assert len(row["a"]["time"]) <= 1001
    assert row["difference"]["time"][0] == pytest.approx(START, abs=0.1)


def test_a_recording_is_compared_with_a_live_device(running: InProcessServer) -> None:
    answer = send_request(running, "first", "7", align="correlation").json()
    [row] = answer["signals"]
    assert row["signal_b"] == "Line.y"
    assert row["figures"]["rms"] < 0.05
    begins = send_request(running, "first", "7", align="start").json()
    assert begins["offset"] == pytest.approx(answer["offset"], abs=0.02)
    assert begins["uncertainty"] is None


def test_by_the_clock_there_may_be_no_overlap(running: InProcessServer) -> None:
    answer = send_request(running, "first", "second").json()
    assert answer["offset"] == 0
    [row] = answer["signals"]
    assert row["difference"] is None
    assert row["figures"] == {}
    assert "do not overlap" in row["notes"][0]


def test_two_ranges_of_one_recording(running: InProcessServer) -> None:
    name = named(running, "first")
    a, b = {"source": "first", "t0": START, "t1": START + 8}, {"source": "first", "t0": START + 5, "t1": START + 20}
    body = {"a": a, "b": b, "signals": [name], "align": "correlation"}
    answer = running.client.post(URL, json=body).json()
    assert answer["offset"] == pytest.approx(0.0, abs=1e-3)
    assert answer["signals"][0]["figures"]["rms"] == pytest.approx(0.0, abs=1e-9)
    assert answer["signals"][0]["figures"]["n"] == 301


@each_row(
    ("change", "status", "kind"),
    [
        ({"b": {"source": "none"}}, 404, "not-found"),
        ({"signals_b": ["Line.y", "Line.y"]}, 422, "bad-value"),
        ({"align": "magic"}, 422, "bad-request"),
        ({"b": {"source": "7", "t0": 5.0, "t1": 6.0}}, 404, "not-found"),
        ({"b": {"source": "7", "t0": 6.0, "t1": 5.0}}, 422, "bad-span"),
    ],
)
def test_a_wrong_request_is_refused(running: InProcessServer, change: dict[str, Any], status: int, kind: str) -> None:
    names: dict[str, Any] = {"signals": [named(running, "first")], "signals_b": ["Line.y"]}
    body = {"a": {"source": "first"}, "b": {"source": "7"}, **names, **change}
    assert_problem(running.client.post(URL, json=body), status, kind)


def test_settings_that_are_not_known_are_refused(running: InProcessServer) -> None:
    sides = {"a": {"source": "first"}, "b": {"source": "second"}}
    assert_problem(running.client.post(f"{URL}/settings", json=sides), 409, "not-read")


def test_settings_as_recorded_and_as_read_now_are_compared(tmp_path: Path) -> None:
    """A device is read and recorded, then its location is changed: the diff has both values."""
    with (
        ServerProcess("sim:xbus?seed=1&rate=10", data=tmp_path) as process,
        http_client(base_url=process.url) as client,
    ):
        url = "/api/devices/1"
        block_until(lambda: client.get("/api/devices").json()[0]["status"] == "live", "it streams")

        def job(what: str, body: dict[str, Any]) -> None:
            number = client.post(f"{url}/{what}", json=body).json()["id"]
            block_until(
                lambda: any(one["id"] == number for one in client.get(f"{url}/jobs").json()["done"]), f"{what} is over"
            )

        live = {"source": "1"}
        refused = client.post(f"{URL}/settings", json={"a": live, "b": live})
        assert_problem(refused, 409, "not-read")
        assert refused.json()["message"].startswith("A: ")
        job("read", {})
        recording = client.post("/api/recordings/start", json={"devices": ["1"]}).json()["id"]
        assert client.post("/api/recordings/stop", json={}).status_code == 200
        block_until(lambda: client.get(f"/api/recordings/{recording}").status_code == 200, "it is opened")
        job("apply", {"changes": {"LocationID": {"location_id": 42}}})
        sides = {"a": {"source": recording}, "b": live}
        answer = client.post(f"{URL}/settings", json=sides).json()
        rows = {row["setting"]: (row["left"], row["right"]) for row in answer["rows"]}
        assert rows == {"LocationID": ("0", "42")}
        assert answer["same"] > 20
        assert answer["left"].startswith("A: MTi-")
        [entry] = [one for one in client.get("/api/recordings").json() if one["id"] == recording]
        assert answer["left"].endswith(f", as recorded in “{entry['title']}”")
        assert answer["right"].startswith("B: MTi-")
        assert answer["changes"] == {}  # it is for reading; Configure writes
        unknown = client.post(f"{URL}/settings", json={"a": {"source": recording, "device": "7"}, "b": live})
        assert_problem(unknown, 409, "not-read")
        assert f"A: “{entry['title']}” holds no settings" in unknown.json()["message"]  # of two recordings, which?
        both = client.post(f"{URL}/settings", json={"a": sides["a"], "b": sides["a"]}).json()
        assert both["rows"] == []
