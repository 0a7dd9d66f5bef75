"""Signals of the simulated IMX-5: every data set that its simulator streams, computed from the shared drive and packed
as configured.

    drive(t) + errors ──> SignalSamples (force, turn, place …) ──> one function per data set ──> rows of bytes
      ──> packets

The drive (protocols/simulator/trajectory.py) is in ENU with the body's y to the left and z up; this family uses NED
with y to the right and z down, so vectors of the body change two signs and attitudes are rotated on both sides.

A receiver needs `FIRST_FIX_NS` to its first fix. Until then the week is 0 and the time of week counts from power-on,
the navigation filter aligns and stays at its last known place; then week, place and status change from one packet to
the next, as in a real device. A receiver's solution is AGE_NS old when it is sent.

All packets of one data set in a quarter of a second are rows of one array, so that the cost is per field and not per
packet. The result depends on seed and time only, not on how time is cut.

Rules for editing: a data set that can be streamed is a row in `SOURCES` and a function marked with its number.

Source: inertial-sense-sdk 2.7.1, data_sets.h; ISB document, "Data Source Update Rates".
"""

import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from imuscope.protocols import rotations
from imuscope.protocols.arrays import Array, Floats
from imuscope.protocols.isb.dataset_loader import SETS
from imuscope.protocols.isb.frames import DATA, FIRST, HEADER, SECOND, TRAILER
from imuscope.protocols.isb.time_base import GPS_EPOCH, WEEK_S
from imuscope.protocols.schema.layouts import element
from imuscope.protocols.simulator import trajectory
from imuscope.protocols.simulator.setups import AS_BUILT, SensorSetup

S = 10**9
BLOCK_NS = 250_000_000
AGE_NS = 80_000_000
FIRST_FIX_NS, FINE_NS = 4 * S, 9 * S
GNSS_NS = 200_000_000
LEAP_S = 18  # GPS time is ahead of UTC since 2017
UTC_2026_S = 1_767_225_600
TURN_RANGE, FORCE_RANGE = math.radians(4000), 16 * trajectory.GRAVITY  # IMX-5 data sheet
STILL_M_S = 0.05  # m/s

NAV, IMU, SLOW, GNSS = "nav", "imu", "slow", "gnss"
FLIP = np.array([1.0, -1.0, -1.0])  # of a body vector, y left and z up to y right and z down
_NED_FROM_ENU = np.array([0, math.sqrt(0.5), math.sqrt(0.5), 0])
_LEFT_UP_FROM_RIGHT_DOWN = np.array([0.0, 1, 0, 0])

SKY = (  # system, satellite, elevation °, azimuth °, carrier to noise ratio in dBHz
    *((1, 2, 63, 47, 46), (1, 5, 41, 301, 41), (1, 12, 77, 190, 48), (1, 25, 34, 122, 42), (1, 29, 19, 228, 34)),
    *((3, 3, 58, 265, 45), (3, 8, 37, 80, 41), (3, 15, 25, 158, 37), (3, 30, 9, 330, 29)),
    *((4, 19, 44, 14, 38), (4, 27, 7, 201, 22), (6, 1, 52, 96, 43), (6, 7, 33, 349, 39), (6, 14, 6, 61, 24)),
    (2, 123, 36, 171, 36),
)
MIN_DBHZ = 30  # dBHz; stronger satellites are used

# Bits of the status words, as named in datasets.txt.
_COARSE, _FINE = 0b111, 0b111 << 4
_GPS_POSITION, _UPDATE, _MAG_HEADING, _NAV_MODE, _STATIONARY, _GPS_VELOCITY, _KINEMATIC = (
    1 << n for n in (8, 9, 11, 12, 13, 14, 15)
)
_ALIGNING, _NAV, _FIX_3D = 1 << 16, 3 << 16, 1 << 24
_TURNING, _SHAKEN, _RECEIVING, _CLIPPED_TURN, _CLIPPED_FORCE, _TIME_VALID, _PASSED = (
    1 << n for n in (0, 1, 4, 8, 9, 6, 25)
)


