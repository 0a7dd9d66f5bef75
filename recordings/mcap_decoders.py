"""Decoders for MCAP messages of other programs, chosen by the schema in the file.

    json                       self-describing
    protobuf   protobuf        a FileDescriptorSet: foxglove.* and any other
    cdr        ros2msg         the text of its definition: sensor_msgs/msg/Imu and everything in a ROS 2 bag

A number within messages and short arrays is a column: angular_velocity.x, orientation_covariance.0. Text, bytes and
long arrays (images, clouds) are not. The time of measurement is header.stamp, stamp or timestamp, if present.

The libraries are loaded when such a file is opened. Schemas and messages come from outside: invalid ones give no
reader, or no numbers.

Source: MCAP well-known encodings, mcap.dev/spec/registry; units: ROS REP 103 and the definitions in sensor_msgs.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from recordings.mcap_reader import McapChannel
from recordings.tolerant_json import loads

LONGEST_ARRAY = 16
DEEPEST = 8
STAMPS = ("header.stamp", "stamp", "timestamp")
UNITS: Mapping[str, Mapping[str, str]] = {
    "sensor_msgs/msg/Imu": {"angular_velocity": "rad/s", "linear_acceleration": "m/s²"},
    "sensor_msgs/msg/MagneticField": {"magnetic_field": "T"},
    "sensor_msgs/msg/FluidPressure": {"fluid_pressure": "Pa"},
    "sensor_msgs/msg/Temperature": {"temperature": "°C"},
    "sensor_msgs/msg/NavSatFix": {"latitude": "°", "longitude": "°", "altitude": "m"},
    "geometry_msgs/msg/TwistStamped": {"twist.linear": "m/s", "twist.angular": "rad/s"},
}
_SENSELESS = (ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError, RecursionError, struct.error)
_EMPTY_SECTION = re.compile(r"(?:^|\n)MSG:[^\n]*\n(?:[ \t]*(?:#[^\n]*)?(?:\n|$))*(?:=|$)")


@dataclass(slots=True)
class NumericMessage:
    """The numbers of one message by their path, and its time of measurement, unix s; NaN if absent.

    Args:
        rows: the rows of a table of a moment ({"rows": [{…}, …]}, as satellites in our own exports).
    """

    stamp: float = math.nan
    of: dict[str, float] = field(default_factory=dict)
    rows: list[NumericMessage] = field(default_factory=list)

    def put(self, path: str, value: Any) -> None:
        """Store one value, if it is a number."""
        if isinstance(value, bool | int | float):
            self.of[path or "value"] = float(value)

    def stamped(self, path: str, seconds: float, nanoseconds: float) -> None:
        """Store a time: the time of measurement if the path says so, else a number like others."""
        moment = seconds + nanoseconds / 1e9
        if path in STAMPS:
            self.stamp = moment if moment > 0 else math.nan
        else:
            self.of[path] = moment


MessageReader = Callable[[bytes], NumericMessage]


def reader_of(topic: McapChannel) -> MessageReader | None:
    """Decoder for the messages of a channel; None if their encoding is unknown."""
    maker = _MAKERS.get((topic.encoding, topic.schema_encoding if topic.encoding != "json" else ""))
    try:
        read = maker(topic) if maker is not None else None
    except _SENSELESS:
        return None
    if read is None:
        return None

    def safe(data: bytes) -> NumericMessage:
        try:
            return read(data)
        except _SENSELESS:
            return NumericMessage()

    return safe


def unit_of(topic: McapChannel, path: str) -> str:
    """The unit of a number, if the message type defines it."""
    known = UNITS.get(topic.schema, {})
    return next((unit for name, unit in known.items() if path == name or path.startswith(f"{name}.")), "")


def _json(topic: McapChannel) -> MessageReader:
    def walk(value: Any, path: str, depth: int, found: NumericMessage) -> NumericMessage:
        for name, inside in _inside(value) if depth < DEEPEST else ():
            walk(inside, f"{path}.{name}" if path else name, depth + 1, found)
        found.put(path, value)
        return found

    def read(data: bytes) -> NumericMessage:
        value = loads(data)
        rows = value["rows"] if isinstance(value, dict) and value.keys() == {"rows"} else None
        if isinstance(rows, list) and rows and all(isinstance(row, dict) for row in rows):
            return NumericMessage(rows=[walk(row, "", 0, NumericMessage()) for row in rows])
        return walk(value, "", 0, NumericMessage())

    return read


def _inside(value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        yield from value.items()
    elif isinstance(value, list) and len(value) <= LONGEST_ARRAY:
        yield from ((str(number), one) for number, one in enumerate(value))


def _ros2(topic: McapChannel) -> MessageReader | None:
    from mcap.records import Schema
    from mcap_ros2.decoder import DecoderFactory

    text = topic.schema_data.decode()
    if _EMPTY_SECTION.search(text) or not all(c.isprintable() or c in "\n\r\t" for c in text):
        return None  # an array of empty elements has any length in no bytes; and errors in the text are printed
    schema = Schema(id=1, data=topic.schema_data, encoding="ros2msg", name=topic.schema)
    try:
        decode = DecoderFactory().decoder_for("cdr", schema)
    except Exception as error:  # the parser raises a dozen types without a common base
        raise ValueError(str(error)) from None
    if decode is None:
        return None

    def read(data: bytes) -> NumericMessage:
        found = NumericMessage()

        def walk(value: Any, path: str, depth: int) -> None:
            names = getattr(value, "__slots__", None)
            if depth > DEEPEST:
                return
            if isinstance(value, list | tuple):
                for number, one in enumerate(value if len(value) <= LONGEST_ARRAY else ()):
                    walk(one, f"{path}.{number}" if path else str(number), depth + 1)
            elif names is None:
                found.put(path, value)
            elif tuple(names) == ("sec", "nanosec"):
                found.stamped(path, value.sec, value.nanosec)
            else:
                for name in names:
                    walk(getattr(value, name), f"{path}.{name}" if path else name, depth + 1)

        walk(decode(data), "", 0)
        return found

    return read


def _protobuf(topic: McapChannel) -> MessageReader:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from google.protobuf.message import DecodeError

    try:
        files = descriptor_pb2.FileDescriptorSet.FromString(topic.schema_data)
    except DecodeError as error:
        raise ValueError(str(error)) from None
    pool = descriptor_pool.DescriptorPool()
    for file in _in_order({file.name: file for file in files.file}):
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(topic.schema))

    def read(data: bytes) -> NumericMessage:
        found = NumericMessage()
        try:
            _fields(kind.FromString(data), "", 0, found)
        except DecodeError:
            return NumericMessage()
        return found

    return read


def _in_order(files: Mapping[str, Any]) -> list[Any]:
    """Each file after its dependencies."""
    done: dict[str, Any] = {}

    def visit(name: str, depth: int) -> None:
        if name in done or name not in files or depth > len(files):
            return
        for needed in files[name].dependency:
            visit(needed, depth + 1)
        done[name] = files[name]

    for name in files:
        visit(name, 0)
    return list(done.values())


def _fields(message: Any, path: str, depth: int, found: NumericMessage) -> None:
    """The numbers of a protobuf message, including unset ones, which are zero."""
    if depth > DEEPEST:
        return
    for one in message.DESCRIPTOR.fields:
        inner = f"{path}.{one.name}" if path else one.name
        if one.message_type is not None and one.message_type.GetOptions().map_entry:
            continue
        value = getattr(message, one.name)
        if one.is_repeated:
            values = list(enumerate(value)) if len(value) <= LONGEST_ARRAY else []
        elif one.message_type is not None and not message.HasField(one.name):
            continue
        else:
            values = [(-1, value)]
        for number, item in values:
            place = inner if number < 0 else f"{inner}.{number}"
            if one.message_type is None:
                found.put(place, item)
            elif one.message_type.full_name in ("google.protobuf.Timestamp", "google.protobuf.Duration"):
                found.stamped(place, item.seconds, item.nanos)
            else:
                _fields(item, place, depth + 1, found)


_MAKERS: Mapping[tuple[str, str], Callable[[McapChannel], MessageReader | None]] = {
    ("json", ""): _json,
    ("protobuf", "protobuf"): _protobuf,
    ("cdr", "ros2msg"): _ros2,
}
