"""Computed signals of live devices: channels on the bus that follow, survive a restart, and end when removed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.server import wire
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.derived_channels import DerivedChannels
from imuscope.server.extensions.analysis.expressions.expression_syntax import ExpressionError
from imuscope.server.library.signal_definitions import FILE, SignalDefinition, SignalDefinitions
from imuscope.server.settings.config import Config
from imuscope.server.streaming.channel_rows import ChannelRows
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.live_signal import BEGIN, LiveSignal
from tests.support.problems import assert_problem

TOTAL = SignalDefinition("Total", "norm(Acceleration)")


def device(number: str = "1", serial: str = "0080A1B2") -> wire.DeviceInfo:
    return wire.DeviceInfo(number, "MTi", "sim:xbus", "simulator", "live", protocol="xbus", serial_number=serial)


class DerivedBench(LiveSignal):
    """Derived channels of one device."""

    def __init__(self, folder: Path, number: str = "1") -> None:
        columns = [wire.ColumnInfo(axis, "f4", "m/s²") for axis in "xyz"]
        info = wire.ChannelInfo(0, number, "M", "Acceleration", "Acceleration", "vector", "m/s²", "", columns)
        self.device = device(number)
        super().__init__(self.device, info, late=0.01)
        self.derived = DerivedChannels(self.telemetry.bus, self.telemetry.store, SignalDefinitions(folder))

    def send(self, n: int, rate: float = 100.0) -> None:
        self.publish(n, rate, [np.full(n, 3.0), np.full(n, 4.0), np.zeros(n)])

    def channels(self, name: str = "Total") -> list[wire.ChannelInfo]:
        return [one.info for one in self.telemetry.store.all if one.info.name == name]

    def rows(self, name: str = "Total") -> list[Any]:
        [info] = self.channels(name)
        return self.telemetry.store.of(info.id).ring.read()


@pytest.fixture
def bench(tmp_path: Path) -> DerivedBench:
    """With a second of samples and a computed signal."""
    bench = DerivedBench(tmp_path)
    bench.send(100)
    bench.derived.put(bench.device, TOTAL)
    return bench


def test_a_signal_begins_with_what_memory_holds_and_follows(bench: DerivedBench) -> None:
    [info] = bench.channels()
    assert (info.unit, info.kind, info.message) == ("m/s²", "scalar", "expression")
    assert len(bench.rows()[0]) == 100
    for _ in range(20):
        bench.send(7)
    arrival, time, values = bench.rows()
    assert len(values) == 240
    np.testing.assert_allclose(values, 5.0)
    np.testing.assert_allclose(np.diff(time), 0.01, atol=1e-6)
    np.testing.assert_allclose(arrival, time + 0.01, atol=1e-6)


def test_a_long_past_comes_step_by_step(tmp_path: Path) -> None:
    bench = DerivedBench(tmp_path)
    bench.send(5000)
    bench.derived.put(bench.device, TOTAL)
    assert len(bench.rows()[0]) == 1000
    for _ in range(5):
        bench.send(1)
    assert len(bench.rows()[0]) == 5005
    np.testing.assert_allclose(np.diff(bench.rows()[1]), 0.01, atol=1e-6)


def test_a_definition_survives_a_restart_with_another_id_and_waits_for_samples(tmp_path: Path) -> None:
    first = DerivedBench(tmp_path)
    first.send(100)
    first.derived.put(first.device, TOTAL)
    again = DerivedBench(tmp_path, number="4")
    assert again.channels() == []
    again.send(5)
    problem = again.derived.problem("4", "Total")
    assert problem is not None
    assert "not known yet" in problem.message
    again.now += 2
    again.send(100)
    again.now += 2
    again.send(1)
    assert len(again.rows()[0]) >= 101
    assert again.derived.problem("4", "Total") is None


def test_another_expression_replaces_the_channel_and_removal_ends_it(bench: DerivedBench, tmp_path: Path) -> None:
    bench.derived.put(bench.device, SignalDefinition("Total", "Acceleration > 3.5 m/s²"))
    [info] = bench.channels()
    assert (info.unit, [column.name for column in info.columns]) == ("", ["x", "y", "z"])
    bench.send(10)
    assert [column[-1] for column in bench.rows()[2:]] == [0, 1, 0]
    bench.derived.remove(bench.device, "Total")
    assert bench.channels() == []
    bench.send(10)
    with pytest.raises(DomainError, match="not found"):
        bench.derived.remove(bench.device, "Total")
    assert SignalDefinitions(tmp_path).of(bench.device) == ()


def test_a_mistake_stores_nothing_and_leaves_the_signal_of_that_name(bench: DerivedBench, tmp_path: Path) -> None:
    with pytest.raises(ExpressionError, match="character 6"):
        bench.derived.put(bench.device, SignalDefinition("Total", "norm(Speed)"))
    for name in ("", "a/b", "a.b", " a", "x" * 61, "Acceleration"):
        with pytest.raises(DomainError) as caught:
            bench.derived.put(bench.device, SignalDefinition(name, "norm(Acceleration)"))
        assert caught.value.kind == "name"
    assert SignalDefinitions(tmp_path).of(bench.device) == (TOTAL,)
    bench.send(10)
    assert len(bench.rows()[0]) == 110


def test_a_new_rate_begins_again_on_the_same_channel(tmp_path: Path) -> None:
    bench = DerivedBench(tmp_path)
    bench.send(200)
    bench.derived.put(bench.device, SignalDefinition("Smooth", "mean(Acceleration.x, 1 s)"))
    before = bench.channels("Smooth")
    for _ in range(12):
        bench.send(100, rate=400.0)
    assert bench.channels("Smooth") == before
    _arrival, _, values = bench.rows("Smooth")
    assert len(values) == 200 + 1200
    np.testing.assert_allclose(values, 3.0)


def test_signals_use_each_other_and_follow(bench: DerivedBench) -> None:
    bench.derived.put(bench.device, SignalDefinition("Twice", "Total + Acceleration.x"))
    bench.derived.put(bench.device, SignalDefinition("Last", "mean(Twice, 100 ms)"))
    for _ in range(10):
        bench.send(7)
    for name, value in (("Twice", 8.0), ("Last", 8.0)):
        _, time, values = bench.rows(name)
        assert len(values) == 170
        np.testing.assert_allclose(values, value)
        np.testing.assert_allclose(np.diff(time), 0.01, atol=1e-6)


def test_what_uses_a_signal_that_is_edited_begins_again(bench: DerivedBench) -> None:
    bench.derived.put(bench.device, SignalDefinition("Twice", "2 * Total"))
    bench.derived.put(bench.device, SignalDefinition("Four", "2 * Twice"))
    bench.derived.put(bench.device, SignalDefinition("Total", "Acceleration.x * 1 s"))
    bench.send(10)
    assert [info.unit for info in bench.channels("Four")] == ["m/s"]
    np.testing.assert_allclose(bench.rows("Four")[2], 12.0)
    bench.derived.put(bench.device, SignalDefinition("Four", "Twice + 1 m/s"))
    bench.derived.put(bench.device, SignalDefinition("Total", "Acceleration.x"))
    problem = bench.derived.problem("1", "Four")
    assert problem is not None
    assert "cannot be added" in problem.message
    assert bench.channels("Four") == []
    assert [info.unit for info in bench.channels("Twice")] == ["m/s²"]


def test_a_signal_that_would_use_itself_is_refused_with_the_way(bench: DerivedBench, tmp_path: Path) -> None:
    bench.derived.put(bench.device, SignalDefinition("Mid", "2 * Total"))
    bench.derived.put(bench.device, SignalDefinition("End", "Mid / 2"))
    with pytest.raises(DomainError, match="“Total” uses “End” uses “Mid” uses “Total”"):
        bench.derived.put(bench.device, SignalDefinition("Total", "End + Acceleration.x"))
    with pytest.raises(DomainError, match="“Total” uses “Total”"):
        bench.derived.put(bench.device, SignalDefinition("Total", "Total.value + Acceleration.x"))
    assert SignalDefinitions(tmp_path).of(bench.device)[0] == TOTAL


def test_nothing_is_kept_of_the_signals_of_a_device_that_was_removed(bench: DerivedBench) -> None:
    """The reason that a signal was not computed stayed, with what the attempt had looked at."""
    bench.derived.definitions.put(bench.device, SignalDefinition("Other", "norm(Nothing)"))
    bench.derived._sweep()
    assert bench.derived.problem("1", "Other") is not None
    bench.telemetry.bus.remove_device("1")
    assert not bench.derived._problems
    assert not bench.derived._running


def test_a_signal_that_others_use_is_not_removed(bench: DerivedBench) -> None:
    bench.derived.put(bench.device, SignalDefinition("Mid", "2 * Total"))
    bench.derived.put(bench.device, SignalDefinition("End", "Total / 2"))
    with pytest.raises(DomainError, match="Total cannot be removed: “Mid”, “End” use it") as caught:
        bench.derived.remove(bench.device, "Total")
    assert caught.value.kind == "busy"
    for name in ("Mid", "End", "Total"):
        bench.derived.remove(bench.device, name)
    assert bench.derived.definitions.of(bench.device) == ()


def test_those_that_use_others_are_computed_again_after_a_restart(tmp_path: Path) -> None:
    first = DerivedBench(tmp_path)
    first.send(100)
    first.derived.put(first.device, TOTAL)
    first.derived.put(first.device, SignalDefinition("Mid", "2 * Total"))
    first.derived.put(first.device, SignalDefinition("Total", "norm(Acceleration) * 2"))
    again = DerivedBench(tmp_path, number="4")
    for _ in range(5):
        again.send(100)
        again.now += 2
    np.testing.assert_allclose(again.rows("Mid")[2], 20.0)


def test_signals_of_two_devices_are_one_expression(tmp_path: Path) -> None:
    bench = DerivedBench(tmp_path)
    bench.telemetry.bus.set_device(device("2", "0080A1B3"))
    info = wire.ChannelInfo(
        0, "2", "M", "Level", "Level", "scalar", "m/s²", "", [wire.ColumnInfo("value", "f8", "m/s²")]
    )
    other = bench.telemetry.bus.advertise(info)

    def both() -> None:
        time = bench.now + 0.0031 + np.arange(20) / 40
        bench.send(50)
        bench.telemetry.bus.publish([ChannelRows(other, [time + 0.01, time, 1 + (time - BEGIN)])])

    for _ in range(4):
        both()
    text = 'resample(Acceleration.x, 50 Hz) - resample(shift("2/Level", 20 ms), 50 Hz)'
    bench.derived.put(bench.device, SignalDefinition("Between", text))
    for _ in range(8):
        both()
    _, time, values = bench.rows("Between")
    known = np.isfinite(values)
    assert known.sum() > 200
    np.testing.assert_allclose(values[known], 3 - (1 + time[known] - 0.02 - BEGIN), atol=1e-5)


def test_removing_the_device_ends_its_signals(bench: DerivedBench, tmp_path: Path) -> None:
    bench.telemetry.bus.remove_device("1")
    assert bench.telemetry.store.all == []
    assert SignalDefinitions(tmp_path).of(bench.device) == (TOTAL,)


@each_row("text", ["", "[]", "{", '{"xbus-0080A1B2": 3}', '{"xbus-0080A1B2": [{"name": "a/b"}, 5]}'])
def test_an_unreadable_file_counts_as_absent(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE).write_text(text)
    definitions = SignalDefinitions(tmp_path)
    assert definitions.of(device()) == ()
    definitions.put(device(), TOTAL)
    assert json.loads((tmp_path / FILE).read_text())["xbus-0080A1B2"][0]["name"] == "Total"


@pytest.fixture
def running(tmp_path: Path) -> Iterator[InProcessServer]:
    with InProcessServer(Config(data=tmp_path, sources=("/dev/one",)), FakeLink) as running:
        yield running


def test_over_http(running: InProcessServer) -> None:
    client, bus = running.client, running.services.telemetry.bus
    info = wire.ChannelInfo(0, "7", "M", "Line", "Line", "scalar", "m", "", [wire.ColumnInfo("y", "f8", "m")])
    times = bus.now() - 1 + np.arange(100) / 100

    def begin() -> None:
        bus.set_device(device("7"))
        bus.publish([ChannelRows(bus.advertise(info), [times, times, times - times[0]])])

    running.call(begin)
    words = client.get("/api/signals/words").json()
    assert {"name": "norm", "form": "norm(v)", "doc": "Length of a vector."} in words["functions"]
    assert "m" in words["units"]
    url = "/api/devices/7/signals"
    made = client.put(f"{url}/Speed of it", json={"expression": "derivative(Line)"})
    assert made.json() == {
        "name": "Speed of it",
        "expression": "derivative(Line)",
        "unit": "m/s",
        "message": "",
        "hint": "",
    }
    assert client.get(url).json() == [made.json()]
    problem = assert_problem(client.put(f"{url}/Bad", json={"expression": "norm(Lin)"}), 422, "bad-expression")
    assert "character 6" in problem["message"]
    assert_problem(client.put("/api/devices/9/signals/Bad", json={"expression": "Line"}), 404, "not-found")
    assert client.delete(f"{url}/Speed of it").status_code == 204
    assert_problem(client.delete(f"{url}/Speed of it"), 404, "not-found")


def test_the_preview_takes_signals_of_several_devices(running: InProcessServer) -> None:
    client, bus = running.client, running.services.telemetry.bus
    times = bus.now() - 1 + np.arange(100) / 100

    def begin() -> None:
        for number, slope in (("7", 1.0), ("8", 3.0)):
            bus.set_device(device(number, f"0080A1B{number}"))
            columns = [wire.ColumnInfo("y", "f8", "m")]
            info = wire.ChannelInfo(0, number, "M", f"Line{number}", "Line", "scalar", "m", "", columns)
            bus.publish([ChannelRows(bus.advertise(info), [times, times, slope * (times - times[0])])])

    running.call(begin)
    body = {"source": "7", "t0": None, "t1": None, "options": {}}
    text = '(shift("8/Line8", 0.1 s) - Line7)'
    [result] = client.post("/api/analysis/expression", json={**body, "signals": [text]}).json()
    values = np.array(result["figures"]["values"])
    assert result["units"]["values"] == "m"
    np.testing.assert_allclose(values[np.isfinite(values)][-1], 3 * 0.89 - 0.99, atol=1e-6)
    unnamed = client.post("/api/analysis/expression", json={**body, "signals": ["(Line8 - Line7)"]})
    assert_problem(unnamed, 422, "bad-expression")  # as saving it would be
