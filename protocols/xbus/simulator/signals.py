"""Value of every MTData2 item along the shared trajectory.

    drive(t) + errors ──> quantities (force, attitude, place …) ──> one method per item ──> bytes in the given precision

The truth is protocols/simulator/trajectory.py; limits of products and receivers are added here: clipping ranges of
sensors, a fix that takes seconds, corrections that fix it later and are lost now and then, a solution that is old when
it is sent.

Rules for editing: a new item is a row in output_configuration.py and a method of `ItemValues` marked with its name.

Source: MT0101P 2020.A, table 17 (formats), 25-27 (GNSS, status), 5.3.6.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from imuscope.protocols import rotations
from imuscope.protocols.arrays import Array, Floats
from imuscope.protocols.simulator import trajectory
from imuscope.protocols.simulator.setups import AS_BUILT, SensorSetup
from imuscope.protocols.xbus.output_configuration import OUTPUTS

TICKS_S = 10_000  # SampleTimeFine
GNSS_AGE_NS = 80_000_000  # age of a receiver's solution when it arrives

ACCELERATION_RANGE = 98.07  # m/s²: ±10 g, MTi 600-series data sheet
TURN_RANGE = math.radians(2000)
FIELD_RANGE = 8.0  # of the Earth's field
FIRST_FIX_NS, FIRST_RTK_NS, FIXED_RTK_NS = 3 * 10**9, 6 * 10**9, 15 * 10**9
RTK_PERIOD_S, RTK_LOST_S = 90.0, 6.0  # under trees the fixed solution floats for a while
UTC_2026_NS = 1_767_225_600 * 10**9


PRECISIONS = {0: ">f4", 1: "fp1220", 2: "fp1632", 3: ">f8"}
LOCALS = {0: "ENU", 4: "NED", 8: "NWU"}
_TURN_TO = {  # rotates ENU vectors into the other system
    "ENU": np.array([1.0, 0, 0, 0]),
    "NED": np.array([0, math.sqrt(0.5), math.sqrt(0.5), 0]),
    "NWU": np.array([math.sqrt(0.5), 0, 0, -math.sqrt(0.5)]),
}
_PVT = np.dtype(
    [("itow", ">u4"), ("year", ">u2"), ("month", "u1"), ("day", "u1"), ("hour", "u1"), ("min", "u1"), ("sec", "u1")]
    + [("valid", "u1"), ("tAcc", ">u4"), ("nano", ">i4"), ("fixtype", "u1"), ("flags", "u1"), ("numSV", "u1")]
    + [("res", "u1"), ("lon", ">i4"), ("lat", ">i4"), ("height", ">i4"), ("hMSL", ">i4"), ("hAcc", ">u4")]
    + [("vAcc", ">u4"), ("velN", ">i4"), ("velE", ">i4"), ("velD", ">i4"), ("gSpeed", ">i4"), ("headMot", ">i4")]
    + [("sAcc", ">u4"), ("headAcc", ">u4"), ("headVeh", ">i4")]
    + [(name + "dop", ">u2") for name in "gptvhne"]
)
_RAW = np.dtype([("acc", ">u2", 3), ("gyr", ">u2", 3), ("mag", ">u2", 3), ("temp", ">i2")])
_UTC = np.dtype(
    [("ns", ">u4"), ("year", ">u2"), *((name, "u1") for name in ("month", "day", "hour", "min", "sec", "flags"))]
)
_SKY = (  # system, satellite, carrier to noise ratio in dBHz
    *((0, 2, 44), (0, 5, 38), (0, 12, 47), (0, 25, 41), (0, 29, 33), (2, 3, 45), (2, 8, 40), (2, 15, 36)),
    *((2, 30, 29), (6, 1, 42), (6, 7, 39), (6, 14, 24), (3, 19, 37), (3, 27, 21), (1, 123, 35)),
)


@dataclass(frozen=True, slots=True)
class VehicleState:
    """Effects of commands on the status word. Times are device time, ns.

    Args:
        no_rotation: (begin, end, first rotation noticed) of the last no-rotation update, or None.
        representative_motion: in-run compass calibration collects data.
        sync_out_every: interval of pulses, in samples; 0 never.
        sync_in_s: interval of triggers, s; 0 never.
        utc_ns: UTC at device time 0, ns since the Unix epoch; and whether it was set by the user.
        location: the user's number of the device.
    """

    no_rotation: tuple[int, int, int] | None = None
    representative_motion: bool = False
    sync_out_every: int = 0
    sync_in_s: float = 0.0
    utc_ns: int = UTC_2026_NS
    utc_valid: bool = False
    location: int = 0


@dataclass(frozen=True, slots=True)
class XbusSignalSource:
    """Inputs of all items of one run of the Measurement state, apart from time.

    Args:
        abilities: of the product: "orientation", "baro", "gnss", "rtk", "selftest".
        seed: of the sensor errors.
        wrap: ticks at which SampleTimeFine wraps.
        jump: (device time ns, by ticks): the clock's one jump, a fault; None for none.
        vibration: share of the vehicle's shaking that reaches the sensor, 0 to 1.
        serial: device identifier.
        setup: motion, and errors that a calibration finds.
    """

    abilities: frozenset[str]
    seed: int = 0
    wrap: int = 2**32
    jump: tuple[int, int] | None = None
    vibration: float = 0.0
    serial: int = 0
    setup: SensorSetup = AS_BUILT
    state: VehicleState = field(default_factory=VehicleState)

    def ticks(self, device_ns: Array) -> Array:
        """SampleTimeFine at device times."""
        ticks = np.asarray(device_ns) // (10**9 // TICKS_S)
        if self.jump:
            ticks = ticks + np.where(np.asarray(device_ns) >= self.jump[0], self.jump[1], 0)
        return ticks % self.wrap

    def has_fix(self, times: Array) -> Array:
        return (times >= FIRST_FIX_NS) if "gnss" in self.abilities else np.zeros(len(times), bool)

    def rtk(self, times: Array) -> Array:
        """0 none, 1 floating, 2 fixed."""
        if "rtk" not in self.abilities:
            return np.zeros(len(times), np.int64)
        lost = np.remainder(times / 1e9, RTK_PERIOD_S) > RTK_PERIOD_S - RTK_LOST_S
        return (times >= FIRST_RTK_NS) * 1 + ((times >= FIXED_RTK_NS) & ~lost)


class OutputSchedule(Protocol):
    """Properties of a stream needed by `ItemValues`."""

    @property
    def rate(self) -> int:
        """Samples/s."""

    @property
    def items(self) -> tuple[tuple[int, int], ...]:
        """(identifier, Hz)."""

    @property
    def delayed(self) -> bool:
        """Whether the values are a receiver's solution of an earlier time."""

    def errors(self, name: str, grade: trajectory.SensorGrade) -> trajectory.SensorErrors:
        """The errors of one sensor, the same object at every call."""