@dataclass(frozen=True, slots=True)
class StreamSource:
    """A data set that can be streamed, its pace, and its bit of DID_RMC."""

    did: int
    pace: str
    bit: int


SOURCES: Mapping[int, StreamSource] = {
    row.did: row
    for row in (
        StreamSource(58, IMU, 4),
        StreamSource(3, NAV, 5),
        StreamSource(4, NAV, 0),
        StreamSource(5, NAV, 1),
        StreamSource(52, SLOW, 7),
        StreamSource(53, SLOW, 6),
        StreamSource(13, GNSS, 10),
        StreamSource(30, GNSS, 20),
        StreamSource(15, GNSS, 14),
    )
}


def _dtype(did: int) -> np.dtype[Any]:
    """A data set's structure as a numpy dtype."""
    struct = SETS[did].struct
    assert struct is not None
    names = [field.name for field, _ in struct.places]
    forms = [(element(field), field.shape) for field, _ in struct.places]
    offsets = [at for _, at in struct.places]
    return np.dtype({"names": names, "formats": forms, "offsets": offsets, "itemsize": struct.size})


DTYPES = {did: _dtype(did) for did in (*SOURCES, 1, 10, 12, 121, 123)}


@dataclass(frozen=True, slots=True)
class SignalSource:
    """Inputs of all values of one run, apart from time.

    Args:
        seed: of the sensor errors.
        vibration: share of the vehicle's shaking that reaches the sensor, 0 to 1.
        jump: (device time ns, by ns): the device's clock jumps once, a fault; None for none.
        utc_ns: UTC at device time 0, ns since the Unix epoch.
        setup: motion, and errors that a calibration finds.
    """

    seed: int = 0
    vibration: float = 0.0
    jump: tuple[int, int] | None = None
    utc_ns: int = UTC_2026_S * S
    setup: SensorSetup = AS_BUILT

    def up(self, times: Array, age_ns: int = 0) -> Array:
        """Device clock, ns, in packets sent `age_ns` after `times`."""
        if self.jump is None:
            return times
        return np.asarray(times + np.where(times + age_ns >= self.jump[0], self.jump[1], 0))

    def gps(self, up: Array, fixed: Array) -> tuple[Array, Array]:
        """GPS week and time of week in ns by up-time; before the first fix 0 and the up-time."""
        week, tow = np.divmod(up + (self.utc_ns + (LEAP_S - GPS_EPOCH) * S), WEEK_S * S)
        return np.where(fixed, week, 0), np.where(fixed, tow, up)


