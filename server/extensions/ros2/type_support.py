"""Types of ROS 2 messages: hashes, serialization. The `rosbags` library has the definitions of Jazzy.

    type_hash("sensor_msgs/msg/Imu")        RIHS01_7d9a…: the same in all distributions with the same definition
    serialize(message, type)                CDR with its encapsulation header

The library is imported on first use, which takes some 0.3 s.
"""

import functools
from typing import Any

_SEQUENCE_KINDS = ("ARRAY", "SEQUENCE")


class TypeSupportError(ValueError):
    """A type without a definition here."""


@functools.cache
def _typestore() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def is_known(type_name: str) -> bool:
    """Whether a type is defined here."""
    return type_name in _typestore().fielddefs


@functools.cache
def type_hash(type_name: str) -> str:
    """Hash of a type, as ROS writes it (REP 2011, RIHS01).

    Raises:
        TypeSupportError: an unknown type.
    """
    _check(type_name)
    return str(_typestore().hash_rihs01(type_name))


def message_class(type_name: str) -> Any:
    """The class of a type's messages, with a field for each of its definition.

    Raises:
        TypeSupportError: an unknown type.
    """
    _check(type_name)
    return _typestore().types[type_name]


@functools.cache
def fields_of(type_name: str) -> tuple[tuple[str, str, int | None], ...]:
    """The fields of a type in order: name, type of its elements, and how many: None for one, −1 for a sequence.

    Raises:
        TypeSupportError: an unknown type.
    """
    _check(type_name)
    fields = []
    for name, (kind, details) in _typestore().fielddefs[type_name][1]:
        inner, count = (
            (details[0], details[1] if kind.name == "ARRAY" else -1) if kind.name in _SEQUENCE_KINDS else (None, None)
        )
        element = (kind, details) if inner is None else inner
        fields.append((str(name), str(element[1] if element[0].name == "NAME" else element[1][0]), count))
    return tuple(fields)


def definition(type_name: str) -> str:
    """The definition with those of the types in it, as in a recording (encoding ros2msg).

    Raises:
        TypeSupportError: an unknown type.
    """
    _check(type_name)
    return str(_typestore().generate_msgdef(type_name, ros_version=2)[0])


def serialize(message: Any, type_name: str) -> bytes:
    """A message as CDR.

    Raises:
        TypeSupportError: an unknown type.
    """
    _check(type_name)
    return bytes(_typestore().serialize_cdr(message, type_name, little_endian=True))


def _check(type_name: str) -> None:
    if not is_known(type_name):
        raise TypeSupportError(f"the type {type_name} has no definition here")
