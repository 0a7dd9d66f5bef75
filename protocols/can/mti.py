"""CAN messages of an MTi: the 600-series, Avior and Sirius. Byte order is big-endian.

The quantities are those of MTData2 (protocols/xbus/data_identifiers.py), with the type and scale that they have on the
bus. Sources of the rows:

    doc      Movella documentation, "CAN Messages" (mtidocs.movella.com/canmessages)
    MT1604P  MT CAN Protocol Documentation, MT1604P, revision A, 2019, section 6
    SDK      identifiers in the open-source device API of Xsens, xscandataidentifier.h
    driver   identifiers, places and scales in the Xsens MTi CAN driver for ROS, tested with an MTi-680

They differ in three points:

    SampleTime       ticks of 100 µs (doc), or µs (MT1604P, SDK): the log decides (protocols/can/survey.py)
    0x061, 0x062     rate of turn, acceleration (SDK, driver); MT1604P has them the other way round
    AltitudeEllipsoid   signed (driver), as a height must be; MT1604P calls it unsigned

0x023 (a rotation matrix), 0x077 and 0x078 (latitude and longitude, each with 64 bits) are only named, by the SDK: no
source says what their bytes are, so they are left out.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array
from imuscope.protocols.can.rows import CanDeviceKind, CanRow, JoinedQuantity, Payloads, Role
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.xbus.data_identifiers import BY_NAME, PVT_FIELDS, UTC_FIELDS

COORDINATES = "ENU"
CENTURY = 2000
_PVT = {field.name: field for field in PVT_FIELDS}
_UNIT_NORM = 0.02  # from which a quaternion may differ in length


def _field(name: str, dtype: str, scale: float = 1.0, **more: object) -> Field:
    """A quantity of MTData2 with its type on the bus."""
    known = BY_NAME[name]
    frame = known.frame.replace("local", COORDINATES)
    return replace(known, dtype=dtype, scale=scale, frame=frame, id=-1, **more)  # type: ignore[arg-type]


def _numbers(payloads: Payloads, dtype: str, count: int) -> Array:
    size = np.dtype(dtype).itemsize * count
    return np.ascontiguousarray(payloads[:, :size]).view(dtype).astype(np.float64)


def _increment(payloads: Payloads) -> Array:
    """Three numbers whose scale is two to the power of minus the byte after them."""
    scale: Array = np.exp2(-payloads[:, 6].astype(np.float64))
    return np.asarray(_numbers(payloads, ">i2", 3) * scale[:, None])


def _degrees(payloads: Payloads) -> Array:
    """Latitude and longitude; the range of the latter is twice as wide."""
    return np.asarray(_numbers(payloads, ">i4", 2) * np.array((2.0**-24, 2.0**-23)))


def _utc(payloads: Payloads) -> Array:
    """The records of UtcTime: year, month, day, hour, minute, second, and u16 of 0.1 ms."""
    kinds = [(field.name, np.dtype(field.dtype).newbyteorder("=")) for field in _UTC.fields]
    out = np.empty(len(payloads), np.dtype(kinds))
    out["ns"] = payloads[:, 6].astype(np.uint32) * 25_600_000 + payloads[:, 7].astype(np.uint32) * 100_000
    out["year"] = payloads[:, 0].astype(np.uint16) + CENTURY
    for place, name in enumerate(("month", "day", "hour", "minute", "second"), 1):
        out[name] = payloads[:, place]
    return out


def _is_unit(payloads: Payloads) -> NDArray[np.bool_]:
    norm = np.linalg.norm(_numbers(payloads, ">i2", 4) / 32_767, axis=1)
    return np.asarray(np.abs(norm - 1) < _UNIT_NORM)


def _is_place(payloads: Payloads) -> NDArray[np.bool_]:
    return np.asarray((np.abs(_degrees(payloads)) <= (90.0, 180.0)).all(axis=1))


def _is_date(payloads: Payloads) -> NDArray[np.bool_]:
    month, day, hour, minute, second = (payloads[:, place] for place in range(1, 6))
    return np.asarray(
        (month <= 12) & (day <= 31) & (hour < 24) & (minute < 60) & (second <= 60) & (payloads[:, 6] < 40)
    )


_UTC = replace(BY_NAME["UtcTime"], fields=UTC_FIELDS[:-1], id=-1)
_STATUS = Field(
    "GnssReceiverStatus",
    fields=(
        *(_PVT[name] for name in ("fixtype", "numSV", "flags", "valid")),
        Field("numSvs", "u1", doc="Satellites seen."),
    ),
    title="GNSS receiver",
    doc="Fix and satellites of the GNSS receiver.",
)
_DOP = Field(
    "GnssReceiverDop",
    fields=tuple(_PVT[name] for name in ("pdop", "tdop", "vdop", "hdop")),
    title="GNSS precision",
    doc="Dilution of precision of the GNSS receiver.",
)
_ERROR = Field("code", "u1", choices={1: "the output buffer was full: messages were dropped"}, doc="Code of the error.")
_ALL = "doc, MT1604P, SDK, driver"
_BOTH = "MT1604P, SDK, driver"
_16, _UNIT = ">i2", 1 / 32_767


def _ecef(axis: str) -> Field:
    doc = f"Position, earth-centred and earth-fixed, {axis}."
    return Field(f"PositionEcef{axis.upper()}", ">i4", unit="m", scale=2.0**-8, decimals=2, frame="ECEF", doc=doc)


def _row(identifier: int, field: Field, size: int, source: str, role: Role = "", **more: object) -> CanRow:
    return CanRow(identifier, replace(field, source=source), size, source, role, **more)  # type: ignore[arg-type]


MTI = CanDeviceKind(
    "Xsens MTi (CAN)",
    (
        _row(0x001, replace(_ERROR, name="Error"), 1, _ALL, "report"),
        _row(0x002, Field("Warning", "u1", doc="Code of the warning."), 1, "SDK, driver", "report"),
        _row(0x005, _field("SampleTimeFine", ">u4"), 4, _ALL, "time"),
        _row(0x006, _field("PacketCounter", ">u2", title="Group counter"), 2, _ALL, "counter"),
        _row(0x007, _UTC, 8, _ALL, "utc", values=_utc, is_plausible=_is_date),
        _row(0x011, _field("StatusWord", ">u4"), 4, _BOTH),
        _row(0x021, _field("Quaternion", _16, _UNIT), 8, _BOTH, is_plausible=_is_unit),
        _row(0x022, _field("EulerAngles", _16, 2.0**-7), 6, _BOTH),
        _row(0x031, _field("DeltaV", _16), 7, _BOTH, values=_increment),
        _row(0x032, _field("RateOfTurn", _16, 2.0**-9), 6, _BOTH),
        _row(0x033, _field("DeltaQ", _16, _UNIT), 8, _BOTH, is_plausible=_is_unit),
        _row(0x034, _field("Acceleration", _16, 2.0**-8), 6, _BOTH),
        _row(0x035, _field("FreeAcceleration", _16, 2.0**-8), 6, _BOTH),
        _row(0x041, _field("MagneticField", _16, 2.0**-10), 6, _BOTH),
        _row(0x051, _field("Temperature", _16, 2.0**-8), 2, _BOTH),
        _row(0x052, _field("BaroPressure", ">u4", 2.0**-15, decimals=1), 4, _BOTH),
        _row(0x061, _field("RateOfTurnHR", _16, 2.0**-9), 6, "SDK, driver; scale MT1604P", "apart"),
        _row(0x062, _field("AccelerationHR", _16, 2.0**-8), 6, "SDK, driver; scale MT1604P", "apart"),
        _row(0x071, _field("LatLon", ">i4"), 8, _BOTH, values=_degrees, is_plausible=_is_place),
        _row(0x072, _field("AltitudeEllipsoid", ">i4", 2.0**-15), 4, _BOTH),
        _row(0x073, _ecef("x"), 4, "SDK, driver", "part"),
        _row(0x074, _ecef("y"), 4, "SDK, driver", "part"),
        _row(0x075, _ecef("z"), 4, "SDK, driver", "part"),
        _row(0x076, _field("VelocityXYZ", _16, 2.0**-6), 6, _BOTH),
        _row(0x079, _STATUS, 5, "SDK, driver"),
        _row(0x07A, _DOP, 8, "SDK, driver"),
    ),
    ticks_ns=(100_000, 1_000),
    joined=(JoinedQuantity(_field("PositionEcef", "f8"), ("PositionEcefX", "PositionEcefY", "PositionEcefZ")),),
    remark="CAN messages of an MTi do not name the coordinate system: it is taken to be ENU, as delivered.",
)
"""The rows are in the order in which the identifiers have priority on the bus, and in which a device sends them."""
