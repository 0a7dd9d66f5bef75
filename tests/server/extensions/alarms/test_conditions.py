"""Conditions of alarms: units, vectors, several channels, flags, mistakes with their place."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms.conditions import ExpressionJudge, FlagJudge
from imuscope.server.extensions.alarms.definitions import ExpressionCondition, FlagCondition
from imuscope.server.extensions.alarms.machine import BETWEEN, BEYOND, UNKNOWN, WITHIN
from imuscope.server.extensions.analysis.expressions.expression_functions import FUNCTIONS
from imuscope.server.extensions.analysis.expressions.expression_syntax import ExpressionError
from imuscope.server.wire import BitsInfo, ChannelInfo, ColumnInfo
from tests.support.each_row import each_row

G = 9.80665


def channel(number: int, name: str, unit: str, *columns: str) -> ChannelInfo:
    infos = [ColumnInfo(column, "f8", unit) for column in columns]
    return ChannelInfo(number, "1", name, name, name, "vector", unit, "", infos)


ACCELERATION = channel(1, "Acceleration", "m/s²", "x", "y", "z")
RATE = channel(2, "RateOfTurn", "°/s", "x", "y", "z")
TEMPERATURE = channel(3, "Temperature", "°C", "value")
STATUS = ChannelInfo(
    4,
    "1",
    "StatusWord",
    "StatusWord",
    "Status",
    "status",
    "",
    "",
    [ColumnInfo("value", "u4", bits=[BitsInfo("SelfTest", 0, 1), BitsInfo("Fix", 3, 2)])],
)
ALL = [ACCELERATION, RATE, TEMPERATURE, STATUS]
RATES = {1: 100.0, 2: 40.0, 3: 100.0, 4: 100.0}


def judge(expression: str, clear: str = "", missing_s: float = 3.0) -> ExpressionJudge:
    return ExpressionJudge(ExpressionCondition(expression=expression, clear=clear), ALL, missing_s, RATES)


def rows(time: Sequence[float], *columns: Sequence[float]) -> list[np.ndarray]:
    return [np.array(time, float), np.array(time, float), *(np.array(column, float) for column in columns)]


def test_a_limit_in_another_unit_and_a_lower_one_to_clear() -> None:
    one = judge("norm(Acceleration) > 3 g", clear="2.5 g")
    size = np.array([2.4, 2.6, 3.1, 2.6, 2.4]) * G
    time, codes, values = one.judge({1: rows(range(5), size, size * 0, size * 0)})
    assert codes.tolist() == [WITHIN, BETWEEN, BEYOND, BETWEEN, WITHIN]
    assert time.tolist() == [0, 1, 2, 3, 4]
    assert values.tolist() == size.tolist()
    assert (one.unit, one.limit, one.direction) == ("m/s²", pytest.approx(3 * G), 1)
    assert one.subject.strip() == "norm(Acceleration)"


def test_a_limit_on_the_left_is_the_same_condition() -> None:
    one = judge("-10 °C > Temperature", clear="-8 °C")
    _, codes, _ = one.judge({3: rows(range(3), [-11, -9, -7])})
    assert codes.tolist() == [BEYOND, BETWEEN, WITHIN]
    assert (one.direction, one.limit) == (-1, -10)


def test_one_column_of_a_vector_is_enough_and_the_worst_value_is_reported() -> None:
    one = judge("Acceleration > 1 g")
    _, codes, values = one.judge({1: rows(range(2), [0, 1], [20, 2], [0, 3])})
    assert codes.tolist() == [BEYOND, WITHIN]
    assert values.tolist() == [20, 3]


def test_what_cannot_be_determined_is_unknown() -> None:
    one = judge("Acceleration > 1 g")
    _, codes, _ = one.judge({1: rows(range(3), [math.nan, 1, math.nan], [20, 2, 3], [0, 3, 3])})
    assert codes.tolist() == [BEYOND, WITHIN, UNKNOWN]


def test_a_combination_is_its_own_limit() -> None:
    one = judge("Acceleration.x > 1 g and Acceleration.y < 0 m/s²")
    _, codes, values = one.judge({1: rows(range(2), [20, 20], [-1, 1], [0, 0])})
    assert codes.tolist() == [BEYOND, WITHIN]
    assert np.isnan(values).all()
    assert math.isnan(one.limit)


@given(st.lists(st.integers(1, 7), min_size=1, max_size=8), st.lists(st.integers(1, 7), min_size=1, max_size=8))
def test_two_channels_give_the_same_however_they_arrive(first: list[int], second: list[int]) -> None:
    """Every sample of both is judged once, in order, whichever channel comes sooner and in whatever batches."""
    a_time, r_time = np.arange(40) * 0.1, np.arange(25) * 0.16
    a = rows(a_time.tolist(), np.sin(a_time * 3) * 20, a_time * 0, a_time * 0)
    r = rows(r_time.tolist(), np.cos(r_time * 2) * 50, r_time * 0, r_time * 0)
    text = "Acceleration.x > 1 g and RateOfTurn.x < 10 °/s"
    whole = judge(text).judge({1: a, 2: r})
    one, parts, at, turn = judge(text), [], [0, 0], 0
    while at[0] < len(a_time) or at[1] < len(r_time):
        given_now = {}
        for k, (data, sizes) in enumerate(((a, first), (r, second))):
            size = sizes[turn % len(sizes)]
            if at[k] < len(data[0]):
                given_now[k + 1] = [column[at[k] : at[k] + size] for column in data]
                at[k] += size
        turn += 1
        parts.append(one.judge(given_now))
    time, codes = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    assert time.tolist() == whole[0].tolist()
    assert codes.tolist() == whole[1].tolist()
    horizon = min(a_time[-1], r_time[-1])
    assert time.tolist() == np.unique([t for t in [*a_time, *r_time] if t <= horizon]).tolist()


def test_nothing_is_interpolated_across_a_gap() -> None:
    one = judge("Acceleration.x > 1 g and RateOfTurn.x < 10 °/s", missing_s=0.5)
    slow = rows([0, 0.1, 2.0], [20, 20, 20], [0, 0, 0], [0, 0, 0])
    quick = rows([0, 0.1, 1.0, 2.0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0])
    time, codes, _ = one.judge({1: slow, 2: quick})
    assert dict(zip(time.tolist(), codes.tolist(), strict=True)) == {0: BEYOND, 0.1: BEYOND, 1: UNKNOWN, 2: BEYOND}


def test_a_flag_is_set_or_clear() -> None:
    word = [0b1, 0b10, 0b1000, 0b1001]
    _, codes, _ = FlagJudge(FlagCondition(kind="flag", signal="StatusWord", flag="SelfTest"), ALL).judge(
        {4: rows(range(4), word)}
    )
    assert codes.tolist() == [BEYOND, WITHIN, WITHIN, BEYOND]
    _, codes, values = FlagJudge(FlagCondition(kind="flag", signal="StatusWord", flag="Fix", is_set=False), ALL).judge(
        {4: rows(range(4), word)}
    )
    assert codes.tolist() == [BEYOND, BEYOND, WITHIN, WITHIN]
    assert values.tolist() == [0, 0, 1, 1]
    with pytest.raises(DomainError, match="no flag Nothing"):
        FlagJudge(FlagCondition(kind="flag", signal="StatusWord", flag="Nothing"), ALL)


@each_row(
    ("text", "marked"),
    [
        ("norm(Acceleration) > 3 °/s", "norm(Acceleration) > 3 °/s"),
        ("norm(Acceleration) > ", ""),
        ("norm(Speed) > 3 g", "Speed"),
        ("norm(Acceleration)", "norm(Acceleration)"),
        ("1 g > 3 g", "1 g > 3 g"),
        ("1 g < lowpass(Acceleration.x, 60 Hz)", "60 Hz"),
        ("derivative(Acceleration.x) > 1 g", "derivative(Acceleration.x) > 1 g"),
        ("nrom(Acceleration) > 3 g", "nrom(Acceleration)"),
    ],
)
def test_a_mistake_has_its_place(text: str, marked: str) -> None:
    with pytest.raises(ExpressionError) as error:
        judge(text)
    assert text[error.value.begin : error.value.end] == marked
    assert error.value.message.endswith(")")


@each_row("clear", ["3.5 g", "2 °/s", "Temperature", "2 g +", "1"])
def test_a_limit_to_clear_has_to_fit(clear: str) -> None:
    with pytest.raises(DomainError, match=r"[Ll]imit to clear"):
        judge("norm(Acceleration) > 3 g", clear=clear)


def test_a_limit_to_clear_needs_one_comparison() -> None:
    with pytest.raises(DomainError, match="single comparison"):
        judge("Acceleration.x > 1 g and Temperature > 3 °C", clear="1 g")


def test_every_function_is_judged_alike_in_pieces() -> None:
    """The same samples in other batches may not give other values."""
    time = np.arange(400) * 0.01
    values = rows(time.tolist(), np.sin(time * 20), np.cos(time * 20), time * 0)
    arguments = {
        "dot": "Acceleration, Acceleration",
        "cross": "Acceleration, Acceleration",
        "atan2": "Acceleration.x, Acceleration.y",
        **dict.fromkeys(("exp", "log", "log10", "sin", "cos", "tan", "asin", "acos"), "Acceleration.x / (1 m/s²)"),
        **dict.fromkeys(("mean", "rms", "min", "max", "shift"), "Acceleration.x, 1 s"),
        **dict.fromkeys(("lowpass", "highpass", "resample"), "Acceleration.x, 1 Hz"),
        "bandpass": "Acceleration.x, 1 Hz, 2 Hz",
        "unwrap": "Acceleration.x * (1 °/(1 m/s²))",
    }
    for name in sorted({*FUNCTIONS} - {"rotate", "euler"}):  # of quaternions, by sample
        text = f"{name}({arguments.get(name, 'Acceleration.x')}) > 0"
        one, whole = judge(text), judge(text).judge({1: values})
        parts = [one.judge({1: [column[k : k + 7] for column in values]}) for k in range(0, 400, 7)]
        assert np.concatenate([part[1] for part in parts]).tolist() == whole[1].tolist(), text
        assert len(whole[0]) > 3, text
