"""Lines through values whose errors are correlated in a way that is not known.

Each covariance that the errors may have counts by its restricted likelihood (the coefficients are estimated too), and
the uncertainty of the slope contains what the slopes under them differ by.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Floats


@dataclass(frozen=True, slots=True)
class LineFit:
    """A fit under one covariance: the coefficient of the last column of its design, and the variance of it."""

    likelihood: float
    slope: float
    variance: float


def line_fit(covariance: Floats, design: Floats, values: Floats) -> LineFit:
    """The generalised least squares of these values.

    Args:
        covariance: (n, n) of their errors, up to a factor.
        design: (n, m).
        values: (n,).
    """
    root = np.linalg.cholesky(covariance)
    rows, right = np.linalg.solve(root, design), np.linalg.solve(root, values)
    normal = rows.T @ rows
    solution = np.linalg.solve(normal, rows.T @ right)
    rest, freedom = float(np.sum(np.square(right - rows @ solution))), len(values) - design.shape[1]
    logs = 2 * float(np.log(np.diag(root)).sum()) + float(np.linalg.slogdet(normal)[1])
    likelihood = -0.5 * (freedom * float(np.log(max(rest, 1e-300))) + logs)
    return LineFit(likelihood, float(solution[-1]), rest / freedom * float(np.linalg.inv(normal)[-1, -1]))


def mean_line(fits: Sequence[LineFit], freedom: int, first: float = 1.0) -> tuple[float, float, Floats]:
    """Mean slope, half of its 95 % interval, and the weights of the fits; `first`: how much more the first counts."""
    from scipy.special import stdtrit

    likelihood, slopes, variances = np.array([(one.likelihood, one.slope, one.variance) for one in fits]).T
    weights = np.exp(likelihood - likelihood.max())
    weights[0] *= first
    weights /= weights.sum()
    slope = float(weights @ slopes)
    sigma = float(np.sqrt(weights @ (variances + np.square(slopes - slope))))
    return slope, float(stdtrit(freedom, 0.975)) * sigma, weights
