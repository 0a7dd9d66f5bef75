"""Expressions batch by batch: in whatever pieces samples come, the result is that of everything at once."""

import contextlib
import itertools
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import Unit
from imuscope.server import wire
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.expression_functions import FUNCTIONS, Context
from imuscope.server.extensions.analysis.expressions.expression_syntax import ExpressionError, parse
from imuscope.server.extensions.analysis.expressions.expressions import evaluate
from imuscope.server.extensions.analysis.expressions.live_expression import LiveExpression, usual_rate
from imuscope.server.extensions.analysis.expressions.live_streams import WAIT_S, Piece
from imuscope.server.extensions.analysis.signals.quantities import Quantity
from imuscope.server.extensions.analysis.signals.signals import columns_named
from tests.support.deep_run import some
from tests.support.each_row import each_row

RATES = {1: 100.0, 2: 40.0, 3: 100.0, 4: 100.0}
N = 600
BEGIN = 1_760_000_000.0
DRAW = np.random.default_rng(7)


def info(number: int, name: str, unit: str, names: Sequence[str], period: float = 0.0) -> wire.ChannelInfo:
    columns = [wire.ColumnInfo(one, "f8", unit, period=period) for one in names]
    return wire.ChannelInfo(number, "1", "M", name, name, "vector", unit, "", columns)


INFOS = [
    info(1, "Acceleration", "m/s²", "xyz"),
    info(2, "Speed", "m/s", ["value"]),
    info(3, "Yaw", "°", ["value"], 360.0),
    info(4, "Turn", "", ["w", "x", "y", "z"]),
]


