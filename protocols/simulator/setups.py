"""Other motions of a simulated sensor than the drive, and errors that a calibration finds.

    sim:xbus?motion=tumble&hard_iron=0.3&soft_iron=0.1      turned by hand through all directions, near iron
    sim:xbus?motion=rest&gyro_bias=0.5                      on a table
    sim:isb?motion=turn                                     on a turntable: does not determine a magnetometer

Errors have fixed directions, so that a test knows the truth from one number each (`SensorSetup`). Motions other than
the drive are turns about a fixed place; time 0 is power-on.

Rules for editing: as trajectory.py; a motion gives force, rate and field that belong together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from protocols.simulator import trajectory
from protocols.simulator.family import SimulatorOption
from protocols.simulator.trajectory import Array, Floats, MotionState

HARD_IRON = np.array([2.0, -3.0, 1.0]) / np.sqrt(14.0)
SOFT_IRON = np.array([[1.0, 0.4, -0.2], [0.4, -0.8, 0.3], [-0.2, 0.3, -0.2]])
GYRO_BIAS = np.array([1.0, -2.0, 2.0]) / 3.0
_STEP_S = 1e-4


@dataclass(frozen=True, slots=True)
class SensorSetup:
    """Motion of a simulated sensor, and its errors.

    Args:
        motion: of MOTIONS.
        hard_iron: added along HARD_IRON, as a share of the Earth's field.
        soft_iron: measured = (1 + soft_iron · SOFT_IRON) · field.
        gyro_bias: added along GYRO_BIAS, °/s.
    """

    motion: str = "drive"
    hard_iron: float = 0.0
    soft_iron: float = 0.0
    gyro_bias: float = 0.0

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> SensorSetup:
        """Of the options of a request."""
        return cls(*(options[option.name] for option in SETUP_OPTIONS))

    def motion_at(self, t: Array) -> MotionState:
        """Motion at times `t`, (n,) s."""
        return MOTIONS[self.motion](t)

    def field(self, field: Floats) -> Floats:
        """The field at the sensor, (n, 3), in the body: forward, left, up."""
        if not self.hard_iron and not self.soft_iron:
            return field
        found: Floats = field + self.soft_iron * field @ SOFT_IRON + self.hard_iron * HARD_IRON
        return found

    def turn(self, rate: Floats) -> Floats:
        """The rate that the gyroscope shows, (n, 3) rad/s."""
        return rate + np.radians(self.gyro_bias) * GYRO_BIAS if self.gyro_bias else rate


AS_BUILT = SensorSetup()
"""The drive, without further errors."""


def _rest(t: Array) -> MotionState:
    return _turned(np.asarray(t, np.float64), lambda at: np.zeros((len(at), 3)))


def _tumble(t: Array) -> MotionState:
    """Through all directions, at up to 150 °/s: three turns whose periods have no common multiple within minutes."""
    periods = np.array([17.0, 11.0, 7.0])
    return _turned(np.asarray(t, np.float64), lambda at: 2 * np.pi * at[:, None] / periods)


def _turn(t: Array) -> MotionState:
    """About the vertical only, once in 8 s."""
    return _turned(np.asarray(t, np.float64), lambda at: 2 * np.pi * at[:, None] / [np.inf, np.inf, 8.0])


def _turned(t: Floats, angles: Callable[[Floats], Floats]) -> MotionState:
    """At a fixed place, turned about x, then y, then z by angles (n, 3)."""
    q = _attitude(angles(t))
    ahead, behind = _attitude(angles(t + _STEP_S)), _attitude(angles(t - _STEP_S))
    back = behind * [1.0, -1.0, -1.0, -1.0]
    step = trajectory.multiply(back, ahead)
    step = step * np.where(step[:, :1] < 0, -1.0, 1.0)
    rate = step[:, 1:] / _STEP_S  # twice the half angle over twice the step
    still = np.zeros((len(t), 3))
    up = np.broadcast_to([0.0, 0.0, trajectory.GRAVITY], (len(t), 3))
    field = np.broadcast_to(trajectory.FIELD_ENU, (len(t), 3))
    return MotionState(
        t,
        still,
        still,
        still,
        trajectory.euler(q),
        q,
        rate,
        trajectory.to_body(q, up),
        trajectory.to_body(q, field),
    )


def _attitude(angles: Floats) -> Floats:
    """q_enu_from_body of turns about x, then y, then z of the body."""
    q = np.zeros((len(angles), 4))
    q[:, 0] = 1.0
    for axis in range(3):
        half = np.zeros((len(angles), 4))
        half[:, 0] = np.cos(angles[:, axis] / 2)
        half[:, 1 + axis] = np.sin(angles[:, axis] / 2)
        q = trajectory.multiply(q, half)
    return q


MOTIONS: Mapping[str, Callable[[Array], MotionState]] = {
    "drive": trajectory.vehicle_motion,
    "rest": _rest,
    "tumble": _tumble,
    "turn": _turn,
}

SETUP_OPTIONS = (
    SimulatorOption("motion", "choice", "drive", tuple(MOTIONS)),
    SimulatorOption("hard_iron", "number", 0, high=10),
    SimulatorOption("soft_iron", "number", 0, high=1),
    SimulatorOption("gyro_bias", "number", 0, high=100, unit="°/s"),
)
"""Options of a family whose simulated devices can have a setup; in the order of the attributes of SensorSetup."""
