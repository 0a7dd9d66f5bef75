"""Other motions of a simulated sensor than the drive, and errors that a calibration finds.

    sim:xbus?motion=tumble&hard_iron=0.3&soft_iron=0.1      turned by hand through all directions, near iron
    sim:xbus?motion=rest&gyro_bias=0.5                      on a table
    sim:isb?motion=turn                                     on a turntable: does not determine a magnetometer

Errors have fixed directions, so that a test knows the truth from one number each (`SensorSetup`). Motions other than
the drive are turns about a fixed place; time 0 is power-on.

Rules for editing: as trajectory.py; a motion gives force, rate and field that belong together.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from imuscope.protocols import rotations
from imuscope.protocols.arrays import Array, Floats
from imuscope.protocols.simulator import trajectory
from imuscope.protocols.simulator.family import SimulatorOption
from imuscope.protocols.simulator.trajectory import MotionState

HARD_IRON = np.array([2.0, -3.0, 1.0]) / np.sqrt(14.0)
SOFT_IRON = np.array([[1.0, 0.4, -0.2], [0.4, -0.8, 0.3], [-0.2, 0.3, -0.2]])
GYRO_BIAS = np.array([1.0, -2.0, 2.0]) / 3.0
ACC_BIAS = np.array([2.0, 1.0, -2.0]) / 3.0
ACC_SCALE = np.array([1.0, -0.5, 0.3])
MOUNT = np.array([1.0, -2.0, 3.0]) / np.sqrt(14.0)
_STEP_S = 1e-4
_HOLD_S, _MOVE_S = 5.0, 1.5
_SIDES = (  # turns about x and y, °, and whether it rests there: up are z, y, −z, −y, x, −x
    *((0, 0, 1), (90, 0, 1), (180, 0, 1), (270, 0, 1), (360, 0, 0)),
    *((360, -90, 1), (360, -180, 0), (360, -270, 1), (360, -360, 0)),
)
_STOP_S, _CHANGE_S, _CRUISE_S, _SPEED = 6.0, 4.0, 1.0, 3.0  # of the straight drive


@dataclass(frozen=True, slots=True)
class SensorSetup:
    """Motion of a simulated sensor, and its errors.

    Args:
        motion: of MOTIONS.
        hard_iron: added along HARD_IRON, as a share of the Earth's field.
        soft_iron: measured = (1 + soft_iron · SOFT_IRON) · field.
        gyro_bias: added along GYRO_BIAS, °/s.
        acc_bias: added along ACC_BIAS, m/s².
        acc_scale: measured = (1 + acc_scale · ACC_SCALE) · force, axis by axis.
        mount: the sensor is turned in the vehicle about MOUNT, °.
    """

    motion: str = "drive"
    hard_iron: float = 0.0
    soft_iron: float = 0.0
    gyro_bias: float = 0.0
    acc_bias: float = 0.0
    acc_scale: float = 0.0
    mount: float = 0.0

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> "SensorSetup":
        """The setup that the options of a request describe."""
        return cls(*(options[option.name] for option in SETUP_OPTIONS))

    def motion_at(self, t: Array) -> MotionState:
        """Motion at times `t`, (n,) s."""
        motion = MOTIONS[self.motion](t)
        if not self.mount:
            return motion
        q = self.q_vehicle_from_sensor
        turn = np.broadcast_to(q, (len(motion.t), 4))
        attitude = rotations.product(motion.q_enu_from_body_wxyz, q)
        return replace(
            motion,
            euler=rotations.euler_of(attitude),
            q_enu_from_body_wxyz=attitude,
            rate=rotations.to_body(turn, motion.rate),
            force=rotations.to_body(turn, motion.force),
            field=rotations.to_body(turn, motion.field),
        )

    @property
    def q_vehicle_from_sensor(self) -> Floats:
        """Mounting, (4,) scalar first: forward, left, up from the sensor's axes."""
        half = np.radians(self.mount) / 2
        quaternion: Floats = np.concatenate(([np.cos(half)], np.sin(half) * MOUNT))
        return quaternion

    def force(self, force: Floats) -> Floats:
        """The specific force that the accelerometer shows, (n, 3) m/s²."""
        if not self.acc_bias and not self.acc_scale:
            return force
        measured: Floats = force * (1 + self.acc_scale * ACC_SCALE) + self.acc_bias * ACC_BIAS
        return measured

    def field(self, field: Floats) -> Floats:
        """The field at the sensor, (n, 3), in the body: forward, left, up."""
        if not self.hard_iron and not self.soft_iron:
            return field
        measured: Floats = field + self.soft_iron * field @ SOFT_IRON + self.hard_iron * HARD_IRON
        return measured

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


