"""Properties of sensors that families declare."""

from __future__ import annotations

from math import degrees, sqrt

import pytest

from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.protocols.registry.families import PROTOCOLS
from tests.support.each_row import each_row


@each_row(
    ("product", "turn", "acceleration", "heading"),
    [
        ("MTi-630-8A1G6", 0.007, 60, 0),
        ("MTi-300-2A8G4", 0.01, 60, 1),
        ("MTi-100-2A8G4", 0.01, 60, 0),
        ("MTi-10-2A5G4", 0.03, 60, 0),
        ("MTi-3-8A7G6", 0, 0, 0),
        ("", 0, 0, 0),
    ],
)
def test_noise_of_an_mti(product: str, turn: float, acceleration: float, heading: float) -> None:
    result = PROTOCOLS["xbus"].device.sensors(product)
    assert result.axes == "FLU"
    assert degrees(result.turn) == pytest.approx(turn)
    assert result.acceleration / 9.80665e-6 == pytest.approx(acceleration)
    assert degrees(result.heading) == pytest.approx(heading)


def test_noise_of_an_imx_is_that_of_its_makers_at_100_hz() -> None:
    result = PROTOCOLS["isb"].device.sensors("IMX-5.0.4")
    assert result.axes == "FRD"
    assert degrees(result.turn) * sqrt(100 / 2) == pytest.approx(0.0267, rel=2e-3)  # °/s
    assert result.acceleration * sqrt(100 / 2) == pytest.approx(0.00333, rel=2e-3)  # m/s²
    assert PROTOCOLS["isb"].device.sensors("GPX-1.0") == SensorProperties("FRD")


def test_a_family_that_declares_nothing_has_the_axes_of_ros() -> None:
    assert PROTOCOLS["idtp"].device.sensors("IDTP device") == SensorProperties("FLU", 0, 0, 0, 0, 0)
