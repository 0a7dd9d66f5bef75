"""Quantities in NMEA sentences: their numbers, combined into batches of a message for plots.

    $PSONCMS,0.99,0.01,…,9.81,…*hh     q0 q1 q2 q3 │ accX accY accZ │ gyrX … │ magX … │ temp
                                       Quaternion  │ Acceleration   │ …      │ …      │ Temperature
    $HCHDM,354.0,M*hh                  headingM, 0 … 360°: a quantity that wraps

A sentence gives names and numbers (protocols/embedded/nmea.py, protocols/xbus/binary_strings.py); this module assigns
quantities by name, for any sentence. Numbers along axes are one quantity, as in a device's own messages: an orientation
is drawn as one. A name that is not listed is shown unchanged.

The columns of a message follow from its definition, never from the fields that are filled: a receiver without a fix
leaves most of them empty, and one at rest its course. An empty field is NaN.

The numbers of a sentence that no table knows are shown by their places, field_01, field_02 …, without units. If its
first field is a word ($PIXSE,ATITUD,…), this is part of the name: other words there mean other numbers. So are the
names of the transducers in a sentence XDR.

A number whose sign is a letter in the next field gets it here: `$PHTRO,10.37,P` is a pitch of −10.37°. The sentence
itself keeps both as on the wire.

Rules for editing: a new quantity is a row of `TOGETHER` (several numbers) or `ALONE` (one).
Sources: MT0101P 2020.A, 5.3.5; NMEA 0183 names as pynmeagps spells them.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from imuscope.protocols.embedded.nmea import SENTENCES, number_names, number_of
from imuscope.protocols.embedded.ubx_content import TAG, fields_of, samples_of
from imuscope.protocols.events import Batch, Text
from imuscope.protocols.schema.fields import Field, Message

_XYZ = ("x", "y", "z")
_NED = ("north", "east", "down")
_EULER = ("roll", "pitch", "yaw")
_SIDES = re.compile(r"NS|EW|^dirs$|^dirvar$|(steer|rudder)dir$|Side$")  # fields with the direction of the number before
_NEGATIVE = frozenset("SWLPB")  # south, west, left (port); in PHTRO bow down and port down
_ABOUT_FRAME = {"class", "id", "number", "length"}  # of a UBX or RTCM message whose content is not read
UNNAMED = "field_01"  # of a sentence that no table knows
_WORD = re.compile(r"[A-Za-z][A-Za-z0-9]{1,9}")
_UNKNOWN = "imuscope does not know this sentence: its numbers are shown by their places."
_TICKS = "All samples of a message have its time; sTtag counts ticks of the sensor, whose length is not documented."
_ABSENT = frozenset({"", "nan", "-nan", "inf", "-inf", "-", "--", "n/a"})  # cells of a number that there is not
_MAX_KINDS = 256  # kinds of sentences remembered: a healthy port has a dozen


def _vector(
    name: str, unit: str, decimals: int, axes: tuple[str, ...] = _XYZ, *, title: str = "", frame: str = ""
) -> Field:
    return Field(name, "f8", (3,), unit=unit, axes=axes, decimals=decimals, title=title, frame=frame)


TOGETHER: Mapping[tuple[str, ...], Field] = {
    ("q0", "q1", "q2", "q3"): Field(
        "Quaternion", "f8", (4,), axes=("q0", "q1", "q2", "q3"), decimals=4, doc="Orientation, scalar first."
    ),
    ("accX", "accY", "accZ"): _vector("Acceleration", "m/s²", 3),
    ("gyrX", "gyrY", "gyrZ"): _vector("RateOfTurn", "rad/s", 4, title="Rate of turn"),
    ("magX", "magY", "magZ"): _vector("MagneticField", "a.u.", 4, title="Magnetic field"),
    ("velX", "velY", "velZ"): _vector("Velocity", "m/s", 3),
    ("velN", "velE", "velD"): _vector("VelocityNED", "m/s", 3, _NED, title="Velocity", frame="NED"),
    ("xAccel", "yAccel", "zAccel"): _vector("Acceleration", "m/s²", 2),
    ("accelX", "accelY", "accelZ"): _vector("Acceleration", "m/s²", 3),
    ("xAngRate", "yAngRate", "zAngRate"): _vector("RateOfTurn", "°/s", 3, title="Rate of turn"),
    ("gyroX", "gyroY", "gyroZ"): _vector("RateOfTurn", "°/s", 3, title="Rate of turn"),
    ("pqrX", "pqrY", "pqrZ"): _vector("RateOfTurn", "rad/s", 4, title="Rate of turn", frame="body"),
    ("uvwX", "uvwY", "uvwZ"): _vector("Velocity", "m/s", 3, frame="body"),
    ("nedN", "nedE", "nedD"): _vector("LocalPosition", "m", 3, _NED, title="Local position", frame="NED"),
    ("thetaRoll", "thetaPitch", "thetaYaw"): _vector("EulerAngles", "rad", 4, _EULER, title="Euler angles"),
    ("dthetaX", "dthetaY", "dthetaZ"): _vector("RotationIncrement", "rad", 4, title="Rotation increment"),
    ("dvelX", "dvelY", "dvelZ"): _vector("VelocityIncrement", "m/s", 4, title="Velocity increment"),
    ("Roll", "Pitch", "Yaw"): _vector("EulerAngles", "°", 2, _EULER, title="Euler angles", frame="NED from body"),
    ("Quat3", "Quat0", "Quat1", "Quat2"): Field(
        "Quaternion", "f8", (4,), axes=("w", "x", "y", "z"), decimals=4, frame="NED from body", doc="Orientation."
    ),
    ("MagX", "MagY", "MagZ"): _vector("MagneticField", "G", 4, title="Magnetic field", frame="body"),
    ("AccelX", "AccelY", "AccelZ"): _vector("Acceleration", "m/s²", 3, frame="body"),
    ("BodyAccelX", "BodyAccelY", "BodyAccelZ"): _vector(
        "TrueAcceleration", "m/s²", 3, title="True acceleration", frame="body"
    ),
    ("InertialAccelX", "InertialAccelY", "InertialAccelZ"): _vector(
        "TrueAccelerationNED", "m/s²", 3, _NED, title="True acceleration", frame="NED"
    ),
    ("GyroX", "GyroY", "GyroZ"): _vector("RateOfTurn", "rad/s", 4, title="Rate of turn", frame="body"),
    ("DeltaThetaX", "DeltaThetaY", "DeltaThetaZ"): _vector(
        "RotationIncrement", "°", 3, title="Rotation increment", frame="body"
    ),
    ("DeltaVelX", "DeltaVelY", "DeltaVelZ"): _vector(
        "VelocityIncrement", "m/s", 3, title="Velocity increment", frame="body"
    ),
    ("VelN", "VelE", "VelD"): _vector("VelocityNED", "m/s", 3, _NED, title="Velocity", frame="NED"),
    ("PositionX", "PositionY", "PositionZ"): _vector("Position", "m", 3, frame="ECEF"),
    ("VelocityX", "VelocityY", "VelocityZ"): _vector("Velocity", "m/s", 3, frame="ECEF"),
}


def _angle(title: str, period: float = 0.0) -> Field:
    return Field("", "f8", unit="°", title=title, decimals=2, period=period)


ALONE: Mapping[str, Field] = {
    "heading": _angle("Heading", 360),
    "headingT": _angle("Heading, true", 360),
    "headingM": _angle("Heading, magnetic", 360),
    "cog": _angle("Course over ground", 360),
    "cogt": _angle("Course over ground, true", 360),
    "cogm": _angle("Course over ground, magnetic", 360),
    "roll": _angle("Roll"),
    "pitch": _angle("Pitch"),
    "mv": _angle("Magnetic variation"),
    "lat": Field("", "f8", unit="°", title="Latitude", decimals=7),
    "lon": Field("", "f8", unit="°", title="Longitude", decimals=7, period=360),
    "Latitude": Field("", "f8", unit="°", decimals=7),
    "Longitude": Field("", "f8", unit="°", decimals=7, period=360),
    "alt": Field("", "f8", unit="m", title="Height above sea level", decimals=2),
    "sep": Field("", "f8", unit="m", title="Geoid above the ellipsoid", decimals=2),
    "hae": Field("", "f8", unit="m", title="Height above the ellipsoid", decimals=2),
    "hMSL": Field("", "f8", unit="m", title="Height above sea level", decimals=2),
    "heave": Field("", "f8", unit="m", title="Heave", decimals=2),
    "spd": Field("", "f8", unit="kn", title="Speed over ground", decimals=2),
    "sogn": Field("", "f8", unit="kn", title="Speed over ground", decimals=2),
    "sogk": Field("", "f8", unit="km/h", title="Speed over ground, km/h", decimals=2),
    "rollRate": Field("", "f8", unit="°/s", title="Rate of roll", decimals=2),
    "pitchRate": Field("", "f8", unit="°/s", title="Rate of pitch", decimals=2),
    "temp": Field("", "f8", unit="°C", title="Temperature", decimals=1),
}


class NmeaQuantities:
    """Makes batches from the sentences of one stream, with one message for each kind of sentence."""

    def __init__(self) -> None:
        self._messages: dict[tuple[str, ...], Message] = {}
        self._places: dict[str, list[str]] = {}  # of numbers in each kind of unknown sentence

    def batches(self, texts: Iterable[Text]) -> list[Batch]:
        """One batch for each kind of sentence that contains numbers; without device time."""
        kinds: dict[tuple[str, ...], list[tuple[Text, list[float]]]] = {}
        for text in texts:
            if not text.name or text.line.startswith("!"):  # encapsulated: packed bits, such as AIS
                continue
            name, fields = text.name, text.fields
            samples = [_numbers(fields)]
            if text.protocol == "nmea" and UNNAMED in fields:
                name, samples[0] = self._unnamed(name, fields)
            elif text.protocol == "nmea":
                word = next(iter(fields.values()), "") if name.startswith("P") else ""
                columns = number_names(name, word if isinstance(word, str) else "")
                if name.endswith("XDR"):
                    name = "_".join((name, *_transducers(fields)))
                    columns = tuple(field for field in fields if field.startswith("data_"))
                if not fields.keys().isdisjoint(columns):
                    samples[0] = {**dict.fromkeys(columns, math.nan), **samples[0]}
            elif text.protocol == "ubx":
                samples = samples_of(name, fields) or samples
            for numbers in samples:
                if numbers.keys() - _ABOUT_FRAME:
                    kinds.setdefault((text.protocol, name, *numbers), []).append((text, list(numbers.values())))
        return [self._batch(kind, rows) for kind, rows in kinds.items()]

    def _unnamed(self, name: str, fields: Mapping[str, Any]) -> tuple[str, dict[str, float]]:
        """Name and numbers of a sentence that no table knows; NaN where one had a number before and is empty now."""
        word = fields[UNNAMED] or ""
        kind = f"{name}_{word}" if _WORD.fullmatch(word) else name
        numbers = {place: number for place, cell in fields.items() if (number := number_of(cell or "")) is not None}
        empty = {place for place, cell in fields.items() if (cell or "").strip().lower() in _ABSENT}
        if kind not in self._places and len(self._places) >= _MAX_KINDS:
            self._places.clear()
        places = self._places.setdefault(kind, sorted(empty) if numbers else [])
        places += sorted(numbers.keys() - set(places))
        return kind, {place: numbers.get(place, math.nan) for place in sorted(places)} if numbers else {}

    def _batch(self, kind: tuple[str, ...], rows: Sequence[tuple[Text, list[float]]]) -> Batch:
        if kind not in self._messages:
            if len(self._messages) >= _MAX_KINDS:
                self._messages.clear()
            self._messages[kind] = _message(kind)
        table = np.array([numbers for _, numbers in rows])
        at = {name: i for i, name in enumerate(kind[2:])}
        columns = {name: table[:, i] for name, i in at.items()}
        for names, field in TOGETHER.items():
            if at.keys() >= set(names):
                columns[field.name] = table[:, [at[name] for name in names]]
        message = self._messages[kind]
        return Batch(
            message=message,
            device="",
            arrival_ns=np.array([text.arrival_ns for text, _ in rows], np.int64),
            offset=np.array([text.offset for text, _ in rows], np.int64),
            time_ns=None,
            columns={field.name: columns[field.name] for field in message.fields},
        )


def _message(kind: tuple[str, ...]) -> Message:
    protocol, name, *names = kind
    whole = [(group, field) for group, field in TOGETHER.items() if set(group) <= set(names)]
    in_groups = {one for group, _ in whole for one in group}
    fields = [field for _, field in whole]
    own = {field.name: field for field in SENTENCES[name].fields} if name in SENTENCES else fields_of(name)
    fields += [_named(one, own.get(one)) for one in names if one not in in_groups]
    title = name if protocol == name.lower() else f"{protocol.upper()} {name}"
    apart = tuple(field.name for _, field in whole)
    about = _UNKNOWN if protocol == "nmea" and names[0].startswith("field_") else _TICKS if TAG in names else ""
    return Message(0, name, tuple(fields), separate_channels=apart, title=title, doc=about)


def _named(name: str, own: Field | None) -> Field:
    """A single number: as generally known, else from the table of its sentence."""
    row = ALONE.get(name) or own or Field("", "f8")
    return Field(
        name, "f8", unit=row.unit, decimals=row.decimals, period=row.period, title=row.title, doc=row.title or row.doc
    )


def _transducers(fields: Mapping[str, Any]) -> list[str]:
    """Names of the transducers in a sentence XDR, or their types."""
    places = (name.rpartition("_")[2] for name in fields if name.startswith("data_"))
    return [str(fields.get(f"tdrid_{place}") or fields.get(f"tdrtype_{place}") or place) for place in places]


def _numbers(fields: Mapping[str, Any]) -> dict[str, float]:
    numbers: dict[str, float] = {}
    before = ""
    for name, value in fields.items():
        if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
            numbers[name] = float(value)
        elif before in numbers and _SIDES.search(name) and str(value).strip().upper() in _NEGATIVE:
            numbers[before] = -abs(numbers[before])  # a latitude may be signed already
        before = name
    return numbers
