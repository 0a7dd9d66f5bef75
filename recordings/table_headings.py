"""Headings of tables: name, unit and index of a column, and the columns that form one vector.

    Gyroscope x (rad/s)      name "Gyroscope x", unit "rad/s"
    gyro_rad[0]              a number in brackets is an index, not a unit
    w_RS_S_x [rad s^-1]      units are written as everywhere in imuscope: rad/s

Columns are grouped into channels by name: `Acceleration.x`, `acc_x` and `accX` go with their y and z, as do
`Gyroscope x`, `ax`, `x_acc`, `gyro[0]` to `gyro[2]`, and plain `x`, `y`, `z`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

AXES = ("x", "y", "z")
PLAIN = "xyz"  # name of the vector of columns that are named x, y and z only
_FRAME = re.compile(r"(ENU|NED|NWU|ECEF|WGS84|body)\b")  # of quantities, as exports name them
_HEAD = re.compile(r"^\s*(?P<name>.*?)\s*(?:[(\[](?P<unit>[^)\]]*)[)\]])?\s*$")
_INDEX = re.compile(r"^(?P<group>.+?)(?:\[(?P<index>\d+)\]|\((?P<round>\d+)\))$")
_AXIS = re.compile(r"^(?P<group>.+?)(?:[._](?P<axis>[^._]+)|(?<=[a-z])(?P<letter>[XYZ]))$")
_LAST = re.compile(r"^(?P<group>.*?[^\s\-:/])[\s\-:/]*(?P<axis>[xyzXYZ])$")
_FIRST = re.compile(r"^(?P<axis>[xyzXYZ])[\s._\-:]*(?P<group>[^\s._\-:].*)$")
_PER = re.compile(r"^(?P<what>\S+) s\^-(?P<power>[12])$")
_SQUARED = re.compile(r"/s(?:\^2|2|\*\*2|ec\^2)$")
_POWERS = {"1": "/s", "2": "/s²"}


@dataclass(frozen=True, slots=True)
class ColumnHeading:
    """Name, unit and frame of a column; `text` as it is in the file."""

    text: str
    name: str
    unit: str
    frame: str = ""

    @classmethod
    def of(cls, text: str) -> ColumnHeading:
        """The heading in a cell."""
        plain = text.strip().strip("\ufeff")
        match = _HEAD.match(plain)
        if match is None or _INDEX.match(plain):
            return cls(plain, plain, "")
        parts = [part.strip() for part in (match["unit"] or "").split(";")]
        frame = next(filter(_FRAME.match, parts), "")
        return cls(plain, match["name"], unit_of(match["unit"] or ""), frame)


def unit_of(text: str) -> str:
    """The unit in the brackets after a name; a frame may stand with it or instead of it ("m/s; NED")."""
    parts = [part.strip() for part in text.split(";") if not _FRAME.match(part.strip())]
    return ";".join(map(_usual, parts))


def _usual(unit: str) -> str:
    per = _PER.match(unit)
    if per is not None:
        return per["what"] + _POWERS[per["power"]]
    return _SQUARED.sub("/s²", unit)


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
    places = {name: _place(name) for name in names}
    places |= _triples([name for name in names if places[name] is None])
    groups: dict[str, list[tuple[str, str]]] = {}
    for name in names:
        group, inner = places[name] or (name, "value")
        groups.setdefault(group, []).append((name, inner))
    out: list[tuple[str, list[tuple[str, str]]]] = []
    for group, members in groups.items():
        if len(members) == 1:
            out.append((members[0][0], [(members[0][0], "value")]))
        elif {inner.lower() for _, inner in members} == set(AXES):
            out.append((group, sorted(((name, inner.lower()) for name, inner in members), key=lambda one: one[1])))
        else:
            out.append((group, members))
    return out


def _place(name: str) -> tuple[str, str] | None:
    """Group and name in it, where the heading alone names both."""
    if (index := _INDEX.match(name)) is not None:
        return index["group"].rstrip("._ "), index["index"] or index["round"]
    if (axis := _AXIS.match(name)) is not None:
        return axis["group"], axis["axis"] or axis["letter"].lower()
    return None


def _triples(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Group and axis of those names that occur with all three axes: at the end, at the beginning, or alone."""
    matches: dict[str, tuple[str, str]] = {}
    for pattern in (_LAST, _FIRST):
        groups: dict[str, dict[str, str]] = {}
        for name in names:
            match = pattern.match(name)
            if name not in matches and match is not None:
                groups.setdefault(match["group"], {}).setdefault(match["axis"].lower(), name)
        for group, members in groups.items():
            if len(members) == len(AXES):
                matches |= {name: (group, axis) for axis, name in members.items()}
    alone = {name.lower(): name for name in names if name.lower() in AXES}
    if len(alone) == len(AXES):
        matches |= {name: (PLAIN, axis) for axis, name in alone.items()}
    return matches


def axis_of(inner: str, members: int) -> str:
    """Axis of a column in a group of that many; "" for none."""
    if inner in (*AXES, "w"):
        return inner
    return AXES[int(inner)] if members == len(AXES) and inner in ("0", "1", "2") else ""
