"""String outputs of the simulated MTi, one function per string type.

    SetStringOutputType ──> the lines of each tick, in the order of their bits:   $HEHDT,123.45,T*1B␍␊

Two of them are not NMEA: TSS2, a line of fixed columns, and EM1000, ten bytes (binary_strings.py has their layout). A
device without GNSS omits the strings of a GNSS device. Heading is clockwise from north, pitch positive bow up, roll
positive port up. There is no magnetic variation at the place of the drive.

The rate: with the strings in the 600-series, 115200 / (period · (skip factor + 1)) before.

Source: MT0101P 2020.A, 5.3.5 SetStringOutputType, SetPeriod and SetOutputSkipFactor; the letters of PHTRO, garbled in
the document, from other makers.
"""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from imuscope.protocols import rotations
from imuscope.protocols.arrays import Array, Floats
from imuscope.protocols.embedded.nmea import checksum
from imuscope.protocols.simulator import trajectory
from imuscope.protocols.xbus.binary_strings import EM1000, EM1000_HEAD
from imuscope.protocols.xbus.enums import STRING_TYPES
from imuscope.protocols.xbus.simulator.measurement import BLOCK_NS
from imuscope.protocols.xbus.simulator.signals import ItemValues, XbusSignalSource

_KNOTS = 1 / 0.514444
_COURSE_FROM = 0.2  # m/s: below it no true course is sent
_RECEIVER = ("GPGGA", "GPZDA", "GPRMC", "XSVEL")


class Moment:
    """Inputs for the lines of one block of ticks, one row per tick."""

    def __init__(self, values: ItemValues, run: XbusSignalSource) -> None:
        self.roll, down, yaw = np.degrees(rotations.euler_of(values.quaternion("ENU"))).T
        self.pitch = -down
        self.heading: Floats = np.round((90 - yaw) % 360, 2) % 360
        self.force, self.turn, self.field = values.force[0], values.turn[0], values.field[0]
        self.quaternion = values.quaternion("ENU")
        self.temperature = values.temperature()[:, 0]
        self.place, self.velocity = values.place, values.velocity
        self.fix = run.has_fix(values.times)
        self.utc = (run.state.utc_ns + values.times).astype("datetime64[ns]")


def _nmea(content: str) -> bytes:
    return f"${content}*{checksum(content.encode('ascii')):02X}\r\n".encode("ascii")


def _clock(at: Moment, k: int) -> str:
    """UTC time of day, hhmmss.ss."""
    text = str(at.utc[k])[11:22]
    return text.replace(":", "")


def _angle(value: float, width: int, letters: str) -> str:
    """Degrees and minutes, and the half of the globe: 4530.1234,N."""
    degrees, minutes = divmod(abs(value) * 60, 60)
    minutes = min(minutes, 59.9999)
    return f"{int(degrees):0{width}d}{minutes:07.4f},{letters[int(value < 0)]}"


def _place(at: Moment, k: int) -> str:
    return f"{_angle(at.place[k, 0], 2, 'NS')},{_angle(at.place[k, 1], 3, 'EW')}" if at.fix[k] else ",,,"


def _signed(value: float, form: str) -> str:
    """A minus sign or a space, then the number without its sign."""
    return f"{'-' if value < 0 else ' '}{abs(value):{form}}"


def _tss2(at: Moment, k: int) -> bytes:
    roll, pitch = (_signed(round(value * 100), "04.0f") for value in (at.roll[k], at.pitch[k]))
    return f":{round(at.heading[k] * 100) % 36000:05d}  0000H{roll} {pitch}F\r\n".encode("ascii")


def _em1000(at: Moment, k: int) -> bytes:
    roll, pitch = round(at.roll[k] * 100), round(at.pitch[k] * 100)
    return EM1000_HEAD + EM1000.pack(roll, pitch, 0, round(at.heading[k] * 100) % 36000)[2:]


def _phtro(at: Moment, k: int) -> bytes:
    pitch, roll = at.pitch[k], at.roll[k]
    return _nmea(f"PHTRO,{abs(pitch):.2f},{'PM'[int(pitch > 0)]},{abs(roll):.2f},{'BT'[int(roll > 0)]}")


def _psoncms(at: Moment, k: int) -> bytes:
    numbers = [*at.quaternion[k], *at.force[k], *at.turn[k], *at.field[k]]
    return _nmea(f"PSONCMS,{','.join(f'{number:.4f}' for number in numbers)},{at.temperature[k]:.1f}")


def _gga(at: Moment, k: int) -> bytes:
    height = at.place[k, 2] - trajectory.GEOID_M
    levels = f"{height:.1f},M,{trajectory.GEOID_M:.1f},M" if at.fix[k] else ",M,,M"
    quality = "1,12,0.9" if at.fix[k] else "0,00,99.9"
    return _nmea(f"GPGGA,{_clock(at, k)},{_place(at, k)},{quality},{levels},,")