class SignalSamples:
    """Truth and readings at consecutive samples of one pace, each computed on first access.

    Args:
        first: number of the first sample since the device was switched on.
        times: (n,) device time of each, ns.
        age_ns: their age when they are sent.
    """

    def __init__(self, run: SignalSource, first: int, times: Array, period_ns: int, age_ns: int = 0) -> None:
        self.run, self.first, self.times, self.period_ns, self.age_ns = run, first, times, period_ns, age_ns

    @cached_property
    def motion(self) -> trajectory.MotionState:
        return self.run.setup.motion_at(self.times / 1e9)

    @cached_property
    def fixed(self) -> Array:
        """Whether there is a fix, as in the receiver's first solution with one."""
        return np.asarray(self.times + self.age_ns >= FIRST_FIX_NS)

    @cached_property
    def up(self) -> Array:
        """The device's own clock, ns."""
        return self.run.up(self.times, self.age_ns)

    @cached_property
    def gps(self) -> tuple[Array, Array]:
        """Week, and time of week in ns."""
        return self.run.gps(self.up, self.fixed)

    @cached_property
    def fine(self) -> Array:
        return np.asarray(self.times >= FINE_NS)

    def _error(self, name: str, grade: trajectory.SensorGrade) -> Floats:
        seed = self.run.seed ^ zlib.crc32(name.encode())
        return trajectory.SensorErrors(grade, seed, S / self.period_ns).at(self.first, len(self.times))

    def _shaking(self, name: str, grade: trajectory.SensorGrade) -> Floats | float:
        if not self.run.vibration:
            return 0.0
        return self.run.vibration * trajectory.vibration(self.motion)[:, None] * self._error(name, grade)

    @cached_property
    def force(self) -> Floats:
        """Specific force, (n, 3) m/s², forward, right, down."""
        felt = self.run.setup.force(self.motion.force) + self._shaking("acc-road", trajectory.SHAKING_FORCE)
        felt = felt + self._error("acc", trajectory.ACCELEROMETER)
        return np.asarray(np.clip(felt, -FORCE_RANGE, FORCE_RANGE) * FLIP)

    @cached_property
    def rotation_rate(self) -> Floats:
        """Rate of turn, (n, 3) rad/s."""
        felt = self.run.setup.turn(self.motion.rate) + self._shaking("gyr-road", trajectory.SHAKING_TURN)
        felt = felt + self._error("gyr", trajectory.GYRO)
        return np.asarray(np.clip(felt, -TURN_RANGE, TURN_RANGE) * FLIP)

    @cached_property
    def field(self) -> Floats:
        return np.asarray(
            (self.run.setup.field(self.motion.field) + self._error("mag", trajectory.MAGNETOMETER)) * FLIP
        )

    @cached_property
    def attitude(self) -> Floats:
        """q_ned_from_body_wxyz, a fraction of a degree off."""
        small = self._error("att", trajectory.ATTITUDE) / 2
        wrong = np.concatenate([np.sqrt(1 - (small**2).sum(axis=1, keepdims=True)), small], axis=1)
        q = rotations.product(self.motion.q_enu_from_body_wxyz, wrong)
        q = rotations.product(rotations.product(_NED_FROM_ENU, q), _LEFT_UP_FROM_RIGHT_DOWN)
        return np.asarray(q * np.where(q[:, :1] < 0, -1.0, 1.0))

    @cached_property
    def enu(self) -> Floats:
        """Place, (n, 3) m from trajectory.PLACE; that place itself before the first fix."""
        return np.where(self.fixed[:, None], self.motion.position + self._error("pos", trajectory.POSITION), 0.0)

    @cached_property
    def velocity(self) -> Floats:
        """(n, 3) m/s ENU; 0 before the first fix."""
        return np.where(self.fixed[:, None], self.motion.velocity + self._error("vel", trajectory.VELOCITY), 0.0)

    @cached_property
    def ins_status(self) -> Array:
        still = trajectory.speed(self.motion) < STILL_M_S
        word = np.where(self.fixed, _COARSE | _GPS_POSITION | _UPDATE | _NAV_MODE | _GPS_VELOCITY | _NAV | _FIX_3D, 0)
        word |= np.where(self.fixed, 0, 1 | _ALIGNING)
        word |= np.where(self.fine, _FINE | _KINEMATIC, 0) | np.where(still, _STATIONARY, 0) | _MAG_HEADING
        return np.asarray(word)

    @cached_property
    def hdw_status(self) -> Array:
        moving = trajectory.speed(self.motion) >= STILL_M_S
        word = np.where(self.fixed, _RECEIVING | _TIME_VALID, 0) | _PASSED
        word |= np.where(moving, _SHAKEN, 0) | np.where(np.abs(self.motion.rate).max(axis=1) > 0.02, _TURNING, 0)
        word |= np.where(np.abs(self.rotation_rate).max(axis=1) >= TURN_RANGE, _CLIPPED_TURN, 0)
        return np.asarray(word | np.where(np.abs(self.force).max(axis=1) >= FORCE_RANGE, _CLIPPED_FORCE, 0))

    @cached_property
    def gps_status(self) -> Array:
        """Satellites used, fix, fix is good, PPS."""
        used = np.where(self.fixed, sum(cno > MIN_DBHZ for *_, cno in SKY), 0)
        return np.asarray(used | np.where(self.fixed, 3 << 8 | 1 << 16 | 1 << 28, 0))


