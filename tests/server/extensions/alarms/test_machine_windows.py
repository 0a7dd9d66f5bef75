"""Conditions with filters and windows: in whatever pieces samples come, judged as all of them at once."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import Unit
from imuscope.server.extensions.alarms.conditions import ExpressionJudge
from imuscope.server.extensions.alarms.definitions import AlarmDefinition, ExpressionCondition
from imuscope.server.extensions.alarms.instance import AlarmState
from imuscope.server.extensions.alarms.machine import BETWEEN, BEYOND, UNKNOWN, WITHIN
from imuscope.server.extensions.alarms.service import RATES_EVERY, AlarmService
from imuscope.server.extensions.analysis.expressions.expression_functions import Context
from imuscope.server.extensions.analysis.expressions.expression_syntax import parse
from imuscope.server.extensions.analysis.expressions.expressions import evaluate
from imuscope.server.extensions.analysis.expressions.live_expression import RateUnknownError
from imuscope.server.extensions.analysis.signals.quantities import Quantity
from imuscope.server.extensions.analysis.signals.signals import columns_named
from imuscope.server.wire import ChannelInfo, ColumnInfo, DeviceInfo
from tests.support.each_row import each_row
from tests.support.live_signal import BEGIN, LiveSignal

RATE, N = 100.0, 900
DRAW = np.random.default_rng(11)


def info(number: int, name: str, unit: str, names: Sequence[str]) -> ChannelInfo:
    return ChannelInfo(
        number, "1", name, name, name, "vector", unit, "", [ColumnInfo(one, "f8", unit) for one in names]
    )


INFOS = [info(1, "Acceleration", "m/s²", "xyz"), info(2, "Speed", "m/s", ["value"])]
RATES = {1: RATE, 2: 25.0}


def recorded(*, gaps: bool) -> list[Floats]:
    """Arrival, time and columns of Acceleration; with a gap, and samples without a value, if wanted."""
    index = np.arange(N)
    if gaps:
        index = np.concatenate((index[:300], index[340:]))
    time = BEGIN + index / RATE
    columns = [np.cumsum(DRAW.normal(0, 1, len(index))) for _ in range(3)]
    if gaps:
        columns[0][500:503] = np.nan
    return [time + 0.02, time, *columns]


WHOLE, GAPPY = recorded(gaps=False), recorded(gaps=True)
SPEED = [BEGIN + np.arange(225) / 25 + 0.03, BEGIN + np.arange(225) / 25, np.cumsum(DRAW.normal(0, 1, 225))]

TEXTS = [
    ("mean(norm(Acceleration), 100 ms) > 1 g", "0.8 g"),
    ("rms(highpass(Acceleration.x, 2 Hz), 300 ms) > 1 m/s²", ""),
    ("lowpass(Acceleration, 5 Hz) > 0.5 g", "0.2 g"),
    ("0 > derivative(Acceleration.z)", ""),
    ("norm(Acceleration) > 1.1 * mean(norm(Acceleration), 1 s)", ""),
    ("max(Acceleration.x, 1 s) - min(Acceleration.x, 1 s) > 5 m/s² and Acceleration.y > 0", ""),
    ("integral(Acceleration.y) < -2 m/s", ""),
]
CUTS = st.lists(st.floats(0, 1), max_size=25)


def judge(text: str, clear: str = "") -> ExpressionJudge:
    return ExpressionJudge(ExpressionCondition(expression=text, clear=clear), INFOS, 3.0, RATES)


def in_pieces(one: ExpressionJudge, rows: dict[int, list[Floats]], cuts: Sequence[float]) -> list[np.ndarray]:
    """Time, codes and values of all samples, in batches of their arrival."""
    ends = [BEGIN + share * (N / RATE + 1) for share in sorted(cuts)]
    results = []
    for low, high in zip([-np.inf, *ends], [*ends, np.inf], strict=True):
        chosen = {number: (columns[0] > low) & (columns[0] <= high) for number, columns in rows.items()}
        results.append(one.judge({k: [part[some] for part in rows[k]] for k, some in chosen.items() if some.any()}))
    return [np.concatenate([piece[k] for piece in results]) for k in range(3)]


def truth(text: str, columns: list[Floats]) -> tuple[Floats, Floats]:
    """Times, and whether the condition holds, of everything at once without looking ahead."""

    def resolve(name: str) -> Quantity:
        own = columns_named(INFOS, [name])
        names = tuple(one.info.columns[one.at].name for one in own) if len(own) > 1 else ("",)
        return Quantity(tuple(columns[2 + one.at] for one in own), Unit.parse("m/s²"), columns[1], names)

    result = evaluate(parse(text), resolve, Context(zero_phase=False, whole_windows=True))
    assert result.time is not None
    parts = np.array(result.parts)
    known = np.where((parts == 1).any(axis=0), 1.0, parts.sum(axis=0))
    return result.time, known


@each_row("columns", [WHOLE, GAPPY], ids=["even", "gaps"])
@each_row(("text", "clear"), TEXTS)
@settings(max_examples=5, deadline=None)
@given(cuts=CUTS)
def test_pieces_are_judged_as_everything_at_once(
    text: str, clear: str, columns: list[Floats], cuts: list[float]
) -> None:
    time, codes, _ = in_pieces(judge(text, clear), {1: columns}, cuts)
    expected_time, expected = truth(text, columns)
    np.testing.assert_array_equal(time, expected_time[: len(time)])
    assert len(time) >= len(expected_time) - 1  # a derivative waits for the next sample
    expected = expected[: len(time)]
    assert (codes == BEYOND).tolist() == (expected == 1).tolist()
    assert (codes == UNKNOWN).tolist() == np.isnan(expected).tolist()
    assert clear or BETWEEN not in codes
    assert {BEYOND, WITHIN} <= {*codes.tolist()}


@settings(max_examples=15, deadline=None)
@given(cuts=CUTS)
def test_signals_of_two_channels_are_judged_alike_in_pieces(cuts: list[float]) -> None:
    text = "rms(Acceleration.x, 400 ms) > 1 m/s² and lowpass(Speed, 2 Hz) > 0"
    rows = {1: GAPPY, 2: SPEED}
    whole, pieces = in_pieces(judge(text), rows, []), in_pieces(judge(text), rows, cuts)
    assert pieces[0].tolist() == whole[0].tolist()
    assert pieces[1].tolist() == whole[1].tolist()
    assert {BEYOND, WITHIN} <= {*whole[1].tolist()}


def test_the_state_begins_again_after_a_gap() -> None:
    """A mean of 0.5 s takes no sample from before a gap, even if that is shorter than the window."""
    time = BEGIN + np.concatenate((np.arange(100), np.arange(130, 200))) / RATE
    high = np.where(np.arange(170) < 100, 20.0, 1.0)
    rows = [time, time, high, high * 0, high * 0]
    _, codes, values = judge("mean(Acceleration.x, 500 ms) > 1 g").judge({1: rows})
    assert codes.tolist() == [UNKNOWN] * 49 + [BEYOND] * 51 + [UNKNOWN] * 49 + [WITHIN] * 21
    known = codes != UNKNOWN
    np.testing.assert_allclose(values[known], high[known], atol=1e-9)


def test_the_limit_and_what_is_compared_with_it_are_reported() -> None:
    one = judge("1 g < rms(Acceleration.x, 200 ms)", "0.5 g")
    assert (one.subject, one.unit, one.direction) == ("rms(Acceleration.x, 200 ms)", "m/s²", 1)
    assert one.limit == pytest.approx(9.80665)
    assert [column.name for column in one.columns] == ["Acceleration.x"]
    assert one.rates == {1: RATE}
    assert judge("Acceleration.x > 1 g").rates == {}


def test_without_a_rate_a_window_cannot_be_judged() -> None:
    with pytest.raises(RateUnknownError, match="rate of Speed is not known"):
        ExpressionJudge(ExpressionCondition(expression="mean(Speed, 1 s) > 0"), INFOS, 3.0, {2: 0.0})


class AlarmBench(LiveSignal):
    """Alarms of one device that sends an acceleration along x."""

    def __init__(self, folder: Path) -> None:
        super().__init__(DeviceInfo("1", "MTi", "sim:xbus", "simulator", "live", protocol="xbus"), INFOS[0])
        self.alarms = AlarmService(self.telemetry.bus, self.telemetry.store, folder, cast(Any, None))
        self.alarms.turn()

    def send(self, n: int, value: float, rate: float = RATE) -> None:
        self.publish(n, rate, [np.full(n, value)] * 3)

    def state(self) -> AlarmState:
        """The state after some turns."""
        for _ in range(RATES_EVERY + 1):
            self.alarms.turn()
        [stored] = self.alarms.alarms
        [result] = self.alarms.states(stored.id)
        return result

    def add(self, expression: str) -> None:
        condition = ExpressionCondition(expression=expression)
        asyncio.run(self.alarms.add(AlarmDefinition(name="Shock", condition=condition)))


def test_an_alarm_waits_for_the_rate_and_is_judged_from_then_on(tmp_path: Path) -> None:
    bench = AlarmBench(tmp_path)
    bench.add("mean(Acceleration.x, 1 s) > 1 g")
    bench.send(5, 1.0)
    assert "rate of Acceleration is not known" in bench.state().problem
    bench.send(100, 1.0)
    assert bench.state().problem == ""
    bench.send(10, 1.0)
    assert bench.state().status == "ok"
    bench.send(100, 20.0)
    result = bench.state()
    assert (result.status, result.signals) == ("raised", ["Acceleration.x"])


def test_a_new_alarm_knows_the_past_but_is_not_raised_by_it(tmp_path: Path) -> None:
    """The mean of 10 s is that of memory: 0.1 s of other values do not make it."""
    bench = AlarmBench(tmp_path)
    bench.send(1000, 20.0)
    bench.add("mean(Acceleration.x, 10 s) > 1 g")
    assert bench.state().status == "missing"
    bench.send(10, 0.0)
    result = bench.state()
    assert result.status == "raised"
    assert result.raised_value == pytest.approx(20 * 999 / 1000)


def test_windows_begin_again_when_the_rate_changes(tmp_path: Path) -> None:
    bench = AlarmBench(tmp_path)
    bench.send(100, 1.0)
    bench.add("mean(Acceleration.x, 100 ms) > 1 g")
    for _ in range(6):
        bench.send(100, 1.0, rate=400.0)
        bench.state()
    bench.send(39, 20.0, rate=400.0)
    bench.state()
    bench.send(1, 1.0, rate=400.0)
    result = bench.state()
    assert result.value == pytest.approx((39 * 20 + 1) / 40)  # 40 samples are 100 ms now
