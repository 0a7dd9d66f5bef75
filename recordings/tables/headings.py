"""Headings of tables: name, unit and index of a column, and the columns that form one vector.

    Gyroscope x (rad/s)      name "Gyroscope x", unit "rad/s"
    gyro_rad[0]              a number in brackets is an index, not a unit
    w_RS_S_x [rad s^-1]      units are written as everywhere in imuscope: rad/s
    accel_x_mps2             a unit at the end of the name

Columns are grouped into channels by name: `Acceleration.x`, `acc_x` and `accX` go with their y and z, as do
`Gyroscope x`, `ax`, `x_acc`, `gyro[0]` to `gyro[2]`, and plain `x`, `y`, `z`; w goes with these three.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

AXES = ("x", "y", "z")
PLAIN = "xyz"  # name of the vector of columns that are named x, y and z only
_FRAME = re.compile(r"(ENU|NED|NWU|ECEF|WGS84|body)\b")  # of quantities, as exports name them
_HEAD = re.compile(
    r"^\s*(?P<name>.*?)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>(?:[^()]|\([^()]*\))*)\))?\s*$"  # m/(s^2) has two pairs
)
_WIDE = str.maketrans("（）［］", "()[]")
_INDEX = re.compile(r"^(?P<group>.+?)(?:\[(?P<index>\d+)\]|\((?P<round>\d+)\))$")
_AXIS = re.compile(r"^(?P<group>.+?)(?:[._/](?P<axis>[^._/]+)|(?<=[a-z])(?P<letter>[WXYZ]))$")
_LAST = re.compile(r"^(?P<group>.*?[^\s\-:/])[\s\-:/]*(?<!\s-)(?P<axis>[w-zW-Z])$")  # "a -y" is not y
_FIRST = re.compile(r"^(?P<axis>[w-zW-Z])[\s._\-:]*(?P<group>[^\s._\-:].*)$")
_MIDDLE = re.compile(r"^(?P<group>.+)[._ ](?P<axis>[w-zW-Z])(?P<after>[._ ].+)$")
_ARRAY = re.compile(r"^(?P<group>.*?[^\d.])\.?\d+$")
_AXIS_UNIT = re.compile(r"^(?P<name>.+(?:[._ ][xyz]|[a-z][XYZ]))[._ ](?P<unit>[a-zµ][a-z0-9_/^µ²]*)$", re.IGNORECASE)
_PER = re.compile(r"^(?P<what>\S+?)[ .]s\^?-(?P<power>[12])$")
_POWERS = {"1": "/s", "2": "/s²"}
_IN = re.compile(r"^in (?=\S)|'s$", re.IGNORECASE)
_SPELLINGS = (
    (re.compile(r"^m(?:ps|(?:/\(?|_|_per_)?s(?:ec)?)_?(?:(?:\^|\*\*)?2\)?|²|/s(?:ec)?)$"), "m/s²"),
    (re.compile(r"^(?:rad|radians?)(?:ps|(?:_|/|_per_)(?:s|sec|second))$"), "rad/s"),
    (re.compile(r"^(?:dps|(?:deg|degrees?)(?:ps|(?:_|/|_per_)(?:s|sec|second)))$"), "deg/s"),
    (re.compile(r"^m(?:ps|_per_s|_s)$"), "m/s"),
    (re.compile(r"^(?:deg_?c|celsius)$"), "°C"),
)
"""Units as programs write them, also as the end of a name, in lower case → unit."""
_NAMED = ("g", "mg", "ut", "uT", "µT", "gauss", "mgauss", "nT", "deg", "rad", "m", "mm")
"""Units that are one only behind an axis: accel_x_g."""


@dataclass(frozen=True, slots=True)
class ColumnHeading:
    """Name, unit and frame of a column; `text` as it is in the file."""

    text: str
    name: str
    unit: str
    frame: str = ""

    @classmethod
    def of(cls, text: str) -> "ColumnHeading":
        """The heading in a cell."""
        whole = text.strip().strip("\ufeff")
        plain = whole.translate(_WIDE)
        match = _HEAD.match(plain)
        if match is None or _INDEX.match(plain):
            return cls(whole, plain, "")
        unit = match["square"] or match["round"] or ""
        behind = _AXIS_UNIT.match(plain)
        if behind is not None and (behind["unit"] in _NAMED or _spelled(behind["unit"])):
            return cls(whole, behind["name"], unit_of(behind["unit"]))
        frame = next(filter(_FRAME.match, (part.strip() for part in unit.split(";"))), "")
        return cls(whole, match["name"], unit_of(unit), frame)


def unit_of(text: str) -> str:
    """The unit in the brackets after a name; a frame may stand with it or instead of it ("m/s; NED")."""
    parts = [part.strip() for part in text.split(";") if not _FRAME.match(part.strip())]
    return ";".join(map(_usual, parts))


def _usual(unit: str) -> str:
    unit = _IN.sub("", unit)
    per = _PER.match(unit)
    if re.fullmatch("x[0-9A-F]{4}", unit):  # a field of a MIP packet
        return ""
    return per["what"] + _POWERS[per["power"]] if per is not None else _spelled(unit) or unit


def _spelled(unit: str) -> str:
    return next((usual for pattern, usual in _SPELLINGS if pattern.match(unit.lower())), "")


def unique(names: Sequence[str]) -> list[str]:
    """The names, with a number after those that occur again."""
    counts: dict[str, int] = {}
    out = []
    for name in names:
        counts[name] = counts.get(name, 0) + 1
        out.append(name if counts[name] == 1 else f"{name} #{counts[name]}")
    return out


def grouped(names: list[str]) -> list[tuple[str, list[tuple[str, str]]]]:
    """Columns grouped by quantity: (name of the quantity, [(heading, name in it)])."""
    middle = _triples(names, (_MIDDLE, _FIRST))
    places = {name: middle.get(name) or _place(name) for name in names}
    places |= _triples([name for name in names if places[name] is None])
    groups: dict[str, list[tuple[str, str]]] = {}
    for name in names:
        group, inner = places[name] or (name, "value")
        groups.setdefault(group, []).append((name, inner))
    out: list[tuple[str, list[tuple[str, str]]]] = []
    for group, members in groups.items():
        axes = {inner.lower(): name for name, inner in members if inner.lower() in (*AXES, "w")}
        others = [name for name, _ in members if name not in axes.values()]
        if {*AXES} <= axes.keys() and others and (len(others) < len(AXES) or all(map(_ARRAY.match, others))):
            out += [(group, _ordered(axes)), *_arrays(others)]  # with a covariance, for instance
        elif len(members) == 1:
            out.append((members[0][0], [(members[0][0], "value")]))
        else:
            out.append((group, _ordered(axes) if {*AXES} <= axes.keys() and not others else members))
    return out


def _ordered(axes: dict[str, str]) -> list[tuple[str, str]]:
    return [(axes[axis], axis) for axis in ("w", *AXES) if axis in axes]


def _arrays(names: Sequence[str]) -> list[tuple[str, list[tuple[str, str]]]]:
    """Columns grouped by what their numbers follow; each of the others alone."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for name in names:
        match = _ARRAY.match(name)
        group = match["group"] if match is not None else name
        groups.setdefault(group, []).append((name, name[len(group) :].lstrip(".") or "value"))
    return [(group if len(members) > 1 else members[0][0], members) for group, members in groups.items()]


