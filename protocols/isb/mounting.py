"""Mounting of an IMX: insRotation, the rotation from the sensor frame to the output frame of the navigation.

Inertial data stay in the sensor frame, so the rotation that was found from them replaces the stored one. Its angles are
applied about z, then y, then x.

Source: inertial-sense-sdk 2.7.1, data_sets.h, nvm_flash_cfg_t; ISB document, "Setting Data".
"""

from __future__ import annotations

import numpy as np

from imuscope.protocols.commands.mounting import Floats, MountingSetting
from imuscope.protocols.commands.transactions import Values
from imuscope.protocols.rotations import euler_columns


def _values(matrix: Floats, present: Values) -> Values:
    del present
    return {"insRotation": frame_angles(matrix).tolist()}


def frame_angles(matrix: Floats) -> Floats:
    """Angles about x, y, z, rad, that turn the frame of a vector, about z first, into that of matrix · vector."""
    return np.radians(euler_columns(list(matrix.T.ravel())))


MOUNTING = MountingSetting(
    "DID_FLASH_CONFIG",
    "insRotation",
    _values,
    "Attitude and velocity are then those of the vehicle; inertial data stay in the axes of the sensor.",
)
