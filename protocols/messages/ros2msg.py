"""Types of ROS 2 messages, from the text of their definitions as files and viewers carry it.

    std_msgs/Header header
    float64[9] orientation_covariance          a fixed array; float64[] and float64[<=5] are sequences
    uint8 FIX=0                                a constant: nothing on the wire
    ================================================================================
    MSG: std_msgs/Header
    builtin_interfaces/Time stamp
    string frame_id

The text comes from outside: an invalid one is a ValueError.

Source: ROS 2 interface definition (docs.ros.org, "About ROS 2 interfaces"); MCAP registry, "ros2msg".
"""

import re
from dataclasses import dataclass, field

PRIMITIVES = {
    **{"bool": "u1", "byte": "u1", "char": "u1", "float32": "f4", "float64": "f8"},
    **{f"{sign}int{size}": f"{(sign and 'u') or 'i'}{size // 8}" for sign in ("", "u") for size in (8, 16, 32, 64)},
}
TIMES = ("builtin_interfaces/Time", "builtin_interfaces/Duration", "time", "duration")
MAX_DEPTH = 16
MOST_TYPES = 256
LONGEST_TEXT = 1 << 20
_SEPARATOR = re.compile(r"^=+[ \t]*$", re.MULTILINE)
_FIELD = re.compile(
    r"^(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?P<array>\[(?P<bound><=)?(?P<count>\d*)\])?\s+(?P<name>[A-Za-z]\w*)(?P<rest>.*)$"
)


@dataclass(frozen=True, slots=True)
class StructField:
    """One field of a message.

    Args:
        kind: dtype code of a number ("f8"), "string", "time" (seconds and nanoseconds), or "struct".
        count: 1 for a single value; elements of a fixed array; −1 for a sequence.
        is_array: whether it is an array, of whatever count.
    """

    name: str
    kind: str
    struct: "StructType | None" = None
    count: int = 1
    is_array: bool = False


@dataclass(slots=True)
class StructType:
    """Fields of a message type, in the order of its definition."""

    name: str
    fields: tuple[StructField, ...] = field(default_factory=tuple)


def parse(name: str, text: str) -> StructType:
    """The type of a message from its definition, with all types that it contains.

    Args:
        name: of the type: "sensor_msgs/msg/Imu".

    Raises:
        ValueError: the text is not a definition, or a type is missing, unsupported, or contains itself.
    """
    if len(text) > LONGEST_TEXT:
        raise ValueError("the definition is too long")
    first, *others = _SEPARATOR.split(text)
    sections = {_short(name): first}
    for other in others:
        head, _, body = other.strip().partition("\n")
        if head.startswith("MSG:"):
            inner = _short(head.removeprefix("MSG:").strip())
            if not sections.get(inner, "").strip():
                sections[inner] = body
    return _Types(sections).type(_short(name), 0)


class _Types:
    def __init__(self, sections: dict[str, str]) -> None:
        self._sections = sections
        self._made: dict[str, StructType] = {}
        self._budget = MOST_TYPES

    def type(self, name: str, depth: int) -> StructType:
        if name in self._made:
            return self._made[name]
        self._budget -= 1
        if depth > MAX_DEPTH or self._budget < 0:
            raise ValueError(f"{name} is nested too deeply")
        package = name.rpartition("/")[0]
        lines = (line.partition("#")[0].strip() for line in self._sections[name].splitlines())
        fields = tuple(one for line in lines if line and (one := self._field(line, package, depth)) is not None)
        made = self._made[name] = StructType(name, fields)
        return made

    def _field(self, line: str, package: str, depth: int) -> StructField | None:
        match = _FIELD.match(line)
        if match is None:
            raise ValueError(f"not a field: {line!r:.80}")
        if match["rest"].lstrip().startswith("="):
            return None  # a constant
        kind, name = match["type"], match["name"]
        count = 1
        if match["array"]:
            count = int(match["count"]) if match["count"] and not match["bound"] else -1
        is_array = bool(match["array"])
        if kind in PRIMITIVES:
            return StructField(name, PRIMITIVES[kind], None, count, is_array)
        if kind == "string":
            return StructField(name, "string", None, count, is_array)
        if kind == "wstring":
            raise ValueError("wstring is not supported")  # its encoding differs between middlewares
        if _short(kind) in TIMES:
            return StructField(name, "time", None, count, is_array)
        inner = self.type(self._resolved(kind, package), depth + 1)
        return StructField(name, "struct", inner, count, is_array)

    def _resolved(self, kind: str, package: str) -> str:
        """Full name of a type as a field names it."""
        short = _short(kind)
        names = [short, f"{package}/{short}", "std_msgs/Header" if short == "Header" else ""]
        section = next((one for one in names if one in self._sections), None)
        if section is None:
            raise ValueError(f"{kind} is not defined")
        return section


def _short(name: str) -> str:
    """pkg/msg/Type → pkg/Type."""
    parts = name.split("/")
    return f"{parts[0]}/{parts[-1]}" if len(parts) > 1 else name
