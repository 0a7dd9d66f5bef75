"""Quantities of JSON messages that imuscope wrote: its decoded exports, and its Foxglove server.

Their schema (recordings/exporters/topics.py) has the title of the quantity, and of each field the unit and the frame.
So the messages of another imuscope are the same quantities again.
"""

import json
import re
from dataclasses import dataclass

from imuscope.protocols.messages.quantities import MessageQuantity
from imuscope.protocols.schema.fields import Field

LETTERS = str.maketrans(
    {"µ": "u", "°": "deg", "²": "2", "³": "3", "/": "_", "%": "pct", "Ω": "Ohm", "·": "_", " ": "_", ".": "_"}
)
AXES = (
    *(("x", "y", "z"), ("w", "x", "y", "z"), ("q0", "q1", "q2", "q3"), ("roll", "pitch", "yaw")),
    *(("east", "north", "up"), ("north", "east", "down"), ("north", "west", "up"), ("E", "N", "U"), ("N", "E", "D")),
)


@dataclass(frozen=True, slots=True)
class OwnColumn:
    """One column of a quantity: its name in it ("value" of a single one), its unit and frame."""

    name: str
    unit: str
    frame: str


def letters(unit: str) -> str:
    """A unit in letters: m_s2."""
    return re.sub(r"\W", "", unit.translate(LETTERS), flags=re.ASCII)


def columns_of(title: str, schema: bytes) -> dict[str, OwnColumn]:
    """Columns of the fields of one of our schemas: {"x_m_s2": ("x", "m/s²", "body")}; {} for other schemas.

    Args:
        title: the schema's name.
    """
    try:
        parsed = json.loads(schema)
        row = parsed["properties"].get("rows", {}).get("items", parsed)
        if parsed["title"] != title:
            return {}
        fields = {
            str(field): (str(one.get("unit", "")), str(one.get("frame", "")))
            for field, one in row["properties"].items()
        }
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return {}
    columns = {}
    for field, (unit, frame) in fields.items():
        name = field.removesuffix(f"_{letters(unit)}") if unit else field
        columns[field] = OwnColumn(name, unit, frame)
    return columns


def own_quantity(title: str, columns: dict[str, OwnColumn]) -> MessageQuantity:
    paths, fields = tuple(columns), list(columns.values())
    frame = fields[0].frame if len({one.frame for one in fields}) == 1 else ""
    if len(fields) == 1:
        return MessageQuantity(Field(title, "<f8", unit=fields[0].unit, frame=frame), paths)
    names = tuple(one.name for one in fields)
    units = {one.unit for one in fields}
    if names in AXES and len(units) == 1:
        return MessageQuantity(Field(title, "<f8", (len(names),), unit=units.pop(), axes=names, frame=frame), paths)
    inner = tuple(Field(one.name, "<f8", unit=one.unit) for one in fields)
    return MessageQuantity(Field(title, fields=inner, frame=frame), paths)
