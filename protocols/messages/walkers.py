"""Numbers of one JSON or protobuf message, by their path.

A number within messages and short arrays has a path: angular_velocity.x, noise.0. Text, bytes and long arrays have not.
The time of measurement is header.stamp, stamp or timestamp, if present. Messages come from outside: parts that cannot
be read is a ValueError.
"""

import json
import math
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

LONGEST_ARRAY = 16
MAX_DEPTH = 8
STAMPS = ("header.stamp", "stamp", "timestamp")
SENSELESS = (ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError, RecursionError, struct.error)


@dataclass(slots=True)
class NumericMessage:
    """The numbers of one message by their path, and its time of measurement, ns since 1970; 0 if absent.

    Args:
        rows: the rows of a table of a moment ({"rows": [{…}, …]}, as satellites in our own messages).
    """

    stamp_ns: int = 0
    of: dict[str, float] = field(default_factory=dict)
    rows: "list[NumericMessage]" = field(default_factory=list)

    def put(self, path: str, value: Any) -> None:
        """Store one value, if it is a number."""
        if isinstance(value, bool | int | float):
            self.of[path or "value"] = float(value)

    def put_time(self, path: str, seconds: float, nanoseconds: float) -> None:
        """Store a time: the time of measurement if the path says so, else a number like others."""
        if path in STAMPS:
            if math.isfinite(seconds) and math.isfinite(nanoseconds):
                self.stamp_ns = max(0, int(seconds) * 1_000_000_000 + int(nanoseconds))
        else:
            self.of[path] = seconds + nanoseconds / 1e9


MessageReader = Callable[[bytes], NumericMessage]


def json_reader() -> MessageReader:
    """Reader of JSON messages, which need no schema."""

    def walk(value: Any, path: str, depth: int, message: NumericMessage) -> NumericMessage:
        if isinstance(value, dict) and path and value.keys() in ({"sec", "nsec"}, {"sec", "nanosec"}):
            seconds, nanoseconds = (one for _, one in sorted(value.items(), key=lambda item: item[0] != "sec"))
            if isinstance(seconds, int | float) and isinstance(nanoseconds, int | float):
                message.put_time(path, seconds, nanoseconds)
                return message
        for name, inside in _inside(value) if depth < MAX_DEPTH else ():
            walk(inside, f"{path}.{name}" if path else name, depth + 1, message)
        message.put(path, value)
        return message

    def read(data: bytes) -> NumericMessage:
        value = json.loads(data)
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


def protobuf_reader(name: str, schema: bytes) -> MessageReader:
    """Reader of protobuf messages.

    Args:
        name: of the message type.
        schema: a FileDescriptorSet.

    Raises:
        ValueError or another of SENSELESS: the schema is invalid.
    """
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from google.protobuf.message import DecodeError

    try:
        files = descriptor_pb2.FileDescriptorSet.FromString(schema)
    except DecodeError as error:
        raise ValueError(str(error)) from None
    pool = descriptor_pool.DescriptorPool()
    for file in _in_order({file.name: file for file in files.file}):
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(name))

    def read(data: bytes) -> NumericMessage:
        numbers = NumericMessage()
        try:
            _fields(kind.FromString(data), "", 0, numbers)
        except DecodeError as error:
            raise ValueError(str(error)) from None
        return numbers

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


def _fields(message: Any, path: str, depth: int, numbers: NumericMessage) -> None:
    """The numbers of a protobuf message, including unset ones, which are zero."""
    if depth > MAX_DEPTH:
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
                numbers.put(place, item)
            elif one.message_type.full_name in ("google.protobuf.Timestamp", "google.protobuf.Duration"):
                numbers.put_time(place, item.seconds, item.nanos)
            else:
                _fields(item, place, depth + 1, numbers)
