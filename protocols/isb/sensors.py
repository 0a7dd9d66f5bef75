"""Axes and noise of the sensors of Inertial Sense products."""

from __future__ import annotations

from protocols.sensor_properties import SensorProperties


def sensors_of(product: str) -> SensorProperties:
    """Properties of a product: x forward, y right, z down."""
    return SensorProperties(axes="FRD")
