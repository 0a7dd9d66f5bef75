"""Functions of expressions, one row each: what they take, and how they are computed over columns."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.rotations import euler_columns
from imuscope.protocols.schema.units import NO_UNIT, Unit
from imuscope.recordings.columns.breaks import GAP_STEPS
from imuscope.server.extensions.analysis.expressions.expression_syntax import Call, ExpressionError, Node
from imuscope.server.extensions.analysis.signals.quantities import Quantity, at_times, in_runs, on_one_axis
from imuscope.server.extensions.analysis.signals.signals import ANGLES, grouped

SECOND, HERTZ, DEGREE, RADIAN = (Unit.parse(text) for text in ("s", "Hz", "°", "rad"))
MAX_ORDER = 8
MAX_RESAMPLED = 50_000_000


@dataclass(slots=True)
class SampleBudget:
    """Samples that `resample` may make in all expressions of one request; `left`: of these."""

    left: int = MAX_RESAMPLED

    def spend(self, count: int, node: Node) -> None:
        """Take some of them.

        Raises:
            ExpressionError: there are not as many left.
        """
        if count > self.left:
            used = MAX_RESAMPLED - self.left
            before = f", after {grouped(used)} of the request before it" if used else ""
            hint = f"At most {grouped(MAX_RESAMPLED)} in one request; choose a lower rate or a shorter range."
            raise ExpressionError(f"{grouped(count)} samples{before} are too many.", *_place(node), hint)
        self.left -= count


@dataclass(frozen=True, slots=True)
class Context:
    """Circumstances of an evaluation.

    Attributes:
        zero_phase: filters and moving windows may look ahead, as on recordings; else they use the past only.
        budget: of the request that the expression belongs to; None: one for each use of `resample`.
        whole_windows: a moving window has no value until it is full, as in alarms; else that of the samples so far.
    """

    zero_phase: bool
    budget: SampleBudget | None = field(default=None, compare=False)
    whole_windows: bool = False


@dataclass(frozen=True, slots=True)
class Function:
    """One function.

    Args:
        form: as typed, for completion: "lowpass(x, cut-off, order)".
        doc: one sentence.
        least, most: numbers of arguments.
        run: takes the arguments and the call, for its place in the text.
    """

    form: str
    doc: str
    least: int
    most: int
    run: Callable[[list[Quantity], Call, Context], Quantity]

    def apply(self, arguments: list[Quantity], node: Call, context: Context) -> Quantity:
        """The value of a call.

        Raises:
            ExpressionError: its arguments do not fit.
        """
        if not self.least <= len(arguments) <= self.most:
            raise ExpressionError(f"{node.name} does not take {len(arguments)} arguments.", *_place(node), self.form)
        return self.run(arguments, node, context)


def _place(node: Node) -> tuple[int, int]:
    return node.begin, node.end


def _wide(quantity: Quantity, columns: int, node: Node, what: str) -> Quantity:
    if len(quantity.parts) != columns:
        raise ExpressionError(f"{what} of {columns} columns is needed here.", *_place(node), "Name a whole channel.")
    return quantity


def _signal(quantity: Quantity, node: Node) -> Quantity:
    if quantity.is_number:
        raise ExpressionError("A signal is needed here, not a number.", *_place(node))
    return quantity


def _constant(quantity: Quantity, node: Node, unit: Unit, low: float, high: float) -> float:
    """A number in a unit, within limits (low < number ≤ high)."""
    example = f"{high / 2 if high < math.inf else 1:g} {unit}".strip()
    if not quantity.is_number or not quantity.unit.fits(unit):
        raise ExpressionError(
            f"A number{f' in {unit}' if str(unit) else ''} is needed here.", *_place(node), f"For example {example}."
        )
    value = quantity.in_unit(unit).number
    if not low < value <= high:
        limits = f"more than {low:g}" if high == math.inf else f"{low:g} to {high:.6g}"
        raise ExpressionError(
            f"{value:g} {unit}".strip() + " is not allowed here.", *_place(node), f"Give {limits} {unit}".strip() + "."
        )
    return value


# ── values of one moment ────────────────────────────────────────────────────────────────────────────────────────────


def _norm(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    [x] = arguments
    total = np.square(x.parts[0])
    for part in x.parts[1:]:
        total = total + np.square(part)
    return x.with_parts([np.sqrt(total)])


def _dot(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    a, b = on_one_axis(arguments)
    _wide(b, len(a.parts), node.arguments[1], "A vector")
    total = sum((p * q for p, q in zip(a.parts, b.parts, strict=True)), np.zeros(()))
    time = a.time if a.time is not None else b.time
    return replace(a, time=time).with_parts([np.asarray(total)], a.unit * b.unit)


def _cross(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    a, b = on_one_axis([_wide(one, 3, at, "A vector") for one, at in zip(arguments, node.arguments, strict=True)])
    return a.with_parts(_crossed(a.parts, b.parts), a.unit * b.unit)


def _crossed(a: Sequence[Floats], b: Sequence[Floats]) -> list[Floats]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _rotate(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    q, v = on_one_axis(
        [
            _wide(arguments[0], 4, node.arguments[0], "A quaternion"),
            _wide(arguments[1], 3, node.arguments[1], "A vector"),
        ]
    )
    length = np.sqrt(sum((np.square(part) for part in q.parts), np.zeros(())))
    w, *axis = (part / length for part in q.parts)
    twice = [2 * part for part in _crossed(axis, v.parts)]
    turned = _crossed(axis, twice)
    return v.with_parts([part + w * t + u for part, t, u in zip(v.parts, twice, turned, strict=True)])


def _euler(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    return euler_angles(_wide(arguments[0], 4, node.arguments[0], "A quaternion"))


def euler_angles(q: Quantity, angle: str = "") -> Quantity:
    """Roll, pitch and yaw of a quaternion, or one of them, °."""
    parts = tuple(euler_columns(q.parts))
    if angle:
        return Quantity((parts[ANGLES.index(angle)],), DEGREE, q.time, ("",), 360.0, breaks=q.breaks)
    return Quantity(parts, DEGREE, q.time, ANGLES, 360.0, breaks=q.breaks)


def _elementwise(work: Callable[[Any], Any], unit: Unit | None = None) -> Callable[..., Quantity]:
    def run(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
        x = arguments[0]
        if unit is not None and x.unit.dimensions:
            raise ExpressionError(
                f"{node.name} takes a number without a unit, not {x.unit}.", *_place(node.arguments[0])
            )
        return x.with_parts([work(part) for part in x.parts], unit)

    return run


def _of_angle(work: Callable[[Any], Any]) -> Callable[..., Quantity]:
    def run(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
        x = arguments[0]
        if x.unit.dimensions and not x.unit.fits(DEGREE):
            raise ExpressionError(f"{node.name} takes an angle, not {x.unit}.", *_place(node.arguments[0]))
        factor = x.unit.to(RADIAN) if x.unit.dimensions else 1.0
        return x.with_parts([work(part * factor) for part in x.parts], NO_UNIT)

    return run


def _to_angle(work: Callable[[Any], Any]) -> Callable[..., Quantity]:
    return _elementwise(lambda part: np.degrees(work(part)), DEGREE)


def _atan2(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    y, x = on_one_axis(arguments)
    if not y.unit.fits(x.unit):
        raise ExpressionError(f"{y.unit} and {x.unit} do not fit.", *_place(node))
    _wide(x, len(y.parts), node.arguments[1], "A value")
    x = x.in_unit(y.unit)
    angles = tuple(np.degrees(np.arctan2(a, b)) for a, b in zip(y.parts, x.parts, strict=True))
    time = y.time if y.time is not None else x.time
    return Quantity(angles, DEGREE, time, y.names, 360.0, breaks=y.breaks or x.breaks)


def _sqrt(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    [x] = arguments
    return x.with_parts([np.sqrt(part) for part in x.parts], x.unit ** Fraction(1, 2))


# ── along time ──────────────────────────────────────────────────────────────────────────────────────────────────────


def _unwrap(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    x = _signal(arguments[0], node.arguments[0])
    if not x.unit.fits(DEGREE):
        raise ExpressionError(f"unwrap takes an angle, not {x.unit or 'a number'}.", *_place(node.arguments[0]))
    period = Unit.parse("°").to(x.unit) * 360
    return in_runs(x, lambda _, v: np.unwrap(v, period=period), gap=math.inf)


def _derivative(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    x = _signal(arguments[0], node.arguments[0])

    def work(t: Floats, v: Floats) -> Floats:
        keep = np.flatnonzero(np.diff(t, prepend=-math.inf) > 0)  # of samples at one time the first
        slopes = np.full(len(v), np.nan)
        if len(keep) > 1:
            slopes[keep] = np.gradient(v[keep], t[keep])
        return slopes

    values = x if not x.period else _continued(x)
    slopes = in_runs(values, work)
    return replace(slopes, unit=x.unit / SECOND)


def _continued(x: Quantity) -> Quantity:
    """An angle without its jumps."""
    return in_runs(x, lambda _, v: np.unwrap(v, period=x.period), gap=math.inf)


def _integral(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    x = _signal(arguments[0], node.arguments[0])

    def work(t: Floats, v: Floats) -> Floats:
        areas = np.diff(t) * (v[1:] + v[:-1]) / 2
        return np.concatenate(([0.0], np.cumsum(areas)))

    return replace(in_runs(x, work, gap=math.inf), unit=x.unit * SECOND)


def _moving(measure: Callable[[Floats, int, int, Floats], Floats]) -> Callable[..., Quantity]:
    def run(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
        x = _signal(arguments[0], node.arguments[0])
        span = _constant(arguments[1], node.arguments[1], SECOND, 0.0, 86400.0)

        def work(t: Floats, v: Floats) -> Floats:
            rate = (len(t) - 1) / (t[-1] - t[0]) if len(t) > 1 and t[-1] > t[0] else 1.0
            count = max(1, round(span * rate))
            size = min(count, len(t))
            before = size // 2 if context.zero_phase else size - 1
            result = measure(v, size, before, t)
            if context.whole_windows:
                result[: count - 1] = np.nan
            return result

        return in_runs(x, work)

    return run


def _mean_of(values: Floats, size: int, before: int, time: Floats) -> Floats:
    centre = float(values.mean())
    sums = np.concatenate(([0.0], np.cumsum(values - centre)))
    at = np.arange(len(values))
    low, high = np.maximum(at - before, 0), np.minimum(at - before + size, len(values))
    means: Floats = (sums[high] - sums[low]) / (high - low) + centre
    return means


def _rms_of(values: Floats, size: int, before: int, time: Floats) -> Floats:
    return np.sqrt(np.maximum(_mean_of(np.square(values), size, before, time), 0.0))


def _extreme(name: str) -> Callable[[Floats, int, int, Floats], Floats]:
    def measure(values: Floats, size: int, before: int, time: Floats) -> Floats:
        from scipy import ndimage

        origin = before - size // 2  # scipy's window begins size // 2 before the sample
        extremes: Floats = getattr(ndimage, name)(values, size, mode="nearest", origin=origin)
        return extremes

    return measure


MEASURES: Mapping[str, Callable[[Floats, int, int, Floats], Floats]] = {
    "mean": _mean_of,
    "rms": _rms_of,
    "min": _extreme("minimum_filter1d"),
    "max": _extreme("maximum_filter1d"),
}
"""Figures of moving windows: of values, the window's size, its samples before each one, and times."""


