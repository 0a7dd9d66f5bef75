"""Allan deviation: overlapping, for many averaging times, with confidence intervals and the parameters of the noise.

The sensor has to rest: motion is left out (rest.py), and the part that follows the temperature
of the device is removed (thermal_drift.py). The result states how much of both. Nothing is computed
across a gap. Parameters and verdicts come only if what they presuppose was found (preconditions.py).
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import rounded
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.noise import noise_model
from imuscope.server.extensions.analysis.noise.allan_deviation import allan_curve, averaging_lengths, intervals
from imuscope.server.extensions.analysis.noise.data_sheet import sheet_curve, verdicts, withheld
from imuscope.server.extensions.analysis.noise.noise_model import NoiseModel, fit_noise
from imuscope.server.extensions.analysis.noise.noise_yaml import FORMATS
from imuscope.server.extensions.analysis.noise.preconditions import Measured, obstacles, unchecked
from imuscope.server.extensions.analysis.noise.registry import (
    Analysis,
    AnalysisOption,
    Result,
    Settings,
    choice,
    register_analysis,
)
from imuscope.server.extensions.analysis.noise.thermal_drift import ThermalDrift, thermal_drift
from imuscope.server.extensions.analysis.signals.rest import rest_of
from imuscope.server.extensions.analysis.signals.sampling import sampling_of, unwrapped
from imuscope.server.extensions.analysis.signals.signals import Signal

MIN_SAMPLES = 9
MOTION = ("exclude", "include")
TEMPERATURE = ("exclude", "include")
DRIFT_RATIO = 2.0  # a ramp that is this many times the rest of the model at the longest averaging time is noted


def run(signal: Signal, options: Settings) -> Result:
    """The Allan deviation of one signal; see the module docstring."""
    sampling = sampling_of(signal, MIN_SAMPLES)
    values = unwrapped(signal)
    notes = sampling.notes()
    rest = rest_of(signal, values, sampling)
    runs, left_out = list(sampling.runs), 0.0
    longest = max((part.stop - part.start for part in rest.runs), default=0)
    if MOTION[int(options["motion"])] == "exclude" and longest >= MIN_SAMPLES:
        runs, left_out = list(rest.runs), rest.moving
        if left_out:
            notes.append(f"{rounded(left_out)} s of motion left out, {100 * left_out / rest.whole:.0f} % of the range.")
    longest = max(part.stop - part.start for part in runs)
    if longest < MIN_SAMPLES:
        hint = f"At least {MIN_SAMPLES} samples without a gap are needed. Request a longer range."
        raise DomainError("no-result", f"{signal.name} has no stretch without a gap that is long enough.", hint)
    drift = _drift(signal, values, runs)
    if drift is not None:
        is_removed = TEMPERATURE[int(options["temperature"])] == "exclude"
        values = values - drift.part if is_removed else values
        notes.append(_drift_note(drift, signal.unit, is_removed))
    lengths = averaging_lengths(longest, options["per_decade"])
    curve = allan_curve([values[part] for part in runs], sampling.rate, lengths)
    model = fit_noise(curve)
    low, high = intervals(curve.adev, model.freedom)
    measured = Measured(signal, values, sampling, replace(rest, runs=runs), curve, model)
    problems = obstacles(measured)
    ramp = "" if problems else _ramp_note(model, signal.unit)
    if not problems:
        level = measured.regularity.level
        may_change = measured.slow.is_suspected or measured.regularity.may_jump
        model = model.widened((level.low, level.high) if level else (1.0, 1.0), may_change=may_change)
    if not problems and not ramp and may_change:
        course = f"follow {measured.slow.words}" if measured.slow.is_suspected else "jump"
        ramp = f"The bias may {course}; then K and B contain it. Record longer to find out."
    sheet = signal.data_sheet
    compared: Result = {} if sheet is None else {"data_sheet": sheet_curve(sheet, curve.tau).tolist()}
    if sheet is not None and problems:
        compared = {**compared, "verdicts": withheld(sheet, signal.unit, problems[0].message)}
    elif sheet is not None:
        compared = {**compared, "verdicts": verdicts(sheet, signal.unit, curve, model, drifts=bool(ramp))}
    noise: Result = {
        "model": model.deviation(curve.tau).tolist(),
        "parameters": {
            name: {"value": one.value, "low": one.low, "high": one.high} for name, one in model.parameters.items()
        },
    }
    return {
        "tau": curve.tau.tolist(),
        "adev": curve.adev.tolist(),
        "low": low.tolist(),
        "high": high.tolist(),
        "degrees_of_freedom": model.freedom.tolist(),
        **({"obstacles": [one.figures() for one in problems]} if problems else noise),
        **compared,
        **({} if drift is None else {"temperature_drift": _drift_figures(drift)}),
        "rate": sampling.rate,
        "n": sum(part.stop - part.start for part in runs),
        "gaps": sampling.gaps,
        "left_out": left_out,
        "jitter": sampling.jitter,
        "notes": [*notes, *([ramp] if ramp else [])],
        "unchecked": unchecked(signal),
    }


def _drift(signal: Signal, values: Floats, runs: Sequence[slice]) -> ThermalDrift | None:
    if signal.temperature is None:
        return None
    try:
        return thermal_drift(signal.time, values, runs, signal.temperature())
    except DomainError:  # too many samples of the temperature: the noise is judged without
        return None


def _drift_figures(drift: ThermalDrift) -> dict[str, float]:
    return {
        "per_degree": drift.per_degree,
        "uncertainty": drift.uncertainty,
        "lowest": drift.low,
        "highest": drift.high,
    }


def _drift_note(drift: ThermalDrift, unit: str, is_removed: bool) -> str:
    """A sentence on a drift with temperature, and how to decide otherwise."""
    is_line = math.isfinite(drift.uncertainty)
    bound = f" ± {drift.uncertainty:.2g} {unit} per °C" if is_line else f" {unit} per °C in the mean"
    size = f"{drift.per_degree:+.3g}{bound} between {drift.low:.1f} and {drift.high:.1f} °C"
    size += ", if no other drift coincides," if is_line else ", not along a line,"
    if is_removed:
        return f"Temperature drift of {size} was removed. Set temperature to include to keep it."
    return f"The signal follows the temperature: {size[:-1]}. Set temperature to exclude to remove it."


def _ramp_note(model: NoiseModel, unit: str) -> str:
    """A sentence if the bias drifts in one direction, as it does while the sensor warms up; else ""."""
    tau = np.array([model.tau[1]])
    ramp = model.parameters["ramp"]
    whole, part = float(model.deviation(tau)[0]), ramp.value * float(tau[0]) / np.sqrt(2)
    if part < whole / np.sqrt(1 + 1 / DRIFT_RATIO**2):
        return ""
    drift = f"{ramp.value * 3600:.3g} {unit}/h".strip()
    drifts = f"The bias drifts by {drift}: averaging times near {rounded(tau[0])} s show the drift."
    return f"{drifts} A sensor that warms up is one cause."


def _units() -> dict[str, Any]:
    names = noise_model.UNITS.items()
    return {
        "tau": "s",
        **dict.fromkeys(("adev", "low", "high", "model", "data_sheet"), "{unit}"),
        **{f"parameters.{name}.{end}": unit for name, unit in names for end in ("value", "low", "high")},
        **{"rate": "Hz", "left_out": "s", "jitter": "s"},
        **dict.fromkeys(("temperature_drift.per_degree", "temperature_drift.uncertainty"), "{unit}/°C"),
        **dict.fromkeys(("temperature_drift.lowest", "temperature_drift.highest"), "°C"),
    }


register_analysis(
    Analysis(
        "allan",
        "Allan deviation",
        "overlapping Allan deviation, its 95 % interval, and random walk, bias instability and drift",
        run,
        _units(),
        (
            AnalysisOption("per_decade", 8, 1, 50, "", "Averaging times per decade."),
            choice("motion", MOTION, "Whether stretches with motion are left out."),
            choice("temperature", TEMPERATURE, "Whether the influence of the temperature is removed."),
        ),
        order=30,
        formats=FORMATS,
        companions=True,
    )
)
