"""Data identifiers of MTData2, as a table, and the meaning of an identifier's bits.

    bit  15 14 13 12 11 | 10 9 8 | 7 6 5 4 | 3 2 1 0
         group          | 0      | type    | format

    format, bits 1:0   precision of a real number: 0 float32, 1 fixed point 12.20, 2 fixed point 16.32, 3 float64
            bits 3:2   coordinate system: 0 ENU (x east, y north, z up), 4 NED, 8 NWU; 0x0C means nothing

Group and type select a row; the precision selects the wire type of those rows whose dtype is "real"; the coordinate
system completes `frame`, where "local" in a row stands for it. Rows of fixed type ignore the format bits (BaroPressure
is listed as 301y in the document and is an unsigned integer for any y).

`item(identifier, size)` is the entry point: it gives the Field as in a frame, or a field of opaque bytes called
"0x4FF0" if the identifier is unknown or its size does not fit.

Names are those of the document without "XDI_". Rows whose doc ends in "(not in the document)" are from the devices'
own software.

Source: MT0101P 2020.A, section 5.3.5 (Tables 16 and 17) and section 5.3.6, with its errata.
"""

from dataclasses import replace
from functools import lru_cache

from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.layouts import form_for_size
from imuscope.protocols.xbus.enums import (
    GNSS_FIXES,
    GNSS_FLAGS,
    GNSS_SYSTEMS,
    GNSS_VALID,
    POLARITIES,
    SATELLITE_FLAGS,
    STATUS_BITS,
    STATUS_BYTE_BITS,
    UTC_FLAGS,
)

PRECISIONS = (">f4", "fp1220", "fp1632", ">f8")
PRECISION_NAMES = dict(zip(PRECISIONS, ("Float32", "Fp1220", "Fp1632", "Float64"), strict=True))
COORDINATES = ("ENU", "NED", "NWU")

XYZ = ("x", "y", "z")
_Q = ("q0", "q1", "q2", "q3")
_MATRIX = ("m00", "m01", "m02", "m10", "m11", "m12", "m20", "m21", "m22")
_ALSO = " (not in the document)"

UTC_FIELDS = (  # also the payload of SetUTCTime and UTCTime
    Field("ns", ">u4", unit="ns", doc="Nanosecond of the second."),
    Field("year", ">u2", doc="Year, 1999 to 2099."),
    Field("month", "u1", doc="Month, 1 to 12."),
    Field("day", "u1", doc="Day of the month, from 1."),
    Field("hour", "u1", unit="h", doc="Hour of the day."),
    Field("minute", "u1", unit="min", doc="Minute of the hour."),
    Field("second", "u1", unit="s", doc="Second of the minute."),
    Field("flags", "u1", bits=UTC_FLAGS, doc="Validity of the parts of this time."),
)