def _positions(t: Array) -> MotionState:
    """Rests on each of the six sides, again and again."""
    stations = [(float(x), float(y), _HOLD_S * holds) for x, y, holds in _SIDES]
    period = sum(hold + _MOVE_S for _, _, hold in stations)

    def angles(at: Floats) -> Floats:
        out = np.zeros((len(at), 3))
        lap = np.remainder(at, period)
        begin = 0.0
        for number, (x, y, hold) in enumerate(stations):
            to = stations[number + 1] if number + 1 < len(stations) else (360.0, -360.0, 0.0)
            own = (lap >= begin) & (lap < begin + hold + _MOVE_S)
            share = np.clip((lap[own] - begin - hold) / _MOVE_S, 0, 1)
            eased = share**3 * (10 - 15 * share + 6 * share**2)
            out[own, 0] = x + (to[0] - x) * eased
            out[own, 1] = y + (to[1] - y) * eased
            begin += hold + _MOVE_S
        return np.radians(out)

    return _turned(np.asarray(t, np.float64), angles)


def _straight(t: Array) -> MotionState:
    """Rest, a drive straight ahead at up to 3 m/s, rest again."""
    t = np.asarray(t, np.float64)
    still = _turned(t, lambda at: np.broadcast_to(np.radians([0.0, 0.0, 30.0]), (len(at), 3)))
    period = _STOP_S + 2 * _CHANGE_S + _CRUISE_S
    lap = np.remainder(t, period)
    speed, acceleration = np.zeros(len(t)), np.zeros(len(t))
    for begin, sign in ((_STOP_S, 1.0), (_STOP_S + _CHANGE_S + _CRUISE_S, -1.0)):
        share = np.clip((lap - begin) / _CHANGE_S, 0, 1)
        speed += sign * _SPEED * (share - np.sin(2 * np.pi * share) / (2 * np.pi))
        acceleration += sign * _SPEED / _CHANGE_S * (1 - np.cos(2 * np.pi * share))
    ahead = np.array([np.cos(np.radians(30.0)), np.sin(np.radians(30.0)), 0.0])
    moved = np.outer(acceleration, ahead)
    force = rotations.to_body(still.q_enu_from_body_wxyz, moved + np.array([0.0, 0.0, trajectory.GRAVITY]))
    return replace(still, velocity=np.outer(speed, ahead), acceleration=moved, force=force)


def _turned(t: Floats, angles: Callable[[Floats], Floats]) -> MotionState:
    """At a fixed place, turned about x, then y, then z by angles (n, 3)."""
    q = _attitude(angles(t))
    ahead, behind = _attitude(angles(t + _STEP_S)), _attitude(angles(t - _STEP_S))
    back = behind * [1.0, -1.0, -1.0, -1.0]
    step = rotations.product(back, ahead)
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
        rotations.euler_of(q),
        q,
        rate,
        rotations.to_body(q, up),
        rotations.to_body(q, field),
    )


def _attitude(angles: Floats) -> Floats:
    """q_enu_from_body of turns about x, then y, then z of the body."""
    q = np.zeros((len(angles), 4))
    q[:, 0] = 1.0
    for axis in range(3):
        half = np.zeros((len(angles), 4))
        half[:, 0] = np.cos(angles[:, axis] / 2)
        half[:, 1 + axis] = np.sin(angles[:, axis] / 2)
        q = rotations.product(q, half)
    return q


MOTIONS: Mapping[str, Callable[[Array], MotionState]] = {
    "drive": trajectory.vehicle_motion,
    "rest": _rest,
    "tumble": _tumble,
    "turn": _turn,
    "positions": _positions,
    "straight": _straight,
}

SETUP_OPTIONS = (
    SimulatorOption("motion", "choice", "drive", tuple(MOTIONS)),
    SimulatorOption("hard_iron", "number", 0, high=10),
    SimulatorOption("soft_iron", "number", 0, high=1),
    SimulatorOption("gyro_bias", "number", 0, high=100, unit="°/s"),
    SimulatorOption("acc_bias", "number", 0, high=10, unit="m/s²"),
    SimulatorOption("acc_scale", "number", 0, high=1),
    SimulatorOption("mount", "number", 0, high=180, unit="°"),
)
"""Options of a family whose simulated devices can have a setup; in the order of the attributes of SensorSetup."""
