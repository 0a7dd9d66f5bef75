"""Noise of a sensor according to its data sheet, and whether a measured Allan deviation meets it.

Data sheets give typical figures. A noise density d is that of a one-sided spectrum, whose random walk is d/√2, but some
makers mean the random walk itself; therefore a random walk counts as met up to √2 times its figure, and the sentence
says so. "In-run bias stability" is the lowest part of the Allan deviation; it is met if that is surely not larger.
"""

import math
import re
from collections.abc import Callable, Mapping
from typing import Literal

from imuscope.protocols.arrays import Floats
from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.protocols.schema.units import G, Unit, rounded
from imuscope.server.extensions.analysis.noise.allan_deviation import AllanCurve, intervals
from imuscope.server.extensions.analysis.noise.noise_model import FLAT, TAIL_PROBABILITY, NoiseModel
from imuscope.server.extensions.analysis.signals.signals import DataSheetNoise
from imuscope.server.wire import ChannelInfo

TOLERANCE = math.sqrt(2)
INTERVAL_FACTOR = 2.0  # intervals of 95 % grow by this before they decide
MIN_TAU_RATIO = 3.0  # a lowest part is one if the curve goes on to averaging times this many times as long
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
    """Data-sheet noise of a column, in its unit; None without a sheet, or for other sensors than accelerometers and
    gyroscopes.
    """
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
    """Allan deviation of a sensor that exactly meets its data sheet."""
    deviation: Floats = (sheet.random_walk**2 / tau + sheet.bias_instability**2) ** 0.5
    return deviation


def withheld(sheet: DataSheetNoise, unit: str, why: str) -> list[Mapping[str, str]]:
    """Open verdicts, with what prevents them."""
    out = [_verdict("random_walk", "open", f"Random walk: not compared with {_sheet_walk(sheet, unit)}. {why}")]
    if sheet.bias_instability:
        words = f"Bias instability: not compared with {_sheet_bias(sheet, unit)}. {why}"
        out.append(_verdict("bias_instability", "open", words))
    return out


def verdicts(
    sheet: DataSheetNoise, unit: str, curve: AllanCurve, model: NoiseModel, *, drifts: bool
) -> list[Mapping[str, str]]:
    """One verdict for each figure of the sheet: its name, whether it is met, and a sentence for a user.

    Args:
        drifts: a drift in one direction raises the curve.
    """
    out = [_walk(sheet, unit, model)]
    if sheet.bias_instability:
        out.append(_bias(sheet, unit, curve, model, drifts))
    return out


def _walk(sheet: DataSheetNoise, unit: str, model: NoiseModel) -> Mapping[str, str]:
    walk, limit = model.parameters["random_walk"], sheet.random_walk * TOLERANCE
    shown, of = _of_walk(walk.value, unit), _sheet_walk(sheet, unit)
    low, high = (walk.value + INTERVAL_FACTOR * (end - walk.value) for end in (walk.low, walk.high))
    if walk.value <= 0:
        return _verdict("random_walk", "open", f"Random walk: the curve does not show one to compare with {of}.")
    if high <= limit:
        if walk.value <= sheet.random_walk:
            return _verdict("random_walk", "met", f"Random walk {shown}: meets {of}.")
        words = f"Random walk {shown}: within {_of_walk(limit, unit)}, √2 times {of}, since makers differ in what they"
        return _verdict("random_walk", "met", f"{words} call noise density.")
    if low > limit:
        times = _times(walk.value / sheet.random_walk)
        return _verdict("random_walk", "above", f"Random walk {shown}: {times} times {of}.")
    return _verdict("random_walk", "open", f"Random walk {shown}: near the limit of {of}. Record longer to decide.")


def _bias(sheet: DataSheetNoise, unit: str, curve: AllanCurve, model: NoiseModel, drifts: bool) -> Mapping[str, str]:
    low, high = intervals(curve.adev, model.freedom, TAIL_PROBABILITY)
    lowest, surest = int(curve.adev.argmin()), int(high.argmin())
    figure, of = sheet.bias_instability, _sheet_bias(sheet, unit)
    if float(high[surest]) <= figure:
        shown = f"{_of_bias(float(curve.adev[surest]), unit)} at {rounded(float(curve.tau[surest]))} s"
        words = f"Bias instability: the curve comes down to {shown} and so meets {of}."
        return _verdict("bias_instability", "met", words)
    flat = model.parameters["bias_instability"]
    if not drifts and (flat.value + INTERVAL_FACTOR * (flat.low - flat.value)) * math.sqrt(FLAT) > figure * TOLERANCE:
        level = flat.value * math.sqrt(FLAT)
        words = (
            f"Bias instability {_of_bias(level, unit)}, where the model is flat: {_times(level / figure)} times {of}."
        )
        return _verdict("bias_instability", "above", words)
    tau, shown = float(curve.tau[lowest]), _of_bias(float(curve.adev[lowest]), unit)
    if float(curve.tau[-1]) < MIN_TAU_RATIO * tau:
        falls = f"the curve still falls at {rounded(tau)} s, to {shown}"
        sentence = f"Bias instability: {falls}. Record longer to compare with {of}."
        return _verdict("bias_instability", "open", sentence)
    if drifts:
        sentence = f"Bias instability: a drift hides it. Record at rest and at an even temperature to see {of}."
        return _verdict("bias_instability", "open", sentence)
    if float(low[lowest]) > figure * TOLERANCE:
        times = _times(float(curve.adev[lowest]) / figure)
        sentence = f"Bias instability {shown} at {rounded(tau)} s: {times} times {of}."
        return _verdict("bias_instability", "above", sentence)
    sentence = f"Bias instability {shown} at {rounded(tau)} s: near the limit of {of}. Record longer to decide."
    return _verdict("bias_instability", "open", sentence)


def _sheet_walk(sheet: DataSheetNoise, unit: str) -> str:
    return f"the {_of_walk(sheet.random_walk, unit)} of the {sheet.product} data sheet"


def _sheet_bias(sheet: DataSheetNoise, unit: str) -> str:
    return f"the {_of_bias(sheet.bias_instability, unit)} of the {sheet.product} data sheet"


def _verdict(parameter: str, state: State, words: str) -> Mapping[str, str]:
    return {"parameter": parameter, "state": state, "words": words}


def _times(ratio: float) -> str:
    return f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}"


def _of_walk(value: float, unit: str) -> str:
    """A random walk in the units of data sheets: °/√h, or m/s/√h."""
    own = Unit.parse(unit)
    if own.fits(TURN):
        return f"{rounded(value * own.to(TURN) * 60)} °/√h"
    return f"{rounded(value * own.to(ACCELERATION) * 60)} m/s/√h"


def _of_bias(value: float, unit: str) -> str:
    """A bias instability in the units of data sheets: °/h, or µg."""
    own = Unit.parse(unit)
    if own.fits(TURN):
        return f"{rounded(value * own.to(TURN) * 3600)} °/h"
    return f"{rounded(value * own.to(ACCELERATION) / MICRO_G)} µg"
