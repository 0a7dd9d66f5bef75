"""A simulated IDTP sensor.

    power ──> Imu10 and ImuQuat, every 10 ms, sequence 0, 1, 2, …

`IdtpSimulator` is pure: it has no clock, link or thread. The caller passes the current time and gets the bytes sent by
then. IDTP has no requests, so received bytes change nothing.

It measures the shared drive (protocols/simulator/trajectory.py), with the errors of a good MEMS unit. All frames of a
quarter of a second are made at once; they depend on seed and time only, not on how time is cut. The quaternion turns
the body to ENU.

Source: IDTP v2.1.0.
"""

import math
import zlib
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from imuscope.protocols import rotations
from imuscope.protocols.arrays import Array
from imuscope.protocols.idtp.frames import MODES, SAFETY, SECURE, build
from imuscope.protocols.idtp.messages import ACCELERATION, BY_NAME, FIELD, PRESSURE, QUATERNION, RATE
from imuscope.protocols.schema.fields import Message
from imuscope.protocols.simulator import trajectory

Output = tuple[str, int]
"""A payload type by name, and its rate per second."""

BLOCK_NS = 250_000_000
EARTH_UT = 48.0  # strength of the Earth's field at trajectory.PLACE, µT
PRESSURE_NOISE_PA = 1.2
MAX_RATE_HZ = 2000