PVT_FIELDS = (  # Table 25
    Field("itow", ">u4", unit="ms", title="Time of week", doc="GPS time of week."),
    Field("year", ">u2", doc="Year (UTC)."),
    Field("month", "u1", doc="Month (UTC)."),
    Field("day", "u1", doc="Day of the month (UTC)."),
    Field("hour", "u1", unit="h", doc="Hour of the day (UTC)."),
    Field("min", "u1", unit="min", doc="Minute of the hour (UTC)."),
    Field("sec", "u1", unit="s", doc="Second of the minute (UTC), 60 in a leap second."),
    Field("valid", "u1", bits=GNSS_VALID, title="Validity", doc="Validity of date and time."),
    Field("tAcc", ">u4", unit="ns", title="Time accuracy", doc="Estimated accuracy of the time."),
    Field("nano", ">i4", unit="ns", doc="Fraction of the second, −10⁹ to 10⁹."),
    Field("fixtype", "u1", choices=GNSS_FIXES, title="Fix", doc="Fix type."),
    Field("flags", "u1", bits=GNSS_FLAGS, title="Solution flags", doc="Fix status."),
    Field("numSV", "u1", title="Satellites used", doc="Satellites used in the solution."),
    Field("Reserved1", "u1", doc="Reserved."),
    Field("lon", ">i4", unit="°", scale=1e-7, decimals=7, period=360, title="Longitude", doc="Longitude."),
    Field("lat", ">i4", unit="°", scale=1e-7, decimals=7, title="Latitude", doc="Latitude."),
    Field("height", ">i4", unit="mm", title="Height above ellipsoid", doc="Height above the ellipsoid."),
    Field("hMSL", ">i4", unit="mm", title="Height above sea level", doc="Height above mean sea level."),
    Field("hAcc", ">u4", unit="mm", title="Horizontal accuracy", doc="Estimated horizontal accuracy."),
    Field("vAcc", ">u4", unit="mm", title="Vertical accuracy", doc="Estimated vertical accuracy."),
    Field("velN", ">i4", unit="mm/s", title="Velocity north", doc="Velocity north."),
    Field("velE", ">i4", unit="mm/s", title="Velocity east", doc="Velocity east."),
    Field("velD", ">i4", unit="mm/s", title="Velocity down", doc="Velocity down."),
    Field("gSpeed", ">i4", unit="mm/s", title="Speed over ground", doc="Speed over ground."),
    Field(
        "headMot",
        ">i4",
        unit="°",
        scale=1e-5,
        decimals=2,
        period=360,
        title="Heading of motion",
        doc="Heading of motion.",
    ),
    Field("sAcc", ">u4", unit="mm/s", title="Speed accuracy", doc="Estimated accuracy of the speed."),
    Field(
        "headAcc",
        ">u4",
        unit="°",
        scale=1e-5,
        decimals=2,
        title="Heading accuracy",
        doc="Estimated accuracy of both headings.",
    ),
    Field(
        "headVeh",
        ">i4",
        unit="°",
        scale=1e-5,
        decimals=2,
        period=360,
        title="Heading of vehicle",
        doc="Heading of the vehicle.",
    ),
    Field("gdop", ">u2", scale=0.01, decimals=2, title="Geometric DOP", doc="Geometric dilution of precision."),
    Field("pdop", ">u2", scale=0.01, decimals=2, title="Position DOP", doc="Dilution of precision of the position."),
    Field("tdop", ">u2", scale=0.01, decimals=2, title="Time DOP", doc="Dilution of precision of the time."),
    Field("vdop", ">u2", scale=0.01, decimals=2, title="Vertical DOP", doc="Vertical dilution of precision."),
    Field("hdop", ">u2", scale=0.01, decimals=2, title="Horizontal DOP", doc="Horizontal dilution of precision."),
    Field("ndop", ">u2", scale=0.01, decimals=2, title="Northing DOP", doc="Dilution of precision northing."),
    Field("edop", ">u2", scale=0.01, decimals=2, title="Easting DOP", doc="Dilution of precision easting."),
)

SATELLITE_FIELDS = (  # Table 26, the repeated block
    Field("gnssId", "u1", choices=GNSS_SYSTEMS, title="Constellation", doc="Satellite system."),
    Field("svId", "u1", title="Satellite", doc="Satellite number within its constellation."),
    Field("cno", "u1", unit="dBHz", title="C/N0", doc="Carrier to noise ratio."),
    Field("flags", "u1", bits=SATELLITE_FLAGS, title="Use and health", doc="Tracking, use and health."),
)

SAT_INFO_FIELDS = (  # Table 26
    Field("itow", ">u4", unit="ms", title="Time of week", doc="GPS time of week."),
    Field(
        "numSvs",
        "u1",
        title="Satellites seen",
        doc="Number of satellites listed; at most 60, and no more than the item holds.",
    ),
    Field("res1", "u1", doc="Reserved."),
    Field("res2", "u1", doc="Reserved."),
    Field("res3", "u1", doc="Reserved."),
    Field("satellites", shape=(-1,), fields=SATELLITE_FIELDS, doc="One record per satellite."),
)

TRIGGER_FIELDS = (
    Field("line", "u1", doc="Input line."),
    Field("polarity", "u1", choices=POLARITIES, doc="Detected edge."),
    Field("timestamp", ">u4", doc="Time of the edge on the device's clock."),
    Field("frame", ">u2", doc="Frame in which the edge was detected."),
)

RAW_FIELDS = (
    Field("acc", ">u2", (3,), axes=XYZ, doc="Converter readings of the accelerometers."),
    Field("gyr", ">u2", (3,), axes=XYZ, doc="Converter readings of the gyroscopes."),
    Field("mag", ">u2", (3,), axes=XYZ, doc="Converter readings of the magnetometers."),
    Field("temp", ">i2", unit="°C", scale=1 / 256, decimals=1, doc="Internal temperature."),
)

