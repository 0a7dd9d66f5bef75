"""Analyses: statistics against a slow oracle, names of signals, and the same figures over HTTP, live and recorded."""

import asyncio
import dataclasses
import io
import json
import math
import socket
import statistics as plain
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

import imuscope
from imuscope.server import wire
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.signal_request import requested_signals
from imuscope.server.extensions.analysis.jobs.service import AnalysisService
from imuscope.server.extensions.analysis.methods.statistics import run
from imuscope.server.extensions.analysis.noise.registry import Analysis, analyses, analysis_named, register_analysis
from imuscope.server.extensions.analysis.noise.report import figures_of
from imuscope.server.extensions.analysis.signals.signals import Signal, columns_named, finite_signal
from imuscope.server.settings.config import Config
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer, table_server
from tests.support.problems import assert_problem
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

URL = "/api/analysis"
START = 1_760_000_000.0
VALUES = st.floats(-1e6, 1e6)
STEPS = st.floats(1e-3, 10.0)


def signal(values: Any, time: Any = None, period: float = 0.0) -> Signal:
    numbers = np.asarray(values, np.float64)
    times = np.arange(len(numbers)) * 0.01 if time is None else np.asarray(time, np.float64)
    return Signal("Acceleration.x", "m/s²", period, times + START, numbers)


def figures(values: Any, time: Any = None, period: float = 0.0, gap: float = 1.5) -> Any:
    return run(signal(values, time, period), {"gap": gap})


@given(st.lists(st.tuples(VALUES, STEPS), min_size=2, max_size=40))
def test_statistics_agree_with_the_standard_library(rows: list[tuple[float, float]]) -> None:
    values, steps = [value for value, _ in rows], [step for _, step in rows]
    of = signal(values, [math.fsum(steps[:n]) for n in range(len(steps))])
    result: Any = run(of, {"gap": 1.5})
    time = (of.time - of.time[0]).tolist()  # unix seconds have steps of 0.2 µs
    scale = max(abs(value) for value in values) + 1e-9

    def close(value: float, by: float = 1.0) -> Any:
        return pytest.approx(value, rel=1e-6, abs=1e-6 * scale * by)

    assert result["n"] == len(values)
    assert result["mean"] == close(plain.fmean(values))
    assert result["sigma"] == close(plain.stdev(values))
    assert result["rms"] == close(math.sqrt(plain.fmean(value * value for value in values)))
    assert (result["min"], result["max"]) == (min(values), max(values))
    assert result["peak_to_peak"] == close(max(values) - min(values))
    assert result["slope"] == close(plain.linear_regression(time, values).slope, by=1 / min(steps))
    areas = [(a + b) / 2 * (u - t) for a, b, t, u in zip(values, values[1:], time, time[1:], strict=False)]
    assert result["integral"] == close(math.fsum(areas), by=time[-1])
    assert result["duration"] == pytest.approx(time[-1], abs=1e-6)


def test_an_angle_that_wraps_has_a_circular_mean_and_an_unwrapped_slope() -> None:
    turned = (np.arange(200) * 0.5 + 150.0 + 180.0) % 360.0 - 180.0  # 50 °/s from 150° on, across ±180°
    result = figures(turned, period=360.0)
    assert result["mean"] == pytest.approx(-160.25, abs=0.01)
    assert result["slope"] == pytest.approx(50.0)
    assert result["peak_to_peak"] == pytest.approx(99.5)
    assert math.isnan(result["integral"])
    assert math.isnan(result["rms"])
    assert (result["min"], result["max"]) == (150.0, -110.5), "the ends of the arc, as far apart as peak to peak"
    round_and_round = figures((np.arange(800) * 0.5 + 180.0) % 360.0 - 180.0, period=360.0)
    assert math.isnan(round_and_round["min"])
    assert math.isnan(round_and_round["max"])