def _place(name: str) -> tuple[str, str] | None:
    """Group and name in it, where the heading alone names both."""
    if (index := _INDEX.match(name)) is not None:
        return index["group"].rstrip("._ "), index["index"] or index["round"]
    if (axis := _AXIS.match(name)) is not None:
        return axis["group"], axis["axis"] or axis["letter"].lower()
    return None


def _triples(names: Sequence[str], patterns: Sequence[re.Pattern[str]] = (_LAST, _FIRST)) -> dict[str, tuple[str, str]]:
    """Group and axis of those names that occur with all three axes: where a pattern has the axis, or alone."""
    matches: dict[str, tuple[str, str]] = {}
    for pattern in patterns:
        groups: dict[str, dict[str, str]] = {}
        for name in names:
            match = pattern.match(name)
            if name not in matches and match is not None:
                group = match["group"] + (match.groupdict().get("after") or "")
                groups.setdefault(group, {}).setdefault(match["axis"].lower(), name)
        for group, members in groups.items():
            if {*AXES} <= members.keys():
                matches |= {name: (group, axis) for axis, name in members.items()}
    alone = {name.lower(): name for name in names if name.lower() in (*AXES, "w")}
    if {*AXES} <= alone.keys():
        matches |= {name: (PLAIN, axis) for axis, name in alone.items()}
    return matches


def axis_of(inner: str, members: int) -> str:
    """Axis of a column in a group of that many; "" for none."""
    if inner in (*AXES, "w"):
        return inner
    return AXES[int(inner)] if members == len(AXES) and inner in ("0", "1", "2") else ""
