"""Euler angles of quaternions or rotation matrices sent by a device.

Live, the page computes them for every sample. Of a recording it sees summaries, and the least and greatest quaternion
component define no angle; so the angles are computed sample by sample when a recording is opened, and exports have them
too.

    R = Rz(yaw) Ry(pitch) Rx(roll)     frame from body, angles in °, yaw first; within `GIMBAL` of pitch ±90° roll is 0
                                       and yaw takes the rest; a quaternion without length has no angles (NaN)

Source: MT low-level protocol MT0101P 2020.A, sections 8.5 and 8.6; the page's web/src/data/rotations.ts does the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Floats = NDArray[np.float64]

GIMBAL = 1 - 1e-11


def euler_columns(columns: Sequence[Array]) -> list[Floats]:
    """Roll, pitch and yaw of n rotations.

    Args:
        columns: 4 of (n,): w, x, y, z; or 9: the matrix row by row.

    Returns:
        three columns (n,), °: roll and yaw in (−180, 180], pitch in [−90, 90].
    """
    parts = [np.asarray(column, np.float64) for column in columns]
    with np.errstate(all="ignore"):
        m = parts if len(parts) == 9 else _matrix(*parts)
        down = -m[6]
        pitch = np.degrees(np.arcsin(np.clip(down, -1.0, 1.0)))
        locked = np.abs(down) > GIMBAL
        roll = np.where(locked, 0.0, np.degrees(np.arctan2(m[7], m[8])))
        yaw = np.degrees(np.where(locked, np.arctan2(-m[1], m[4]), np.arctan2(m[3], m[0])))
    roll = np.where(np.isnan(pitch), np.nan, roll)
    return [roll, pitch, yaw]


def quaternion_columns(columns: Sequence[Array]) -> list[Floats]:
    """Quaternions of n rotations given as Euler angles.

    Args:
        columns: roll, pitch and yaw, (n,) °.

    Returns:
        w, x, y, z: (n,) each, of unit norm.
    """
    half = [np.radians(np.asarray(column, np.float64)) / 2 for column in columns]
    (cr, cp, cy), (sr, sp, sy) = [np.cos(angle) for angle in half], [np.sin(angle) for angle in half]
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]


def _matrix(w: Floats, x: Floats, y: Floats, z: Floats) -> list[Floats]:
    s = 2 / (w * w + x * x + y * y + z * z)
    return [
        *(1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
        *(s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)),
        *(s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)),
    ]
