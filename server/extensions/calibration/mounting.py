"""Rotation from a sensor to its vehicle, from gravity at rest and a straight drive.

At rest on level ground the accelerometer shows where up is. On a straight drive what it shows beside that is along the
vehicle: the principal direction of the horizontal part. It points forward where the speed, its integral, is positive,
as a drive begins forwards. The matrix turns vectors of the sensor into the axes of the vehicle:

    up     x forward, y left, z up          down     x forward, y right, z down

The ground's slope is not seen, and turns the result as much.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.rotations import euler_columns
from imuscope.server.extensions.analysis.signals.stillness import (
    RestRun,
    StepMeans,
    mean_and_uncertainty,
    step_means,
    stillness,
    within,
)
from imuscope.server.extensions.analysis.signals.triads import Samples
from imuscope.server.extensions.calibration.report import (
    CalibrationRefusal,
    CalibrationReport,
    DriveProgress,
    SensorCorrection,
    begun,
    figure,
)

VerticalAxis = Literal["up", "down"]

REST_S = 4.0
SPEED_CHANGE = 4.0  # m/s: to 2 m/s and back to rest
MAX_TURN = 5.0  # °
MAX_UNCERTAINTY = 2.0  # °
LONGEST_S = 60.0
BLOCK_STEPS = 5  # half a second: vibration within it counts as one
GRAVITY_RANGE = (9.0, 10.6)  # m/s²


@dataclass(frozen=True, slots=True)
class DriveFit:
    """A rest and the drive after it.

    Attributes:
        up, forward: (3,) unit vectors in the sensor, perpendicular.
        up_sigma, forward_sigma: standard uncertainties, rad.
        speed_change: m/s.
        turn: of the heading, the largest difference, °.
    """

    rest_s: float
    up: Floats
    up_sigma: float
    forward: Floats
    forward_sigma: float
    speed_change: float
    turn: float


def mounting_rotation(force: Samples, turn: Samples, vertical: VerticalAxis = "up") -> CalibrationReport:
    """The rotation from samples of accelerometer, m/s², and gyroscope, °/s.

    Args:
        vertical: where z of the vehicle points.
    """
    forces, turns = step_means(force), step_means(turn)
    rest = stillness(turns, forces)
    fits = _fits(forces, turns, rest.runs)
    best = max(fits, key=_quality, default=None)
    longest = max((run.seconds for run in rest.runs), default=0.0)
    rested = best.rest_s if best else longest
    change, turned = (best.speed_change, best.turn) if best else (0.0, 0.0)
    driven = 0.6 * min(1.0, change / SPEED_CHANGE) if rested >= REST_S else 0.0
    progress = 0.4 * min(1.0, rested / REST_S) + driven
    report = begun("mounting", "", force, progress=progress, advice=_advice(rested, change, turned))
    report.drive = DriveProgress(
        rest_s=min(rested, REST_S),
        rest_needed_s=REST_S,
        speed_change=change,
        speed_needed=SPEED_CHANGE,
        turn=turned,
        turn_allowed=MAX_TURN,
    )
    report.refusal = _refusal(rested, best, forces)
    if report.refusal is not None or best is None:
        report.progress = min(report.progress, 0.95)
        return report
    _fill(report, best, vertical)
    return report


def _fill(report: CalibrationReport, best: DriveFit, vertical: VerticalAxis) -> None:
    left = np.cross(best.up, best.forward)
    rows = [best.forward, left, best.up] if vertical == "up" else [best.forward, -left, -best.up]
    matrix = np.array(rows)
    roll, pitch, yaw = mounting_angles(matrix)
    tilt, heading = float(np.degrees(best.up_sigma)), float(np.degrees(best.forward_sigma))
    report.correction = SensorCorrection(
        unit="",
        bias=[0.0, 0.0, 0.0],
        bias_uncertainty=[0.0, 0.0, 0.0],
        matrix=matrix.tolist(),
        matrix_uncertainty=float(max(best.up_sigma, best.forward_sigma)),
    )
    report.figures = [
        figure("roll", "Roll", roll, "°", tilt),
        figure("pitch", "Pitch", pitch, "°", tilt),
        figure("yaw", "Yaw", yaw, "°", heading),
        figure("speed_change", "Change of speed", best.speed_change, "m/s"),
        figure("turn", "Turned", best.turn, "°"),
    ]
    axes = "x forward, y left, z up" if vertical == "up" else "x forward, y right, z down"
    report.notes = [
        f"The matrix turns vectors of the sensor into the axes of the vehicle: {axes}.",
        "The ground was taken as level: a slope of 1° turns roll or pitch by 1°.",
        "The drive was taken to begin forwards.",
    ]


def _fits(forces: StepMeans, turns: StepMeans, runs: list[RestRun]) -> list[DriveFit]:
    fits = []
    for number, run in enumerate(runs):
        if run.seconds < REST_S or not len(forces):
            continue
        # an even speed looks like rest, but a drive has seldom much of it
        later = (one.begin for one in runs[number + 1 :] if one.seconds >= REST_S)
        end = min(next(later, float(forces.time[-1])) + 0.5, run.end + LONGEST_S)
        fit = _fit(forces, turns, run, end)
        if fit is not None:
            fits.append(fit)
    return fits


def _fit(forces: StepMeans, turns: StepMeans, run: RestRun, end: float) -> DriveFit | None:
    """Of the drive between a rest and a time; None if there is none."""
    still = within(forces, run, 0.3)
    drive = within(forces, RestRun(run.end - 1.0, end))
    if len(still) < 10 or len(drive) < 2 * BLOCK_STEPS:
        return None
    mean, sigma = mean_and_uncertainty(still)
    size = float(np.linalg.norm(mean))
    up = mean / size
    added = drive.means - mean
    level = added - np.outer(added @ up, up)
    # the principal direction within the plane
    _, vectors = np.linalg.eigh(level.T @ level)
    forward = vectors[:, -1] - up * float(vectors[:, -1] @ up)
    forward /= np.linalg.norm(forward)
    along = level @ forward
    step = drive.step
    speed = np.cumsum(along) * step
    if speed.mean() < 0:
        forward, along = -forward, -along
    left = np.cross(up, forward)
    across = level @ left
    power = float(along @ along)
    # vibration is not independent from step to step, so that blocks are
    blocks = [slice(k, k + BLOCK_STEPS) for k in range(0, len(along), BLOCK_STEPS)]
    scores = sum(float(along[block] @ across[block]) ** 2 for block in blocks)
    turned = _turned(turns, run, end, up)
    slope = np.sqrt(scores) / power if power else np.inf
    # of half seconds, and without the small ones, so that vibration does not count as a change of speed
    changes = np.abs([float(along[block].sum()) * step for block in blocks])
    change = float(changes[changes > 0.05].sum())
    return DriveFit(
        run.seconds,
        up,
        float(np.linalg.norm(sigma)) / size,
        forward,
        float(np.hypot(slope, np.radians(turned) / np.sqrt(12))),
        change,
        turned,
    )


def _turned(turns: StepMeans, run: RestRun, end: float, up: Floats) -> float:
    """Largest difference of heading on the drive, °, with the bias of the rest taken off."""
    still, drive = within(turns, run, 0.3), within(turns, RestRun(run.end - 1.0, end))
    if not len(still) or not len(drive):
        return 0.0
    rate = (drive.means - still.means.mean(axis=0)) @ up
    heading = np.concatenate(([0.0], np.cumsum(rate) * drive.step))
    return float(heading.max() - heading.min())


def _quality(fit: DriveFit) -> tuple[bool, bool, float]:
    """The best of several drives: straight, strong, certain."""
    return fit.turn <= MAX_TURN, fit.speed_change >= SPEED_CHANGE, -fit.forward_sigma


def _advice(rested: float, change: float, turned: float) -> str:
    if rested < REST_S:
        return f"Stand still on level ground: {max(0.0, REST_S - rested):.0f} s to go."
    if turned > MAX_TURN:
        return "Stop and rest, then drive again, straight ahead."
    if change < SPEED_CHANGE:
        return "Drive straight ahead, briskly, and brake."
    return "Done: the drive was straight and strong enough."


def _refusal(rested: float, best: DriveFit | None, forces: StepMeans) -> CalibrationRefusal | None:
    if rested < REST_S:
        return CalibrationRefusal(
            message=f"The rest before the drive lasted {rested:.1f} s; {REST_S:.0f} s are needed.",
            hint="Stand still on level ground, then drive straight ahead.",
        )
    strength = float(np.median(np.linalg.norm(forces.means, axis=1))) if len(forces) else 0.0
    if not GRAVITY_RANGE[0] <= strength <= GRAVITY_RANGE[1]:
        return CalibrationRefusal(
            message=f"The accelerometer shows {strength:.2f} m/s² of gravity, which is not there on Earth.",
            hint="Calibrate the accelerometer first.",
        )
    if best is None or best.speed_change < SPEED_CHANGE:
        change = best.speed_change if best else 0.0
        return CalibrationRefusal(
            message=f"The speed changed by {change:.1f} m/s; {SPEED_CHANGE:.0f} m/s are needed.",
            hint="Drive straight ahead, accelerate more, and brake.",
        )
    if best.turn > MAX_TURN:
        return CalibrationRefusal(
            message=f"The drive turned by {best.turn:.1f}°; {MAX_TURN:.0f}° are allowed.",
            hint="Stop, rest, and drive again along a straight line.",
        )
    if best.forward_sigma > np.radians(MAX_UNCERTAINTY):
        sigma = np.degrees(best.forward_sigma)
        return CalibrationRefusal(
            message=f"The direction of the drive is uncertain by {sigma:.1f}°; {MAX_UNCERTAINTY:.0f}° are allowed.",
            hint="Drive on smooth ground, and accelerate more.",
        )
    return None


def mounting_angles(matrix: Floats) -> list[float]:
    """Roll, pitch and yaw of a rotation, °, as everywhere (protocols/rotations.py)."""
    return [float(angle) for angle in euler_columns(list(matrix.ravel()))]
