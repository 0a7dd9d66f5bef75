"""NMEA 0183 sentences: framing and fields.

A sensor's port carries NMEA 0183 sentences between, or instead of, its own frames (MT0101P 2020.A, 5.3.5):

    $ HCHDM , 123.45 , M * 2 5 CR LF
    │ └─┬─┘   └──┬───┘   └┬┘ └─┬─┘
    │   │        │        │    line end; a lone LF is taken too
    │   │        │        exclusive-or of all between $ and *, two hexadecimal digits
    │   │        fields, any width, may be empty
    │   address: talker and sentence, or P and a maker's own
    start; ! for encapsulated ones

The framing is: a start, printable characters, a line end within `MAX_SENTENCE_BYTES`, no other start between. A
sentence with a wrong checksum, or broken off, is found too, with an empty name, so that losses are counted. Fields
come from two places: `SENTENCES` below for those specific to one family of devices, pynmeagps for the rest.

Rules for editing: a new sentence is a row in `SENTENCES`. `dtype` "f8" is a number (None when the field is empty),
"i8" a whole one, "ascii" a word. Widths and decimals are free: the document contradicts itself (PSONCMS has "MM,MMMM",
XSVEL mixes 3 and 4 decimals).
"""

import datetime
import functools
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from imuscope.protocols.events import LazyMapping, ParsedMessage
from imuscope.protocols.schema.fields import Field, Message

