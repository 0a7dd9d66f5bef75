"""Sentences specific to Inertial Sense devices: their fields, in order, with units.

    $PIMU,time,pqr,acc                            $PINS1,timeOfWeek,week,insStatus,hdwStatus,theta,uvw,lla,ned
    $INFO,serialNumber,hardwareVer,firmwareVer,…  $ASCE,options,id_1,period_1,id_2,period_2,…

Angles are radians, as in the data sets that these sentences report. `PASHR` is also sent by other devices, and read by
pynmeagps.

Source: inertial-sense-sdk 2.7.1, protocol_nmea.cpp; Inertial Sense user manual, "NMEA 0183 (ASCII) protocol".
"""

from imuscope.protocols.schema.fields import Field, Message

SOURCE = "inertial-sense-sdk 2.7.1, protocol_nmea.cpp"


def _real(name: str, unit: str = "", doc: str = "") -> Field:
    return Field(name, "f8", unit=unit, doc=doc)


def _whole(name: str, unit: str = "", doc: str = "") -> Field:
    return Field(name, "i8", unit=unit, doc=doc)


def _text(name: str, doc: str = "") -> Field:
    return Field(name, "ascii", doc=doc)


def _xyz(name: str, unit: str) -> tuple[Field, ...]:
    return tuple(_real(name + axis, unit) for axis in "XYZ")


_PLACE = (_real("lat", "°"), _real("lon", "°"), _real("hae", "m", "Height above the ellipsoid."))
_IMU = (_real("time", "s", "Time since the device started."), *_xyz("pqr", "rad/s"), *_xyz("acc", "m/s²"))
_INS = (_real("timeOfWeek", "s"), _whole("week"), _whole("insStatus"), _whole("hdwStatus"))
_NED = (_real("nedN", "m"), _real("nedE", "m"), _real("nedD", "m"))
_POWER = (
    _whole("timeValid", doc="1: valid time."),
    _whole("week"),
    _whole("timeOfWeekUs", "µs"),
    _whole("leapValid", doc="1: valid leap seconds."),
    _whole("leapS", "s"),
    _whole("holdover", doc="1: free-running clock."),
)


def _message(name: str, fields: tuple[Field, ...], doc: str) -> Message:
    return Message(0, name, fields, doc=doc, source=SOURCE)


ROWS = (
    _message("PIMU", _IMU, "Rate of turn and acceleration."),
    _message("PRIMU", _IMU, "Rate of turn and acceleration, raw."),
    _message(
        "PPIMU",
        (
            _real("time", "s", "Time since the device started."),
            *_xyz("dtheta", "rad"),
            *_xyz("dvel", "m/s"),
            _real("dt", "s", "Time over which the increments are integrated."),
        ),
        "Increments of rotation and velocity.",
    ),
    _message(
        "PINS1",
        (
            *(*_INS, _real("thetaRoll", "rad"), _real("thetaPitch", "rad"), _real("thetaYaw", "rad")),
            *(*_xyz("uvw", "m/s"), *_PLACE, *_NED),
        ),
        "Attitude as Euler angles, velocity in the body frame, position, and position relative to the reference point.",
    ),
    _message(
        "PINS2",
        (*_INS, *(_real(f"q{i}") for i in range(4)), *_xyz("uvw", "m/s"), *_PLACE),
        "Attitude as a quaternion, velocity in the body frame, and position.",
    ),
    _message(
        "PGPSP",
        (
            *(_whole("timeOfWeekMs", "ms"), _whole("week"), _whole("status"), *_PLACE),
            _real("hMSL", "m", "Height above sea level."),
            *(_real("pDop"), _real("hAcc", "m"), _real("vAcc", "m"), *_xyz("vel", "m/s"), _real("sAcc", "m/s")),
            *(_real("cnoMean", "dBHz"), _real("towOffset", "s"), _whole("leapS", "s")),
        ),
        "Position and velocity of the GNSS receiver.",
    ),
    _message(
        "PSTRB",
        (_whole("week"), _whole("timeOfWeekMs", "ms"), _whole("pin"), _whole("count")),
        "Time of a pulse at a strobe input.",
    ),
    _message(
        "INFO",
        (
            *(_whole("serialNumber"), _text("hardwareVer"), _text("firmwareVer"), _whole("buildNumber")),
            *(_text("protocolVer"), _whole("repoRevision"), _text("manufacturer"), _text("buildDate")),
            *(_text("buildTime"), _text("addInfo"), _whole("hardwareType"), _whole("hdwRunState"), _text("buildType")),
        ),
        "Identity of the device.",
    ),
    _message("ASCE", (_whole("options"),), "Sentences sent and their periods."),
    _message("ASCB", (_whole("options"),), "Sentences sent and their periods."),
    _message(
        "INTEL",
        (
            *(_text("id"), _text("firmwareVer"), _whole("timeOfWeek", "s"), _whole("week"), _whole("leapS", "s")),
            *(_real("ppsPhase1", "ns"), _real("ppsPhase2", "ns"), _real("ppsNoise", "ns")),
            *_xyz("vel", "m/s"),
            *(_real("velN", "m/s"), _real("velE", "m/s"), _real("velD", "m/s")),
        ),
        "Time pulse and velocity.",
    ),
    _message("POWGPS", _POWER, "Time of the GNSS receiver."),
    _message(
        "POWTLV",
        (
            *(*_POWER, _real("latDegMin"), _text("NS"), _real("lonDegMin"), _text("EW"), _real("hae", "m")),
            *(_real("hMSL", "m"), _real("speed", "m/s"), _real("velD", "m/s"), _real("course", "°")),
        ),
        "Time, position and velocity of the GNSS receiver.",
    ),
)
PAIRS = {"ASCE": ("id", "period"), "ASCB": ("id", "period")}
"""Sentences that end in a variable number of pairs: id_1, period_1, id_2 …"""