# -- one function per data set -----------------------------------------------------------------------------------------

Fill = Callable[[SignalSamples, Array], None]
_FILLS: dict[int, Fill] = {}


def _fills(did: int) -> Callable[[Fill], Fill]:
    def register(fill: Fill) -> Fill:
        _FILLS[did] = fill
        return fill

    return register


def _stamp(at: SignalSamples, out: Array) -> None:
    week, tow = at.gps
    out["week"] = week
    if "timeOfWeekMs" in (out.dtype.names or ()):
        out["timeOfWeekMs"] = tow // 10**6
    else:
        out["timeOfWeek"] = tow / 1e9


def _ins(at: SignalSamples, out: Array) -> None:
    _stamp(at, out)
    out["insStatus"], out["hdwStatus"] = at.ins_status, at.hdw_status
    out["uvw"] = rotations.to_body(at.motion.q_enu_from_body_wxyz, at.velocity) * FLIP
    out["lla"] = trajectory.geodetic(at.enu)


@_fills(4)
def _ins_1(at: SignalSamples, out: Array) -> None:
    _ins(at, out)
    out["theta"] = rotations.euler_of(at.attitude)
    out["ned"] = at.enu[:, [1, 0, 2]] * [1, 1, -1]


@_fills(5)
def _ins_2(at: SignalSamples, out: Array) -> None:
    _ins(at, out)
    out["qn2b"] = at.attitude


def _imu_status(at: SignalSamples) -> Array:
    word = 0b111111 | np.where(np.abs(at.rotation_rate).max(axis=1) >= TURN_RANGE, 1 << 30, 0)
    return np.asarray(word | np.where(np.abs(at.force).max(axis=1) >= FORCE_RANGE, 1 << 31, 0))


@_fills(58)
def _imu(at: SignalSamples, out: Array) -> None:
    out["time"], out["status"] = at.up / 1e9, _imu_status(at)
    out["I.pqr"], out["I.acc"] = at.rotation_rate, at.force


@_fills(3)
def _pimu(at: SignalSamples, out: Array) -> None:
    dt = at.period_ns / 1e9
    out["time"], out["dt"], out["status"] = at.up / 1e9, dt, _imu_status(at)
    out["theta"], out["vel"] = at.rotation_rate * dt, at.force * dt


@_fills(52)
def _magnetometer(at: SignalSamples, out: Array) -> None:
    out["time"], out["mag"] = at.up / 1e9, at.field


@_fills(53)
def _barometer(at: SignalSamples, out: Array) -> None:
    height = at.motion.position[:, 2] + trajectory.PLACE[2] - trajectory.GEOID_M
    noise = at._error("baro", trajectory.SensorGrade(density=0.5, bias=8.0))[:, 0]
    pressure = trajectory.pressure(height) + noise
    out["time"], out["bar"] = at.up / 1e9, pressure / 1e3
    out["mslBar"] = (1 - (pressure / 101_325.0) ** (1 / 5.25588)) / 2.25577e-5  # the inverse of trajectory.pressure
    out["barTemp"] = 24.0 + 14.0 * (1 - np.exp(-at.times / (600 * S)))
    out["humidity"] = 38.0 + 2.0 * np.sin(at.times / (90 * S))


