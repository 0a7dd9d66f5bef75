"""Local east-north-up coordinates, m. Exact, through earth-fixed axes (ECEF).

    x_ECEF = (N + h) cos φ cos λ      N = a / √(1 − e² sin² φ)
    y_ECEF = (N + h) cos φ sin λ
    z_ECEF = (N (1 − e²) + h) sin φ

    [e]   [    −sin λ         cos λ       0   ]
    [n] = [ −sin φ cos λ  −sin φ sin λ  cos φ ] (x − x₀)       at the origin φ, λ
    [u]   [  cos φ cos λ   cos φ sin λ  sin φ ]

Source: WGS 84; NIMA TR8350.2, 3rd edition, table 3.1 (a, 1/f).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats

A = 6_378_137.0  # m
F = 1 / 298.257223563
E2 = F * (2 - F)


@dataclass(frozen=True, slots=True)
class Origin:
    """Point where the plane touches the earth: latitude and longitude (°), height above the ellipsoid (m)."""

    lat: float
    lon: float
    height: float


def is_place(lat: NDArray[Any], lon: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether a position is plausible: a receiver without a fix sends zeros or nonsense."""
    with np.errstate(invalid="ignore"):
        sane = np.isfinite(lat) & np.isfinite(lon) & (np.abs(lat) <= 90) & (np.abs(lon) <= 360)
    return np.asarray(sane & ((lat != 0) | (lon != 0)))


def enu_of(lat: Floats, lon: Floats, height: Floats, origin: Origin) -> Floats:
    """East, north and up of places, m.

    Args:
        lat, lon: (n,) °; height: (n,) m.

    Returns:
        (n, 3) float64.
    """
    here = _ecef(np.array([origin.lat]), np.array([origin.lon]), np.array([origin.height]))
    away = _ecef(lat, lon, height) - here
    return np.asarray(away @ enu_turns(np.array([origin.lat]), np.array([origin.lon]))[0].T)


def enu_turns(lat: Floats, lon: Floats) -> Floats:
    """(n, 3, 3) matrices from earth-fixed axes to east, north and up at places, °."""
    phi, lam = np.radians(lat), np.radians(lon)
    rows = [
        [-np.sin(lam), np.cos(lam), np.zeros_like(lam)],
        [-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)],
        [np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _ecef(lat: Floats, lon: Floats, height: Floats) -> Floats:
    phi, lam = np.radians(lat), np.radians(lon)
    n = A / np.sqrt(1 - E2 * np.sin(phi) ** 2)
    out = (n + height) * np.cos(phi)
    return np.column_stack((out * np.cos(lam), out * np.sin(lam), (n * (1 - E2) + height) * np.sin(phi)))
