"""Rotations in the form other programs use: quaternions to ENU, from any attitude representation; their products,
differences and means. Pure. Euler angles are in protocols/euler.py.

    q_enu_from_body = q_enu_from_frame ⊗ q_frame_from_body        frame: ENU, NED or NWU; scalar first

ENU: x east, y north, z up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]
Floats = NDArray[np.float64]

_HALF = math.sqrt(0.5)
ENU_FROM: Mapping[str, Quaternion] = {
    "ENU": (1.0, 0.0, 0.0, 0.0),
    "NED": (0.0, _HALF, _HALF, 0.0),
    "NWU": (_HALF, 0.0, 0.0, _HALF),
}


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """A ⊗ b: rotation by b, then by a."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def unit(q: Sequence[float]) -> Quaternion | None:
    """The same rotation with length 1; None for an invalid one (zeros, NaN)."""
    length = math.hypot(*q)
    if not 1e-6 < length < 1e6:
        return None
    return (q[0] / length, q[1] / length, q[2] / length, q[3] / length)


def of_euler(roll: float, pitch: float, yaw: float) -> Quaternion | None:
    """Quaternion of angles in °, yaw first (ZYX intrinsic)."""
    r, p, y = (math.radians(angle) / 2 for angle in (roll, pitch, yaw))
    cr, sr, cp, sp, cy, sy = math.cos(r), math.sin(r), math.cos(p), math.sin(p), math.cos(y), math.sin(y)
    return unit(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )
    )


def of_matrix(m: Sequence[float]) -> Quaternion | None:
    """Quaternion of a rotation matrix, row by row; computed from the largest of the four components, so that no
    square root vanishes.
    """
    squares = (
        1 + m[0] + m[4] + m[8],
        1 + m[0] - m[4] - m[8],
        1 - m[0] + m[4] - m[8],
        1 - m[0] - m[4] + m[8],
    )
    rows = (
        (squares[0], m[7] - m[5], m[2] - m[6], m[3] - m[1]),
        (m[7] - m[5], squares[1], m[1] + m[3], m[2] + m[6]),
        (m[2] - m[6], m[1] + m[3], squares[2], m[5] + m[7]),
        (m[3] - m[1], m[2] + m[6], m[5] + m[7], squares[3]),
    )
    return unit(rows[max(range(4), key=squares.__getitem__)]) if all(map(math.isfinite, m)) else None


READ: Mapping[str, Callable[[Sequence[float]], Quaternion | None]] = {
    "quaternion": unit,
    "matrix": of_matrix,
    "euler": lambda angles: of_euler(*angles),
}


def yaw_of(q: Quaternion) -> float:
    """Heading about the frame's own z axis, rad."""
    w, x, y, z = q
    return math.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))


def about_z(angle: float) -> Quaternion:
    """The rotation by `angle` rad about z."""
    return (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))


def from_x(v: Vector) -> Quaternion:
    """A rotation that brings +x to the direction of `v`, whose length is not 0."""
    x, y, z = (one / math.hypot(*v) for one in v)
    if x < -0.999999:
        return (0.0, 0.0, 0.0, 1.0)
    quaternion = unit((1 + x, 0.0, -z, y))
    assert quaternion is not None
    return quaternion


# -- many rotations at once: unit quaternions, (n, 4) scalar first -----------------------------------------------------


def conjugate(q: Floats) -> Floats:
    """The inverse of unit quaternions."""
    result: Floats = q * np.array([1.0, -1.0, -1.0, -1.0])
    return result


def product(p: Floats, q: Floats) -> Floats:
    """Hamilton product; either may be one quaternion, (4,)."""
    a, b, c, d = np.moveaxis(p, -1, 0)
    e, f, g, h = np.moveaxis(q, -1, 0)
    parts = [
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    ]
    result: Floats = np.stack(parts, -1)
    return result


def angle_of(q: Floats) -> Floats:
    """Angle of rotation, °, 0 to 180."""
    degrees: Floats = np.degrees(2 * np.arctan2(np.linalg.norm(q[..., 1:], axis=-1), np.abs(q[..., 0])))
    return degrees


def slerp(p: Floats, q: Floats, part: Floats) -> Floats:
    """Rotations between p and q by the shorter way, at a constant rate."""
    dot = np.sum(p * q, axis=-1)
    q = np.where(dot[..., np.newaxis] < 0, -q, q)
    half = np.arccos(np.clip(np.abs(dot), 0, 1))
    sine = np.sin(half)
    flat = sine < 1e-6
    safe = np.where(flat, 1.0, sine)
    first = np.where(flat, 1 - part, np.sin((1 - part) * half) / safe)
    second = np.where(flat, part, np.sin(part * half) / safe)
    blend = first[..., np.newaxis] * p + second[..., np.newaxis] * q
    return np.asarray(blend / np.linalg.norm(blend, axis=-1, keepdims=True))


def mean_rotation(q: Floats) -> Floats:
    """The rotation with the least sum of squared distances: q and −q count as the same (Markley et al., 2007)."""
    _, vectors = np.linalg.eigh(q.T @ q)
    mean: Floats = vectors[:, -1]
    return mean