def test_gaps_are_those_that_end_a_run() -> None:
    time = np.delete(np.arange(100) * 0.01, [20, 50, 51, 52])
    assert figures(np.zeros(96), time)["gaps"] == 2
    assert figures(np.zeros(96), time)["rate"] == pytest.approx(95 / 0.99)


def test_one_sample_has_no_slope_and_no_rate() -> None:
    result, units = figures_of(analysis_named("statistics"), signal([4.0]), {})
    assert (result["n"], result["mean"], result["sigma"]) == (1, 4.0, 0.0)
    assert (result["slope"], result["rate"], result["duration"]) == (None, None, 0.0)
    assert units == {
        **dict.fromkeys(("mean", "sigma", "rms", "min", "max", "peak_to_peak"), "m/s²"),
        **{"slope": "m/s³", "integral": "m/s", "duration": "s", "rate": "Hz"},
    }


def test_units_of_a_signal_without_a_unit() -> None:
    of = Signal("x", "", 0.0, np.zeros(1), np.zeros(1))
    assert analysis_named("statistics").units_for(of, {}) == {
        "slope": "1/s",
        "integral": "s",
        "duration": "s",
        "rate": "Hz",
    }


def test_a_name_is_given_once() -> None:
    assert next(one.name for one in analyses()) == "statistics"
    with pytest.raises(ValueError, match="statistics"):
        register_analysis(Analysis("statistics", "", "", run, {}))


# ── names of signals ─────────────────────────────────────────────────────────────────────────────────────────────────


def channel(number: int, device: str, name: str, *columns: str) -> wire.ChannelInfo:
    infos = [wire.ColumnInfo(column, "f8", "m") for column in columns]
    return wire.ChannelInfo(number, device, "M", name, name, "record", "", "", infos)


CHANNELS = [
    channel(1, "1", "INS", "x", "y"),
    channel(2, "1", "INS.status", "value"),
    channel(3, "2", "GNSS", "x"),
    channel(4, "3", "GNSS", "x"),
    channel(5, "1", "INS", "x", "y", "z"),
]


@each_row(
    ("word", "result"),
    [
        ("INS.x", ["5.x"]),
        ("INS", ["5.x", "5.y", "5.z"]),
        ("INS.status", ["2.value"]),
        ("INS.status.value", ["2.value"]),
        ("2/GNSS.x", ["3.x"]),
        ("3/GNSS", ["4.x"]),
    ],
)
def test_signals_are_named_by_channel_and_column(word: str, result: list[str]) -> None:
    columns = columns_named(CHANNELS, [word])
    assert [f"{one.info.id}.{one.info.columns[one.at].name}" for one in columns] == result


SHARED = [
    dataclasses.replace(channel(1, "1", "Acceleration", "x", "z"), message="Imu6"),
    dataclasses.replace(channel(2, "1", "Acceleration", "x", "z"), message="Imu3Acc"),
    dataclasses.replace(channel(3, "2", "Acceleration", "x", "z"), message="/imu/data"),
]


@each_row(
    ("word", "result"),
    [
        ("1/Imu6/Acceleration.z", [(1, "Imu6/Acceleration.z")]),
        ("Imu3Acc/Acceleration.z", [(2, "Imu3Acc/Acceleration.z")]),
        ("2/Acceleration.z", [(3, "Acceleration.z")]),
        ("/imu/data/Acceleration.z", [(3, "Acceleration.z")]),
        ("Acceleration.z", "2/Acceleration.z"),
        ("1/Acceleration.z", "Name one: 1/Imu3Acc/Acceleration.z, 1/Imu6/Acceleration.z."),
        ('norm("1/Acceleration")', "Name one: 1/Imu3Acc/Acceleration, 1/Imu6/Acceleration."),
    ],
)
def test_a_quantity_in_two_messages_is_named_by_its_message(word: str, result: list[tuple[int, str]] | str) -> None:
    """Regression: the newest of both was taken, without a word."""
    if isinstance(result, list):
        assert [(one.info.id, one.name) for one in columns_named(SHARED, [word])] == result
        return
    with pytest.raises(DomainError) as raised:
        requested_signals(SHARED, [word], zero_phase=True)
    assert result in raised.value.hint