@_fills(13)
def _position(at: SignalSamples, out: Array) -> None:
    _stamp(at, out)
    fixed, lla = at.fixed, trajectory.geodetic(at.enu)
    out["status"], out["satsUsed"] = at.gps_status, at.gps_status & 0xFF
    is_fix = np.where(fixed[:, None], 1.0, 0.0)
    out["lla"], out["ecef"] = lla * is_fix, trajectory.ecef(lla) * is_fix
    out["hMSL"] = np.where(fixed, lla[:, 2] - trajectory.GEOID_M, 0.0)
    better = np.exp(-np.maximum(at.times - FIRST_FIX_NS, 0) / (6 * S))
    out["hAcc"], out["vAcc"] = np.where(fixed, 0.9 + 4 * better, 1e3), np.where(fixed, 1.4 + 6 * better, 1e3)
    out["pDop"] = np.where(fixed, 1.5 + better, 99.99)
    out["cnoMean"] = np.mean([cno for *_, cno in SKY if cno > MIN_DBHZ])
    out["cnoMeanSigma"] = 41
    out["towOffset"] = np.where(fixed, (at.gps[1] - at.up) / 1e9, 0.0)
    out["leapS"] = LEAP_S


@_fills(30)
def _velocity(at: SignalSamples, out: Array) -> None:
    out["timeOfWeekMs"] = at.gps[1] // 10**6
    out["status"], out["sAcc"] = at.gps_status, np.where(at.fixed, 0.06, 10.0)
    latitude, longitude = np.radians(trajectory.PLACE[:2])
    (sin_b, cos_b), (sin_l, cos_l) = ((np.sin(a), np.cos(a)) for a in (latitude, longitude))
    ecef_from_enu = np.array(
        [[-sin_l, -sin_b * cos_l, cos_b * cos_l], [cos_l, -sin_b * sin_l, cos_b * sin_l], [0, cos_b, sin_b]]
    )
    out["vel"] = at.velocity @ ecef_from_enu.T


@_fills(15)
def _satellites(at: SignalSamples, out: Array) -> None:
    out["timeOfWeekMs"] = at.gps[1] // 10**6
    out["numSats"] = len(SKY)
    for i, (system, number, elevation, azimuth, cno) in enumerate(SKY):
        one = out["sat"][:, i]
        one["gnssId"], one["svId"], one["elev"], one["azim"] = system, number, elevation, azimuth
        one["cno"] = cno + np.rint(2 * np.sin(at.times / (11 + i) / 1e9))
        used = (one["cno"] > MIN_DBHZ) & at.fixed
        out["sat"]["status"][:, i] = np.where(used, 7 | 1 << 3 | 1 << 4, np.where(one["cno"] > MIN_DBHZ, 4 | 1 << 4, 2))


# -- packets -----------------------------------------------------------------------------------------------------------


def payload_size(did: int) -> int:
    """Bytes of a data set as it is sent: a list of satellites ends with the last one in use."""
    return 8 + 8 * len(SKY) if did == 15 else DTYPES[did].itemsize


def moments(run: SignalSource, did: int, period_ns: int, steps: Array) -> SignalSamples:
    """The samples `steps` (consecutive) of a data set's source."""
    age = AGE_NS if SOURCES[did].pace == GNSS else 0
    return SignalSamples(run, int(steps[0]), np.maximum(steps * period_ns - age, 0), period_ns, age)


def rows_of(did: int, at: SignalSamples, chosen: Array) -> Array:
    """Payloads of the samples `chosen`, (n, size) uint8."""
    out = np.zeros(len(at.times), DTYPES[did])
    _FILLS[did](at, out)
    return out[chosen].view(np.uint8).reshape(len(chosen), -1)[:, : payload_size(did)]


def packets(did: int, payloads: Array) -> list[bytes]:
    """One DATA packet for each row of payloads."""
    n, size = payloads.shape
    rows = np.empty((n, HEADER + size + TRAILER), np.uint8)
    rows[:, :HEADER] = (FIRST, SECOND, DATA, did, size & 0xFF, size >> 8)
    rows[:, HEADER:-TRAILER] = payloads
    body = rows[:, :-TRAILER].astype(np.int64)
    rows[:, -2] = body.sum(axis=1) & 0xFF  # Fletcher-16: the plain sum, and the sum of the sums
    rows[:, -1] = (body @ np.arange(body.shape[1], 0, -1)) & 0xFF
    flat, step = rows.tobytes(), rows.shape[1]
    return [flat[i : i + step] for i in range(0, len(flat), step)]
