"""Motion of a simulated vehicle.

One plausible drive, as a pure function of time: the same figure of eight over a gentle hill, lap after lap, with
three stops a lap. Position, velocity, acceleration, attitude and rate of turn are derivatives of one another, in closed
form or by differences far finer than any sensor: integrating one gives the other.

               stop 2                     path      (A sin s, B sin 2s), height C (1 − cos s)
            ╭────●────╮   ╭─────────╮     progress  s(t) = 2π (lap + leg / 3): each leg starts and ends at rest,
            │         ╰─●─╯         │               its speed a raised cosine
            │  start  ╭─┴─╮         │     attitude  heading along the path, pitch of the hill; the body leans out of
            ╰─────────╯   ╰────●────╯               turns and dips when braking
                            stop 3        road      a pothole once a lap, an engine at 23 Hz, always running

## Frames

ENU: x east, y north, z up, in metres from `PLACE`. Body: x forward, y left, z up. `q_enu_from_body_wxyz` turns a vector
in the body into ENU; roll, pitch and yaw are its ZYX angles: yaw counts from east, anticlockwise, pitch is positive
with the nose down, roll with the left side up. Specific force is the reading of an accelerometer: acceleration minus
gravity, (0, 0, +g) at rest. The Earth's own rotation (15°/h) is left out: it is below the resolution of these sensors.

## Sensor errors

`SensorErrors` adds the errors of a good MEMS unit, in orders of magnitude from public data sheets: noise of a given
density, white within the sampled band, and a slowly wandering bias. All is a function of seed and sample number, so
that a run is exactly repeatable, however it is cut into pieces.

Rules for editing: this module is independent of protocols and products; ranges, rates and units of the wire belong to
the simulators.
"""

from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Array, Floats
from imuscope.protocols.rotations import of_euler, side_by_side, to_body

# -- the place: 45° N on the zero meridian, halfway between equator and pole -------------------------------------------

PLACE = (45.0, 0.0, 60.0)  # latitude °, longitude °, height above the ellipsoid m
GEOID_M = 47.0  # height of mean sea level above the ellipsoid there, m
GRAVITY = 9.80620  # m/s², normal gravity at 45° (WGS 84)
FIELD_INCLINATION = np.radians(60.5)  # the Earth's field there (World Magnetic Model 2025, rounded)
FIELD_DECLINATION = np.radians(0.9)
FIELD_ENU = np.array(
    [
        np.cos(FIELD_INCLINATION) * np.sin(FIELD_DECLINATION),
        np.cos(FIELD_INCLINATION) * np.cos(FIELD_DECLINATION),
        -np.sin(FIELD_INCLINATION),
    ]
)  # of norm 1, as an MTi reports it after calibration

# -- the drive ---------------------------------------------------------------------------------------------------------

EAST_M, NORTH_M, HILL_M = 90.0, 42.0, 1.5
LEGS = 3
DRIVE_S, REST_S = 33.0, 7.0
LEG_S = DRIVE_S + REST_S
LAP_S = LEGS * LEG_S
LEAN_ROLL, LEAN_PITCH = 0.012, 0.010  # rad per m/s²: a soft car leans 0.7° at 1 m/s²
ENGINE_HZ, ENGINE_M = 23.0, 1.5e-6  # 0.03 m/s² of vibration
POTHOLE_S, POTHOLE_M, POTHOLE_WIDTH_S = 52.0, 0.012, 0.0085  # 12 mm in 9 ms: 170 m/s² for a moment, beyond 10 g
_STEP_S = 1e-4  # differences of angles: error below 1e-6 rad/s


@dataclass(frozen=True, slots=True)
class MotionState:
    """The truth at n moments.

    Args:
        t: (n,) s.
        position, velocity, acceleration: (n, 3) ENU; m, m/s, m/s²; acceleration of the body, without gravity.
        euler: (n, 3) rad: roll, pitch, yaw (ZYX).
        q_enu_from_body_wxyz: (n, 4), scalar first, unit norm.
        rate: (n, 3) rad/s, rate of turn in the body.
        force: (n, 3) m/s², specific force in the body.
        field: (n, 3) magnetic field in the body, norm 1.
    """

    t: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    euler: Floats
    q_enu_from_body_wxyz: Floats
    rate: Floats
    force: Floats
    field: Floats


def vehicle_motion(t: Array) -> MotionState:
    """Position and motion of the vehicle at times `t`, (n,) s. Time 0 is the start of a lap; any time is allowed."""
    t = np.asarray(t, dtype=np.float64)
    position, velocity, acceleration = _path(t)
    euler = _attitude(t)
    ahead, behind = _attitude(t + _STEP_S), _attitude(t - _STEP_S)
    turn = ahead - behind
    turn[:, 2] = np.remainder(turn[:, 2] + np.pi, 2 * np.pi) - np.pi
    rate = _body_rate(euler, turn / (2 * _STEP_S))
    q = of_euler(euler)
    force = to_body(q, acceleration + np.array([0.0, 0.0, GRAVITY]))
    return MotionState(
        t, position, velocity, acceleration, euler, q, rate, force, to_body(q, np.broadcast_to(FIELD_ENU, (len(t), 3)))
    )


