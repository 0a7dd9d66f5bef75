"""Noise model of an inertial sensor, fitted to its Allan variance.

    σ²(τ) = 3 Q²/τ² + N²/τ + (2 ln 2/π) B² + K² τ/3 + R² τ²/2

    Q  quantisation            unit·s
    N  random walk             unit/√Hz, of the angle (gyroscope) or the velocity (accelerometer): its noise density
    B  bias instability        unit
    K  rate random walk        unit·√Hz, written unit/s/√Hz
    R  rate ramp               unit/s

Source: IEEE Std 952-1997, annex C. The squares are fitted without negative values by weighted least squares, with the
weights of the relative variance 2/ν of a deviation of ν degrees of freedom.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.analysis.noise.allan_deviation import (
    FLICKER,
    WALK,
    WHITE,
    WHITE_PHASE,
    AllanCurve,
    intervals,
)

FIT_ITERATIONS = 6  # of the fit, each with the weights and types of noise of the last
NORMAL_QUANTILE = 1.96
SIGNIFICANT_MISFIT = 8.0  # a term has its place if the misfit is smaller by more with it
SHARED_ERROR_FACTOR = 2.0  # of errors in simulations to independent ones: averaging times share samples
MIN_NORM = 1e-300
TAIL_PROBABILITY = 3e-5  # probability beyond each end of the interval of a deviation that decides something
MISFIT_SHARE = 0.1  # a deviation this far from the model, as a part of it, shows that it does not fit …
CHANCE_PROBABILITY = 1e-7  # … if it is so improbable by chance
FLAT = 2 * math.log(2) / math.pi

TERMS: Mapping[str, tuple[float, int, float]] = {
    "quantisation": (3.0, -2, WHITE_PHASE),
    "random_walk": (1.0, -1, WHITE),
    "bias_instability": (FLAT, 0, FLICKER),
    "rate_random_walk": (1 / 3, 1, WALK),
    "ramp": (0.5, 2, WALK),
}
"""Factor and power of τ of each term, and the type of noise where it is the largest."""

UNITS: Mapping[str, str] = {
    "quantisation": "{unit}·s",
    "random_walk": "{unit}/√Hz",
    "bias_instability": "{unit}",
    "rate_random_walk": "{unit}/s/√Hz",
    "ramp": "{unit}/s",
}

Table = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class NoiseParameter:
    """One parameter with its 95 % interval; 0 where the curve does not show it, and then `high` is its limit."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Misfit:
    """The averaging time at which a model fits worst.

    Attributes:
        tau: averaging time, s.
        ratio: of the measured deviation to that of the model.
        expected: standard deviation of that ratio.
    """

    tau: float
    ratio: float
    expected: float


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """A fitted model.

    Attributes:
        parameters: by name, as in TERMS.
        freedom: (n,) degrees of freedom of each deviation, for the type of noise that the model has there.
        tau: range of averaging times fitted, s.
        misfit: the worst of the deviations that the model does not explain; None if it fits.
    """

    parameters: Mapping[str, NoiseParameter]
    freedom: Floats
    tau: tuple[float, float]
    misfit: Misfit | None = None

    def deviation(self, tau: Floats) -> Floats:
        """Allan deviation of the model."""
        terms = [factor * self.parameters[name].value ** 2 * tau**power for name, (factor, power, _) in TERMS.items()]
        total: Floats = np.sqrt(np.sum(terms, axis=0))
        return total

    def widened(self, level: tuple[float, float], *, may_change: bool) -> "NoiseModel":
        """The model with intervals that contain more.

        Args:
            level: standard deviations of the quietest and loudest part, as shares of that of all.
            may_change: what looks like a bias that wanders may be a swing or a step.
        """
        parameters = {name: one if not may_change else replace(one, low=0.0) for name, one in self.parameters.items()}
        walk = self.parameters["random_walk"]
        parameters["random_walk"] = replace(walk, low=walk.low * level[0], high=walk.high * level[1])
        return replace(self, parameters={**parameters, "quantisation": self.parameters["quantisation"]})