RAW_FLOAT_FIELDS = (
    Field("acc", ">f4", (3,), axes=XYZ, doc="Readings of the accelerometers."),
    Field("gyr", ">f4", (3,), axes=XYZ, doc="Readings of the gyroscopes."),
    Field("mag", ">f4", (3,), axes=XYZ, doc="Readings of the magnetometers."),
    Field("temp", ">f4", unit="°C", decimals=1, doc="Internal temperature."),
)


def _row(identifier: int, name: str, dtype: str, shape: tuple[int, ...] = (), **more: object) -> Field:
    return Field(name, dtype, shape, id=identifier, source="MT0101P 5.3.6", **more)  # type: ignore[arg-type]


def _vector(identifier: int, name: str, unit: str, decimals: int, **more: object) -> Field:
    return _row(identifier, name, "real", (3,), unit=unit, axes=XYZ, decimals=decimals, **more)


def _quaternion(identifier: int, name: str, decimals: int, **more: object) -> Field:
    return _row(identifier, name, "real", (4,), axes=_Q, decimals=decimals, **more)


ITEMS: tuple[Field, ...] = (
    _row(0x0810, "Temperature", "real", unit="°C", decimals=2, doc="Temperature inside the device."),
    _row(0x1010, "UtcTime", "", fields=UTC_FIELDS, title="UTC time", doc="Time of the sample in UTC."),
    _row(0x1020, "PacketCounter", ">u2", title="Packet counter", doc="Counts every MTData2 message; wraps at 65 536."),
    _row(0x1030, "Itow", ">u4", unit="ms", title="GPS time of week", doc="GPS time of week" + _ALSO + "."),
    _row(0x1040, "GnssAge", "u1", title="GNSS age", doc="Age of the GNSS data" + _ALSO + "."),
    _row(0x1050, "PressureAge", "u1", title="Pressure age", doc="Packets since the last pressure" + _ALSO + "."),
    _row(
        0x1060,
        "SampleTimeFine",
        ">u4",
        unit="0.1 ms",
        title="Sample time",
        doc="Sample time in ticks of 10 kHz; wraps at 2³² (1- and 600-series) or after a day (10- and 100-series).",
    ),
    _row(0x1070, "SampleTimeCoarse", ">u4", unit="s", title="Sample time, coarse", doc="Sample time in seconds."),
    _row(0x1080, "FrameRange", ">u2", (2,), axes=("first", "last"), doc="First and last frame" + _ALSO + "."),
    _row(0x1090, "PacketCounter8", "u1", title="Packet counter, 8 bit", doc="Counts messages" + _ALSO + "."),
    _row(0x10A0, "SampleTime64", ">u8", title="Sample time, 64 bit", doc="Sample time" + _ALSO + "."),
    _row(0x10B0, "PacketCounter32", ">u4", title="Packet counter, 32 bit", doc="Counts messages" + _ALSO + "."),
    _quaternion(0x2010, "Quaternion", 4, frame="local from body", doc="Orientation, scalar first."),
    _row(
        0x2020,
        "RotationMatrix",
        "real",
        (3, 3),
        axes=_MATRIX,
        frame="local from body",
        column_major=True,
        decimals=4,
        title="Rotation matrix",
        doc="Orientation as a direction cosine matrix, sent column by column.",
    ),
    _row(
        0x2030,
        "EulerAngles",
        "real",
        (3,),
        unit="°",
        axes=("roll", "pitch", "yaw"),
        frame="local from body",
        decimals=2,
        period=360,
        title="Euler angles",
        doc="Orientation as roll, pitch and yaw, turned about z, then y, then x.",
    ),
    _row(0x3010, "BaroPressure", ">u4", unit="Pa", title="Pressure", doc="Pressure measured by the barometer."),
    _vector(
        0x4010,
        "DeltaV",
        "m/s",
        4,
        title="Velocity increment",
        doc="Velocity increment since the last sample (strapdown integration).",
    ),
    _vector(0x4020, "Acceleration", "m/s²", 3, doc="Calibrated acceleration."),
    _vector(
        0x4030,
        "FreeAcceleration",
        "m/s²",
        3,
        frame="local",
        title="Free acceleration",
        doc="Acceleration without gravity, in the local frame.",
    ),
    _vector(
        0x4040,
        "AccelerationHR",
        "m/s²",
        3,
        title="Acceleration, high rate",
        doc="Calibrated acceleration at 800 to 2 000 Hz, in separate messages.",
    ),
    _row(0x4810, "TriggerIn1", "", fields=TRIGGER_FIELDS, title="Trigger 1", doc="Trigger on line 1" + _ALSO + "."),
    _row(0x4820, "TriggerIn2", "", fields=TRIGGER_FIELDS, title="Trigger 2", doc="Trigger on line 2" + _ALSO + "."),
    _row(0x4830, "TriggerIn3", "", fields=TRIGGER_FIELDS, title="Trigger 3", doc="Trigger on line 3" + _ALSO + "."),
    _row(
        0x5010,
        "AltitudeMsl",
        "real",
        unit="m",
        decimals=2,
        title="Altitude above sea level",
        doc="Altitude above mean sea level" + _ALSO + ".",
    ),
    _row(
        0x5020,
        "AltitudeEllipsoid",
        "real",
        unit="m",
        decimals=2,
        title="Altitude",
        doc="Altitude above the WGS 84 ellipsoid.",
    ),
    _vector(
        0x5030,
        "PositionEcef",
        "m",
        2,
        frame="ECEF",
        title="Position",
        doc="Position, earth-centred and earth-fixed; exceeds the range of the fixed-point formats.",
    ),
    _row(
        0x5040,
        "LatLon",
        "real",
        (2,),
        unit="°",
        axes=("lat", "lon"),
        decimals=7,
        title="Latitude, longitude",
        doc="Position as latitude and longitude.",
    ),
    _row(
        0x7010,
        "GnssPvtData",
        "",
        fields=PVT_FIELDS,
        title="GNSS solution",
        doc="Position, velocity and time from the GNSS receiver.",
    ),
    _row(
        0x7020,
        "GnssSatInfo",
        "",
        fields=SAT_INFO_FIELDS,
        title="GNSS satellites",
        doc="Satellites in view of the GNSS receiver.",
    ),
    _row(
        0x7030,
        "GnssPvtPulse",
        ">u4",
        unit="0.1 ms",
        title="GNSS pulse",
        doc="Time of the GNSS solution on the SampleTimeFine clock.",
    ),
    _vector(0x8020, "RateOfTurn", "rad/s", 4, title="Rate of turn", doc="Calibrated rate of turn."),
    _quaternion(
        0x8030,
        "DeltaQ",
        6,
        title="Orientation increment",
        doc="Rotation since the last sample (strapdown integration).",
    ),
    _vector(
        0x8040,
        "RateOfTurnHR",
        "rad/s",
        4,
        title="Rate of turn, high rate",
        doc="Calibrated rate of turn at 800 to 1 600 Hz, in separate messages.",
    ),
    _row(
        0xA010,
        "RawAccGyrMagTemp",
        "",
        fields=RAW_FIELDS,
        title="Raw sensor readings",
        doc="Converter readings before calibration.",
    ),
    _row(
        0xA020,
        "RawGyroTemp",
        ">i2",
        (3,),
        unit="°C",
        scale=1 / 256,
        axes=XYZ,
        decimals=1,
        title="Gyroscope temperatures",
        doc="Temperatures of the gyroscopes.",
    ),
    _row(0xA030, "RawAcc", ">u2", (3,), axes=XYZ, title="Raw acceleration", doc="Converter readings" + _ALSO + "."),
    _row(0xA040, "RawGyr", ">u2", (3,), axes=XYZ, title="Raw rate of turn", doc="Converter readings" + _ALSO + "."),
    _row(0xA050, "RawMag", ">u2", (3,), axes=XYZ, title="Raw magnetic field", doc="Converter readings" + _ALSO + "."),
    _quaternion(
        0xA060,
        "RawDeltaQ",
        6,
        title="Raw orientation increment",
        doc="Rotation increment before calibration" + _ALSO + ".",
    ),
    _vector(
        0xA070,
        "RawDeltaV",
        "",
        4,
        title="Raw velocity increment",
        doc="Velocity increment before calibration" + _ALSO + ".",
    ),
    _row(
        0xA080,
        "RawBlob",
        "bytes",
        (-1,),
        title="Raw data",
        doc="Opaque data; an item of 255 bytes is continued by the next of the same identifier" + _ALSO + ".",
    ),
    _row(
        0xA090,
        "RawFloatAccGyrMagTemp",
        "",
        fields=RAW_FLOAT_FIELDS,
        title="Raw sensor readings, float",
        doc="Sensor readings before calibration" + _ALSO + ".",
    ),
    _row(0xB010, "AnalogIn1", ">u2", title="Analogue input 1", doc="Converter reading" + _ALSO + "."),
    _row(0xB020, "AnalogIn2", ">u2", title="Analogue input 2", doc="Converter reading" + _ALSO + "."),
    _vector(
        0xC020,
        "MagneticField",
        "a.u.",
        4,
        title="Magnetic field",
        doc="Calibrated magnetic field, relative to its strength at calibration.",
    ),
    _vector(
        0xC030,
        "MagneticFieldCorrected",
        "a.u.",
        4,
        title="Magnetic field, corrected",
        doc="Magnetic field with in-run compass calibration" + _ALSO + ".",
    ),
    _vector(0xD010, "VelocityXYZ", "m/s", 3, frame="local", title="Velocity", doc="Velocity from the GNSS/INS filter."),
    _row(
        0xE010,
        "StatusByte",
        "u1",
        bits=STATUS_BYTE_BITS,
        title="Status",
        doc="Low byte of the status word.",
    ),
    _row(0xE020, "StatusWord", ">u4", bits=STATUS_BITS, title="Status", doc="State of filter, sensors and GNSS."),
    _row(0xE040, "Rssi", "i1", unit="dBm", title="Signal strength", doc="Strength of the radio signal" + _ALSO + "."),
    _row(0xE080, "DeviceId", ">u4", title="Device identifier", doc="Identifier of the device."),
    _row(0xE080, "DeviceId", ">u8", title="Device identifier", doc="Identifier of the device, 64 bits (600-series)."),
    _row(0xE090, "LocationId", ">u2", title="Location identifier", doc="Location identifier set by the user."),
)