def speed(motion: MotionState) -> Floats:
    """Over the ground, (n,) m/s."""
    return np.hypot(motion.velocity[:, 0], motion.velocity[:, 1])


def _progress(t: Floats) -> tuple[Floats, Floats, Floats]:
    """s(t) of the path and its first two derivatives, rad, rad/s, rad/s²."""
    leg = np.floor(t / LEG_S)
    tau = np.minimum((t - leg * LEG_S) / DRIVE_S, 1.0)
    turn = 2 * np.pi * tau
    scale = 2 * np.pi / LEGS
    s = scale * (leg + tau - np.sin(turn) / (2 * np.pi))
    s1 = scale / DRIVE_S * (1 - np.cos(turn))
    s2 = scale / DRIVE_S**2 * 2 * np.pi * np.sin(turn)
    return s, s1, s2


def _path(t: Floats) -> tuple[Floats, Floats, Floats]:
    """Position, velocity and acceleration, each (n, 3) ENU."""
    s, s1, s2 = _progress(t)
    place = side_by_side(EAST_M * np.sin(s), NORTH_M * np.sin(2 * s), HILL_M * (1 - np.cos(s)))
    first = _tangent(s)
    second = side_by_side(-EAST_M * np.sin(s), -4 * NORTH_M * np.sin(2 * s), HILL_M * np.cos(s))
    velocity = first * s1[:, None]
    acceleration = second * s1[:, None] ** 2 + first * s2[:, None]
    w = 2 * np.pi * ENGINE_HZ
    shake, hole = np.sin(w * t), _pothole(t)
    place[:, 2] += ENGINE_M * shake + hole[0]
    velocity[:, 2] += ENGINE_M * w * np.cos(w * t) + hole[1]
    acceleration[:, 2] += -ENGINE_M * w**2 * shake + hole[2]
    return place, velocity, acceleration


def _pothole(t: Floats) -> tuple[Floats, Floats, Floats]:
    """Height of the wheel over the road and its derivatives: a Gaussian dip once a lap."""
    x = (np.remainder(t, LAP_S) - POTHOLE_S) / POTHOLE_WIDTH_S
    dip = -POTHOLE_M * np.exp(-0.5 * np.minimum(x * x, 1400.0))
    return dip, -x / POTHOLE_WIDTH_S * dip, (x * x - 1) / POTHOLE_WIDTH_S**2 * dip


def _tangent(s: Floats) -> Floats:
    return side_by_side(EAST_M * np.cos(s), 2 * NORTH_M * np.cos(2 * s), HILL_M * np.sin(s))


def _attitude(t: Floats) -> Floats:
    """Roll, pitch and yaw, (n, 3) rad: along the path, leaning with the acceleration of the smooth road."""
    s, s1, s2 = _progress(t)
    along = _tangent(s)
    x1, y1 = along[:, 0], along[:, 1]
    x2, y2 = -EAST_M * np.sin(s), -4 * NORTH_M * np.sin(2 * s)
    flat = np.hypot(x1, y1)
    yaw = np.arctan2(y1, x1)
    forward = flat * s2 + (x1 * x2 + y1 * y2) / flat * s1**2
    leftward = (x1 * y2 - y1 * x2) / flat * s1**2
    pitch = -np.arctan2(along[:, 2], flat) - LEAN_PITCH * forward
    return side_by_side(LEAN_ROLL * leftward, pitch, yaw)


def _body_rate(euler: Floats, slope: Floats) -> Floats:
    """Rate of turn in the body, (n, 3) rad/s, from ZYX angles and their derivatives."""
    roll, pitch = euler[:, 0], euler[:, 1]
    d_roll, d_pitch, d_yaw = slope.T
    return side_by_side(
        d_roll - d_yaw * np.sin(pitch),
        d_pitch * np.cos(roll) + d_yaw * np.cos(pitch) * np.sin(roll),
        -d_pitch * np.sin(roll) + d_yaw * np.cos(pitch) * np.cos(roll),
    )


# -- the place on Earth ------------------------------------------------------------------------------------------------

_A, _E2 = 6378137.0, 6.69437999014e-3  # WGS 84: semi-major axis m, first eccentricity squared


