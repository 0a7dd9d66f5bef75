"""Mounting of a sensor as its devices store it: a rotation from the sensor's axes to those of the vehicle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.transactions import Values

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MountingSetting:
    """The setting of a family that takes a mounting rotation.

    Args:
        setting: its name.
        field: one of its fields, without which a product does not have it.
        values: of the setting, from the matrix (3, 3) that turns vectors as the device sends them into the vehicle, and
            from its present values. A device that sends vectors already turned by the setting adds the two.
        note: sentence on its effect.
    """

    setting: str
    field: str
    values: Callable[[Floats, Values], Values]
    note: str


def quaternion_of(matrix: Floats) -> Floats:
    """Unit quaternion, (4,) scalar first and not negative, of a rotation matrix (3, 3).

    The eigenvector of the largest eigenvalue of a symmetric form, which is stable for every angle.
    """
    m = matrix
    form = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    q: Floats = np.linalg.eigh(form)[1][:, -1]
    return q if q[0] >= 0 else -q


def matrix_of(q: Floats) -> Floats:
    """Rotation matrix, (3, 3), of a quaternion, (4,) scalar first."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def frame_angles(matrix: Floats) -> Floats:
    """Angles about x, y, z, rad, that turn the frame of a vector, about z first, into that of matrix · vector."""
    back = matrix.T
    pitch = np.arcsin(np.clip(-back[2, 0], -1, 1))
    if np.hypot(back[2, 1], back[2, 2]) < 1e-6:  # the axes of roll and yaw are the same: yaw takes all of it
        return np.array([0.0, pitch, np.arctan2(-back[0, 1], back[1, 1])])
    return np.array([np.arctan2(back[2, 1], back[2, 2]), pitch, np.arctan2(back[1, 0], back[0, 0])])