def encode(values: Array, precision: int) -> Array:
    """(n, k) numbers as (n, bytes) in one of the four precisions; out-of-range values are clamped."""
    form = PRECISIONS[precision]
    if form == "fp1220":
        wire = np.clip(np.rint(values * 2.0**20), -(2.0**31), 2.0**31 - 1).astype(">i4")
    elif form == "fp1632":
        fixed = np.rint(np.clip(values, -32768.0, 32768.0 - 2.0**-32) * 2.0**32).astype(np.int64)
        wire = np.empty(values.shape, [("fraction", ">u4"), ("whole", ">i2")])
        wire["fraction"], wire["whole"] = fixed & 0xFFFFFFFF, fixed >> 32
    else:
        wire = values.astype(form)
    return raw(wire)


def raw(wire: Array) -> Array:
    """The bytes of an array, one row per element of its first axis."""
    wire = np.ascontiguousarray(wire)
    return wire.view(np.uint8).reshape(len(wire), -1)


_ITEMS: dict[str, Callable[..., Array]] = {}
"""Name of an item → the method of `ItemValues` for it; (n, k) numbers for real ones, else the wire's own dtype."""


def _item(*names: str) -> Callable[[Callable[..., Array]], Callable[..., Array]]:
    def register(method: Callable[..., Array]) -> Callable[..., Array]:
        _ITEMS.update(dict.fromkeys(names, method))
        return method

    return register


