"""Hard and soft iron of a magnetometer: the ellipsoid on which its samples lie.

In an even field of strength F a sensor that is turned measures points of an ellipsoid, measured = A · field + bias:
hard iron and offset move its centre, soft iron, scale and misalignment deform it. The correction

    corrected = S (measured − bias),   S symmetric,   |corrected| = F

makes it a sphere. S is symmetric because magnitudes do not show a rotation; F keeps the volume unless it is given.

    1  algebraic      a quadric through the points, by least squares: a start, and a test for an ellipsoid
    2  geometric      Gauss-Newton on |S (m − b)| − F, in units of the signal
    3  uncertainty    of the parameters, from the scatter of residuals of each second, or of four
    4  judgement      cells of directions seen, condition of the problem, error in the worst direction

Samples are thinned to the same number in every cell of directions, so that a rest does not outvote a turn.

Source: Renaudin, Afzal, Lachapelle, "Complete Triaxis Magnetometer Calibration in the Magnetic Domain", 2010.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.analysis.signals.triads import Samples
from imuscope.server.extensions.calibration.directions import (
    CELLS,
    CELLS_PER_RING,
    CENTRES,
    cells_of,
    missing_axes,
    unit_vectors,
)
from imuscope.server.extensions.calibration.report import (
    CalibrationRefusal,
    CalibrationReport,
    DirectionCoverage,
    ResidualTrace,
    SensorCorrection,
    begun,
    figure,
)

MIN_SAMPLES = 60
MIN_IN_CELL = 3  # one may be an outlier
NEEDED_SHARE, GOAL_SHARE = 0.6, 0.9
MAX_CONDITION = 15.0  # a full sphere has 2, a band of ±30° has 9, one of ±20° has 22
MAX_ERROR = 0.03  # of the field, in the worst direction: 1.7°
MAX_RESIDUAL = 0.1  # of the field after the fit
PER_CELL = 40
PROVISIONAL_SAMPLES = 400  # samples for the provisional centre
CLUSTERS_S = (1.0, 4.0)  # residuals are not independent within them
TRACE_POINTS = 240
MAX_ITERATIONS = 30
_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True, slots=True)
class Ellipsoid:
    """A fit: |shape · (m − centre)| = 1.

    Attributes:
        shape: (3, 3) symmetric, positive definite.
        covariance: (9, 9) of the centre and the six elements of `shape`, in the order of _PAIRS.
        condition: of the problem, with centre and shape in units of the radius.
    """

    centre: Floats
    shape: Floats
    covariance: Floats
    condition: float

    @property
    def radius(self) -> float:
        """Of the sphere with the same volume."""
        return float(np.linalg.det(self.shape) ** (-1 / 3))


def magnetometer_iron(samples: Samples, unit: str, field: float = 0.0) -> CalibrationReport:
    """Hard and soft iron from samples of a magnetometer.

    Args:
        field: strength of the field there, in the unit of the samples; 0 if unknown.
    """
    advice = "Turn the sensor slowly through all directions."
    report = begun("magnetometer", unit, samples, progress=0.0, advice=advice)
    report.coverage = _coverage(np.zeros(CELLS, np.bool_), np.empty(0))
    if len(samples) < MIN_SAMPLES:
        report.refusal = CalibrationRefusal(
            message=f"{len(samples)} samples are too few; {MIN_SAMPLES} are needed.",
            hint=advice,
        )
        return report
    centre = provisional_centre(samples.values)
    chosen = _thinned(cells_of(unit_vectors(samples.values - centre)))
    own = samples.at(chosen)
    fit = fit_ellipsoid(own)
    if fit is not None and fit.condition <= MAX_CONDITION:  # its directions are better than the provisional ones
        directions = unit_vectors((samples.values - fit.centre) @ fit.shape)
        own = samples.at(_thinned(cells_of(directions)))
        fit = fit_ellipsoid(own)
    else:
        directions = unit_vectors(samples.values - centre)
    is_covered = np.zeros(CELLS, np.bool_)
    is_covered[:] = np.bincount(cells_of(directions), minlength=CELLS) >= MIN_IN_CELL
    coverage = report.coverage = _coverage(is_covered, directions[-1])
    report.progress = min(1.0, coverage.share / GOAL_SHARE)
    report.advice = _advice(coverage)
    report.refusal = _refusal(fit, own, coverage)
    if fit is None or report.refusal is not None:
        report.progress = min(report.progress, 0.95)
        return report
    _fill(report, fit, own, samples, field)
    return report


def _coverage(is_covered: NDArray[np.bool_], now: Floats) -> DirectionCoverage:
    return DirectionCoverage(
        rings=list(CELLS_PER_RING),
        seen=is_covered.tolist(),
        share=float(is_covered.mean()),
        needed=NEEDED_SHARE,
        goal=GOAL_SHARE,
        missing=missing_axes(is_covered),
        now=now.tolist(),
    )


def _advice(coverage: DirectionCoverage) -> str:
    if coverage.share >= coverage.goal:
        return "Done: all directions have been seen."
    if coverage.missing:
        return f"Turn the sensor until the ring passes the empty fields around {', '.join(coverage.missing)}."
    return "Turn the sensor until the ring has passed the empty fields."


def _refusal(fit: Ellipsoid | None, own: Samples, coverage: DirectionCoverage) -> CalibrationRefusal | None:
    where = f" Missing: around {', '.join(coverage.missing)}." if coverage.missing else ""
    hint = f"Turn the sensor through the empty fields of the sphere.{where}"
    if coverage.share < coverage.needed:
        message = (
            f"Only {100 * coverage.share:.0f} % of all directions were seen; {100 * coverage.needed:.0f} % are needed."
        )
        return CalibrationRefusal(message=message, hint=hint)
    if fit is None:
        message = "The samples do not lie on an ellipsoid."
        return CalibrationRefusal(message=message, hint="Move away from iron, motors and cables, and start again.")
    if fit.condition > MAX_CONDITION:
        message = f"The directions do not determine the ellipsoid (condition number {fit.condition:.0f})."
        return CalibrationRefusal(message=message, hint=hint)
    residual = float(np.std(np.linalg.norm((own.values - fit.centre) @ fit.shape, axis=1)))
    if residual > MAX_RESIDUAL:
        message = f"The field changed while the sensor was turned: {100 * residual:.0f} % remain after the fit."
        return CalibrationRefusal(message=message, hint="Move away from iron, motors and cables, and start again.")
    error = worst_error(fit)
    if error > MAX_ERROR:
        percent, most = f"{100 * error:.1f} %", f"{100 * MAX_ERROR:.0f} %"
        message = f"In its worst direction the corrected field is uncertain by {percent}; {most} are allowed."
        return CalibrationRefusal(message=message, hint=f"Go on turning the sensor slowly.{where}")
    return None


def _fill(report: CalibrationReport, fit: Ellipsoid, own: Samples, samples: Samples, field: float) -> None:
    strength = field or fit.radius
    matrix = strength * fit.shape
    sigma = np.sqrt(np.diagonal(fit.covariance))
    report.correction = SensorCorrection(
        unit=report.unit,
        bias=fit.centre.tolist(),
        bias_uncertainty=sigma[:3].tolist(),
        matrix=matrix.tolist(),
        matrix_uncertainty=float(strength * sigma[3:].max()),
        presupposes="± holds for an even field that did not change while the sensor was turned.",
    )
    raw = np.linalg.norm(own.values, axis=1)
    corrected = np.linalg.norm((own.values - fit.centre) @ matrix, axis=1)
    target = strength if field else float(raw.mean())
    before = float(np.sqrt(np.mean(np.square(raw - target))))
    after = float(np.sqrt(np.mean(np.square(corrected - strength))))
    at = np.unique(np.linspace(0, len(samples) - 1, TRACE_POINTS).astype(np.int64))
    some = samples.values[at]
    report.trace = ResidualTrace(
        title="Strength of the field",
        unit=report.unit,
        target=strength,
        before=np.linalg.norm(some, axis=1).tolist(),
        after=np.linalg.norm((some - fit.centre) @ matrix, axis=1).tolist(),
    )
    stretch = np.linalg.eigvalsh(matrix)
    error = worst_error(fit)
    report.figures = [
        figure("residual_before", "Residual before", before, report.unit),
        figure("residual_before_share", "", 100 * before / target, "%"),
        figure("residual_after", "Residual after", after, report.unit),
        figure("residual_after_share", "", 100 * after / strength, "%"),
        figure("hard_iron", "Hard iron and offset", float(np.linalg.norm(fit.centre)), report.unit),
        figure("soft_iron", "Soft iron and scale", 100 * float(stretch[-1] / stretch[0] - 1), "%"),
        figure("field", "Field", strength, report.unit),
        figure("worst_error", "Uncertainty of direction", float(np.degrees(error)), "°"),
        figure("condition", "Condition number", fit.condition, ""),
    ]
    report.notes = [
        "Magnitudes do not show how the magnetometer is turned against the other sensors; the matrix does not turn it.",
        "Valid as mounted: repeat this when iron, batteries or cables near the sensor have moved.",
    ]
    if not field:
        report.notes.append("The matrix keeps the mean strength of the field, because the true one was not given.")


# -- fits --------------------------------------------------------------------------------------------------------------


def provisional_centre(values: Floats) -> Floats:
    """Centre of a sphere for samples that need not determine one: near the origin unless they say otherwise.

    A few directions fit spheres of any size, so the radius is held near the strength measured, and the centre near 0.
    """
    some = values[np.unique(np.linspace(0, len(values) - 1, PROVISIONAL_SAMPLES).astype(np.int64))]
    usual = float(np.median(np.linalg.norm(some, axis=1))) or 1.0
    centre, radius = np.zeros(3), usual
    for _ in range(10):
        away = some - centre
        size = np.maximum(np.linalg.norm(away, axis=1), 1e-12 * usual)
        rows = np.concatenate((-away / size[:, None], -np.ones((len(some), 1))), axis=1)
        # held as if a few per cent of the samples were at the centre 0 with the usual radius
        held = np.sqrt(0.03 * len(some)) * np.diag([0.3, 0.3, 0.3, 1.0])
        residuals = np.concatenate((size - radius, held.diagonal() * (np.array([*centre, radius - usual]))))
        step = np.linalg.lstsq(np.concatenate((rows, -held)), -residuals, rcond=None)[0]
        centre, radius = centre + step[:3], radius + float(step[3])
        if np.abs(step).max() < 1e-6 * usual:
            break
    return centre


def _thinned(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """At most PER_CELL samples of each cell, evenly along time; in order."""
    order = np.argsort(cells, kind="stable")
    indices = []
    for own in np.split(order, np.flatnonzero(np.diff(cells[order])) + 1):
        indices.append(own[np.unique(np.linspace(0, len(own) - 1, PER_CELL).astype(np.int64))])
    return np.sort(np.concatenate(indices))


def fit_ellipsoid(samples: Samples) -> Ellipsoid | None:
    """The ellipsoid through samples; None if they fit another quadric better."""
    values = samples.values
    middle = values.mean(axis=0)
    size = float(np.sqrt(np.square(values - middle).sum(axis=1).mean())) or 1.0
    scaled = (values - middle) / size
    start = _algebraic(scaled)
    if start is None:
        return None
    parameters = _refined(scaled, start)
    if parameters is None:
        return None
    residuals, rows = _residuals(scaled, parameters)
    singular = np.linalg.svd(rows, compute_uv=False)
    if singular[-1] <= 1e-12 * singular[0]:
        return None
    covariance = _covariance(rows, residuals, samples.time)
    units = np.array([size] * 3 + [1 / size] * 6)
    return Ellipsoid(
        parameters[:3] * size + middle,
        _symmetric(parameters[3:]) / size,
        covariance * np.outer(units, units),
        float(singular[0] / singular[-1]),
    )


def _algebraic(values: Floats) -> Floats | None:
    """Centre and shape of the quadric a x² + b y² + c z² + 2d xy + 2e xz + 2f yz + 2g x + 2h y + 2i z = 1."""
    x, y, z = values.T
    terms = np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z], axis=1)
    a, b, c, d, e, f, g, h, i = np.linalg.lstsq(terms, np.ones(len(values)), rcond=None)[0]
    form = np.array([[a, d, e], [d, b, f], [e, f, c]])
    if np.linalg.eigvalsh(form)[0] <= 1e-9:
        return None
    centre = -np.linalg.solve(form, [g, h, i])
    own, vectors = np.linalg.eigh(form / (1 + centre @ form @ centre))
    shape = vectors * np.sqrt(own) @ vectors.T
    return np.concatenate((centre, [shape[pair] for pair in _PAIRS]))


def _refined(values: Floats, parameters: Floats) -> Floats | None:
    """Gauss-Newton with damping on |S (m − b)| − 1, divided by the gradient's size so that it counts distances."""
    damping = 1e-6
    residuals, rows = _residuals(values, parameters)
    cost = float(residuals @ residuals)
    for _ in range(MAX_ITERATIONS):
        normal = rows.T @ rows
        step = np.linalg.solve(normal + damping * np.diag(normal.diagonal() + 1e-12), -rows.T @ residuals)
        trial = parameters + step
        if np.linalg.eigvalsh(_symmetric(trial[3:]))[0] <= 0:
            damping *= 10
            continue
        fresh, slopes = _residuals(values, trial)
        new_cost = float(fresh @ fresh)
        if new_cost > cost:
            damping *= 10
            if damping > 1e6:
                break
            continue
        is_settled = np.abs(step).max() < 1e-10
        parameters, residuals, rows, cost, damping = trial, fresh, slopes, new_cost, damping / 10
        if is_settled:
            break
    return parameters if np.isfinite(parameters).all() else None