def test_without_names_all_signals_are_analysed(captures: Path) -> None:
    """Regression: {} in place of all of them, as the help promises."""
    file = captures.parent / "cases" / "verdicts" / "idtp_two_accelerations.bin"
    if not file.exists():
        pytest.skip(f"{file} is not there")
    with imuscope.open(file) as recording:
        figures = recording.analyse("statistics")
        results = {name: (one["n"], round(one["mean"], 3)) for name, one in figures.items() if name.endswith(".z")}
        assert results == {
            "Imu6/Acceleration.z": (300, 9.81),
            "RateOfTurn.z": (300, 0.0),
            "Imu3Acc/Acceleration.z": (150, 1.0),
        }
        assert set(recording.analyse("psd", begin_s=0.1)) <= set(figures)
        with pytest.raises(imuscope.ImuscopeError, match="Several messages have Acceleration"):
            recording.analyse("statistics", "Acceleration")


@each_row(
    ("word", "kind", "hint"),
    [
        ("INS.w", "not-found", "x, y, z"),
        ("Speed", "not-found", "GNSS, INS, INS.status"),
        ("GNSS.x", "which-device", "2/GNSS.x, 3/GNSS.x"),
        ("9/GNSS.x", "not-found", "GNSS, INS"),
    ],
)
def test_a_wrong_name_states_what_there_is(word: str, kind: str, hint: str) -> None:
    with pytest.raises(DomainError) as raised:
        columns_named(CHANNELS, [word])
    assert raised.value.kind == kind
    assert hint in raised.value.hint


# ── over HTTP ────────────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[InProcessServer]:
    """A recording "line" with y = 2 t + 1 and a hole, and a live device "7" with the same samples."""
    times = [n * 0.01 for n in range(500) if not 100 <= n < 110]
    rows = "".join(f"{START + t:.3f},{2 * t + 1:.6f},{math.sin(t):.9f}\n" for t in times)
    with table_server(tmp_path_factory.mktemp("data"), line="time,y (m),s\n" + rows) as running:
        live = running.services.telemetry.bus.now() - 6 + np.array(times)
        running.publish("7", "Line", "m", [live, live, 2 * np.array(times) + 1])
        yield running


def send_request(running: InProcessServer, name: str = "statistics", **body: Any) -> Any:
    return running.client.post(f"{URL}/{name}", json=body)


def test_a_recording_and_a_live_device_have_the_same_figures(running: InProcessServer) -> None:
    y = next(name for name in running.signals_of("line") if "y" in name)
    [recorded] = send_request(running, source="line", signals=[y]).json()
    [live] = send_request(running, source="7", signals=["Line.y"]).json()
    for name, value in recorded["figures"].items():
        assert live["figures"][name] == pytest.approx(value, rel=1e-4), name
    assert recorded["figures"]["n"] == 490
    assert recorded["figures"]["gaps"] == 1
    assert recorded["figures"]["slope"] == pytest.approx(2.0, abs=1e-4)
    assert recorded["figures"]["integral"] == pytest.approx(4.99**2 + 4.99, rel=1e-5)
    assert live["units"]["integral"] == "m·s"


def test_a_range_and_several_signals(running: InProcessServer) -> None:
    names = running.signals_of("line")
    answer = send_request(running, source="line", signals=names, t0=START + 1.5, t1=START + 2.5).json()
    assert [one["signal"] for one in answer] == names
    assert {one["figures"]["n"] for one in answer} == {101}
    table = pa.ipc.open_stream(
        io.BytesIO(
            send_request(running, source="line", signals=names, t0=START + 1.5, t1=START + 2.5, format="arrow").content
        )
    ).read_all()
    assert table.column("signal").to_pylist() == names
    for name, value in answer[0]["figures"].items():
        assert table.column(name)[0].as_py() == pytest.approx(value)
    assert table.schema.field("duration").metadata == {b"unit": b"s"}