MAX_SENTENCE_BYTES = 192  # the standard says 82; $PSONCMS needs 132
_BODY = re.compile(rb"[$!]([\x20\x22\x23\x25-\x7e]{0,188})(\r{0,2}\n)?")  # printable; \r\r\n: in text mode, twice
_ADDRESS = re.compile(rb"[$!]([A-Z][A-Z0-9]{2,9})[,*]")
_SUM = re.compile(rb"\*([0-9A-Fa-f]{2})$")
_STARTS = re.compile(rb"[$!]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)  # Python's float also accepts "1_0" and "inf"
_WHOLE = re.compile(r"[+-]?\d{1,20}", re.ASCII)
STARTS = re.compile(rb"[$!][A-Z]")  # start of anything treated as a sentence, valid or broken

_NUMBER_KINDS = frozenset({"DE", "IN", "LA", "LN"})  # types of pynmeagps
SATELLITES_OF_GSV = 4  # at most in one sentence; pynmeagps counts those that are there

SOURCE = "MT0101P 2020.A, 5.3.5 SetStringOutputType"
UNCHECKED = frozenset({"PRDID", "HEHDT"})  # without a checksum in that table; accepted with and without


def _real(name: str, unit: str = "", doc: str = "") -> Field:
    return Field(name, "f8", unit=unit, doc=doc)


def _integer(name: str, doc: str = "") -> Field:
    return Field(name, "i8", doc=doc)


def _word(name: str, doc: str) -> Field:
    return Field(name, "ascii", doc=doc)


def _xyz(name: str, unit: str) -> tuple[Field, ...]:
    return tuple(_real(name + axis, unit) for axis in "XYZ")


# ASCII messages of VectorNav sensors (VN-100, -200, -300) are framed as sentences are. Their angles describe the body
# in the frame of north, east and down; the scalar of a quaternion is its last number. A message with a 16-bit checksum
# is not one of NMEA, and counts as damaged. The spelling of names is VectorNav's.
_MANUALS = "VectorNav VN-100 user manual UM001 2.05, VN-300 user manual UM005 0.14"
_ANGLES = (_real("Yaw", "°"), _real("Pitch", "°"), _real("Roll", "°"))
_QUATERNION = tuple(_real(f"Quat{place}") for place in range(4))
_MAG, _ACCEL, _GYRO = _xyz("Mag", "G"), _xyz("Accel", "m/s²"), _xyz("Gyro", "rad/s")
_SENSORS = (*_MAG, *_ACCEL, *_GYRO)
_POSITION = (_real("Latitude", "°"), _real("Longitude", "°"), _real("Altitude", "m", "Height above the ellipsoid."))
_SPEED = (_real("VelN", "m/s"), _real("VelE", "m/s"), _real("VelD", "m/s"))
_ECEF = (*_xyz("Position", "m"), *_xyz("Velocity", "m/s"))
_WEEK = (_real("Time", "s", "Time of the GPS week."), _integer("Week", "GPS week."))
_FIX = (*_WEEK, _integer("GpsFix", "0: none, 1: time alone, 2: 2D, 3: 3D."), _integer("NumSats"))
_INS = (*_WEEK, _word("Status", "Status of the filter, in hexadecimal digits."), *_ANGLES)
_UNCERTAIN = (
    _real("AttUncertainty", "°"),
    _real("PosUncertainty", "m"),
    _real("VelUncertainty", "m/s"),
)
_ACCURACY = (_real("SpeedAcc", "m/s"), _real("TimeAcc", "s"))


def _vectornav(name: str, fields: tuple[Field, ...], doc: str) -> Message:
    return Message(0, name, fields, doc=doc, source=_MANUALS)


VECTORNAV = (
    _vectornav("VNYPR", _ANGLES, "Yaw, pitch and roll."),
    _vectornav("VNQTN", _QUATERNION, "Quaternion."),
    _vectornav("VNQMR", (*_QUATERNION, *_SENSORS), "Quaternion, magnetic field, acceleration, rate of turn."),
    _vectornav("VNMAG", _MAG, "Magnetic field."),
    _vectornav("VNACC", _ACCEL, "Acceleration."),
    _vectornav("VNGYR", _GYRO, "Rate of turn."),
    _vectornav("VNMAR", _SENSORS, "Magnetic field, acceleration, rate of turn."),
    _vectornav("VNYMR", (*_ANGLES, *_SENSORS), "Angles, magnetic field, acceleration, rate of turn."),
    _vectornav(
        "VNYBA", (*_ANGLES, *_xyz("BodyAccel", "m/s²"), *_GYRO), "Angles, true acceleration in the body's axes."
    ),
    _vectornav(
        "VNYIA", (*_ANGLES, *_xyz("InertialAccel", "m/s²"), *_GYRO), "Angles, true acceleration to north, east, down."
    ),
    _vectornav(
        "VNIMU",
        (*_SENSORS, _real("Temp", "°C"), _real("Pressure", "kPa")),
        "Magnetic field, acceleration and rate of turn without compensation by the filter; temperature, pressure.",
    ),
    _vectornav(
        "VNGPS",
        (*_FIX, *_POSITION, *_SPEED, _real("NorthAcc", "m"), _real("EastAcc", "m"), _real("VertAcc", "m"), *_ACCURACY),
        "Solution of the GNSS receiver.",
    ),
    _vectornav("VNGPE", (*_FIX, *_ECEF, *_xyz("PosAcc", "m"), *_ACCURACY), "Solution of the GNSS receiver, ECEF."),
    _vectornav("VNINS", (*_INS, *_POSITION, *_SPEED, *_UNCERTAIN), "Navigation solution."),
    _vectornav("VNINE", (*_INS, *_ECEF, *_UNCERTAIN), "Navigation solution, ECEF."),
    _vectornav("VNISL", (*_ANGLES, *_POSITION, *_SPEED, *_ACCEL, *_GYRO), "Navigation solution and sensors."),
    _vectornav("VNISE", (*_ANGLES, *_ECEF, *_ACCEL, *_GYRO), "Navigation solution and sensors, ECEF."),
    _vectornav(
        "VNDTV",
        (_real("DeltaTime", "s"), *_xyz("DeltaTheta", "°"), *_xyz("DeltaVel", "m/s")),
        "Increments of rotation and velocity, and the time that they span.",
    ),
)


def _nmea(number: int, name: str, doc: str, *fields: Field) -> Message:
    return Message(number, name, fields, doc=doc, source=SOURCE)


PAIRS: dict[str, tuple[str, str]] = {}  # see add_sentences
SENTENCES: dict[str, Message] = {
    row.name: row
    for row in (
        _nmea(
            3,
            "PHTRO",
            "Pitch and roll.",
            _real("pitch", "°"),
            _word("pitchSide", "M: bow up, P: bow down"),
            _real("roll", "°"),
            _word("rollSide", "B: port down; the other letter is garbled in the document, T: port up"),
        ),
        _nmea(
            4,
            "PRDID",
            "Pitch, roll and true heading.",
            _real("pitch", "°", "Bow up is positive."),
            _real("roll", "°", "Port up is positive."),
            _real("headingT", "°"),
        ),
        _nmea(
            6,
            "PSONCMS",
            "Quaternion, acceleration, rate of turn, magnetic field, temperature.",
            *(_real(f"q{i}", "") for i in range(4)),
            *_xyz("acc", "m/s²"),
            *_xyz("gyr", "rad/s"),
            *_xyz("mag", "a.u."),
            _real("temp", "°C"),
        ),
        _nmea(
            11,
            "PTCF",
            "Heading, roll, pitch and their rates.",
            _real("heading", "°"),
            _word("headingRef", "T: true north"),
            _real("roll", "°"),
            _real("pitch", "°"),
            _real("rollRate", "°/s"),
            _real("pitchRate", "°/s"),
        ),
        _nmea(12, "XSVEL", "Velocity.", *_xyz("vel", "m/s")),
        *VECTORNAV,
    )
}


def find_nmea(data: bytes | memoryview, *, final: bool) -> tuple[list[ParsedMessage], int]:
    """All sentences in `data`, a stretch without frames of another protocol.

    Args:
        final: no data follows; incomplete sentences will never be completed.

    Returns:
        the sentences in order, and the position from which bytes must be kept because a sentence there may be
        incomplete (the length of `data` if none is).
    """
    data = bytes(data)
    messages: list[ParsedMessage] = []
    at = 0
    while start := _STARTS.search(data, at):
        begin = start.start()
        body = _BODY.match(data, begin)
        assert body is not None
        if body.group(2):
            end = body.end()
            if sentence := _sentence(data[begin:end], begin):
                messages.append(sentence)
        else:
            end = body.end(1)
            left = len(data) - end
            cut_short = left == 0 or (left <= 2 and data[end:] == b"\r" * left)
            if cut_short and end - begin <= MAX_SENTENCE_BYTES - 4 and not final:
                return messages, begin
            if _ADDRESS.match(data, begin):
                messages.append(ParsedMessage(begin, end - begin, "nmea", "", _text(data[begin:end])))
        at = max(end, begin + 1)
    return messages, len(data)


def _sentence(raw: bytes, offset: int) -> ParsedMessage | None:
    """A whole line, checked and read. None for a line that only starts like a sentence."""
    line = raw.rstrip(b"\r\n")
    address = _ADDRESS.match(line + b",")
    if not address:
        return None
    name = address.group(1).decode("ascii")
    total = _SUM.match(line, max(len(line) - 3, 0))
    if total:
        content = line[1 : total.start()]
        good = checksum(content) == int(total.group(1), 16)
    else:
        content = line[1:]
        good = name in UNCHECKED
    if not good:
        return ParsedMessage(offset, len(raw), "nmea", "", _text(line))
    read = functools.partial(_own, name, content) if name in SENTENCES else functools.partial(_standard, line, content)
    fields = LazyMapping(read)
    return ParsedMessage(offset, len(raw), "nmea", name, _text(line), fields)


def checksum(content: bytes) -> int:
    """Exclusive-or of the bytes between start and asterisk: computed as one long number, halved until a byte is
    left.
    """
    total = int.from_bytes(content, "big")
    shift = 8 << max(len(content) - 1, 1).bit_length()
    while shift > 8:
        shift >>= 1
        total ^= total >> shift
    return total & 0xFF


def sentence(text: str) -> bytes:
    """A line of NMEA 0183: `text` is the part between $ and *."""
    return f"${text}*{checksum(text.encode()):02X}\r\n".encode()


def add_sentences(rows: Iterable[Message], pairs: Mapping[str, tuple[str, str]]) -> None:
    """Register sentences specific to one family of devices.

    Args:
        rows: their fields, in order.
        pairs: names of those that end in a variable number of pairs: id_1, period_1, id_2 …
    """
    SENTENCES.update((row.name, row) for row in rows)
    PAIRS.update(pairs)


def _own(name: str, content: bytes) -> dict[str, Any]:
    """Values of a sentence from the table; missing fields are left out, surplus ones kept."""
    words = _text(content).split(",")[1:]
    values: dict[str, Any] = {}
    for row, word in zip(SENTENCES[name].fields, words, strict=False):
        values[row.name] = word.strip() if row.dtype == "ascii" else _number_of(row, word)
    count = len(SENTENCES[name].fields)
    pair = PAIRS.get(name)
    for index in range(count, len(words)):
        if pair:
            values[f"{pair[(index - count) % 2]}_{(index - count) // 2 + 1}"] = _whole(words[index])
        else:
            values[f"field_{index + 1:02d}"] = words[index]
    return values


def _number_of(row: Field, word: str) -> float | int | None:
    return number_of(word) if row.dtype == "f8" else _whole(word)


def _whole(word: str) -> int | None:
    return int(word) if _WHOLE.fullmatch(word.strip()) else None


def number_of(word: str) -> float | None:
    """The number of a word; None if it is not one, or not finite ("nan" is not a measurement)."""
    value = float(word) if _NUMBER.fullmatch(word.strip()) else math.nan
    return value if math.isfinite(value) else None


def _standard(line: bytes, content: bytes) -> dict[str, Any]:
    """Values of a standard sentence, read by pynmeagps; latitude and longitude in signed degrees."""
    import pynmeagps  # here, because it takes 60 ms, unneeded without sentences
    from pynmeagps import exceptions

    bad = (exceptions.NMEAMessageError, exceptions.NMEAParseError, exceptions.NMEATypeError, exceptions.NMEAStreamError)
    try:
        message = pynmeagps.NMEAReader.parse(line + b"\r\n", validate=0)
    except (*bad, ValueError, LookupError, TypeError, AttributeError, ArithmeticError):
        message = None  # the checksum is right, so the sentence counts; its words are kept as they are
    if message is None:
        return {f"field_{i:02d}": word or None for i, word in enumerate(_text(content).split(",")[1:], 1)}
    return {name: _plain(value) for name, value in vars(message).items() if not name.startswith("_")}


@functools.lru_cache(maxsize=256)
def number_names(name: str, word: str) -> tuple[str, ...]:
    """Names of the numbers that a sentence has room for, whether or not it fills them; none if no table has it.

    Args:
        word: its first field, which is a part of the address of some makers' sentences.
    """
    if name in SENTENCES:
        return tuple(row.name for row in SENTENCES[name].fields if row.dtype != "ascii")
    from pynmeagps import NMEA_PAYLOADS_GET
    from pynmeagps.nmeatypes_get_prop import NMEA_PAYLOADS_GET_PROP

    makers = NMEA_PAYLOADS_GET_PROP.get(f"{name[1:]}{word}".upper()) or NMEA_PAYLOADS_GET_PROP.get(name[1:])
    names: list[str] = []
    for field, kind in ((makers if name.startswith("P") else NMEA_PAYLOADS_GET.get(name[2:])) or {}).items():
        if isinstance(kind, str):
            names += [field] if kind in _NUMBER_KINDS else []
            continue
        times, group = kind
        if name.endswith("GSV"):
            times = SATELLITES_OF_GSV
        elif not isinstance(times, int):
            times = 0 if times == "None" else MAX_SENTENCE_BYTES // (2 * len(group))  # more do not fit into a line
        names += [f"{one}_{i:02d}" for i in range(1, times + 1) for one in group if group[one] in _NUMBER_KINDS]
    return tuple(names)


def _plain(value: Any) -> Any:
    """Numbers and words only: times and dates as ISO 8601, an empty field or a number that is not finite as None."""
    if isinstance(value, datetime.time | datetime.date):
        return value.isoformat()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return None if value == "" else value


def _text(raw: bytes) -> str:
    return raw.decode("ascii", "replace")
