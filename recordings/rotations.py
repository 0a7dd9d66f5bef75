"""Rotations in the form other programs use: quaternions to ENU, from any attitude representation. Pure.

    q_enu_from_body = q_enu_from_frame ⊗ q_frame_from_body        frame: ENU, NED or NWU; scalar first

ENU: x east, y north, z up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]

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
    found = unit((1 + x, 0.0, -z, y))
    assert found is not None
    return found
