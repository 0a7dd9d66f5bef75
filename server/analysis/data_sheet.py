"""Noise of a sensor as its data sheet tells, and whether a measured Allan deviation meets it.

Data sheets give typical figures. A noise density d is that of a one-sided spectrum, whose random walk is d/√2, but some
makers mean the random walk itself; therefore a figure counts as met up to √2 times its value. "In-run bias stability"
is the lowest part of the Allan deviation.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Literal

from protocols.sensor_properties import SensorProperties
from server.analysis.allan_deviation import AllanCurve
from server.analysis.noise_model import NoiseModel
from server.analysis.signals import DataSheetNoise, Floats
from server.analysis.units import G, Unit
from server.wire import ChannelInfo

TOLERANCE = math.sqrt(2)
DECIDED = 3.0  # a lowest part is one if the curve goes on to averaging times this many times as long
SENSORS = (
    (re.compile("^(rate.?of.?turn|angular.?(rate|velocity)|gyro)", re.I), "rad/s", "turn", "turn_bias"),
    (re.compile("^acceleration", re.I), "m/s²", "acceleration", "acceleration_bias"),
)
TURN, ACCELERATION = Unit.parse("°/s"), Unit.parse("m/s²")
MICRO_G = 1e-6 * G
State = Literal["met", "above", "open"]
Product = Callable[[str], tuple[str, SensorProperties]]
"""Name of a device's product and the properties of its sensors, by the device's id."""


def unknown_product(device: str) -> tuple[str, SensorProperties]:
    """The product of a device of which nothing is known."""
    del device
    return "", SensorProperties()


def data_sheet_of(info: ChannelInfo, at: int, product: Product) -> DataSheetNoise | None:
    """Data-sheet noise of a column, in its unit; None for what is no accelerometer or gyroscope, or without a sheet."""
    unit = Unit.parse(info.columns[at].unit)
    for title, si, density, bias in SENSORS:
        if info.kind == "vector" and title.match(info.title or info.name) and unit.fits(Unit.parse(si)):
            name, sensors = product(info.device)
            if not getattr(sensors, density):
                return None
            factor = Unit.parse(si).to(unit)
            walk = getattr(sensors, density) / math.sqrt(2) * factor
            return DataSheetNoise(name, walk, getattr(sensors, bias) * factor)
    return None


def sheet_curve(sheet: DataSheetNoise, tau: Floats) -> Floats:
    """Allan deviation of a sensor that is just what its data sheet says."""
    found: Floats = (sheet.random_walk**2 / tau + sheet.bias_instability**2) ** 0.5
    return found


def verdicts(
    sheet: DataSheetNoise, unit: str, curve: AllanCurve, low: Floats, model: NoiseModel, *, drifts: bool
) -> list[Mapping[str, str]]:
    """One verdict for each figure of the sheet: its name, whether it is met, and a sentence for a person.

    Args:
        low: lower ends of the intervals of the curve.
        drifts: a drift in one direction raises the curve.
    """
    found = [_walk(sheet, unit, model)]
    if sheet.bias_instability:
        found.append(_bias(sheet, unit, curve, low, drifts))
    return found


def _walk(sheet: DataSheetNoise, unit: str, model: NoiseModel) -> Mapping[str, str]:
    walk, limit = model.parameters["random_walk"], sheet.random_walk * TOLERANCE
    shown, figure = _of_walk(walk.value, unit), _of_walk(sheet.random_walk, unit)
    of = f"the {figure} of the {sheet.product} data sheet"
    if walk.value <= 0:
        return _verdict("random_walk", "open", f"Random walk: the curve does not show one to compare with {of}.")
    if walk.high <= limit or (walk.value <= limit and walk.low <= sheet.random_walk):
        return _verdict("random_walk", "met", f"Random walk {shown}: meets {of}.")
    if walk.low > limit:
        times = _times(walk.value / sheet.random_walk)
        return _verdict("random_walk", "above", f"Random walk {shown}: {times} times {of}.")
    return _verdict("random_walk", "open", f"Random walk {shown}: near the limit of {of}. Record longer to decide.")


def _bias(sheet: DataSheetNoise, unit: str, curve: AllanCurve, low: Floats, drifts: bool) -> Mapping[str, str]:
    at = int(curve.adev.argmin())
    lowest, tau = float(curve.adev[at]), float(curve.tau[at])
    shown, limit = _of_bias(lowest, unit), sheet.bias_instability * TOLERANCE
    of = f"the {_of_bias(sheet.bias_instability, unit)} of the {sheet.product} data sheet"
    if lowest <= limit:
        return _verdict("bias_instability", "met", f"Bias instability {shown} at {tau:.3g} s: meets {of}.")
    if float(curve.tau[-1]) < DECIDED * tau:
        falls = f"the curve still falls at {tau:.3g} s, to {shown}"
        sentence = f"Bias instability: {falls}. Record longer to compare with {of}."
        return _verdict("bias_instability", "open", sentence)
    if drifts:
        sentence = f"Bias instability: a drift hides it. Record at rest and at an even temperature to see {of}."
        return _verdict("bias_instability", "open", sentence)
    if float(low[at]) > limit:
        times = _times(lowest / sheet.bias_instability)
        sentence = f"Bias instability {shown} at {tau:.3g} s: {times} times {of}."
        return _verdict("bias_instability", "above", sentence)
    sentence = f"Bias instability {shown} at {tau:.3g} s: near the limit of {of}. Record longer to decide."
    return _verdict("bias_instability", "open", sentence)


def _verdict(parameter: str, state: State, words: str) -> Mapping[str, str]:
    return {"parameter": parameter, "state": state, "words": words}


def _figure(value: float) -> str:
    """Three digits, without a power of ten below a million."""
    return f"{value:.0f}" if 100 <= value < 1e6 else f"{value:.3g}"


def _times(ratio: float) -> str:
    return f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}"


def _of_walk(value: float, unit: str) -> str:
    """A random walk in the units of data sheets: °/√h, or m/s/√h."""
    own = Unit.parse(unit)
    if own.fits(TURN):
        return f"{_figure(value * own.to(TURN) * 60)} °/√h"
    return f"{_figure(value * own.to(ACCELERATION) * 60)} m/s/√h"


def _of_bias(value: float, unit: str) -> str:
    """A bias instability in the units of data sheets: °/h, or µg."""
    own = Unit.parse(unit)
    if own.fits(TURN):
        return f"{_figure(value * own.to(TURN) * 3600)} °/h"
    return f"{_figure(value * own.to(ACCELERATION) / MICRO_G)} µg"
