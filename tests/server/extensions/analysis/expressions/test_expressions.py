"""Expressions: syntax, units, functions against plain computations, and mistakes that are marked where they are."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal as scipy_signal

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import SYMBOLS, Unit
from imuscope.server import wire
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.expression_functions import FUNCTIONS, Context
from imuscope.server.extensions.analysis.expressions.expression_syntax import ExpressionError, parse
from imuscope.server.extensions.analysis.expressions.expressions import evaluate, notes_of
from imuscope.server.extensions.analysis.expressions.live_expression import LiveExpression
from imuscope.server.extensions.analysis.expressions.signal_request import ExpressionSignal, requested_signals
from imuscope.server.extensions.analysis.signals.quantities import Quantity
from imuscope.server.extensions.analysis.signals.signals import SignalColumn
from tests.support.each_row import each_row

RATE = 100.0
N = 400
TIME = 1_760_000_000.0 + np.arange(N) / RATE
DRAW = np.random.default_rng(1)
XYZ = ("x", "y", "z")


def vector(unit: str, time: Floats = TIME, names: tuple[str, ...] = XYZ, period: float = 0.0) -> Quantity:
    parts = tuple(DRAW.normal(0, 1, len(time)) for _ in names)
    return Quantity(parts, Unit.parse(unit), time, names if len(names) > 1 else ("",), period)


ACC, GYRO, FIELD = vector("m/s²"), vector("°/s"), vector("a.u.")
SLOW = vector("m/s", TIME[::10] + 0.003, ("",))
ANGLE = Quantity(((np.arange(N) * 7.0 + 180) % 360 - 180,), Unit.parse("°"), TIME, ("",), 360.0)
TURN = vector("", names=("w", "x", "y", "z"))
KNOWN: Mapping[str, Quantity] = {
    "Acceleration": ACC,
    **{f"Acceleration.{name}": Quantity((part,), ACC.unit, TIME) for name, part in zip(XYZ, ACC.parts, strict=True)},
    "RateOfTurn": GYRO,
    "RateOfTurn.z": Quantity((GYRO.parts[2],), GYRO.unit, TIME),
    "Field": FIELD,
    "Speed": SLOW,
    "Yaw": ANGLE,
    "Turn": TURN,
    "2/Rate of turn.z": Quantity((GYRO.parts[2],), GYRO.unit, TIME),
}


def resolve(name: str) -> Quantity:
    if name not in KNOWN:
        raise DomainError("not-found", f"Signal {name} not found.", "Channels: …")
    return KNOWN[name]


def value(text: str, *, zero_phase: bool = True) -> Quantity:
    return evaluate(parse(text), resolve, Context(zero_phase))


def one(text: str, **options: Any) -> Floats:
    [part] = value(text, **options).parts
    return part


x, y, z = ACC.parts
G = 9.80665


@each_row(
    ("text", "expected", "unit"),
    [
        ("Acceleration.x + Acceleration.y * 2", x + y * 2, "m/s²"),
        ("-Acceleration.x ^ 2", -(x**2), "m²/s⁴"),
        ("Acceleration.x / Acceleration.y", x / y, ""),
        ("Acceleration.x - 1 g", x - G, "m/s²"),
        ("1 g - Acceleration.x", G - x, "m/s²"),
        ("norm(Acceleration)", np.sqrt(x * x + y * y + z * z), "m/s²"),
        ("norm(Acceleration) > 0.2 g", np.sqrt(x * x + y * y + z * z) > 0.2 * G, ""),
        ("Acceleration.x > 0", x > 0, ""),
        (
            "Acceleration.x > 0 and not Acceleration.y > 0 or Acceleration.z >= 1 m/s²",
            (x > 0) & ~(y > 0) | (z >= 1),
            "",
        ),
        ("RateOfTurn.z * 2 s", GYRO.parts[2] * 2, "°"),
        ("RateOfTurn.z + 1 rad/s", GYRO.parts[2] + 180 / math.pi, "°/s"),
        ("dot(Acceleration, Field)", sum(a * b for a, b in zip(ACC.parts, FIELD.parts, strict=True)), "m·a.u./s²"),
        ("sqrt(Acceleration.x ^ 2)", np.abs(x), "m/s²"),
        ("2 ^ 3 ^ 2 * (Acceleration.x / (1 m/s²))", 512 * x, ""),
        ("sin(Yaw)", np.sin(np.radians(ANGLE.parts[0])), ""),
        ("atan2(Acceleration.y, Acceleration.x)", np.degrees(np.arctan2(y, x)), "°"),
        ('"2/Rate of turn.z" == RateOfTurn.z', np.ones(N), ""),
        ("abs(Acceleration.x)", np.abs(x), "m/s²"),
    ],
)
def test_values_and_units(text: str, expected: Floats, unit: str) -> None:
    result = value(text)
    assert result.parts[0] == pytest.approx(np.asarray(expected, float), rel=1e-12, abs=1e-12)
    assert str(result.unit) == unit
    assert result.time is TIME


def test_vectors() -> None:
    assert np.array(value("cross(Acceleration, RateOfTurn)").parts) == pytest.approx(
        np.cross(np.array(ACC.parts).T, np.array(GYRO.parts).T).T
    )
    w, i, j, k = (part / np.sqrt(sum(one * one for one in TURN.parts)) for part in TURN.parts)
    matrix = np.array(
        [
            [1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w)],
            [2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w)],
            [2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j)],
        ]
    )
    expected = np.einsum("abn,bn->an", matrix, np.array(ACC.parts))
    assert np.array(value("rotate(Turn, Acceleration)").parts) == pytest.approx(expected)
    assert value("euler(Turn)").names == ("roll", "pitch", "yaw")
    assert value("Acceleration * 2").names == XYZ
    assert value("2 * Acceleration").names == XYZ
    assert value("norm(Acceleration) * Acceleration").names == XYZ


def test_other_times_are_interpolated_and_undefined_outside() -> None:
    results = one("Speed + 0 * Speed + Acceleration.x * 0 s")
    assert SLOW.time is not None
    expected = np.interp(TIME, SLOW.time, SLOW.parts[0], np.nan, np.nan)
    assert results == pytest.approx(expected, nan_ok=True)
    assert np.isnan(results[0])
    assert np.isnan(results[-1])


def test_truth_keeps_its_value_until_the_next_sample() -> None:
    result = one("(Speed > 0) and Acceleration.x == Acceleration.x")
    assert set(result[np.isfinite(result)]) == {0.0, 1.0}
    at = np.searchsorted(SLOW.time, TIME, "right") - 1
    inside = np.isfinite(result)
    assert np.array_equal(result[inside], (SLOW.parts[0][at] > 0)[inside])


def test_angles_take_the_short_way() -> None:
    assert np.abs(one("Yaw - shift(Yaw, 0 s)")).max() == 0.0
    turned = one("unwrap(Yaw)")
    assert np.diff(turned) == pytest.approx(np.full(N - 1, 7.0))
    assert one("derivative(Yaw)") == pytest.approx(np.full(N, 700.0), rel=1e-4)  # unix seconds have steps of 0.2 µs
    assert str(value("derivative(Yaw)").unit) == "°/s"


def test_derivative_and_integral_belong_together() -> None:
    result = value("derivative(integral(RateOfTurn.z))")
    expected = np.convolve(GYRO.parts[2], [0.25, 0.5, 0.25], "same")
    assert result.parts[0][2:-2] == pytest.approx(expected[2:-2], rel=1e-3, abs=1e-3)
    assert str(result.unit) == "°/s"
    assert str(value("integral(Acceleration)").unit) == "m/s"


@each_row("zero_phase", [True, False])
def test_moving_windows(zero_phase: bool) -> None:
    size, before = 25, 12 if zero_phase else 24
    windows = [x[max(0, n - before) : n - before + size] for n in range(N)]
    for name, plain in (
        ("mean", np.mean),
        ("rms", lambda w: np.sqrt(np.mean(np.square(w)))),
        ("min", np.min),
        ("max", np.max),
    ):
        expected = np.array([plain(window) for window in windows])
        assert one(f"{name}(Acceleration.x, 250 ms)", zero_phase=zero_phase) == pytest.approx(expected), name


def test_filters_are_those_of_scipy() -> None:
    low = scipy_signal.butter(2, 10, "lowpass", fs=RATE, output="sos")
    assert one("lowpass(Acceleration.x, 10 Hz)") == pytest.approx(scipy_signal.sosfiltfilt(low, x), rel=1e-3, abs=1e-3)
    zi = scipy_signal.sosfilt_zi(low) * x[0]
    causal = scipy_signal.sosfilt(low, x, zi=zi)[0]
    assert one("lowpass(Acceleration.x, 10 Hz)", zero_phase=False) == pytest.approx(causal, rel=1e-3, abs=1e-3)
    band = scipy_signal.butter(4, [5, 20], "bandpass", fs=RATE, output="sos")
    result = one("bandpass(Acceleration.x, 5 Hz, 20 Hz, 4)")
    assert result == pytest.approx(scipy_signal.sosfiltfilt(band, x), rel=1e-3, abs=1e-3)
    assert notes_of(parse("lowpass(a, 1 Hz)"), Context(True)) == [
        "Computed without delay, forwards and backwards: lowpass."
    ]
    assert "causal" in notes_of(parse("1 + mean(a, 1 s)"), Context(False))[0]
    assert notes_of(parse("norm(a)"), Context(False)) == []


def test_nothing_crosses_a_gap() -> None:
    rows = np.r_[0:150, 250:400]
    time, values = TIME[rows], x[rows]
    part = Quantity((values,), ACC.unit, time)
    result = evaluate(parse("mean(a, 0.5 s)"), lambda _: part, Context(True)).parts[0]
    alone = evaluate(
        parse("mean(a, 0.5 s)"), lambda _: Quantity((x[:150],), ACC.unit, TIME[:150]), Context(True)
    ).parts[0]
    assert result[:150] == pytest.approx(alone)
    even = evaluate(parse("resample(a, 50 Hz)"), lambda _: part, Context(True))
    assert even.time is not None
    inside = (even.time > TIME[149] + 1e-6) & (even.time < TIME[250] - 1e-6)
    assert np.isnan(even.parts[0][inside]).all()
    assert np.isfinite(even.parts[0][~inside]).all()


def test_missing_values_stay_missing() -> None:
    holed = x.copy()
    holed[100:105] = np.nan
    results = evaluate(
        parse("lowpass(a, 5 Hz) > 0"), lambda _: Quantity((holed,), ACC.unit, TIME), Context(True)
    ).parts[0]
    assert np.isnan(results[100:105]).all()
    assert np.isfinite(np.delete(results, np.s_[100:105])).all()


DEEP = [
    *("-" * 3900 + "Acceleration.x", "not " * 900 + "1 > 2", "+".join("1" * 1900)),
    *("-".join(["Acceleration.x"] * 250), "*".join("1" * 1900), "^".join("1" * 1900), " or ".join(["1 > 2"] * 300)),
]
"""Trees as deep as their text: one that walked them answered with a fault of the program."""


@each_row(
    ("text", "marked", "words"),
    [
        ("norm(Acceleration > 3", "", "“)” is missing"),
        (
            "Acceleration.x + RateOfTurn.z",
            "Acceleration.x + RateOfTurn.z",
            "A value in m/s² and a value in °/s cannot be added",
        ),
        ("Acceleration.x > 3", "Acceleration.x > 3", "a number without a unit cannot be compared"),
        ("nrom(Acceleration)", "nrom(Acceleration)", "no function nrom"),
        ("Acceleration.x + Speeed", "Speeed", "Signal Speeed not found"),
        ("lowpass(Acceleration.x, 80 Hz)", "80 Hz", "80 Hz is not allowed"),
        ("lowpass(Acceleration.x, 8)", "8", "A number in Hz is needed"),
        ("cross(Acceleration, Acceleration.x)", "Acceleration.x", "A vector of 3 columns"),
        ("Acceleration * Turn", "Acceleration * Turn", "vector of 3 columns and one of 4"),
        ("sin(Acceleration.x)", "Acceleration.x", "takes an angle"),
        ("log(Acceleration.x)", "Acceleration.x", "without a unit"),
        ("mean(Acceleration.x)", "mean(Acceleration.x)", "does not take 1 argument"),
        ("mean(3, 1 s)", "3", "A signal is needed"),
        ("Acceleration.x ^ Speed", "Speed", "An exponent"),
        ("Acceleration.x and 1", "Acceleration.x", "true or false"),
        ("1 < 2 < 3", "<", "chained"),
        ("Acceleration.x = 3", "=", "assigns nothing"),
        ("Acceleration.x $ 3", "$", "not allowed"),
        ('"Acceleration', '"', "not allowed"),
        ("", "", "ends where a value is expected"),
        ("__import__('os')", "__import__('os')", "no function __import__"),
        ("(" * 100, "(", "nested too deeply"),
        ("1 +" * 2000, "1 +" * 2000, "characters"),
        *((text, text, "one within the other") for text in DEEP),
        ("lowpass(Acceleration.x, 1e-300 Hz, 8)", "lowpass(Acceleration.x, 1e-300 Hz, 8)", "no such filter"),
        ("bandpass(Acceleration.x, 1e-300 Hz, 1e-299 Hz, 8)",) * 2 + ("no such filter",),
    ],
)
def test_a_mistake_is_marked(text: str, marked: str, words: str) -> None:
    with pytest.raises(ExpressionError) as raised:
        value(text)
    assert words in raised.value.message
    assert text[raised.value.begin : raised.value.end] == marked
    assert raised.value.kind == "bad-expression"


@given(st.text(alphabet=" ab.123+-*/^()<>=,\"'gm/s²norm", max_size=60))
def test_any_text_gives_a_value_or_a_marked_mistake(text: str) -> None:
    mistake = results = None
    try:
        results = evaluate(parse(text), lambda _: ACC, Context(True))
    except ExpressionError as error:
        mistake = error
    if mistake:
        assert 0 <= mistake.begin <= mistake.end <= len(text) + 1
    if results:
        assert {part.shape for part in results.parts} <= {(N,), ()}


def test_each_function_has_its_form() -> None:
    for name, function in FUNCTIONS.items():
        assert function.form.startswith(f"{name}(")
        assert function.doc.endswith(".")


@each_row("text", ["", "m/s²", "°/s", "m²/s⁴", "1/s", "km/h", "m·s", "a.u.", "°C", "rad², m²", "1/115200 s"])
def test_units_are_written_as_they_are_read(text: str) -> None:
    assert str(Unit.parse(text)) == text


@given(st.lists(st.tuples(st.sampled_from(sorted(SYMBOLS)), st.integers(-3, 3)), max_size=4))
def test_units_multiply_like_numbers(powers: list[tuple[str, int]]) -> None:
    whole = Unit()
    for symbol, power in powers:
        whole *= Unit.parse(symbol) ** power
    assert whole.factor == pytest.approx(math.prod(SYMBOLS[symbol][0] ** power for symbol, power in powers))
    assert (whole / whole).powers == ()
    assert Unit.parse(str(whole)).fits(whole)


# ── in requests ──────────────────────────────────────────────────────────────────────────────────────────────────────


def channel(number: int, name: str, unit: str, *columns: str) -> wire.ChannelInfo:
    infos = [wire.ColumnInfo(column, "f8", unit) for column in columns]
    return wire.ChannelInfo(number, "1", "M", name, name, "vector", unit, "", infos)


INFOS = [channel(1, "Acceleration", "m/s²", *XYZ), channel(2, "Rate of turn", "°/s", *XYZ)]


def read(column: SignalColumn) -> tuple[Floats, Floats]:
    values = (ACC if column.info.id == 1 else GYRO).parts[column.at].copy()
    values[7] = np.nan
    return TIME.copy(), values


def test_a_request_names_columns_channels_and_expressions() -> None:
    words = ["Rate of turn", 'norm("Rate of turn") > 10 °/s', "lowpass(Acceleration, 10 Hz)"]
    requested = requested_signals(INFOS, words, zero_phase=False)
    signals = [signal for one in requested for signal in one.signals(read)]
    assert [signal.name for signal in signals] == [
        *(f"Rate of turn.{name}" for name in XYZ),
        words[1],
        *(f"({words[2]}).{name}" for name in XYZ),
    ]
    assert {len(signal.time) for signal in signals} == {N - 1}
    assert [signal.unit for signal in signals[-4:]] == ["", "m/s²", "m/s²", "m/s²"]
    assert "causal" in signals[-1].notes[0]
    assert {one.device for one in requested} == {"1"}
    assert len(requested[-1].columns) == 3


def test_the_samples_of_all_expressions_of_a_request_are_bounded_together() -> None:
    word = "resample(Acceleration.x, 1 Hz)"
    one, other = requested_signals(INFOS, [word, f"resample({word}, 1 Hz)"], zero_phase=True)
    assert isinstance(one, ExpressionSignal)
    assert isinstance(other, ExpressionSignal)
    assert one.context.budget is not None
    one.context.budget.left = 9
    assert len(one.signals(read)[0].time) == 4
    with pytest.raises(ExpressionError, match=r"4 samples.* are too many") as refused:
        other.signals(read)
    assert "At most 50 000 000 in one request" in refused.value.hint


@each_row(
    ("word", "kind", "words"),
    [
        ("Speed", "not-found", "Signal Speed not found"),
        ("norm(Speed)", "bad-expression", "Signal Speed not found. (character 6)"),
        ("1 + 2", "bad-expression", "is the number 3"),
    ],
)
def test_a_wrong_word_is_refused(word: str, kind: str, words: str) -> None:
    with pytest.raises(DomainError) as raised:
        [signal for one in requested_signals(INFOS, [word], zero_phase=True) for signal in one.signals(read)]
    assert raised.value.kind == kind
    assert words in raised.value.message


OTHER = replace(channel(3, "Speed", "m/s", "value"), device="2")


@each_row(
    ("word", "device", "kind"),
    [
        ("Speed", "1", "not-found"),
        ("1/Speed", "", "not-found"),  # it was one divided by the speed of device 2
        ("1/Speed", "2", "not-found"),
        ("2/Acceleration.x", "1", "not-found"),
        ("norm(Acceleration)", "2", "bad-expression"),
        ("Acceleration.x > 3 m/s²", "2", "bad-expression"),
        ('norm("2/Acceleration")', "", "bad-expression"),
    ],
)
def test_a_device_without_the_signal_is_not_answered_for_by_another(word: str, device: str, kind: str) -> None:
    """Two sensors differed by 0: one of them was compared with itself."""
    with pytest.raises(DomainError) as raised:
        requested_signals([*INFOS, OTHER], [word], zero_phase=True, device=device)
    assert raised.value.kind == kind
    assert "not found" in raised.value.message
    assert "Another device has it: " in raised.value.hint


@each_row(
    ("word", "device", "devices"),
    [
        ("Speed", "", {"2"}),
        ("Acceleration.x", "1", {"1"}),
        ("2/Speed", "1", {"2"}),
        ("1 / Speed", "", {"2"}),
        ('norm(Acceleration) / "2/Speed"', "1", {"1", "2"}),
        ("7/Speed", "", {"2"}),  # there is no device 7
    ],
)
def test_a_name_with_its_device_is_that_device_s(word: str, device: str, devices: set[str]) -> None:
    results = requested_signals([*INFOS, OTHER], [word], zero_phase=True, device=device)
    assert {column.device for one in results for column in one.columns} == devices


def test_euler_angles_that_the_page_derives_can_be_named() -> None:
    """They were in the tree of signals, but `EulerAngles.yaw` was not found."""
    columns = [wire.ColumnInfo(name, "f4") for name in ("q0", "q1", "q2", "q3")]
    info = wire.ChannelInfo(1, "1", "M", "Quaternion", "Quaternion", "quaternion", "", "ENU", columns)
    turn = np.radians(30.0)
    parts = [np.full(3, value) for value in (np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2))]

    def read(column: SignalColumn) -> tuple[Floats, Floats]:
        return TIME[:3], parts[column.at]

    words = ["EulerAngles.yaw", "1/EulerAngles.yaw", "abs(EulerAngles.yaw) * 2", "EulerAngles"]
    results = requested_signals([info], words, zero_phase=True)
    signals = [signal for one in results for signal in one.signals(read)]
    assert [signal.name for signal in signals[:2]] == words[:2]
    assert [signal.unit for signal in signals] == ["°"] * 6
    assert [round(float(signal.values[0]), 6) for signal in signals] == [30.0, 30.0, 60.0, 0.0, 0.0, 30.0]
    assert signals[0].period == 360.0
    live = LiveExpression([info], "EulerAngles.yaw + 1 °", {1: RATE})
    assert live.feed({1: [TIME[:3], TIME[:3], *parts]}).parts[0] == pytest.approx([31.0] * 3)
    second = replace(info, id=2, device="2")
    with pytest.raises(DomainError, match=r"Several devices have EulerAngles\.yaw"):
        requested_signals([info, second], ["EulerAngles.yaw"], zero_phase=True)
    with pytest.raises(DomainError, match=r"EulerAngles\.up not found"):
        requested_signals([info], ["EulerAngles.up"], zero_phase=True)
