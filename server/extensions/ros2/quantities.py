"""Mapping from the channels of a device to the quantities that ROS has messages for. Pure.

A channel is chosen by its title and its unit, so no family is named; the attitude is the one that all views show
(recordings/exporters/entities.py). Where several fit, a receiver's own position comes before a fused one, and a
velocity against the earth before one in body axes. A magnetic field in arbitrary units cannot become tesla: it has a
reason instead of a place.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from imuscope.recordings.exporters.entities import Attitude, devices_of

Info = Mapping[str, Any]  # a channel: server/wire/ ChannelInfo

TO_SI: Mapping[str, Mapping[str, float]] = {
    "turn": {"rad/s": 1.0, "°/s": 0.017453292519943295, "deg/s": 0.017453292519943295},
    "acceleration": {"m/s²": 1.0, "g": 9.80665, "mg": 9.80665e-3},
    "field": {"T": 1.0, "mT": 1e-3, "µT": 1e-6, "uT": 1e-6, "nT": 1e-9, "G": 1e-4, "gauss": 1e-4, "mG": 1e-7},
    "pressure": {"Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "kPa": 1000.0, "bar": 1e5},
    "temperature": {"°C": 1.0},
    "velocity": {"m/s": 1.0},
    "length": {"m": 1.0, "mm": 1e-3},
}
TITLES: Mapping[str, str] = {  # of quantities in files of other programs
    **{"angular_velocity": "Rate of turn", "linear_acceleration": "Acceleration", "fluid_pressure": "Pressure"},
    **{"magnetic_field": "Magnetic field", "w_RS_S": "Rate of turn", "a_RS_S": "Acceleration"},
}
HINT = "Choose others, name the units of a table with --columns FILE, or export MCAP or CSV."
TABLE_TITLES: Mapping[str, re.Pattern[str]] = {
    "Rate of turn": re.compile(r"gyr|angular|omega|drehrate|pqr|^w$|角速度|陀螺", re.I),
    "Acceleration": re.compile(r"acc(?!ur|um)|beschleunig|^a$|加速度", re.I),
    "Magnetic field": re.compile(r"^mag|^b$|地磁|磁", re.I),
}
"""Vectors of tables by their headings, if their units fit."""
_NOT_MEASURED = re.compile(r"bias|offset|drift|noise|std|var|cov|err|free|user|lin|grav|world|global|earth|estim", re.I)
WORLD_FRAMES = ("ENU", "NED", "NWU")
_LATITUDE, _LONGITUDE = re.compile("^lat", re.I), re.compile("^lon", re.I)
_HEIGHT = re.compile("^(alt|height$|h_?ell)", re.I)
_HORIZONTAL, _VERTICAL = re.compile("^h_?acc", re.I), re.compile("^v_?acc", re.I)
_FIX = re.compile("^fix_?type$", re.I)
_SPEED = re.compile("^s_?acc$", re.I)
_NORTH_EAST_DOWN = tuple(re.compile(f"^vel_?{axis}$", re.I) for axis in "ned")
_NOT_ITS_OWN = re.compile("base|reference|relative", re.I)
_RECEIVER = re.compile("gnss|gps", re.I)
_DATE = ("year", "month", "day", "hour", "min", "sec")


@dataclass(frozen=True, slots=True)
class Place:
    """Columns of a channel that hold a quantity.

    Args:
        columns: positions in the channel.
        message: of the channel: columns of one message have the same times.
        scale: to the unit of ROS.
        frame: as advertised, "" for axes of the body.
    """

    channel: int
    columns: tuple[int, ...]
    message: str
    scale: float = 1.0
    frame: str = ""


@dataclass(frozen=True, slots=True)
class GnssPlaces:
    """A position on the earth, and its quality by the device; None for missing values.

    Args:
        place: latitude and longitude, °.
        height: above the ellipsoid, m.
        horizontal, vertical: accuracies, m, one standard deviation.
        fix: type of the solution.
        invalid: values of `fix` that are not a position.
    """

    place: Place
    height: Place | None = None
    horizontal: Place | None = None
    vertical: Place | None = None
    fix: Place | None = None
    invalid: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class SpeedPlaces:
    """A velocity against the earth (ENU, NED, NWU or ECEF), and its accuracy, m/s, one standard deviation; None: the
    device sends none.
    """

    place: Place
    accuracy: Place | None


@dataclass(frozen=True, slots=True)
class UtcPlaces:
    """The device's own time: year to second with `nano` ns, or GPS week, time of week and leap seconds."""

    parts: Place
    kind: str  # "utc" or "gps"
    nano: int = -1  # column of ns; −1: none
    valid: int = -1  # column of flags: 1 the date is valid, 2 the time is; −1: none
    is_receiver: bool = False  # the time of a satellite receiver


