"""Every payload type of IDTP, as rows.

    0x00 … 0x06   standard: float32 readings, little-endian, packed
    0x07 … 0x7F   reserved
    0x80 … 0xFF   the vendor's own

A type without a row is shown as bytes, unless the user has described it (custom_payloads.py). In version 2.0 every type
was the vendor's own, whatever its number.

The document names single readings (acc_x, acc_y, acc_z); readers want the vector. So a row has one field for each
quantity, and WIRE holds the document's names for lists, scripts and composing. The rows describe the wire; the decoder
adds STATUS to them, its findings on each frame, as flags.

Source: IDTP v2.1.0, sections 4.5.1 to 4.5.3; Imu6, Imu9 and Imu10 have the units of the three-axis types (erratum 10).
"""

from collections.abc import Mapping
from dataclasses import replace

from imuscope.protocols.schema.fields import Bits, Field, Message

STANDARD_END = 0x07  # the first number without a meaning
SECTION = "IDTP v2.1.0, section 4.5.1"
XYZ = ("x", "y", "z")


def _reading(
    name: str, unit: str, axes: tuple[str, ...], decimals: int, doc: str, title: str = "", frame: str = ""
) -> Field:
    shape = (len(axes),) if axes else ()
    kind = Field(name, "<f4", shape, title=title, frame=frame, doc=doc, source=SECTION)
    return replace(kind, unit=unit, axes=axes, decimals=decimals)


ACCELERATION = _reading("Acceleration", "m/s²", XYZ, 3, "Specific force along the sensor's right-handed axes.")
RATE = _reading("RateOfTurn", "rad/s", XYZ, 4, "Rate of turn about the sensor's axes.", title="Rate of turn")
FIELD = _reading(
    "MagneticField", "µT", XYZ, 2, "Magnetic flux density along the sensor's axes.", title="Magnetic field"
)
PRESSURE = _reading("BaroPressure", "Pa", (), 1, "Pressure measured by the barometer.", title="Pressure")
QUATERNION = _reading(
    "Quaternion", "", ("w", "x", "y", "z"), 4, "Orientation as a unit quaternion, scalar first.", frame="ENU from body"
)

WIRE: Mapping[str, tuple[str, ...]] = {
    ACCELERATION.name: ("acc_x", "acc_y", "acc_z"),
    RATE.name: ("gyr_x", "gyr_y", "gyr_z"),
    FIELD.name: ("mag_x", "mag_y", "mag_z"),
    PRESSURE.name: ("baro",),
    QUATERNION.name: ("w", "x", "y", "z"),
}
"""Field → the document's names of its elements."""


def _row(number: int, name: str, fields: tuple[Field, ...], doc: str) -> Message:
    return Message(number, name, fields, channel_per_field=True, doc=doc, source=SECTION)


MESSAGES: tuple[Message, ...] = (
    _row(0x00, "Imu3Acc", (ACCELERATION,), "An accelerometer."),
    _row(0x01, "Imu3Gyr", (RATE,), "A gyroscope."),
    _row(0x02, "Imu3Mag", (FIELD,), "A magnetometer."),
    _row(0x03, "Imu6", (ACCELERATION, RATE), "Accelerometer and gyroscope."),
    _row(0x04, "Imu9", (ACCELERATION, RATE, FIELD), "Accelerometer, gyroscope and magnetometer."),
    _row(0x05, "Imu10", (ACCELERATION, RATE, FIELD, PRESSURE), "Accelerometer, gyroscope, magnetometer and barometer."),
    _row(0x06, "ImuQuat", (QUATERNION,), "Orientation."),
)
BY_ID: Mapping[int, Message] = {row.id: row for row in MESSAGES}
BY_NAME: Mapping[str, Message] = {row.name: row for row in MESSAGES}

MODE_NAMES: Mapping[int, str] = {0: "Lite", 1: "Safety", 2: "Secure"}
MODE_BITS, UNVERIFIED, NOT_FINITE, NOT_UNIT, TOO_LONG = 0, 2, 3, 4, 5

STATUS = Field(
    "Status",
    "u1",
    title="Frame status",
    bits=(
        Bits("Mode", MODE_BITS, 2, MODE_NAMES, doc="Protection of the frame: CRC-8, CRC-32 or HMAC."),
        Bits(
            "Unverified", UNVERIFIED, severity="warning", doc="The frame is Secure, and there is no key to verify it."
        ),
        Bits("NotFinite", NOT_FINITE, severity="warning", doc="A value is infinite or not a number."),
        Bits(
            "NotUnit",
            NOT_UNIT,
            severity="warning",
            doc="The quaternion's norm is not 1; the quaternion is shown as a gap.",
        ),
        Bits("TooLong", TOO_LONG, severity="warning", doc="The payload is longer than its type defines."),
    ),
    doc="Status of each frame.",
)


def status_of(name: str) -> Field:
    """STATUS of one message, under a unique name, because channels are keyed by name."""
    return replace(STATUS, name=status_name(name), title=f"{name} frame")


def status_name(name: str) -> str:
    return f"{name}Status"


def opaque(number: int, size: int, name: str = "") -> Message:
    """A payload of unknown layout: its bytes."""
    data = Field("data", "bytes", (size,), title="Payload", doc="Payload as received.")
    return Message(number, name or f"0x{number:02X}", (data,) if size else (), doc="Payload without a definition.")


def rest(name: str, size: int) -> Field:
    """Trailing bytes of a payload of that name, after the fields of its type."""
    return Field(
        f"{name}Rest", "bytes", (size,), title=f"{name} rest", doc="Bytes of the payload after the fields of its type."
    )