def stream(number: int, columns: int, *, gaps: bool = False) -> list[Floats]:
    """Arrival, time and columns of a channel: even times, with gaps and missing values if wanted."""
    rate = RATES[number]
    index = np.arange(round(N * rate / 100))
    if gaps:
        index = np.concatenate((index[: len(index) // 3], index[len(index) // 3 + 9 :]))
    time = BEGIN + 0.003 * (number - 1) * (number == 2) + index / rate
    values = [np.cumsum(DRAW.normal(0, 1, len(index))) for _ in range(columns)]
    if gaps:
        values[0][50:53] = np.nan
    return [time + 0.02, time, *values]


def samples(*, gaps: bool = False) -> dict[int, list[Floats]]:
    results = {1: stream(1, 3, gaps=gaps), 2: stream(2, 1), 3: stream(3, 1, gaps=gaps), 4: stream(4, 4)}
    norm = np.linalg.norm(results[4][2:], axis=0)
    results[4][2:] = [part / norm for part in results[4][2:]]
    results[3][2] = (np.arange(len(results[3][2])) * 7.0 + 180) % 360 - 180
    return results


EVEN, GAPPY = samples(), samples(gaps=True)


def at_once(text: str, rows: Mapping[int, Sequence[Floats]]) -> Quantity:
    def resolve(name: str) -> Quantity:
        columns = columns_named(INFOS, [name])
        own = [one.info.columns[one.at] for one in columns]
        _, time, *values = rows[columns[0].info.id]
        names = tuple(one.name for one in own) if len(own) > 1 else ("",)
        parts = tuple(values[one.at] for one in columns)
        return Quantity(parts, Unit.parse(own[0].unit), time, names, own[0].period)

    return evaluate(parse(text), resolve, Context(zero_phase=False))


def in_pieces(text: str, rows: Mapping[int, Sequence[Floats]], cuts: Sequence[float]) -> tuple[LiveExpression, Piece]:
    """All samples in the order of their arrival, in batches that end at these shares of the whole."""
    live = LiveExpression(INFOS, text, RATES)
    ends = [BEGIN + share * (N / 100 + 1) for share in sorted(cuts)]
    results: list[Piece] = []
    for low, high in zip([-np.inf, *ends], [*ends, np.inf], strict=True):
        batch: dict[int, Sequence[Any]] = {}
        for number, columns in rows.items():
            some = (columns[0] > low) & (columns[0] <= high)
            if some.any():
                batch[number] = [column[some] for column in columns]
        results.append(live.feed(batch))
    results.append(live.finish())
    whole = results[0]
    for piece in results[1:]:
        whole = whole.then(piece)
    return live, whole


TEXTS = [
    "norm(Acceleration) - 1 g",
    "norm(Acceleration) > 2 g and not Acceleration.x < 0",
    "cross(Acceleration, shift(Acceleration, 15 ms))",
    "rotate(Turn, Acceleration)",
    "euler(Turn)",
    "derivative(Acceleration)",
    "derivative(Speed) + Acceleration.x",
    "Acceleration.x * Speed",
    "Speed > 1 m/s and Acceleration.x > 0",
    "derivative(Yaw)",
    "unwrap(Yaw) - Yaw",
    "integral(Acceleration.x)",
    "mean(Acceleration, 200 ms)",
    "rms(Acceleration.y, 0.5 s)",
    "min(Acceleration.z, 30 ms) + max(Acceleration.z, 1 s)",
    "lowpass(Acceleration, 10 Hz)",
    "highpass(norm(Acceleration), 2 Hz, 3)",
    "bandpass(Acceleration.x, 2 Hz, 12 Hz)",
    "lowpass(Yaw, 3 Hz)",
    "Acceleration.x - shift(Acceleration.x, 20 ms)",
    "resample(Acceleration, 33 Hz)",
    "rms(derivative(lowpass(Acceleration.x, 20 Hz)), 100 ms) / (1 m/s³)",
    "lowpass(Speed, 5 Hz) + integral(Acceleration.x)",
    "atan2(Acceleration.y, Acceleration.x) + sin(Yaw) * 1 deg",
    "sqrt(abs(Acceleration.x)) + exp(Speed / (10 m/s)) * sqrt(1 m/s²)",
]
CUTS = st.lists(st.floats(0, 1), max_size=30)


@cache
def expected_of(text: str, kind: str) -> Quantity:
    return at_once(text, EVEN if kind == "even" else GAPPY)


@each_row("kind", ["even", "gaps"])
@each_row("text", TEXTS)
@settings(max_examples=5, deadline=None)
@given(cuts=CUTS)
def test_pieces_give_what_everything_at_once_gives(text: str, kind: str, cuts: list[float]) -> None:
    rows = EVEN if kind == "even" else GAPPY
    live, result = in_pieces(text, rows, cuts)
    expected = expected_of(text, kind)
    assert expected.time is not None
    assert (live.unit, live.probe.names) == (str(expected.unit), expected.names)
    np.testing.assert_allclose(result.time, expected.time, rtol=0, atol=1e-6)
    for part, target in zip(result.parts, expected.parts, strict=True):
        np.testing.assert_allclose(part, target, rtol=1e-6, atol=1e-6 * (1 + np.nanmax(np.abs(target))))


def test_every_function_is_in_a_case() -> None:
    assert {name for name in FUNCTIONS if not any(f"{name}(" in text for text in TEXTS)} <= {
        *("dot", "log", "log10", "cos", "tan", "asin", "acos")  # of one moment, as the others beside them
    }


def test_mistakes_are_marked_where_they_are() -> None:
    for text, place in (
        ("Acceleration + Speed", (0, 20)),
        ("1 + Nothing.x", (4, 13)),
        ("lowpass(Acceleration, 80 Hz)", (22, 27)),
        ("mean(Acceleration, 1 h)", (19, 22)),
        ("smooth(Acceleration)", (0, 20)),
    ):
        with pytest.raises(ExpressionError) as caught:
            LiveExpression(INFOS, text, RATES)
        assert (caught.value.begin, caught.value.end) == place, text


def test_an_expression_without_a_signal_or_with_an_unknown_rate_is_refused() -> None:
    with pytest.raises(DomainError, match="names no signal"):
        LiveExpression(INFOS, "1 + 2", RATES)
    with pytest.raises(ExpressionError, match="rate of Speed is not known"):
        LiveExpression(INFOS, "Speed * 2", {2: 0.0})


def test_a_silent_signal_holds_the_others_up_for_a_while_only() -> None:
    live = LiveExpression(INFOS, "Acceleration.x * Speed", RATES)
    columns = EVEN[1]
    assert len(live.feed({1: [column[:100] for column in columns]})) == 0
    result = live.feed({1: [column[100:] for column in columns]})
    assert result.time[-1] == pytest.approx(columns[1][-1] - WAIT_S, abs=0.02)
    assert np.isnan(result.parts[0]).all()


def test_times_never_step_back() -> None:
    live = LiveExpression(INFOS, "Acceleration.x", RATES)
    ones = [np.ones(3)] * 3
    live.feed({1: [np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]), *ones]})
    result = live.feed({1: [np.array([4.0, 5.0, 6.0]), np.array([2.5, np.nan, 5.5]), *ones]})
    assert result.time.tolist() == [3.0, 5.0, 5.5]


def test_the_usual_rate_ignores_gaps_and_needs_some_samples() -> None:
    time = np.concatenate((np.arange(100), 500 + np.arange(100))) / 200
    assert usual_rate(time) == pytest.approx(200)
    assert usual_rate(time[:10]) == 0


@each_row(
    ("text", "words", "hint"),
    [
        ("resample(Speed, 5e4 Hz)", "50000 samples per second are too many", "At most 20000 Hz"),
        ("resample(Acceleration, 1e4 Hz)", "10000 samples per second of 3 columns", "At most 6666.67 Hz"),
        ("resample(resample(Speed, 1e6 Hz), 10 Hz)", "1e+06 samples per second", "At most 20000 Hz"),
        ("mean(Acceleration, 700 s)", "windows of 210 000 samples", "At most 200 000 samples"),
        ("mean(Yaw, 1500 s) + max(Yaw, 600 s)", "windows of 210 000 samples", "At most 200 000 samples"),
        (f"abs({'+'.join(['Speed'] * 110)}) + abs({'+'.join(['Speed'] * 110)})", "More than 200 operators", "Divide"),
        ("Speed^9999999", "to the power of 1e+07 is not allowed", "At most 100"),
        ("Speed**1e308", "to the power of 1e+308 is not allowed", "At most 100"),
        ("((Speed^9)^9)^9", "to the power of 729 is not allowed", "At most 100"),
    ],
)
def test_an_expression_that_costs_too_much_is_refused_with_the_figure_and_the_limit(
    text: str, words: str, hint: str
) -> None:
    with pytest.raises(ExpressionError, match=re.escape(words)) as refused:
        LiveExpression(INFOS, text, RATES)
    assert hint in refused.value.hint


def test_a_clock_that_jumps_does_not_fill_the_memory_with_resampled_samples() -> None:
    live = LiveExpression(INFOS, "resample(Speed, 1000 Hz)", RATES)
    time = BEGIN + np.arange(10) / 40
    late = time + 1e9
    pieces = [live.feed({2: [one, one, np.ones(10)]}) for one in (time, late, late + 0.25)]
    assert sum(map(len, pieces)) < 3000
    times = np.concatenate([one.time for one in pieces])
    assert (np.diff(times) > 0).all()
    assert times[-1] == pytest.approx(late[-1] + 0.25, abs=0.001)
    assert np.isnan(pieces[1].parts[0][1:1000]).all()
    assert np.isfinite(pieces[2].parts[0]).all()


EXTREMES = ("0", "5e-324", "1e-300", "1e-9", "0.5", "1", "8", "50", "86400", "1e6", "1e300", "1e999", "-1", "-1e308")
UNUSUAL: Mapping[str, Floats] = {
    "no sample": np.empty(0),
    "one sample": np.array([BEGIN]),
    "one time": np.full(20, BEGIN),
    "a step of 0.2 µs": BEGIN + np.arange(20) * 2.4e-7,
    "a gap": BEGIN + np.array([*range(20), *range(300, 320)]) / 100,
}


def calls_with_extremes(name: str) -> list[str]:
    """Calls of a function with a signal and with extreme numbers of all kinds."""
    function = FUNCTIONS[name]
    numbers = [f"{one} {unit}".strip() for one in EXTREMES for unit in ("", "Hz", "s")]
    several = [f"{one} Hz" for one in ("1e-300", "1e-9", "1", "49", "1e300")]
    results = []
    for count in range(function.least, function.most + 1):
        rest = itertools.product(["x", *numbers] if count == 2 else several, repeat=min(count - 1, 2))
        orders = ["0", "1e-300", "3", "8", "1e300"] if count > 2 and name.endswith("pass") else [""]
        results += [
            f"{name}({', '.join(['x', *words, *filter(None, [order])][:count])})" for words in rest for order in orders
        ]
    return list(dict.fromkeys(results))


class Causal:
    """A context of live data that knows whether a function has asked: if not, that of recordings gives the same."""

    budget = None
    whole_windows = False

    def __init__(self) -> None:
        self.was_requested = False

    @property
    def zero_phase(self) -> bool:
        self.was_requested = True
        return False


@each_row("name", sorted(FUNCTIONS))
def test_extreme_arguments_are_computed_or_refused_in_words(name: str) -> None:
    for text in some(calls_with_extremes(name), 4):
        parsed = parse(text)
        for time in UNUSUAL.values():
            for fill in (1.0, np.nan, np.inf, 1e308):
                values = np.where(np.arange(len(time)) % 3 == 1, fill, 1.0)
                x = Quantity((values,), Unit.parse("°" if name == "unwrap" else ""), time)
                live_context: Any = Causal()
                with contextlib.suppress(ExpressionError):
                    evaluate(parsed, lambda _: x, live_context)  # noqa: B023
                if live_context.was_requested:
                    with contextlib.suppress(ExpressionError):
                        evaluate(parsed, lambda _: x, Context(zero_phase=True))  # noqa: B023
        for rate, samples in ((1e-4, 4), (100.0, 20), (2000.0, 20)):
            with contextlib.suppress(ExpressionError):
                live = LiveExpression([info(1, "x", "", ["value"])], text, {1: rate})
                time = BEGIN + np.arange(samples) / rate
                live.feed({1: [time, time, np.full(samples, 1e308)]})
