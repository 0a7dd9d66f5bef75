"""Mounting of an MTi: its alignment RotSensor, the rotation from the sensor frame to the object frame.

An MTi sends vectors already turned by RotSensor, so a rotation that was found from them comes on top of it.

Source: MT0101P 2020.A, 5.3.5 SetAlignmentRotation; MTi Family Reference Manual, MT1600P, alignment resets.
"""

from __future__ import annotations

import numpy as np

from imuscope.protocols.commands.mounting import Floats, MountingSetting
from imuscope.protocols.commands.transactions import Values
from imuscope.protocols.rotations import matrix_of, quaternion_of

_NAMES = ("q0", "q1", "q2", "q3")


def _values(matrix: Floats, present: Values) -> Values:
    stored = np.array([float(present.get(name, 1.0 if name == "q0" else 0.0)) for name in _NAMES])
    before = matrix_of(stored) if np.linalg.norm(stored) > 0.5 else np.eye(3)
    q = quaternion_of(matrix @ before)
    return dict(zip(_NAMES, (q if q[0] >= 0 else -q).tolist(), strict=True))


MOUNTING = MountingSetting(
    "AlignmentRotation.RotSensor",
    "q0",
    _values,
    "The device then sends vectors and orientation in the axes of the vehicle.",
)
