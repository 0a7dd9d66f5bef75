"""Messages of every common ROS 2 type with random content: the numbers that rosbags has put into them."""

from random import Random
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from imuscope.protocols.messages.decoder import STAMPS, reader_of
from imuscope.protocols.messages.records import MessageChannel
from tests.server.links import rosbags_messages as ros
from tests.support.each_row import each_row

PACKAGES = ("sensor_msgs", "geometry_msgs", "nav_msgs", "std_msgs", "diagnostic_msgs", "trajectory_msgs", "stereo_msgs")
EMPTY = "std_msgs/msg/Empty"  # on the wire it has a byte that its definition does not have
TYPES = [name for name in ros.STORE.fielddefs if name.split("/")[0] in PACKAGES and name != EMPTY]
NUMBERS = {"bool", "byte", "char", "octet", *(f"{u}int{size}" for u in ("", "u") for size in (8, 16, 32, 64))}
MAX_SHOWN = 16


def value_of(definition: Any, random: Random, numbers: dict[str, float], path: str, shown: bool) -> Any:
    """A random value of a field; its numbers are put where the decoder must find them."""
    kind, detail = definition
    if kind == Nodetype.BASE:
        name = detail[0]
        if name == "string":
            return "abcdefgh"[: random.randrange(8)]
        value: Any = random.uniform(-9, 9) if name.startswith("float") else random.randrange(0, 100)
        value = float(np.float32(value)) if name == "float32" else bool(value % 2) if name == "bool" else value
        if shown:
            numbers[path] = float(value)
        return value
    if kind == Nodetype.NAME:
        return message_of(detail, random, numbers, path, shown)
    inner, count = (
        detail
        if kind == Nodetype.ARRAY
        else (detail[0], random.choice((0, 1, 3, 20) if detail[0][0] == Nodetype.BASE else (0, 1, 3)))
    )
    shown = shown and count <= MAX_SHOWN
    values = [value_of(inner, random, numbers, f"{path}.{n}", shown) for n in range(count)]
    if inner[0] == Nodetype.BASE and inner[1][0] != "string":
        name = {"byte": "uint8", "char": "uint8", "octet": "uint8"}.get(inner[1][0], inner[1][0])
        return np.array(values, dtype=name)
    return values


def message_of(name: str, random: Random, numbers: dict[str, float], path: str = "", shown: bool = True) -> Any:
    results: dict[str, float] = {}
    fields = {
        field: value_of(definition, random, results, f"{path}.{field}" if path else field, shown)
        for field, definition in ros.STORE.fielddefs[name][1]
    }
    if name in ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"):
        if shown and path not in STAMPS:
            numbers[path] = fields["sec"] + fields["nanosec"] / 1e9
    else:
        numbers.update(results)
    return ros.STORE.types[name](**fields)


@each_row("name", TYPES)
def test_numbers_of_a_type(name: str) -> None:
    channel = MessageChannel(1, "/x", "cdr", name, "ros2msg", ros.definition(name))
    read = reader_of(channel)
    assert read is not None
    for seed in range(5):
        numbers: dict[str, float] = {}
        data = ros.cdr(name, message_of(name, Random(seed), numbers))
        (results,), refused = read([data])
        assert not refused
        expected = dict(list(numbers.items())[:500])
        assert {path: float(column[0]) for path, column in results.columns.items()} == expected