def test_the_analyses_are_listed_with_their_options(running: InProcessServer) -> None:
    [result] = [one for one in running.client.get(URL).json() if one["name"] == "histogram"]
    assert result["options"][0]["name"] == "bins"


@each_row(
    ("body", "status", "kind"),
    [
        ({"source": "nothing", "signals": ["x"]}, 404, "not-found"),
        ({"source": "7", "signals": ["Speed"]}, 404, "not-found"),
        ({"source": "7", "signals": []}, 422, "bad-request"),
        ({"source": "7", "signals": ["Line.y"], "t0": 5, "t1": 4}, 422, "bad-span"),
        ({"source": "7", "signals": ["Line.y"], "t1": 5}, 404, "not-found"),
        ({"source": "7", "signals": ["Line.y"], "options": {"gap": 0.5}}, 422, "bad-value"),
        ({"source": "7", "signals": ["Line.y"], "options": {"gap": "wide"}}, 422, "bad-value"),
        ({"source": "7", "signals": ["Line.y"], "options": {"gap": True}}, 422, "bad-value"),
        ({"source": "7", "signals": ["Line.y"], "options": {"width": 1}}, 422, "bad-value"),
    ],
)
def test_a_wrong_request_is_refused(running: InProcessServer, body: dict[str, Any], status: int, kind: str) -> None:
    assert_problem(send_request(running, **body), status, kind)


def test_an_unknown_analysis_is_refused_with_those_there_are(running: InProcessServer) -> None:
    report = assert_problem(send_request(running, "spectres", source="7", signals=["Line.y"]), 404, "not-found")
    assert "statistics" in report["hint"]


def test_a_viewer_may_analyse(running: InProcessServer, tmp_path: Path) -> None:
    config = Config(data=tmp_path, sources=("/dev/one",), view_token="v" * 20, control_token="c" * 20)
    with InProcessServer(config, FakeLink) as guarded:
        report = guarded.client.post(
            f"{URL}/statistics", json={"source": "x", "signals": ["x"]}, headers={"authorization": f"Bearer {'v' * 20}"}
        )
        assert_problem(report, 404, "not-found")


def test_an_analysis_ends_when_its_client_leaves(running: InProcessServer, monkeypatch: pytest.MonkeyPatch) -> None:
    analyses, begun = running.services.parts.get(AnalysisService), threading.Event()

    async def never(job: object) -> None:
        begun.set()
        await asyncio.Event().wait()

    monkeypatch.setattr(analyses.forks, "run", never)
    body = json.dumps({"source": "7", "signals": ["Line"]}).encode()
    host = running.url.removeprefix("http://")
    with socket.create_connection(("127.0.0.1", int(host.rpartition(":")[2]))) as client:
        head = f"POST {URL}/statistics HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/json\r\n"
        client.sendall(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)
        assert begun.wait(PATIENCE_S)
        assert analyses.queue.running == 1
    block_until(lambda: analyses.queue.running == 0, "the analysis ended")


def test_samples_that_are_not_finite_are_counted() -> None:
    """X / 0 "has no samples in that range", and a root left samples out without a word."""
    time, values = START + np.arange(1000) * 0.01, np.ones(1000)
    values[::4] = np.nan
    some, none = (
        finite_signal(name, "m", 0.0, time, part) for name, part in (("some", values), ("none", values * np.nan))
    )
    analysis = next(one for one in analyses() if one.name == "statistics")
    result, _ = figures_of(analysis, some, {"gap": 1.5})
    assert result["n"] == 750
    assert result["notes"][0] == "250 of 1 000 samples of some are not finite numbers; they are left out."
    with pytest.raises(
        DomainError, match="none has 1 000 samples in that range, and each is infinite or not a number"
    ) as error:
        figures_of(analysis, none, {"gap": 1.5})
    assert "division by 0" in error.value.hint
