"""Noise of the sensors of MTi products, and the accuracy of their attitude.

    series      gyroscopes                accelerometers           roll and pitch; heading
    1           -                         -                        -
    10          0.03 °/s/√Hz, 18 °/h      60 µg/√Hz, 15 µg         0.5°; 1° (MTi-30)
    100         0.01 °/s/√Hz, 10 °/h      60 µg/√Hz, 15 µg         0.2°; 1° (MTi-300)
    600         0.007 °/s/√Hz, 8 °/h      60 µg/√Hz, 15 µg         -

The second figure of a sensor is its in-run bias stability. An IMU has no attitude, and the heading of a VRU is not
referenced. A dash stands for a figure that no document at hand gives; a covariance that needs it is unknown.
The body's axes are x forward, y left, z up, as printed on the housing.

Source: MTi 10-series and MTi 100-series User Manual, MT0605P, sensor specifications; product sheet of the MTi-300
(Movella, May 2023); MTi 600-series Datasheet, MT1603P 2020.A.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians

from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.protocols.xbus.products import model_of

MICRO_G = 9.80665e-6


def _series(turn: float, turn_bias: float) -> SensorProperties:
    """Properties of a series: °/s/√Hz and °/h of its gyroscopes; the accelerometers are the same in all."""
    return SensorProperties(
        turn=radians(turn),
        acceleration=60 * MICRO_G,
        turn_bias=radians(turn_bias / 3600),
        acceleration_bias=15 * MICRO_G,
    )


_BY_SERIES = {1: SensorProperties(), 10: _series(0.03, 18), 100: _series(0.01, 10), 600: _series(0.007, 8)}
_TILT = {10: 0.5, 100: 0.2}  # °, by series
_HEADING = {30: 1.0, 300: 1.0}  # °, by model


def sensors_of(product: str) -> SensorProperties:
    """Properties of a product, by its code."""
    model = model_of(product)
    if model is None:
        return SensorProperties()
    tilt = radians(_TILT.get(model.series, 0.0)) if model.kind != "IMU" else 0.0
    return replace(_BY_SERIES[model.series], tilt=tilt, heading=radians(_HEADING.get(model.number, 0.0)))