@dataclass(frozen=True, slots=True)
class DeviceQuantities:
    """The quantities of a device; None for those that it does not send.

    Args:
        attitude_place: the columns of `attitude`.
        no_field: why a magnetic field is not published; "" for none.
    """

    turn: Place | None = None
    acceleration: Place | None = None
    attitude: Attitude | None = None
    attitude_place: Place | None = None
    field: Place | None = None
    no_field: str = ""
    velocity: Place | None = None
    speed: SpeedPlaces | None = None
    pressure: Place | None = None
    temperature: Place | None = None
    fix: GnssPlaces | None = None
    utc: UtcPlaces | None = None

    @property
    def channels(self) -> set[int]:
        places = [self.turn, self.acceleration, self.attitude_place, self.field, self.velocity, self.pressure]
        places += [self.temperature, self.utc.parts if self.utc else None]
        if self.fix:
            places += [self.fix.place, self.fix.height, self.fix.horizontal, self.fix.vertical, self.fix.fix]
        if self.speed:
            places += [self.speed.place, self.speed.accuracy]
        return {place.channel for place in places if place}


def quantities_of(device: Mapping[str, Any], channels: Sequence[Info]) -> DeviceQuantities:
    """The quantities of a device.

    Args:
        device: as in server/wire/ DeviceInfo.
        channels: of that device; of those with one name the newest is active.
    """
    channels = list({(str(info["message"]), str(info["name"])): info for info in channels}.values())
    entities = [one for one in devices_of([device], channels) if one.id == device["id"]]
    attitude = entities[0].attitude if entities else None
    infos = {info["id"]: info for info in channels}
    field, no_field = _field(channels)
    return DeviceQuantities(
        turn=next(_vectors(channels, "^(rate of turn|angular (rate|velocity))", "turn"), None),
        acceleration=next(_vectors(channels, "^acceleration", "acceleration"), None),
        attitude=attitude,
        attitude_place=_every(infos[attitude.channel]) if attitude else None,
        field=field,
        no_field=no_field,
        velocity=_velocity(channels),
        speed=_speed(channels),
        pressure=_scalar(channels, "^pressure|^bar$", "pressure"),
        temperature=_scalar(channels, "^temp|^barTemp$", "temperature"),
        fix=_fix(channels),
        utc=_utc(channels),
    )


def recorded_quantities(device: Mapping[str, Any], channels: Sequence[Info]) -> DeviceQuantities:
    """The quantities of a device in a recording, which may be one of messages or a EuRoC table: as `quantities_of`."""
    own = [info for info in channels if info["device"] == device["id"]]
    named = TITLES if device["protocol"] else {**{title: _title_of(title) for title in _titles(own)}, **TITLES}
    return quantities_of(device, [{**info, "title": named.get(str(info["title"]), info["title"])} for info in own])


def _titles(channels: Sequence[Info]) -> set[str]:
    return {str(info["title"]) for info in channels if info["kind"] == "vector"}


def _title_of(heading: str) -> str:
    """The title of the quantity that a heading of a table names; the heading itself for others."""
    if _NOT_MEASURED.search(heading):
        return heading
    return next((title for title, pattern in TABLE_TITLES.items() if pattern.search(heading)), heading)


def _every(info: Info) -> Place:
    return Place(int(info["id"]), tuple(range(len(info["columns"]))), str(info["message"]), 1.0, str(info["frame"]))


def _units(info: Info) -> set[str]:
    return {str(column["unit"]) or str(info["unit"]) for column in info["columns"]}


def _vectors(channels: Sequence[Info], title: str, quantity: str) -> Iterator[Place]:
    for info in channels:
        if info["kind"] != "vector" or len(info["columns"]) != 3 or not re.match(title, str(info["title"]), re.I):
            continue
        units = _units(info)
        scale = TO_SI[quantity].get(next(iter(units)), 0.0) if len(units) == 1 else 0.0
        if scale:
            frame = str(info["frame"])
            yield Place(int(info["id"]), (0, 1, 2), str(info["message"]), scale, "" if frame == "body" else frame)


def _field(channels: Sequence[Info]) -> tuple[Place | None, str]:
    vectors = next(_vectors(channels, "^magnetic", "field"), None)
    if vectors is not None:
        return vectors, ""
    for info in channels:
        if info["kind"] == "vector" and re.match("^magnetic", str(info["title"]), re.I):
            unit = next(iter(_units(info)), "")
            words = "in arbitrary units (a.u.)" if unit in ("a.u.", "") else f"in {unit}"
            return None, f"The device sends its magnetic field {words}, which cannot be converted to tesla."
    return None, ""


def _velocity(channels: Sequence[Info]) -> Place | None:
    vectors = list(_vectors(channels, "^velocity$", "velocity"))
    world = [one for one in vectors if one.frame in WORLD_FRAMES]
    body = [one for one in vectors if not one.frame]
    return next(iter(world + body), None)