def _zda(at: Moment, k: int) -> bytes:
    year, month, day = str(at.utc[k])[:10].split("-")
    return _nmea(f"GPZDA,{_clock(at, k)},{day},{month},{year},00,00")


def _rmc(at: Moment, k: int) -> bytes:
    east, north = at.velocity[k, :2]
    speed = float(np.hypot(east, north))
    course = f"{np.degrees(np.arctan2(east, north)) % 360:.1f}" if speed >= _COURSE_FROM and at.fix[k] else ""
    year, month, day = str(at.utc[k])[:10].split("-")
    moving = f"{speed * _KNOTS:.1f}" if at.fix[k] else ""
    state = "A" if at.fix[k] else "V"
    return _nmea(f"GPRMC,{_clock(at, k)},{state},{_place(at, k)},{moving},{course},{day}{month}{year[2:]},0.0,E")


def _ptcf(at: Moment, k: int) -> bytes:
    rates = ",".join(_signed(rate, ".2f") for rate in np.degrees([at.turn[k, 0], -at.turn[k, 1]]))
    return _nmea(f"PTCF,{at.heading[k]:.1f},T,{_signed(at.roll[k], '.1f')},{_signed(at.pitch[k], '.1f')},{rates}")


LINES: Mapping[str, Callable[[Moment, int], bytes]] = {
    "HCHDM": lambda at, k: _nmea(f"HCHDM,{at.heading[k]:.2f},M"),
    "HCHDG": lambda at, k: _nmea(f"HCHDG,{at.heading[k]:.2f},0.0,E,0.0,E"),
    "TSS2": _tss2,
    "PHTRO": _phtro,
    "PRDID": lambda at, k: _nmea(f"PRDID,{at.pitch[k]:.2f},{at.roll[k]:.2f},{at.heading[k]:.2f}"),
    "EM1000": _em1000,
    "PSONCMS": _psoncms,
    "HCMTW": lambda at, k: _nmea(f"HCMTW,{at.temperature[k]:.1f},C"),
    "HEHDT": lambda at, k: _nmea(f"HEHDT,{at.heading[k]:.2f},T"),
    "HEROT": lambda at, k: _nmea(f"HEROT,{-60 * np.degrees(at.turn[k, 2]):.1f},A"),
    "GPGGA": _gga,
    "PTCF": _ptcf,
    "XSVEL": lambda at, k: _nmea("XSVEL," + ",".join(_signed(one, ".4f") for one in at.velocity[k])),
    "GPZDA": _zda,
    "GPRMC": _rmc,
}


@dataclass(frozen=True)
class Sentences:
    """One uninterrupted run of the measurement state with strings, instead of a Measurement.

    Args:
        types: the word of SetStringOutputType.
        hertz: ticks/s.
        begin_ns: device time of the first.
        run: inputs of the values.
    """

    types: int
    hertz: float
    begin_ns: int
    run: XbusSignalSource
    items: tuple[tuple[int, int], ...] = ()
    delayed: bool = False
    _errors: dict[str, trajectory.SensorErrors] = field(default_factory=dict, compare=False)

    @property
    def rate(self) -> int:
        """Rate of the sensor errors: whole samples a second."""
        return max(1, round(self.hertz))

    @cached_property
    def chosen(self) -> tuple[str, ...]:
        """The requested strings that this device has."""
        names = (bits.name for bits in STRING_TYPES if bits.of(self.types) and bits.name in LINES)
        return tuple(name for name in names if name not in _RECEIVER or "gnss" in self.run.abilities)

    def errors(self, name: str, grade: trajectory.SensorGrade) -> trajectory.SensorErrors:
        if name not in self._errors:
            self._errors[name] = trajectory.SensorErrors(grade, self.run.seed ^ zlib.crc32(name.encode()), self.rate)
        return self._errors[name]

    def block(self, number: int, counter: int) -> list[tuple[int, bytes]]:
        """The lines of a quarter of a second, as (device time ns, the bytes of one tick), in order."""
        if not self.hertz or not self.chosen:
            return []
        period = 1e9 / self.hertz
        first, end = (int(np.ceil(quarter * BLOCK_NS / period)) for quarter in (number, number + 1))
        steps = np.arange(first, end)
        if not len(steps):
            return []
        times: Array = self.begin_ns + np.rint(steps * period).astype(np.int64)
        at = Moment(ItemValues(self.run, self, steps, times, steps), self.run)
        return [(int(time), b"".join(LINES[name](at, k) for name in self.chosen)) for k, time in enumerate(times)]