def geodetic(position: Floats) -> Floats:
    """Latitude °, longitude °, height m, (n, 3), of ENU positions within some kilometres of `PLACE`."""
    latitude, longitude, height = PLACE
    sine = np.sin(np.radians(latitude))
    w = np.sqrt(1 - _E2 * sine**2)
    meridian, prime = _A * (1 - _E2) / w**3, _A / w
    return side_by_side(
        latitude + np.degrees(position[:, 1] / (meridian + height)),
        longitude + np.degrees(position[:, 0] / ((prime + height) * np.cos(np.radians(latitude)))),
        height + position[:, 2],
    )


def ecef(place: Floats) -> Floats:
    """Earth-centred coordinates, (n, 3) m, of latitude °, longitude °, height m."""
    latitude, longitude, height = np.radians(place[:, 0]), np.radians(place[:, 1]), place[:, 2]
    prime = _A / np.sqrt(1 - _E2 * np.sin(latitude) ** 2)
    return side_by_side(
        (prime + height) * np.cos(latitude) * np.cos(longitude),
        (prime + height) * np.cos(latitude) * np.sin(longitude),
        (prime * (1 - _E2) + height) * np.sin(latitude),
    )


def pressure(height: Floats) -> Floats:
    """Air pressure, Pa, at a height above sea level, m (International Standard Atmosphere, troposphere)."""
    return np.asarray(101325.0 * (1 - 2.25577e-5 * height) ** 5.25588)


# -- sensor errors -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SensorGrade:
    """Quality of a sensor triad: noise density in unit/√Hz, and the size of its slow bias in the same unit."""

    density: float
    bias: float


GYRO = SensorGrade(density=np.radians(0.007), bias=np.radians(8.0 / 3600))  # rad/s: 0.007 °/s/√Hz, 8 °/h
ACCELEROMETER = SensorGrade(density=60e-6 * GRAVITY, bias=15e-6 * GRAVITY)  # 60 µg/√Hz, 15 µg
MAGNETOMETER = SensorGrade(density=1e-4, bias=1e-3)  # of the Earth's field: 0.5 mG in a 100 Hz stream
ATTITUDE = SensorGrade(density=np.radians(0.003), bias=np.radians(0.2))  # rad, of a filter's solution
POSITION = SensorGrade(density=0.02, bias=0.6)  # m, of a satellite receiver without corrections
VELOCITY = SensorGrade(density=0.01, bias=0.03)

# Vibration of engine and road on a rigidly mounted sensor at full speed, as a density like a sensor's noise. On tarmac
# a car's floor shakes by some tenths of m/s² and °/s; a tenth of that stays at standstill, from the idling engine.
SHAKING_FORCE = SensorGrade(density=0.035, bias=0.0)
SHAKING_TURN = SensorGrade(density=np.radians(0.06), bias=0.0)
IDLING = 0.08
FULL_SPEED = 12.0  # m/s


def vibration(motion: MotionState) -> Floats:
    """Share of full vibration at each time of a drive, (n,)."""
    return IDLING + (1 - IDLING) * np.minimum(speed(motion) / FULL_SPEED, 1.0)


_BLOCK = 256
_WAVES_S = (37.0, 101.0, 283.0, 811.0)  # periods of the slow bias: no two in step


class SensorErrors:
    """The errors of one triad.

    Args:
        grade: quality of the sensor.
        seed: repeats exactly; use a different one for every triad.
        rate: samples/s, which sets the bandwidth of the noise.
    """

    def __init__(self, grade: SensorGrade, seed: int, rate: float) -> None:
        self._seed = seed
        self._sigma = grade.density * np.sqrt(rate / 2)
        random = np.random.default_rng([seed, 0])
        self._phase = random.uniform(0, 2 * np.pi, (len(_WAVES_S), 3))
        self._size = grade.bias * np.sqrt(2 / len(_WAVES_S)) * random.uniform(0.7, 1.3, (len(_WAVES_S), 3))
        self._constant = grade.bias * random.normal(size=3)
        self._rate = rate
        self._blocks: dict[int, Floats] = {}  # the last two of the noise: the next samples are in them

    def at(self, first: int, count: int) -> Floats:
        """Errors of samples `first` … `first + count − 1`, (count, 3)."""
        blocks = range(first // _BLOCK, (first + count - 1) // _BLOCK + 1)
        noise = np.concatenate([self._noise(block) for block in blocks])[first % _BLOCK :][:count]
        return noise + self.bias((first + np.arange(count)) / self._rate)

    def bias(self, t: Floats) -> Floats:
        """The slow part alone at times `t`, (n, 3)."""
        waves = 2 * np.pi * t[:, None, None] / np.array(_WAVES_S)[:, None]
        return np.asarray(self._constant + (self._size * np.sin(waves + self._phase)).sum(axis=1))

    def _noise(self, block: int) -> Floats:
        values = self._blocks.get(block)
        if values is None:
            values = np.random.default_rng([self._seed, 1 + block]).normal(scale=self._sigma, size=(_BLOCK, 3))
            self._blocks = {**dict(list(self._blocks.items())[-1:]), block: values}
        return values
