"""Fields of MIP packets, as rows: data, replies and commands.

A row that begins with a function (write, read, save, load, default) is one for each function, because their arguments
differ; the function is its `prefix`.

Source: numbers, layouts and units are those of the vendor's public MIP SDK; ../README.md names its files.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from imuscope.plugin import Bits, Field, size_of

BASE, COMMAND_3DM, COMMAND_FILTER = 0x01, 0x0C, 0x0D
IMU_DATA, FILTER_DATA = 0x80, 0x82
COMMANDS = (BASE, COMMAND_3DM, COMMAND_FILTER)
DATA = {IMU_DATA: "ImuData", FILTER_DATA: "FilterData"}
ACK = 0xF1
WRITE, READ, SAVE, LOAD, DEFAULT = 1, 2, 3, 4, 5
FUNCTIONS = {WRITE: "Write", READ: "Read", SAVE: "Save", LOAD: "Load", DEFAULT: "Default"}
ERRORS = {0: "OK", 1: "unknown command", 2: "bad checksum", 3: "invalid parameter", 4: "failed", 5: "timed out"}
XYZ = ("x", "y", "z")
G = 9.80665


@dataclass(frozen=True, slots=True)
class Row:
    """A field of a packet.

    Args:
        set, descriptor: its numbers.
        fields: of its data, behind `prefix`.
        time: whether it is the clock of its packet.
    """

    set: int
    descriptor: int
    name: str
    fields: tuple[Field, ...] = ()
    prefix: bytes = b""
    time: bool = False

    @property
    def size(self) -> int:
        """Bytes of its data."""
        return len(self.prefix) + sum(size_of(field) for field in self.fields)


def _vector(name: str, unit: str, title: str, *, scale: float = 1.0, decimals: int = 3) -> tuple[Field, ...]:
    return (Field(name, ">f4", (3,), unit, scale, axes=XYZ, decimals=decimals, title=title),)


def _valid(name: str) -> Field:
    return Field(name, ">u2", bits=(Bits("Valid", 0, normal_set=True),), title="Validity")


def _gps_time(number: int, descriptor: int) -> Row:
    fields = (Field("tow", ">f8", unit="s", decimals=4), Field("week", ">u2"), Field("time_flags", ">u2"))
    return Row(number, descriptor, "GpsTimestamp" if number == IMU_DATA else "FilterTimestamp", fields, time=True)


def _text(name: str) -> Field:
    return Field(name, "ascii", (16,), pad=0x20)


ANGLE = {"unit": "rad", "low": -math.pi, "high": math.pi, "decimals": 4, "default": 0.0}
ROTATION = (
    Field("roll", ">f4", **ANGLE, doc="About the x axis."),  # type: ignore[arg-type]
    Field("pitch", ">f4", unit="rad", low=-math.pi / 2, high=math.pi / 2, decimals=4, default=0.0),
    Field("yaw", ">f4", **ANGLE, doc="About the z axis."),  # type: ignore[arg-type]
)
ROTATION_NAME = "SensorToVehicleRotation"
ROTATION_COMMAND, ROTATION_REPLY = 0x11, 0x81

ROWS: tuple[Row, ...] = (
    Row(IMU_DATA, 0x04, "ScaledAccelerometer", _vector("Acceleration", "m/s²", "", scale=G)),
    Row(IMU_DATA, 0x05, "ScaledGyro", _vector("RateOfTurn", "rad/s", "Rate of turn", decimals=4)),
    Row(IMU_DATA, 0x06, "ScaledMagnetometer", _vector("MagneticField", "G", "Magnetic field", decimals=4)),
    _gps_time(IMU_DATA, 0x12),
    Row(
        FILTER_DATA,
        0x01,
        "LlhPosition",
        (
            Field("LatLon", ">f8", (2,), "°", axes=("lat", "lon"), decimals=7, title="Position", frame="WGS84"),
            Field("Height", ">f8", unit="m", decimals=2, doc="Above the ellipsoid."),
            _valid("position_valid"),
        ),
    ),
    Row(
        FILTER_DATA,
        0x03,
        "OrientationQuaternion",
        (
            Field("Quaternion", ">f4", (4,), axes=("w", "x", "y", "z"), decimals=4, frame="NED from body"),
            _valid("quaternion_valid"),
        ),
    ),
    Row(
        FILTER_DATA,
        0x05,
        "OrientationEuler",
        (
            Field(
                "EulerAngles",
                ">f4",
                (3,),
                "°",
                math.degrees(1),
                axes=("roll", "pitch", "yaw"),
                decimals=2,
                title="Euler angles",
                frame="NED from body",
            ),
            _valid("euler_valid"),
        ),
    ),
    _gps_time(FILTER_DATA, 0x11),
    *(
        Row(number, ACK, "Ack", (Field("command", "u1", base=16), Field("error", "u1", choices=ERRORS)))
        for number in COMMANDS
    ),
    Row(
        BASE,
        0x81,
        "DeviceInformation",
        (
            Field("firmware", ">u2"),
            *(_text(name) for name in ("model_name", "model_number", "serial_number", "lot", "options")),
        ),
    ),
    Row(COMMAND_FILTER, ROTATION_REPLY, ROTATION_NAME, ROTATION),
    Row(BASE, 0x01, "Ping"),
    Row(BASE, 0x02, "SetToIdle"),
    Row(BASE, 0x03, "GetDeviceInformation"),
    Row(BASE, 0x06, "Resume"),
    Row(COMMAND_FILTER, ROTATION_COMMAND, f"Write{ROTATION_NAME}", ROTATION, bytes((WRITE,))),
    *(
        Row(COMMAND_FILTER, ROTATION_COMMAND, f"{words}{ROTATION_NAME}", (), bytes((function,)))
        for function, words in FUNCTIONS.items()
        if function != WRITE
    ),
)
BY_NAME: Mapping[str, Row] = {row.name: row for row in ROWS if row.descriptor != ACK}
BY_NUMBER: Mapping[tuple[int, int], list[Row]] = {
    key: [row for row in ROWS if (row.set, row.descriptor) == key]
    for key in {(row.set, row.descriptor) for row in ROWS}
}


@lru_cache(maxsize=4096)
def row_of(number: int, descriptor: int, size: int, function: int) -> Row:
    """The row of a field by its numbers, its size and the first byte of its data; one of bytes where none fits."""
    for row in BY_NUMBER.get((number, descriptor), ()):
        if row.size == size and (not row.prefix or row.prefix[0] == function):
            return row
    return row_of_bytes(number, descriptor, size)


def row_of_bytes(number: int, descriptor: int, size: int, place: int = 1) -> Row:
    """An unknown field, the `place`-th of its descriptor in a packet."""
    name = f"data_{descriptor:02x}" + (f"_{place}" if place > 1 else "")
    fields = (Field(name, "bytes", (size,)),) if size else ()
    return Row(number, descriptor, f"0x{number:02X}{descriptor:02X}", fields)