class ItemValues:
    """The values of all items at some samples of one stream, each computed on first access.

    Args:
        steps: (n,) consecutive sample numbers.
        times: (n,) device time of each, ns.
        counter: (n,) PacketCounter of each.
    """

    def __init__(
        self, run: XbusSignalSource, cadence: OutputSchedule, steps: Array, times: Array, counter: Array
    ) -> None:
        self.run, self.cadence = run, cadence
        self.steps, self.counter = steps, counter
        self.times = times - GNSS_AGE_NS if cadence.delayed else times
        self._bytes: dict[int, Array] = {}

    def bytes_of(self, identifier: int) -> Array:
        """(n, size) uint8."""
        if identifier not in self._bytes:
            source = OUTPUTS[identifier & 0xFFF0]
            method = _ITEMS[source.name]
            value = method(self, LOCALS[identifier & 0xC]) if source.local else method(self)
            self._bytes[identifier] = encode(value, identifier & 3) if source.real else raw(value)
        return self._bytes[identifier]

    @cached_property
    def motion(self) -> trajectory.MotionState:
        return self.run.setup.motion_at(self.times / 1e9)

    def _error(self, name: str, grade: trajectory.SensorGrade) -> Floats:
        if len(self.steps) == 0:
            return np.empty((0, 3))
        return self.cadence.errors(name, grade).at(int(self.steps[0]), len(self.steps))

    def _shaking(self, name: str, grade: trajectory.SensorGrade) -> Floats | float:
        if not self.run.vibration:
            return 0.0
        return self.run.vibration * trajectory.vibration(self.motion)[:, None] * self._error(name, grade)

    @cached_property
    def force(self) -> tuple[Floats, Array]:
        """Measured specific force, clamped to the range, and where it was clamped."""
        felt = self.run.setup.force(self.motion.force) + self._shaking("acc-road", trajectory.SHAKING_FORCE)
        return _clip(felt + self._error("acc", trajectory.ACCELEROMETER), ACCELERATION_RANGE)

    @cached_property
    def turn(self) -> tuple[Floats, Array]:
        felt = self.run.setup.turn(self.motion.rate) + self._shaking("gyr-road", trajectory.SHAKING_TURN)
        return _clip(felt + self._error("gyr", trajectory.GYRO), TURN_RANGE)

    @cached_property
    def field(self) -> tuple[Floats, Array]:
        return _clip(self.run.setup.field(self.motion.field) + self._error("mag", trajectory.MAGNETOMETER), FIELD_RANGE)

    @cached_property
    def attitude(self) -> Floats:
        """The filter's solution: q_enu_from_body, a fraction of a degree off."""
        small = self._error("att", trajectory.ATTITUDE) / 2
        wrong = np.concatenate([np.sqrt(1 - (small**2).sum(axis=1, keepdims=True)), small], axis=1)
        return rotations.product(self.motion.q_enu_from_body_wxyz, wrong)

    @cached_property
    def place(self) -> Floats:
        """Measured latitude °, longitude °, height m; centimetres off with corrections, half a metre without."""
        error = self._error("pos", trajectory.POSITION)
        error = error * np.where(self.run.rtk(self.times) == 2, 0.02, 1.0)[:, None]
        return trajectory.geodetic(self.motion.position + error)

    @cached_property
    def velocity(self) -> Floats:
        return self.motion.velocity + self._error("vel", trajectory.VELOCITY)

    # -- one method per item, of the same name

    @_item("Temperature")
    def temperature(self) -> Floats:
        t = self.times / 1e9
        return (24.0 + 14.0 * (1 - np.exp(-t / 600)) + 0.05 * np.sin(t / 47))[:, None]

    @_item("UtcTime")
    def utc_time(self) -> Array:
        out = np.zeros(len(self.times), _UTC)
        valid = self.run.state.utc_valid | self.run.has_fix(self.times)
        _calendar(self.run.state.utc_ns + self.times, out, "ns")
        out["flags"] = np.where(valid, 7, 0)
        return out

    @_item("PacketCounter")
    def packet_counter(self) -> Array:
        return (self.counter % 65536).astype(">u2")

    @_item("SampleTimeFine")
    def sample_time_fine(self) -> Array:
        return np.where(self.is_timed, self.run.ticks(self.times), self._arbitrary).astype(">u4")

    @_item("SampleTimeCoarse")
    def sample_time_coarse(self) -> Array:
        return np.where(self.is_timed, self.times // 10**9, self._arbitrary // TICKS_S).astype(">u4")

    @property
    def is_timed(self) -> Array:
        """Whether the clocks are valid: those of a receiver without a fix are not (MT0101P 5.3.6)."""
        return self.run.has_fix(self.times) | (not self.cadence.delayed)

    @property
    def _arbitrary(self) -> Array:
        return (np.arange(len(self.times)) + self.counter) * 2_654_435_761 % self.run.wrap

    @_item("Quaternion")
    def quaternion(self, local: str) -> Floats:
        return rotations.product(_TURN_TO[local], self.attitude)

    @_item("RotationMatrix")
    def rotation_matrix(self, local: str) -> Floats:
        turned = rotations.matrix_of(self.quaternion(local))
        return np.swapaxes(turned, 1, 2).reshape(-1, 9)  # column by column

    @_item("EulerAngles")
    def euler_angles(self, local: str) -> Floats:
        return np.degrees(rotations.euler_of(self.quaternion(local)))

    @_item("BaroPressure")
    def baro_pressure(self) -> Array:
        height = self.motion.position[:, 2] + trajectory.PLACE[2] - trajectory.GEOID_M
        noise = self._error("baro", trajectory.SensorGrade(density=0.5, bias=8.0))[:, 0]
        return np.rint(trajectory.pressure(height) + noise).astype(">u4")

    @_item("DeltaV")
    def delta_v(self) -> Floats:
        return self.force[0] / self._item_rate(0x4010)

    @_item("Acceleration", "AccelerationHR")
    def acceleration(self) -> Floats:
        return self.force[0]

    @_item("FreeAcceleration")
    def free_acceleration(self) -> Floats:
        turned = np.einsum("nij,nj->ni", rotations.matrix_of(self.attitude), self.force[0])
        return np.asarray(turned - [0, 0, trajectory.GRAVITY])

    @_item("AltitudeEllipsoid")
    def altitude_ellipsoid(self) -> Floats:
        return self.place[:, 2:]

    @_item("PositionEcef")
    def position_ecef(self) -> Floats:
        return trajectory.ecef(self.place)

    @_item("LatLon")
    def lat_lon(self) -> Floats:
        return self.place[:, :2]

    @_item("RateOfTurn", "RateOfTurnHR")
    def rate_of_turn(self) -> Floats:
        return self.turn[0]

    @_item("DeltaQ")
    def delta_q(self) -> Floats:
        half = self.turn[0] / self._item_rate(0x8030) / 2
        angle = np.linalg.norm(half, axis=1, keepdims=True)
        return np.concatenate([np.cos(angle), half * np.sinc(angle / np.pi)], axis=1)

    @_item("MagneticField")
    def magnetic_field(self) -> Floats:
        return self.field[0]

    @_item("VelocityXYZ")
    def velocity_xyz(self, local: str) -> Floats:
        return np.asarray(self.velocity @ rotations.matrix_of(_TURN_TO[local][None])[0].T)

    @_item("StatusByte")
    def status_byte(self) -> Array:
        return (self.status & 0xFF).astype("u1")

    @_item("StatusWord")
    def status_word(self) -> Array:
        return self.status.astype(">u4")

    @_item("DeviceId")
    def device_id(self) -> Array:
        return np.full(len(self.times), self.run.serial, ">u4")

    @_item("LocationId")
    def location_id(self) -> Array:
        return np.full(len(self.times), self.run.state.location, ">u2")

    @_item("RawAccGyrMagTemp")
    def raw_readings(self) -> Array:
        """Converter readings: 16 bits cover each sensor's range."""
        out = np.empty(len(self.times), _RAW)
        limits = (
            ("acc", self.force, ACCELERATION_RANGE),
            ("gyr", self.turn, TURN_RANGE),
            ("mag", self.field, FIELD_RANGE),
        )
        for name, (values, _), limit in limits:
            out[name] = np.clip(np.rint(32768 + values / limit * 32767), 0, 65535)
        out["temp"] = np.rint(self.temperature()[:, 0] * 256)
        return out

    @_item("RawGyroTemp")
    def raw_gyro_temperatures(self) -> Array:
        three = self.temperature() + np.array([0.0, 0.5, -0.5])
        return np.asarray(np.rint(three * 256), ">i2")

    @_item("GnssPvtPulse")
    def gnss_pvt_pulse(self) -> Array:
        return self.run.ticks(self.times).astype(">u4")

    @_item("GnssPvtData")
    def gnss_pvt_data(self) -> Array:
        out = np.zeros(len(self.times), _PVT)
        fix, rtk = self.run.has_fix(self.times), self.run.rtk(self.times)
        utc = self.run.state.utc_ns + self.times
        out["itow"] = (utc // 10**6 - 315_964_800_000 + 18_000) % 604_800_000  # GPS time is 18 s ahead since 2017
        _calendar(np.where(fix, utc, 315_532_800 * 10**9), out, "nano")
        out["valid"], out["tAcc"] = np.where(fix, 7, 0), np.where(fix, 25, 0xFFFFFFFF)
        out["fixtype"] = np.where(fix, 3, 0)
        out["flags"] = np.where(fix, 1 | (rtk > 0) * 2 | rtk << 6, 0)
        out["numSV"] = np.where(fix, sum(cno > 30 for _, _, cno in _SKY), 0)
        lat, lon, height = np.where(fix[:, None], self.place, 0.0).T
        out["lat"], out["lon"] = np.rint(lat * 1e7), np.rint(lon * 1e7)
        out["height"], out["hMSL"] = np.rint(height * 1e3), np.rint((height - trajectory.GEOID_M * fix) * 1e3)
        good = np.where(rtk == 2, 14, np.where(rtk == 1, 180, 900))
        out["hAcc"], out["vAcc"] = np.where(fix, good, 0xFFFFFFFF), np.where(fix, good * 3 // 2, 0xFFFFFFFF)
        east, north, up = np.where(fix[:, None], self.velocity, 0.0).T * 1e3
        out["velN"], out["velE"], out["velD"] = np.rint(north), np.rint(east), np.rint(-up)
        out["gSpeed"] = np.rint(np.hypot(north, east))
        out["headMot"] = np.rint(np.degrees(np.arctan2(east, north)) % 360 * 1e5) * fix
        out["sAcc"], out["headAcc"] = np.where(fix, 60, 99_999), np.where(fix, 80_000, 18_000_000)
        for name, dop in zip("gptvhne", (180, 150, 90, 125, 85, 60, 58), strict=True):
            out[name + "dop"] = np.where(fix, dop, 9999)
        return out

    @_item("GnssSatInfo")
    def gnss_sat_info(self) -> Array:
        utc = self.run.state.utc_ns + self.times
        out = np.zeros((len(self.times), 8 + 4 * len(_SKY)), np.uint8)
        itow = ((utc // 10**6 - 315_964_800_000 + 18_000) % 604_800_000).astype(">u4")
        out[:, :4], out[:, 4] = raw(itow), len(_SKY)
        for i, (system, number, cno) in enumerate(_SKY):
            strength = cno + np.rint(2 * np.sin(self.times / 1e9 / (11 + i)))
            used = (strength > 30) & self.run.has_fix(self.times)
            out[:, 8 + 4 * i : 10 + 4 * i] = (system, number)
            out[:, 10 + 4 * i] = strength
            out[:, 11 + 4 * i] = np.where(used, 0x5F, np.where(strength > 30, 0x17, 0x14))
        return out

    def _item_rate(self, plain: int) -> int:
        """Rate of an item in any precision: the interval that a delta is summed over."""
        return max(rate for identifier, rate in self.cadence.items if identifier & 0xFFF0 == plain)

    @cached_property
    def status(self) -> Array:
        """StatusWord, (n,) int64."""
        state, t = self.run.state, self.times
        clipped = np.concatenate([self.force[1], self.turn[1], self.field[1]], axis=1)
        word = (clipped * (1 << np.arange(8, 17))).sum(axis=1)
        any_clipped = clipped.any(axis=1)
        word |= any_clipped.astype(np.int64) << 19
        word |= 1 if "selftest" in self.run.abilities else 0
        if "orientation" in self.run.abilities:
            word |= (~any_clipped).astype(np.int64) << 1
        fix = self.run.has_fix(t).astype(np.int64)
        word |= fix << 2 | fix << 6 | fix * 3 << 23 | fix << 26 | self.run.rtk(t) << 27
        if state.no_rotation:
            begin, end, noticed = state.no_rotation
            running = (t >= begin) & (t < min(end, noticed))
            word |= np.where(running, 3, np.where((t >= noticed) & (noticed < end), 2, 0)) << 3
        word |= int(state.representative_motion) << 5
        if state.sync_in_s:
            phase = np.remainder(t, round(state.sync_in_s * 1e9))
            word |= (phase < 10**9 // self.cadence.rate).astype(np.int64) << 21
        if state.sync_out_every:
            word |= (self.steps % state.sync_out_every == 0).astype(np.int64) << 22
        return np.asarray(word)


def _clip(values: Floats, limit: float) -> tuple[Floats, Array]:
    return np.clip(values, -limit, limit), np.abs(values) >= limit


def _calendar(utc_ns: Array, out: Array, fraction: str) -> None:
    """Fill year … sec and `fraction` (ns) of a structured array from UTC, ns since the Unix epoch."""
    seconds = utc_ns // 10**9
    day = seconds // 86400
    date = day.astype("datetime64[D]")
    month = date.astype("datetime64[M]")
    out["year"] = date.astype("datetime64[Y]").astype(np.int64) + 1970
    out["month"] = month.astype(np.int64) % 12 + 1
    out["day"] = (date - month.astype("datetime64[D]")).astype(np.int64) + 1
    clock = seconds - day * 86400
    out["hour"], out["min"], out["sec"] = clock // 3600, clock // 60 % 60, clock % 60
    out[fraction] = utc_ns - seconds * 10**9
