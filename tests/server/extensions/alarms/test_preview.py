"""Preview of alarms: how often one would have been raised, live and in recordings, as by the machine itself."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.recordings.columns.store import ChannelLayout, ColumnStore, ColumnStoreWriter
from imuscope.server import wire
from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms import preview
from imuscope.server.extensions.alarms.definitions import AlarmDefinition, ExpressionCondition
from imuscope.server.extensions.alarms.preview import judge_of, preview_of, recorded_preview
from imuscope.server.settings.config import Config
from imuscope.server.streaming.channel_rows import ChannelRows
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.problems import assert_problem

BEGIN, RATE = 1_760_000_000.0, 100.0
SHOCK: dict[str, Any] = {"name": "Shock", "condition": {"kind": "expression", "expression": "Force > 100 N"}}


def info(number: int, name: str, unit: str) -> wire.ChannelInfo:
    columns = [wire.ColumnInfo("value", "f8", unit)]
    return wire.ChannelInfo(number, "1", "M", name, name, "scalar", unit, "", columns)


INFOS = [info(1, "Force", "N"), info(2, "Speed", "m/s")]


def definition(expression: str, **more: Any) -> AlarmDefinition:
    return AlarmDefinition(name="Shock", condition=ExpressionCondition(expression=expression), **more)


def stored(folder: Path, force: np.ndarray, speed: np.ndarray) -> ColumnStore:
    writer = ColumnStoreWriter(folder)
    for number, values, rate in ((1, force, RATE), (2, speed, RATE / 4)):
        writer.channel(number, ChannelLayout(("f8",), (False,)))
        time = BEGIN + np.arange(len(values)) / rate
        writer.append(number, [time + 0.01, time, values])
    return writer.finish({"channels": []})


def shocks(n: int = 6000) -> np.ndarray:
    """A force with three shocks above 100 N: of one sample, of 20, and of 50 at the end."""
    force = 10 * np.sin(np.arange(n) / 7)
    force[1000] = 180.0
    force[2000:2020] = 150.0
    force[-50:] = 120.0
    return force


def test_a_recording_is_judged_as_its_samples_would_have_been_live(tmp_path: Path) -> None:
    store = stored(tmp_path / "store", shocks(), np.zeros(1500))
    results = recorded_preview(definition("Force > 100 N"), store, INFOS)
    assert (results.times, results.worst, results.unit) == (3, 180.0, "N")
    assert [one.worst for one in results.intervals] == [180.0, 150.0, 120.0]
    assert results.t0 == pytest.approx(BEGIN)
    assert results.t1 == pytest.approx(BEGIN + 59.99)
    assert results.seconds == pytest.approx(0.01 + 0.2 + 0.49, abs=1e-6)
    assert recorded_preview(definition("Force > 100 N", raise_s=0.1), store, INFOS).times == 2
    assert recorded_preview(definition("Force > 100 N", latched=True), store, INFOS).times == 3
    assert recorded_preview(definition("Force > 200 N"), store, INFOS).worst is None


@each_row("expression", ["Force > 100 N and Speed > 0", "rms(Force, 200 ms) > 60 N"])
def test_slices_give_what_everything_at_once_gives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, expression: str
) -> None:
    speed = np.sin(np.arange(1500) / 40)
    store = stored(tmp_path / "store", shocks(), speed)
    whole = recorded_preview(definition(expression), store, INFOS)
    monkeypatch.setattr(preview, "SLICE_ROWS", 333)
    results = recorded_preview(definition(expression), store, INFOS)
    assert (results.times, results.t0, results.t1, results.seconds) == (whole.times, whole.t0, whole.t1, whole.seconds)
    assert results.worst is None or results.worst == pytest.approx(whole.worst)
    assert [(one.t0, one.t1) for one in results.intervals] == [(one.t0, one.t1) for one in whole.intervals]
    assert whole.times > 0


def test_without_samples_nothing_is_known(tmp_path: Path) -> None:
    store = stored(tmp_path / "store", np.empty(0), np.empty(0))
    result = recorded_preview(definition("Force > 1 N"), store, INFOS)
    assert (result.times, result.t0, result.t1) == (0, None, None)
    judge = judge_of(definition("Force > 1 N"), INFOS, {})
    assert preview_of(definition("Force > 1 N"), judge, []).times == 0


def test_a_mistake_is_reported_as_when_it_is_saved(tmp_path: Path) -> None:
    store = stored(tmp_path / "store", shocks(), np.zeros(1500))
    with pytest.raises(DomainError, match="cannot be compared"):
        recorded_preview(definition("Force > 1 m"), store, INFOS)


@pytest.fixture
def running(tmp_path: Path) -> Iterator[InProcessServer]:
    config = Config(data=tmp_path, sources=("/dev/one",), control_token="c" * 20, view_token="v" * 20)
    with InProcessServer(config, FakeLink) as running:
        yield running


def test_over_http_a_viewer_may_check_and_preview_but_not_add(running: InProcessServer) -> None:
    client, bus = running.client, running.services.telemetry.bus
    force = shocks()
    times = bus.now() - len(force) / RATE + np.arange(len(force)) / RATE

    def begin() -> None:
        bus.set_device(wire.DeviceInfo("7", "MTi", "sim:xbus", "simulator", "live", protocol="xbus"))
        described = wire.ChannelInfo(
            0, "7", "M", "Force", "Force", "scalar", "N", "", [wire.ColumnInfo("value", "f8", "N")]
        )
        bus.publish([ChannelRows(bus.advertise(described), [times, times, force])])

    running.call(begin)
    viewer = {"authorization": "Bearer " + "v" * 20}
    whole = client.post("/api/alarms/preview", json={"definition": SHOCK, "source": "7"}, headers=viewer).json()
    assert (whole["times"], whole["worst"], whole["unit"]) == (3, 180.0, "N")
    late = {"definition": SHOCK, "source": "7", "seconds": 5}
    answer = client.post("/api/alarms/preview", json=late, headers=viewer).json()
    assert answer["times"] == 1
    assert math.isclose(answer["t1"] - answer["t0"], 5, abs_tol=0.02)
    assert client.post("/api/alarms/check", json=SHOCK, headers=viewer).json()["valid"]
    assert_problem(client.post("/api/alarms", json=SHOCK, headers=viewer), 403, "view-only")
    health = {"name": "Loss", "condition": {"kind": "health", "figure": "loss", "limit": 1}}
    body = {"definition": health, "source": "7"}
    assert_problem(client.post("/api/alarms/preview", json=body, headers=viewer), 422, "bad-value")
    absent = {"definition": SHOCK, "source": "nothing"}
    assert_problem(client.post("/api/alarms/preview", json=absent, headers=viewer), 404, "not-found")
