"""Bias and scale of an accelerometer from rests on its six sides.

At rest an accelerometer shows gravity, upwards. Each rest near an axis gives one equation,
|scale · (measured − bias)| = g, so the sides need not be level or square: six rests determine bias and scale of the
three axes, more of them also how well the model fits. Misalignment of the axes is in the result only if the sides are
declared to be square and the table level:

    square    measured = bias + K · g · axis, linear; the residual shows how well the sensor was placed

Gravity differs by 0.5 % between equator and pole, and the scale with it, unless it is given.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.analysis.signals.stillness import (
    RestRun,
    StepMeans,
    mean_and_uncertainty,
    step_means,
    stillness,
    within,
)
from imuscope.server.extensions.analysis.signals.triads import NO_SAMPLES, Samples
from imuscope.server.extensions.calibration.directions import AXES, AXIS_VECTORS
from imuscope.server.extensions.calibration.report import (
    CalibrationRefusal,
    CalibrationReport,
    ResidualTrace,
    RestPosition,
    SensorCorrection,
    SixPositions,
    begun,
    figure,
)

STANDARD_GRAVITY = 9.80665
GRAVITY_SHARE = 0.0015  # standard deviation of 9.780 to 9.832 m/s², each as likely, as a share
HOLD_S = 2.0  # besides the second that the hand needs to let go
MARGIN_S = 0.3
MIN_COSINE = np.cos(np.radians(30.0))
MAX_SCALE = 0.2  # more is not a scale error, but another unit or a broken axis
MAX_PLACEMENT_DEG = 3.0


@dataclass(frozen=True, slots=True)
class RestOnSide:
    """A rest: which axis pointed up, for how long, and the mean with its uncertainty, (3,) m/s²."""

    side: int
    seconds: float
    mean: Floats
    sigma: Floats


def six_positions(
    force: Samples, turn: Samples = NO_SAMPLES, gravity: float = 0.0, *, square: bool = False
) -> CalibrationReport:
    """Bias and scale from samples of an accelerometer, m/s².

    Args:
        turn: of the gyroscope, °/s, which sees turns sooner.
        gravity: there, m/s²; 0 if unknown.
        square: the sides are square and the table is level.
    """
    means = step_means(force)
    rest = stillness(step_means(turn) if len(turn) else None, means)
    positions = list(_rests_on_sides(means, rest.runs))
    seconds = [max((one.seconds for one in positions if one.side == side), default=0.0) for side in range(6)]
    done = [one >= HOLD_S for one in seconds]
    is_still = rest.motion <= 1
    now = _side_of(means.means[-5:].mean(axis=0)) if len(means) >= 5 and is_still else -1
    missing = [AXES[side] for side in range(6) if not done[side]]
    progress = sum(min(1.0, one / HOLD_S) for one in seconds) / 6
    advice = _advice(missing, now, seconds, is_still)
    report = begun("accelerometer", "m/s²", force, progress=progress, advice=advice)
    report.positions = SixPositions(
        positions=[
            RestPosition(up=axis, seconds=one, is_done=one >= HOLD_S) for axis, one in zip(AXES, seconds, strict=True)
        ],
        now=AXES[now] if now >= 0 else "",
        seconds=HOLD_S,
    )
    if missing:
        report.refusal = CalibrationRefusal(
            message=f"{6 - len(missing)} of six positions are done. Missing: {', '.join(missing)} up.",
            hint=f"Rest the sensor for {HOLD_S:.0f} s with each of these axes pointing up.",
        )
        return report
    used = [one for one in positions if one.seconds >= HOLD_S]
    (_fill_square if square else _fill_free)(report, used, gravity or STANDARD_GRAVITY, is_known=gravity > 0)
    if report.correction is not None and not gravity:
        report.notes.append(
            f"Gravity was taken as {STANDARD_GRAVITY} m/s². It is 9.780 to 9.832 m/s²; the scale is as uncertain."
        )
    return report


def _rests_on_sides(means: StepMeans, runs: Iterable[RestRun]) -> Iterator[RestOnSide]:
    for run in runs:
        own = within(means, run, MARGIN_S)
        if len(own) < 5:
            continue
        mean, sigma = mean_and_uncertainty(own)
        if (side := _side_of(mean)) >= 0:
            yield RestOnSide(side, run.seconds, mean, sigma)


def _side_of(mean: Floats) -> int:
    """Number of the axis that points up; -1: none within 30°."""
    shares = AXIS_VECTORS @ mean / max(float(np.linalg.norm(mean)), 1e-9)
    return int(shares.argmax()) if shares.max() >= MIN_COSINE else -1


def _advice(missing: list[str], now: int, seconds: list[float], is_still: bool) -> str:
    if not missing:
        return "Done: all six positions."
    if is_still and now >= 0 and AXES[now] in missing:
        return f"Hold still with {AXES[now]} up: {max(0.0, HOLD_S - seconds[now]):.0f} s to go."
    return f"Put the sensor down with {missing[0]} pointing up."


def _fill_free(report: CalibrationReport, used: list[RestOnSide], gravity: float, *, is_known: bool) -> None:
    """Bias and scale from magnitudes: Gauss-Newton on |s · (m − b)| − g."""
    means = np.array([one.mean for one in used])
    bias, scale = _start(used, gravity)
    rows = np.empty((len(used), 6))
    for _ in range(20):
        away = (means - bias) * scale
        size = np.linalg.norm(away, axis=1)
        along = away / size[:, None]
        rows[:, :3] = -along * scale
        rows[:, 3:] = along * (means - bias)
        step = np.linalg.lstsq(rows, gravity - size, rcond=None)[0]
        bias, scale = bias + step[:3], scale + step[3:]
        if np.abs(step).max() < 1e-12:
            break
    residual = np.linalg.norm((means - bias) * scale, axis=1) - gravity
    noise = np.array([float(np.linalg.norm(one.sigma * one.mean) / np.linalg.norm(one.mean)) for one in used])
    inverse = np.linalg.pinv(rows)
    # the scatter of the rests counts where there are more of them than unknowns, their own noise anyway
    spare = len(used) - 6
    scatter = float(residual @ residual) / spare if spare else 0.0
    covariance = inverse @ np.diag(np.square(noise) + scatter) @ inverse.T
    words = "± holds for axes that are square to each other and a bias that stays: six rests cannot show otherwise."
    _finish(
        report,
        used,
        gravity,
        bias,
        np.diag(scale),
        np.sqrt(np.diagonal(covariance)),
        is_free=spare == 0,
        is_known=is_known,
        presupposes="" if spare else words,
    )
    report.notes.append("Misalignment of the axes is not determined by magnitudes, and left out.")


def _fill_square(report: CalibrationReport, used: list[RestOnSide], gravity: float, *, is_known: bool) -> None:
    """Bias, scale and misalignment from the axes of the housing: linear."""
    means = np.array([one.mean for one in used])
    rows = np.concatenate((np.ones((len(used), 1)), gravity * AXIS_VECTORS[[one.side for one in used]]), axis=1)
    solution = np.linalg.lstsq(rows, means, rcond=None)[0]
    bias, response = solution[0], solution[1:].T
    residual = means - rows @ solution
    spread = float(np.sqrt(np.square(residual).sum() / max(3 * len(used) - 12, 1)))
    placement = float(np.degrees(spread / gravity))
    if placement > MAX_PLACEMENT_DEG:
        report.refusal = CalibrationRefusal(
            message=f"The positions differ from square by {placement:.1f}°; {MAX_PLACEMENT_DEG:.0f}° are allowed.",
            hint="Put the sensor on square sides on a level table, or calibrate without them.",
        )
        return
    sigma = spread * np.sqrt(np.diagonal(np.linalg.inv(rows.T @ rows)))
    both = np.concatenate((np.full(3, sigma[0]), sigma[1:]))
    words = "± holds for sides that are square and a table that is level."
    _finish(
        report,
        used,
        gravity,
        bias,
        np.linalg.inv(response),
        both,
        is_free=False,
        is_known=is_known,
        presupposes=words,
    )
    report.figures.append(figure("placement", "Placement", placement, "°"))


def _start(used: list[RestOnSide], gravity: float) -> tuple[Floats, Floats]:
    bias, scale = np.zeros(3), np.ones(3)
    for axis in range(3):
        up = np.mean([one.mean[axis] for one in used if one.side == 2 * axis])
        down = np.mean([one.mean[axis] for one in used if one.side == 2 * axis + 1])
        bias[axis], scale[axis] = (up + down) / 2, 2 * gravity / (up - down)
    return bias, scale


def _finish(
    report: CalibrationReport,
    used: list[RestOnSide],
    gravity: float,
    bias: Floats,
    matrix: Floats,
    sigma: Floats,
    *,
    is_free: bool,
    is_known: bool,
    presupposes: str,
) -> None:
    """Fill in the result, or refuse an implausible one."""
    off = float(np.abs(np.diagonal(matrix) - 1).max())
    if not np.isfinite(matrix).all() or off > MAX_SCALE:
        report.refusal = CalibrationRefusal(
            message=f"The scale is {100 * off:.0f} % off; no accelerometer has more than {100 * MAX_SCALE:.0f} %.",
            hint="Check the unit of the signal, and start again.",
        )
        return
    report.correction = SensorCorrection(
        unit="m/s²",
        bias=bias.tolist(),
        bias_uncertainty=sigma[:3].tolist(),
        matrix=matrix.tolist(),
        matrix_uncertainty=float(np.hypot(sigma[3:].max(), 0.0 if is_known else GRAVITY_SHARE)),
        presupposes=presupposes,
    )
    means = np.array([one.mean for one in used])
    raw = np.linalg.norm(means, axis=1)
    corrected = np.linalg.norm((means - bias) @ matrix.T, axis=1)
    before, after = (float(np.sqrt(np.mean(np.square(size - gravity)))) for size in (raw, corrected))
    report.figures = [
        figure("residual_before", "Residual before", before, "m/s²"),
        figure("residual_before_share", "", 100 * before / gravity, "%"),
    ]
    if not is_free:  # six rests fit exactly, which proves nothing
        report.figures += [
            figure("residual_after", "Residual after", after, "m/s²"),
            figure("residual_after_share", "", 100 * after / gravity, "%"),
        ]
    report.figures.append(figure("rests", "Rests used", float(len(used)), ""))
    report.trace = ResidualTrace(
        title="Gravity in each rest",
        unit="m/s²",
        target=gravity,
        before=raw.tolist(),
        after=corrected.tolist(),
    )
