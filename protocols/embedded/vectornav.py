"""ASCII messages of VectorNav sensors (VN-100, -200, -300), which are framed as NMEA 0183 sentences are.

    $VNYMR,Yaw,Pitch,Roll,MagX,MagY,MagZ,AccelX,AccelY,AccelZ,GyroX,GyroY,GyroZ*hh

Angles describe the body in the frame of north, east and down; the scalar of a quaternion is its last number. A message
with a 16-bit checksum is not one of NMEA, and counts as damaged.

Source: VectorNav, VN-100 user manual UM001 2.05, and VN-300 user manual UM005 0.14, sections on the registers of
measurements. The spelling of names is theirs.
"""

from __future__ import annotations

from imuscope.protocols.schema.fields import Field, Message

SOURCE = "VectorNav VN-100 user manual UM001 2.05, VN-300 user manual UM005 0.14"


def _real(name: str, unit: str = "", doc: str = "") -> Field:
    return Field(name, "f8", unit=unit, doc=doc)


def _whole(name: str, doc: str = "") -> Field:
    return Field(name, "i8", doc=doc)


def _xyz(name: str, unit: str) -> tuple[Field, ...]:
    return tuple(_real(name + axis, unit) for axis in "XYZ")


_ANGLES = (_real("Yaw", "°"), _real("Pitch", "°"), _real("Roll", "°"))
_QUATERNION = tuple(_real(f"Quat{place}") for place in range(4))
_MAG, _ACCEL, _GYRO = _xyz("Mag", "G"), _xyz("Accel", "m/s²"), _xyz("Gyro", "rad/s")
_SENSORS = (*_MAG, *_ACCEL, *_GYRO)
_PLACE = (_real("Latitude", "°"), _real("Longitude", "°"), _real("Altitude", "m", "Height above the ellipsoid."))
_SPEED = (_real("VelN", "m/s"), _real("VelE", "m/s"), _real("VelD", "m/s"))
_ECEF = (*_xyz("Position", "m"), *_xyz("Velocity", "m/s"))
_WEEK = (_real("Time", "s", "Time of the GPS week."), _whole("Week", "GPS week."))
_FIX = (*_WEEK, _whole("GpsFix", "0: none, 1: time alone, 2: 2D, 3: 3D."), _whole("NumSats"))
_INS = (*_WEEK, Field("Status", "ascii", doc="Status of the filter, in hexadecimal digits."), *_ANGLES)
_UNCERTAIN = (
    _real("AttUncertainty", "°"),
    _real("PosUncertainty", "m"),
    _real("VelUncertainty", "m/s"),
)
_ACCURACY = (_real("SpeedAcc", "m/s"), _real("TimeAcc", "s"))


def _message(name: str, fields: tuple[Field, ...], doc: str) -> Message:
    return Message(0, name, fields, doc=doc, source=SOURCE)


SENTENCES = (
    _message("VNYPR", _ANGLES, "Yaw, pitch and roll."),
    _message("VNQTN", _QUATERNION, "Quaternion."),
    _message("VNQMR", (*_QUATERNION, *_SENSORS), "Quaternion, magnetic field, acceleration, rate of turn."),
    _message("VNMAG", _MAG, "Magnetic field."),
    _message("VNACC", _ACCEL, "Acceleration."),
    _message("VNGYR", _GYRO, "Rate of turn."),
    _message("VNMAR", _SENSORS, "Magnetic field, acceleration, rate of turn."),
    _message("VNYMR", (*_ANGLES, *_SENSORS), "Angles, magnetic field, acceleration, rate of turn."),
    _message("VNYBA", (*_ANGLES, *_xyz("BodyAccel", "m/s²"), *_GYRO), "Angles, true acceleration in the body's axes."),
    _message(
        "VNYIA", (*_ANGLES, *_xyz("InertialAccel", "m/s²"), *_GYRO), "Angles, true acceleration to north, east, down."
    ),
    _message(
        "VNIMU",
        (*_SENSORS, _real("Temp", "°C"), _real("Pressure", "kPa")),
        "Magnetic field, acceleration and rate of turn without compensation by the filter; temperature, pressure.",
    ),
    _message(
        "VNGPS",
        (*_FIX, *_PLACE, *_SPEED, _real("NorthAcc", "m"), _real("EastAcc", "m"), _real("VertAcc", "m"), *_ACCURACY),
        "Solution of the GNSS receiver.",
    ),
    _message("VNGPE", (*_FIX, *_ECEF, *_xyz("PosAcc", "m"), *_ACCURACY), "Solution of the GNSS receiver, ECEF."),
    _message("VNINS", (*_INS, *_PLACE, *_SPEED, *_UNCERTAIN), "Navigation solution."),
    _message("VNINE", (*_INS, *_ECEF, *_UNCERTAIN), "Navigation solution, ECEF."),
    _message("VNISL", (*_ANGLES, *_PLACE, *_SPEED, *_ACCEL, *_GYRO), "Navigation solution and sensors."),
    _message("VNISE", (*_ANGLES, *_ECEF, *_ACCEL, *_GYRO), "Navigation solution and sensors, ECEF."),
    _message(
        "VNDTV",
        (_real("DeltaTime", "s"), *_xyz("DeltaTheta", "°"), *_xyz("DeltaVel", "m/s")),
        "Increments of rotation and velocity, and the time that they span.",
    ),
)