def fit_noise(curve: AllanCurve) -> NoiseModel:
    """The model with the fewest terms that fits a curve as well as all of them do.

    Where the curve leaves open which term it is (a flat end may be bias instability or the beginning of a rate random
    walk), the intervals cover both: they include those of the fit of all terms.
    """
    columns = np.array([factor * curve.tau**power for factor, power, _ in TERMS.values()]).T
    variance = np.square(curve.adev)
    everything = list(range(len(TERMS)))
    whole, _, weight = _fit(curve, columns, variance, everything)
    errors_of_all = _standard_errors(columns, weight, everything)
    terms = min(
        (list(some) for size in range(1, len(everything) + 1) for some in combinations(everything, size)),
        key=lambda some: _misfit(columns, variance, weight, some) + SIGNIFICANT_MISFIT * len(some),
    )
    squares, freedom, weight = _fit(curve, columns, variance, terms)
    scale = _excess(_misfit(columns, variance, weight, terms), len(variance) - len(terms))
    high = intervals(curve.adev, freedom, TAIL_PROBABILITY)[1]
    estimates = {}
    for at, (name, (factor, power, _)) in enumerate(TERMS.items()):
        errors = _standard_errors(columns, weight, sorted({*terms, at}))
        chosen = _parameter(float(squares[at]), scale * errors[at])
        among_all = _parameter(float(whole[at]), scale * errors_of_all[at])
        # no term is larger than the curve at any averaging time
        limit = float((high / np.sqrt(factor * curve.tau**power)).min())
        upper = max(chosen.value, min(limit, max(chosen.high, among_all.high)))
        estimates[name] = NoiseParameter(chosen.value, min(chosen.low, among_all.low), upper)
    model = NoiseModel(estimates, freedom, (float(curve.tau[0]), float(curve.tau[-1])))
    return replace(model, misfit=_worst(curve, model))


def _excess(misfit: float, freedom: int) -> float:
    """Factor by which errors grow if the curve scatters about the model by more than expected."""
    return math.sqrt(max(1.0, misfit / max(1, freedom)))


def _worst(curve: AllanCurve, model: NoiseModel) -> Misfit | None:
    from scipy.special import chdtr, chdtrc

    ratio = np.square(curve.adev / np.maximum(model.deviation(curve.tau), MIN_NORM))
    freedom = model.freedom
    chance = np.minimum(chdtr(freedom, freedom * ratio), chdtrc(freedom, freedom * ratio))
    bad = (chance < CHANCE_PROBABILITY) & (np.abs(np.sqrt(ratio) - 1) > MISFIT_SHARE)
    if not bad.any():
        return None
    at = int(np.where(bad, np.abs(np.log(np.maximum(ratio, MIN_NORM))), -1.0).argmax())
    return Misfit(float(curve.tau[at]), math.sqrt(ratio[at]), math.sqrt(1 / (2 * freedom[at])))


def _fit(curve: AllanCurve, columns: Table, variance: Floats, terms: list[int]) -> tuple[Floats, Floats, Floats]:
    """Squares of all terms, 0 for those not kept; degrees of freedom; and the weights of the last turn."""
    kinds = [int(kind) for _, _, kind in TERMS.values()]
    model = np.maximum(variance, MIN_NORM)
    noise = [WHITE] * len(curve.tau)
    squares, freedom, weight = np.zeros(len(kinds)), np.ones(len(noise)), np.ones(len(noise))
    for _ in range(FIT_ITERATIONS):
        freedom = curve.degrees_of_freedom(noise)
        weight = np.sqrt(freedom / 2) / model
        squares = np.zeros(len(kinds))
        squares[terms] = _least_squares(columns[:, terms], variance, weight)
        parts = columns * squares
        model = np.maximum(parts.sum(axis=1), MIN_NORM)
        noise = [kinds[int(at)] for at in parts.argmax(axis=1)]
    return squares, freedom, weight


def _least_squares(columns: Table, variance: Floats, weight: Floats) -> Floats:
    from scipy.optimize import nnls

    scaled = columns * weight[:, None]
    size = np.maximum(np.linalg.norm(scaled, axis=0), MIN_NORM)
    solution: Floats = nnls(scaled / size, variance * weight)[0] / size
    return solution


def _misfit(columns: Table, variance: Floats, weight: Floats, terms: list[int]) -> float:
    """Weighted sum of squares that is left."""
    squares = _least_squares(columns[:, terms], variance, weight)
    return float(np.square((columns[:, terms] @ squares - variance) * weight).sum())


def _standard_errors(columns: Table, weight: Floats, terms: list[int]) -> dict[int, float]:
    """Standard errors of the squares of the kept terms."""
    scaled = columns[:, terms] * weight[:, None]
    size = np.maximum(np.linalg.norm(scaled, axis=0), MIN_NORM)
    inverse = np.linalg.pinv((scaled / size).T @ (scaled / size), rcond=1e-12)
    errors = SHARED_ERROR_FACTOR * np.sqrt(np.maximum(np.diag(inverse), 0)) / size
    return dict(zip(terms, errors.tolist(), strict=True))


def _parameter(square: float, error: float) -> NoiseParameter:
    low, high = (math.sqrt(max(square + side * NORMAL_QUANTILE * error, 0.0)) for side in (-1, 1))
    return NoiseParameter(math.sqrt(square), low, high)