def _speed(channels: Sequence[Info]) -> SpeedPlaces | None:
    """A record with columns for north, east and down, else a vector; one with an accuracy comes first."""
    places = []
    for info in channels:
        columns = tuple(_column(info, pattern) for pattern in _NORTH_EAST_DOWN)
        if info["kind"] == "record" and min(columns) >= 0 and info["columns"][columns[0]]["unit"] == "m/s":
            places.append(Place(int(info["id"]), columns, str(info["message"]), 1.0, "NED"))
    vectors = _vectors(channels, "^velocity$", "velocity")
    places += [one for one in vectors if one.frame in (*WORLD_FRAMES, "ECEF")]
    speeds = []
    for place in places:
        same = [info for info in channels if info["message"] == place.message]
        speeds.append(SpeedPlaces(place, _number(same, _SPEED, "velocity")))
    return min(speeds, key=lambda one: one.accuracy is None, default=None)


def _scalar(channels: Sequence[Info], title: str, quantity: str) -> Place | None:
    """A scalar of that title, or a column of a record with that name."""
    for info in channels:
        unit = str(info["unit"])
        if info["kind"] == "scalar" and re.match(title, str(info["title"]), re.I) and unit in TO_SI[quantity]:
            return Place(int(info["id"]), (0,), str(info["message"]), TO_SI[quantity][unit])
    for info in channels:
        for at, column in enumerate(info["columns"]) if info["kind"] == "record" else ():
            unit = str(column["unit"])
            if re.match(title, str(column["name"]), re.I) and unit in TO_SI[quantity]:
                return Place(int(info["id"]), (at,), str(info["message"]), TO_SI[quantity][unit])
    return None


def _column(info: Info, pattern: re.Pattern[str]) -> int:
    return next((at for at, column in enumerate(info["columns"]) if pattern.match(str(column["name"]))), -1)


def _fix(channels: Sequence[Info]) -> GnssPlaces | None:
    places: list[tuple[bool, GnssPlaces]] = []
    for info in channels:
        words = f"{info['group']} {info['title']}"
        lat, lon = _column(info, _LATITUDE), _column(info, _LONGITUDE)
        if info["kind"] == "table" or lat < 0 or lon < 0 or _NOT_ITS_OWN.search(words):
            continue
        place = Place(int(info["id"]), (lat, lon), str(info["message"]))
        same = [info, *(one for one in channels if one["message"] == info["message"] and one is not info)]
        fix, invalid = _fix_type(same)
        places.append(
            (
                not _RECEIVER.search(words),
                GnssPlaces(
                    place,
                    _number(same, _HEIGHT),
                    _number(same, _HORIZONTAL),
                    _number(same, _VERTICAL),
                    fix,
                    invalid,
                ),
            )
        )
    return min(places, key=lambda one: one[0])[1] if places else None


def _number(channels: Sequence[Info], pattern: re.Pattern[str], quantity: str = "length") -> Place | None:
    """A column of a quantity, or a scalar of that name."""
    for info in channels:
        if info["kind"] == "table":
            continue
        at = 0 if info["kind"] == "scalar" and pattern.match(str(info["name"])) else _column(info, pattern)
        if at < 0:
            continue
        unit = str(info["columns"][at]["unit"]) or str(info["unit"])
        if unit in TO_SI[quantity]:
            return Place(int(info["id"]), (at,), str(info["message"]), TO_SI[quantity][unit])
    return None


def _fix_type(channels: Sequence[Info]) -> tuple[Place | None, tuple[int, ...]]:
    for info in channels:
        at = _column(info, _FIX)
        if at >= 0 and info["kind"] != "table":
            choices = info["columns"][at].get("choices", {})
            none = re.compile(r"no fix|invalid|time only|dead reckoning only", re.I)
            invalid = tuple(int(value) for value, meaning in choices.items() if none.search(str(meaning)))
            return Place(int(info["id"]), (at,), str(info["message"])), invalid
    return None, ()


def _utc(channels: Sequence[Info]) -> UtcPlaces | None:
    for info in channels:
        names = [str(column["name"]).lower() for column in info["columns"]]
        if info["kind"] == "table":
            continue
        is_receiver = bool(_RECEIVER.search(f"{info['group']} {info['title']}"))
        parts = [next((at for at, name in enumerate(names) if name.startswith(part)), -1) for part in _DATE]
        if min(parts) >= 0:
            nano = next((at for at, name in enumerate(names) if name in ("nano", "ns", "nanosecond")), -1)
            valid = next((at for at, name in enumerate(names) if name in ("valid", "flags")), -1)
            return UtcPlaces(
                Place(int(info["id"]), tuple(parts), str(info["message"])), "utc", nano, valid, is_receiver
            )
        if {"week", "timeofweekms", "leaps"} <= set(names):
            columns = tuple(names.index(name) for name in ("week", "timeofweekms", "leaps"))
            return UtcPlaces(Place(int(info["id"]), columns, str(info["message"])), "gps", is_receiver=is_receiver)
    return None
