"""Axes and noise of the sensors of Inertial Sense products.

    IMX-5       angular random walk 0.16 °/√h, velocity random walk 0.02 m/s/√h; bias instability 1.5 °/h and 19 µg

Their makers compute the standard deviation of a sample as random walk × √rate; a density is √2 of that, because its
standard deviation is density × √(rate / 2).

Source: docs.inertialsense.com, IMU Specifications; axes of the body (x forward, y right, z down): data_sets.h.
"""

from __future__ import annotations

import re
from math import radians, sqrt

from imuscope.protocols.family.sensor_properties import SensorProperties

_PER_ROOT_SECOND = sqrt(2) / 60  # density of a random walk per √h
_IMX_5 = SensorProperties(
    "FRD",
    turn=radians(0.16) * _PER_ROOT_SECOND,
    acceleration=0.02 * _PER_ROOT_SECOND,
    turn_bias=radians(1.5 / 3600),
    acceleration_bias=19 * 9.80665e-6,
)


def sensors_of(product: str) -> SensorProperties:
    """Properties of a product, by its name: "IMX-5.0.4"."""
    return _IMX_5 if re.match(r"IMX-5\b", product) else SensorProperties("FRD")
