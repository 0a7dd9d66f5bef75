"""Mounting of an IMX: insRotation, the rotation from the sensor frame to the output frame of the navigation.

Inertial data stay in the sensor frame, so the rotation that was found from them replaces the stored one. Its angles are
applied about z, then y, then x.

Source: inertial-sense-sdk 2.7.1, data_sets.h, nvm_flash_cfg_t; ISB document, "Setting Data".
"""

from __future__ import annotations

from imuscope.protocols.mounting import Floats, MountingSetting, frame_angles
from imuscope.protocols.transactions import Values


def _values(matrix: Floats, present: Values) -> Values:
    del present
    return {"insRotation": frame_angles(matrix).tolist()}


MOUNTING = MountingSetting(
    "DID_FLASH_CONFIG",
    "insRotation",
    _values,
    "Attitude and velocity are then those of the vehicle; inertial data stay in the axes of the sensor.",
)