RAW_BLOB = 0xA080

_ROWS: dict[int, list[Field]] = {}
for _item in ITEMS:
    _ROWS.setdefault(_item.id, []).append(_item)
_DOCUMENTED = frozenset(row.id for row in ITEMS if _ALSO not in row.doc)

BY_NAME: dict[str, Field] = {field.name: field for field in reversed(ITEMS)}
"""The first row of each name."""


@lru_cache(maxsize=4096)
def item(identifier: int, size: int) -> Field:
    """The field of `size` bytes under `identifier`. Never fails: unknown or ill-fitting ones are opaque bytes.

    Returns:
        The row with its dtype, shape, frame and full identifier filled in; called "0x4FF0" if opaque.
    """
    local = (identifier >> 2) & 3
    if local < len(COORDINATES):
        for row in _ROWS.get(identifier & 0xFFF0, ()):
            dtype = PRECISIONS[identifier & 3] if row.dtype == "real" else row.dtype
            frame = row.frame.replace("local", COORDINATES[local])
            fields = form_for_size(row.fields, size) if row.fields else ()
            if fields is None:
                continue
            whole = form_for_size((replace(row, dtype=dtype, frame=frame, id=identifier, fields=fields),), size)
            if whole is not None:
                return whole[0]
    return Field(f"0x{identifier:04X}", "bytes", (size,), id=identifier, doc="Unknown data.")


def form_words(one: Field, other: Field) -> str:
    """In what `one` differs from another form of its quantity: "NED", "Float64"; "" for nothing with a name."""
    if one.frame != other.frame:
        return COORDINATES[one.id >> 2 & 3]
    return PRECISION_NAMES.get(one.dtype, "") if one.dtype != other.dtype else ""


def is_known(identifier: int) -> bool:
    """Whether the document gives the sizes of this identifier. One that is known from elsewhere may have others."""
    return identifier & 0xFFF0 in _DOCUMENTED and (identifier >> 2) & 3 < len(COORDINATES)