class IdtpSimulator:
    """A simulated IDTP sensor.

    Args:
        device_id: 0 to 65535.
        seed: repeats noise exactly.
        start_ns: power-on time, on the clock of `advance`.
        rate: samples/s of each of the default outputs, Imu10 and ImuQuat.
        outputs: other ones.
        mode: LITE, SAFETY or SECURE.
        key: for Secure mode.
        clock_drift_ppm: how much faster the device's oscillator runs than the clock of `advance`.
        clock_jump: (device time s, by s): the timestamp jumps once.
        tick_ns: unit of its timestamp.

    Raises:
        ValueError: invalid output, or no key.
    """

    def __init__(
        self,
        device_id: int = 102,
        seed: int = 0,
        start_ns: int = 0,
        *,
        rate: float = 100,
        outputs: Sequence[Output] | None = None,
        mode: int = SAFETY,
        key: bytes | None = None,
        clock_drift_ppm: float = 0.0,
        clock_jump: tuple[float, float] | None = None,
        tick_ns: int = 1_000,
    ) -> None:
        if mode == SECURE and not key:
            raise ValueError("a Secure device needs a key")
        if mode not in range(len(MODES)):
            raise ValueError(f"mode is 0 to {SECURE}, given {mode!r}")
        whole = max(int(rate), 1)
        chosen = outputs or (("Imu10", whole), ("ImuQuat", whole))
        self._streams = [_SimulatedStream(name, hertz, seed) for name, hertz in chosen]
        self.device_id = device_id
        self.baud = 115_200  # the protocol has no line settings; the link's own rate is used
        self._start_ns = start_ns
        self._speed = 1 + clock_drift_ppm * 1e-6
        self._mode, self._key = mode, key
        self._jump = clock_jump and (round(clock_jump[0] * 1e9), round(clock_jump[1] * 1e9))
        self._tick_ns = tick_ns
        self._sequence = 0
        self._block = 0
        self._waiting: list[tuple[int, int, bytes]] = []  # (time, type, payload) of this block not sent yet, last first

    def advance(self, now_ns: int) -> bytes:
        """Bytes sent by the device up to `now_ns`, since the last call."""
        now = int((now_ns - self._start_ns) * self._speed)
        out: list[bytes] = []
        while True:
            while self._waiting and self._waiting[-1][0] <= now:
                self._send(*self._waiting.pop(), out)
            if self._waiting or self._block * BLOCK_NS > now:
                return b"".join(out)
            parts = [part for stream in self._streams for part in stream.block(self._block)]
            self._waiting = sorted(parts, key=lambda part: part[0])[::-1]
            self._block += 1

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Ignores bytes from the host; returns the bytes that the device has sent by then."""
        return self.advance(now_ns)

    @property
    def next_ns(self) -> int:
        """Time of its next message, on the clock of `advance`; 0 if unknown."""
        if not self._waiting:
            return 0
        return self._start_ns + math.ceil(self._waiting[-1][0] / self._speed)

    def _send(self, time_ns: int, kind: int, payload: bytes, out: list[bytes]) -> None:
        number, self._sequence = self._sequence, (self._sequence + 1) & 0xFFFFFFFF
        if self._jump and time_ns >= self._jump[0]:
            time_ns += self._jump[1]
        stamp = time_ns // self._tick_ns
        frame = build(
            kind,
            payload,
            timestamp=stamp & 0xFFFFFFFF,
            sequence=number,
            device=self.device_id,
            mode=self._mode,
            key=self._key,
        )
        out.append(frame)


class _SimulatedStream:
    """One payload type at one rate."""

    def __init__(self, name: str, rate: int, seed: int) -> None:
        if name not in BY_NAME:
            raise ValueError(f"an output is one of {', '.join(BY_NAME)}, given {name!r}")
        if not 1 <= rate <= MAX_RATE_HZ:
            raise ValueError(f"the rate of {name} is 1 to {MAX_RATE_HZ} Hz, given {rate}")
        self._row: Message = BY_NAME[name]
        self._rate = rate
        self._seed = seed
        self._errors: dict[str, trajectory.SensorErrors] = {}

    def block(self, number: int) -> list[tuple[int, int, bytes]]:
        """(time ns, type, payload) of all samples of a quarter of a second."""
        per_ns = self._rate / 1e9
        steps = np.arange(math.ceil(number * BLOCK_NS * per_ns), math.ceil((number + 1) * BLOCK_NS * per_ns))
        if not len(steps):
            return []
        times = steps * 10**9 // self._rate
        truth = trajectory.vehicle_motion(times / 1e9)
        columns = [_MEASURE[field.name](self, truth, int(steps[0])) for field in self._row.fields]
        rows = np.concatenate([column.reshape(len(steps), -1) for column in columns], axis=1).astype("<f4")
        flat, width = rows.tobytes(), 4 * rows.shape[1]
        return [(time, self._row.id, flat[i * width : (i + 1) * width]) for i, time in enumerate(times.tolist())]

    def noise(self, name: str, grade: trajectory.SensorGrade, first: int, count: int) -> Array:
        """Errors of a triad, (count, 3); for the same name and rate equal in every payload type."""
        if name not in self._errors:
            self._errors[name] = trajectory.SensorErrors(grade, self._seed ^ zlib.crc32(name.encode()), self._rate)
        return self._errors[name].at(first, count)


def _force(stream: _SimulatedStream, truth: trajectory.MotionState, first: int) -> Array:
    n = len(truth.t)
    shaken = stream.noise("road", trajectory.SHAKING_FORCE, first, n) * trajectory.vibration(truth)[:, None]
    return truth.force + shaken + stream.noise("acc", trajectory.ACCELEROMETER, first, n)


def _turn(stream: _SimulatedStream, truth: trajectory.MotionState, first: int) -> Array:
    n = len(truth.t)
    shaken = stream.noise("sway", trajectory.SHAKING_TURN, first, n) * trajectory.vibration(truth)[:, None]
    return truth.rate + shaken + stream.noise("gyr", trajectory.GYRO, first, n)


def _field(stream: _SimulatedStream, truth: trajectory.MotionState, first: int) -> Array:
    return EARTH_UT * (truth.field + stream.noise("mag", trajectory.MAGNETOMETER, first, len(truth.t)))


def _pressure(stream: _SimulatedStream, truth: trajectory.MotionState, first: int) -> Array:
    above_sea = trajectory.PLACE[2] - trajectory.GEOID_M + truth.position[:, 2]
    grade = trajectory.SensorGrade(PRESSURE_NOISE_PA / math.sqrt(50), 0.0)
    return trajectory.pressure(above_sea) + stream.noise("baro", grade, first, len(truth.t))[:, 0]


def _attitude(stream: _SimulatedStream, truth: trajectory.MotionState, first: int) -> Array:
    angles = stream.noise("q", trajectory.ATTITUDE, first, len(truth.t))
    return rotations.product(truth.q_enu_from_body_wxyz, rotations.of_euler(angles))


_MEASURE: Mapping[str, Callable[[_SimulatedStream, trajectory.MotionState, int], Array]] = {
    ACCELERATION.name: _force,
    RATE.name: _turn,
    FIELD.name: _field,
    PRESSURE.name: _pressure,
    QUATERNION.name: _attitude,
}
