"""Properties of a product's sensors that its messages do not contain."""

from dataclasses import dataclass
from typing import Literal

BodyAxes = Literal["FLU", "FRD"]


@dataclass(frozen=True, slots=True)
class SensorProperties:
    """Axes and noise of a product, from its data sheet; 0 for values that it does not contain.

    Args:
        axes: of its body: x forward, then y left and z up (FLU), or y right and z down (FRD).
        turn: noise density of the gyroscopes, rad/s/√Hz.
        acceleration: noise density of the accelerometers, m/s²/√Hz.
        field: noise density of the magnetometers, T/√Hz.
        tilt, heading: of its attitude, rad, one standard deviation.
        turn_bias: in-run bias stability of the gyroscopes, rad/s.
        acceleration_bias: in-run bias stability of the accelerometers, m/s².
    """

    axes: BodyAxes = "FLU"
    turn: float = 0.0
    acceleration: float = 0.0
    field: float = 0.0
    tilt: float = 0.0
    heading: float = 0.0
    turn_bias: float = 0.0
    acceleration_bias: float = 0.0
