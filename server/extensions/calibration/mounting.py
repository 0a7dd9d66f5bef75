"""Rotation from a sensor to its vehicle, from gravity at rest and a straight drive.

At rest on level ground the accelerometer shows where up is. On a straight drive what it shows beside that is along the
vehicle: the principal direction of the horizontal part. It points forward where the speed, its integral, is positive,
as a drive begins forwards. The matrix turns vectors of the sensor into the axes of the vehicle:

    up     x forward, y left, z up          down     x forward, y right, z down

An even speed looks like rest, and braking from it like a drive backwards, so a drive lasts until its speed is 0 again:

    speed          0  rising  even  falling  0        one drive, from the first rest to the second,
    looks like     rest      rest      rest           not two, of which the second begins at speed

Drives that contradict each other are refused. The ground's slope is not seen, and turns the result as much.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
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
MAX_END_SPEED = 0.5  # of the highest speed of a drive: the slope of the ground adds to its integral
MIN_SPEED = 0.5  # m/s: a drive has more
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
    fits, is_open = _fits(forces, turns, rest.runs)
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
    sound = [one for one in fits if _quality(one)[:2] == (True, True)]
    if best in sound:
        best = _with_spread(best, sound)
    report.refusal = _refusal(rested, best, forces, is_open=is_open) or _contradiction(sound)
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
        presupposes="± holds for level ground, as a slope of 1° turns roll or pitch by 1°, and for a drive that begins "
        "forwards, from rest; else yaw is off by 180°.",
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
    ]


def _fits(forces: StepMeans, turns: StepMeans, runs: Sequence[RestRun]) -> tuple[list[DriveFit], bool]:
    """Fits of all drives that begin and end at rest, or go on; and whether one seems to rest at another speed only."""
    fits, is_open, number = [], False, 0
    runs = [run for run in runs if run.seconds >= REST_S] if len(forces) else []
    while number < len(runs):
        run = runs[number]
        later = [n for n in range(number + 1, len(runs)) if runs[n].begin <= run.end + LONGEST_S]
        ends = [n for n in later if _is_at_rest(forces, run, runs[n].begin)]
        number += 1
        if later and not ends:  # that, or the rest before, is a coast
            is_open = True
            continue
        end = float(forces.time[-1])
        if ends:
            end, number = runs[ends[0]].begin + 0.5, ends[0]
        fit = _fit(forces, turns, run, min(end, run.end + LONGEST_S))
        if fit is not None:
            fits.append(fit)
    return fits, is_open


def _is_at_rest(forces: StepMeans, run: RestRun, time: float) -> bool:
    """Whether a drive that began in a rest is back at its speed then."""
    mean = within(forces, run, 0.3).means.mean(axis=0)
    added = within(forces, RestRun(run.end - 1.0, time)).means - mean
    speeds = np.linalg.norm(np.cumsum(added, axis=0), axis=1) * forces.step
    return not len(speeds) or bool(speeds[-1] <= max(MIN_SPEED, MAX_END_SPEED * speeds.max()))


def _with_spread(best: DriveFit, fits: Sequence[DriveFit]) -> DriveFit:
    """The best fit; its uncertainty contains half of its distance to any of the others, apart from their sign."""
    cosines = [abs(float(best.forward @ one.forward)) for one in fits]
    spread = max(float(np.arccos(min(one, 1.0))) for one in cosines) / 2
    return replace(best, forward_sigma=max(best.forward_sigma, spread))


def _contradiction(fits: Sequence[DriveFit]) -> CalibrationRefusal | None:
    if all(float(fits[0].forward @ one.forward) > 0 for one in fits[1:]):
        return None
    return CalibrationRefusal(
        message="Two drives contradict each other: where one begins forwards, the other begins backwards.",
        hint="Choose a range with one drive that begins forwards from rest.",
    )


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
    powers = np.array([float(along[block] @ along[block]) for block in blocks])
    turned = _turned(turns, run, end, up)
    slope = _student(power**2 / float(powers @ powers)) * np.sqrt(scores) / power if power else np.inf
    # of half seconds, and without the small ones, so that vibration does not count as a change of speed
    changes = np.abs([float(along[block].sum()) * step for block in blocks])
    change = float(changes[changes > 0.05].sum())
    return DriveFit(
        run.seconds,
        up,
        float(np.sqrt(np.square(sigma).mean())) / size,
        forward,
        float(np.hypot(slope, np.radians(turned) / np.sqrt(12))),
        change,
        turned,
    )


def _student(count: float) -> float:
    """Factor by which an interval of 95 % grows because its scatter is known from so many blocks only."""
    from scipy.special import stdtrit

    return float(stdtrit(max(count - 1, 1.0), 0.975)) / 1.96


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


def _refusal(rested: float, best: DriveFit | None, forces: StepMeans, *, is_open: bool) -> CalibrationRefusal | None:
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
    if is_open:
        return CalibrationRefusal(
            message="The drive does not end at rest: the speed did not change back before the sensor seemed to rest.",
            hint="Begin and end at rest: stand still, drive straight ahead, brake, and stand still again.",
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
