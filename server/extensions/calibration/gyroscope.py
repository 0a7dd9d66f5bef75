"""Bias of a gyroscope: its mean while the sensor rests.

The longest rest counts. Its first and last half second are left out, because a hand lets go there. What the mean cannot
distinguish from a bias stands beside its uncertainty: the turn of the Earth, and a steady turn that no other sensor
excludes. An accelerometer shows turns, but not those about the vertical; the direction of a magnetic field shows these.
"""

import numpy as np

from imuscope.server.extensions.analysis.signals.stillness import (
    RestRun,
    StepMeans,
    mean_and_uncertainty,
    step_means,
    stillness,
    within,
)
from imuscope.server.extensions.analysis.signals.triads import NO_SAMPLES, Samples
from imuscope.server.extensions.calibration.directions import unit_vectors
from imuscope.server.extensions.calibration.report import (
    CalibrationFigure,
    CalibrationRefusal,
    CalibrationReport,
    ResidualTrace,
    RestProgress,
    SensorCorrection,
    begun,
    figure,
)

NEEDED_S, GOAL_S = 10.0, 30.0
MARGIN_S = 0.5
MAX_BIAS = 10.0  # °/s; poor sensors have 5, a turntable has more
TRACE_POINTS = 240
MAX_SWEPT_DEG = 3.0  # ° of a magnetic field within a rest
MAX_WARMING_C = 1.0  # °C within a rest


def gyroscope_bias(
    turn: Samples, force: Samples = NO_SAMPLES, temperature: Samples = NO_SAMPLES, field: Samples = NO_SAMPLES
) -> CalibrationReport:
    """The bias from samples of a gyroscope, °/s.

    Args:
        force: of the accelerometer, m/s², which reveals turns that a gyroscope cannot distinguish from a bias.
        temperature: °C, in the first of three columns.
        field: of the magnetometer, in any unit, which reveals turns about the vertical.
    """
    means = step_means(turn)
    rest = stillness(means, step_means(force) if len(force) else None)
    run = rest.longest
    seconds = run.seconds if run else 0.0
    is_still = rest.motion <= 1
    report = begun("gyroscope", "°/s", turn, progress=min(1.0, seconds / GOAL_S), advice=_advice(seconds, is_still))
    report.rest = RestProgress(
        is_still=is_still, motion=min(rest.motion, 99.0), seconds=seconds, needed=NEEDED_S, goal=GOAL_S
    )
    if run is None or seconds < NEEDED_S:
        report.refusal = CalibrationRefusal(
            message=f"The longest rest is {seconds:.1f} s; {NEEDED_S:.0f} s are needed.",
            hint="Put the sensor down where nothing shakes it, and do not touch it.",
        )
        return report
    own = within(means, run, MARGIN_S)
    bias, uncertainty = mean_and_uncertainty(own)
    size = float(np.linalg.norm(bias))
    if size > MAX_BIAS:
        report.refusal = CalibrationRefusal(
            message=f"The sensor turns steadily at {size:.1f} °/s, more than the bias of any gyroscope "
            f"({MAX_BIAS:.0f} °/s).",
            hint="Stop what turns it, and start again.",
        )
        return report
    swept = _swept(field, run)
    if swept is not None and swept > MAX_SWEPT_DEG:
        report.refusal = CalibrationRefusal(
            message=f"The sensor turns: the direction of the magnetic field changes by {swept:.0f}°.",
            hint="Stop what turns it, keep iron and magnets away, and start again.",
        )
        return report
    report.correction = SensorCorrection(
        unit="°/s",
        bias=bias.tolist(),
        bias_uncertainty=uncertainty.tolist(),
        matrix=np.eye(3).tolist(),
        matrix_uncertainty=0.0,
        presupposes=_presupposes(has_force=len(force) > 0, has_field=swept is not None),
    )
    report.figures = [figure("rest", "Rest", seconds, "s")]
    report.trace = _trace(own, bias)
    report.notes = _temperature_notes(temperature, run.begin, run.end, report.figures)
    return report


def _swept(field: Samples, run: RestRun) -> float | None:
    """Largest change of direction of the field in a rest, °; None without samples of it all along."""
    means = within(step_means(field), run, MARGIN_S).means
    if len(means) < run.seconds or not np.linalg.norm(means, axis=1).all():
        return None
    parts = unit_vectors(np.array([part.mean(axis=0) for part in np.array_split(means, max(2, int(run.seconds)))]))
    return float(np.degrees(np.arccos(np.clip(parts @ parts[0], -1, 1))).max())


def _presupposes(*, has_force: bool, has_field: bool) -> str:
    earth = "The bias contains the turn of the Earth, up to 0.004 °/s"
    if has_field and has_force:
        return f"{earth}."
    about = " about the vertical" if has_force else ""
    return (
        f"{earth}, and any steady turn{about}, which no other sensor here excludes: ± holds only for a sensor at rest."
    )


def _advice(seconds: float, is_still: bool) -> str:
    if seconds >= GOAL_S:
        return "Done: the rest was long enough."
    if not is_still:
        return "Put the sensor down and do not touch it."
    return f"Keep it still: {max(0.0, GOAL_S - seconds):.0f} s to go."


def _trace(own: StepMeans, bias: np.ndarray) -> ResidualTrace:
    per = max(1, round(len(own) / TRACE_POINTS))
    count = len(own) // per
    smooth = own.means[: count * per].reshape(count, per, 3).mean(axis=1)
    return ResidualTrace(
        title="Rate of turn at rest",
        unit="°/s",
        target=0.0,
        before=np.linalg.norm(smooth, axis=1).tolist(),
        after=np.linalg.norm(smooth - bias, axis=1).tolist(),
    )


def _temperature_notes(temperature: Samples, begin: float, end: float, figures: list[CalibrationFigure]) -> list[str]:
    inside = temperature.values[(temperature.time >= begin) & (temperature.time <= end), 0]
    if not len(inside):
        return ["The temperature is unknown. The bias changes with it: repeat this when the sensor is warmer."]
    mean, change = float(np.mean(inside)), float(np.max(inside) - np.min(inside))
    figures.append(figure("temperature", "Temperature", mean, "°C"))
    if change > MAX_WARMING_C:
        return [f"The temperature changed by {change:.1f} °C in the rest. Let the sensor warm up and repeat."]
    return [f"Valid near {mean:.0f} °C: the bias changes with temperature."]