def _residuals(values: Floats, parameters: Floats) -> tuple[Floats, Floats]:
    """|S (m − b)| − 1, (n,), and its derivatives by the nine parameters, (n, 9)."""
    centre, shape = parameters[:3], _symmetric(parameters[3:])
    away = values - centre
    mapped = away @ shape
    size = np.maximum(np.linalg.norm(mapped, axis=1), 1e-300)
    along = mapped / size[:, None]
    rows = np.empty((len(values), 9))
    rows[:, :3] = -along @ shape
    for k, (i, j) in enumerate(_PAIRS):
        rows[:, 3 + k] = along[:, i] * away[:, j] + (along[:, j] * away[:, i] if i != j else 0)
    return size - 1, rows


def _covariance(rows: Floats, residuals: Floats, time: Floats) -> Floats:
    """Of the parameters: the largest of the one for independent residuals and those for clusters of some lengths."""
    inverse = np.linalg.inv(rows.T @ rows)
    n, p = rows.shape
    plain = np.asarray(inverse * float(residuals @ residuals) / max(n - p, 1), np.float64)
    scores = rows * residuals[:, None]
    grown = np.ones(p)
    for length in CLUSTERS_S:
        _, place = np.unique(np.floor(time / length), return_inverse=True)
        sums = np.stack([np.bincount(place, scores[:, k]) for k in range(p)], axis=1)
        count = len(sums)
        if count <= p + 1:
            break
        robust = inverse @ (sums.T @ sums) @ inverse * count / (count - p)
        grown = np.maximum(grown, np.sqrt(np.diagonal(robust) / np.maximum(np.diagonal(plain), 1e-300)))
    covariance: Floats = plain * np.outer(grown, grown)
    return covariance


def _symmetric(elements: Floats) -> Floats:
    matrix = np.empty((3, 3))
    for k, (i, j) in enumerate(_PAIRS):
        matrix[i, j] = matrix[j, i] = elements[k]
    return matrix


def worst_error(fit: Ellipsoid) -> float:
    """Standard uncertainty of the corrected field in its worst direction, as a share of it: an angle in rad."""
    inverse = np.linalg.inv(fit.shape)
    away = CENTRES @ inverse
    worst = 0.0
    for one in away:
        slopes = np.zeros((3, 9))
        slopes[:, :3] = -fit.shape
        for k, (i, j) in enumerate(_PAIRS):
            slopes[i, 3 + k] += one[j]
            if i != j:
                slopes[j, 3 + k] += one[i]
        worst = max(worst, float(np.linalg.eigvalsh(slopes @ fit.covariance @ slopes.T)[-1]))
    return float(np.sqrt(max(worst, 0.0)))