def _filter(kind: str) -> Callable[..., Quantity]:
    edges = 2 if kind == "bandpass" else 1

    def run(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
        from scipy import signal

        x = _signal(arguments[0], node.arguments[0])
        nyquist = _rate(x) / 2
        cut = [
            _constant(one, at, HERTZ, 0.0, nyquist * 0.999)
            for one, at in zip(arguments[1 : 1 + edges], node.arguments[1 : 1 + edges], strict=True)
        ]
        if edges == 2 and not cut[0] < cut[1]:
            raise ExpressionError("The first frequency is not below the second.", *_place(node))
        order = 2
        if len(arguments) > 1 + edges:
            order = round(_constant(arguments[-1], node.arguments[-1], NO_UNIT, 0.0, MAX_ORDER))

        def work(t: Floats, v: Floats) -> Floats:
            try:
                sections = signal.butter(
                    max(1, order), cut if edges == 2 else cut[0], kind, fs=2 * nyquist, output="sos"
                )
                steady = signal.sosfilt_zi(sections)
            except (ValueError, np.linalg.LinAlgError):
                message = f"There is no such filter of a signal with {2 * nyquist:.4g} samples per second."
                raise ExpressionError(message, *_place(node), "Choose a higher frequency, or a lower order.") from None
            if context.zero_phase and len(v) > 3 * (2 * len(sections) + 1):
                filtered: Floats = signal.sosfiltfilt(sections, v)
                return filtered
            causal: Floats = signal.sosfilt(sections, v, zi=steady * v[0])[0]
            return causal

        return in_runs(x if not x.period else _continued(x), work)

    return run


def _rate(x: Quantity) -> float:
    assert x.time is not None
    steps = np.diff(x.time)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if usual <= 0:
        return 1.0
    within = steps[steps <= GAP_STEPS * usual]
    return 1 / float(within.mean())


def _resample(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    x = _signal(arguments[0], node.arguments[0])
    rate = _constant(arguments[1], node.arguments[1], HERTZ, 0.0, 1e6)
    assert x.time is not None
    if not len(x.time):
        return x
    count = math.floor((x.time[-1] - x.time[0]) * rate + 1e-9) + 1
    (context.budget or SampleBudget()).spend(count * len(x.parts), node)
    axis = x.time[0] + np.arange(count) / rate
    steps = np.diff(x.time, append=x.time[-1])
    before = np.searchsorted(x.time, axis, "right") - 1
    in_gap = (steps[before] > GAP_STEPS / _rate(x)) & (x.time[before] < axis)
    moved = at_times(x, np.minimum(axis, x.time[-1]))
    return replace(moved, time=axis, parts=tuple(np.where(in_gap, np.nan, part) for part in moved.parts))


def _shift(arguments: list[Quantity], node: Call, context: Context) -> Quantity:
    x = _signal(arguments[0], node.arguments[0])
    by = _constant(arguments[1], node.arguments[1], SECOND, -1e6, 1e6)
    assert x.time is not None
    return replace(x, time=x.time + by)


FUNCTIONS: Mapping[str, Function] = {
    "norm": Function("norm(v)", "Length of a vector.", 1, 1, _norm),
    "dot": Function("dot(a, b)", "Scalar product of two vectors.", 2, 2, _dot),
    "cross": Function("cross(a, b)", "Vector product of two vectors.", 2, 2, _cross),
    "rotate": Function("rotate(q, v)", "Vector v turned by the quaternion q: q v q*.", 2, 2, _rotate),
    "euler": Function("euler(q)", "Roll, pitch and yaw of a quaternion.", 1, 1, _euler),
    "abs": Function("abs(x)", "Absolute value.", 1, 1, _elementwise(np.abs)),
    "sqrt": Function("sqrt(x)", "Square root.", 1, 1, _sqrt),
    "exp": Function("exp(x)", "Exponential function.", 1, 1, _elementwise(np.exp, NO_UNIT)),
    "log": Function("log(x)", "Natural logarithm.", 1, 1, _elementwise(np.log, NO_UNIT)),
    "log10": Function("log10(x)", "Logarithm to base 10.", 1, 1, _elementwise(np.log10, NO_UNIT)),
    "sin": Function("sin(x)", "Sine of an angle; a number without a unit is in rad.", 1, 1, _of_angle(np.sin)),
    "cos": Function("cos(x)", "Cosine of an angle; a number without a unit is in rad.", 1, 1, _of_angle(np.cos)),
    "tan": Function("tan(x)", "Tangent of an angle; a number without a unit is in rad.", 1, 1, _of_angle(np.tan)),
    "asin": Function("asin(x)", "Arc sine, in °.", 1, 1, _to_angle(np.arcsin)),
    "acos": Function("acos(x)", "Arc cosine, in °.", 1, 1, _to_angle(np.arccos)),
    "atan2": Function("atan2(y, x)", "Angle of the point (x, y), in °.", 2, 2, _atan2),
    "unwrap": Function("unwrap(x)", "Angle without its jumps by 360°.", 1, 1, _unwrap),
    "derivative": Function("derivative(x)", "Rate of change per second; not across gaps.", 1, 1, _derivative),
    "integral": Function(
        "integral(x)", "Running integral over time, from 0, by the trapezoidal rule.", 1, 1, _integral
    ),
    "mean": Function("mean(x, 1 s)", "Moving mean.", 2, 2, _moving(MEASURES["mean"])),
    "rms": Function("rms(x, 1 s)", "Moving root mean square.", 2, 2, _moving(MEASURES["rms"])),
    "min": Function("min(x, 1 s)", "Moving minimum.", 2, 2, _moving(MEASURES["min"])),
    "max": Function("max(x, 1 s)", "Moving maximum.", 2, 2, _moving(MEASURES["max"])),
    "lowpass": Function("lowpass(x, 10 Hz, order)", "Butterworth low pass, of order 2.", 2, 3, _filter("lowpass")),
    "highpass": Function("highpass(x, 1 Hz, order)", "Butterworth high pass, of order 2.", 2, 3, _filter("highpass")),
    "bandpass": Function(
        "bandpass(x, 1 Hz, 10 Hz, order)", "Butterworth band pass, of order 2.", 3, 4, _filter("bandpass")
    ),
    "resample": Function(
        "resample(x, 100 Hz)", "Linear interpolation at even times; not across gaps.", 2, 2, _resample
    ),
    "shift": Function("shift(x, 20 ms)", "The same values later by a time.", 2, 2, _shift),
}
"""All functions by name. Filters and moving windows are causal live, and without delay on recordings."""

DELAYED = ("mean", "rms", "min", "max", "lowpass", "highpass", "bandpass")
"""Functions that differ between live and recorded."""
