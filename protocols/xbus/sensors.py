"""Noise of the sensors of MTi products, and the accuracy of their attitude.

    series      gyroscopes            accelerometers       roll and pitch, heading
    100         0.01 °/s/√Hz          60 µg/√Hz            0.2°, 1° (MTi-300)
    600         0.007 °/s/√Hz         60 µg/√Hz

The body's axes are x forward, y left, z up, as printed on the housing.

Source: product sheet of the MTi-300 (Movella, May 2023); MTi 600-series Datasheet, MT1603P 2020.A.
"""

from __future__ import annotations

from math import radians

from protocols.sensor_properties import SensorProperties
from protocols.xbus.products import model_of

MICRO_G = 9.80665e-6
_SERIES_100 = SensorProperties(turn=radians(0.01), acceleration=60 * MICRO_G)
_MTI_300 = SensorProperties(turn=radians(0.01), acceleration=60 * MICRO_G, tilt=radians(0.2), heading=radians(1))
_SERIES_600 = SensorProperties(turn=radians(0.007), acceleration=60 * MICRO_G)


def sensors_of(product: str) -> SensorProperties:
    """Properties of a product, by its code."""
    model = model_of(product)
    if model is None or model.series not in (100, 600):
        return SensorProperties()
    if model.series == 600:
        return _SERIES_600
    return _MTI_300 if model.number == 300 else _SERIES_100
