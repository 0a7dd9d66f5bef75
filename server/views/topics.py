"""What is a channel of ours called, and how is it described, where other people's plots read JSON? Pure.

    topic     /MTi-630/Acceleration            device, message where it has several quantities, quantity
    field     x_m_s2                           the column, with its unit in letters: a plot's path needs no quotes
    schema    JSON Schema, which says the unit as it is written, what the field means, and what its numbers mean

A number that is not finite is left out of its message, because JSON has none. Single flags of a status word are fields
of their own, true or false, which a plot of states can show. A table (satellites) is one message a time: {"rows": []}.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from server.codec import Samples

Info = Mapping[str, Any]
_LETTERS = str.maketrans(
    {"µ": "u", "°": "deg", "²": "2", "³": "3", "/": "_", "%": "pct", "Ω": "Ohm", "·": "_", " ": "_"}
)


def topic_of(device: Mapping[str, Any], info: Info, taken: set[str]) -> str:
    """The topic of a channel; one that is taken gets the channel's number."""
    parts = [device["name"], *([info["group"]] if info["group"] and info["group"] != info["title"] else [])]
    topic = "/" + "/".join(_word(str(part)) for part in [*parts, info["title"] or info["name"]])
    return f"{topic}_{info['id']}" if topic in taken else topic


def fields_of(info: Info) -> list[str]:
    """The field of each column, with its unit in letters."""
    found: list[str] = []
    for column in info["columns"]:
        unit = re.sub(r"\W", "", str(column["unit"]).translate(_LETTERS), flags=re.ASCII)
        name = _word(f"{column['name']}_{unit}" if unit else str(column["name"]))
        found.append(f"{name}_{len(found)}" if name in found else name)
    return found


def schema_of(info: Info) -> dict[str, Any]:
    """JSON Schema of a channel's messages."""
    properties: dict[str, Any] = {}
    for name, column in zip(fields_of(info), info["columns"], strict=True):
        kind = "number" if column["dtype"].startswith("f") else "integer"
        properties[name] = {"type": kind, "description": _words(column)}
        for bit in _flags(column):
            properties[_flag(name, bit)] = {"type": "boolean", "description": bit["doc"] or bit["name"]}
    words = " ".join(part for part in (info["doc"], f"Frame: {info['frame']}." if info["frame"] else "") if part)
    row = {"type": "object", "title": info["title"] or info["name"], "description": words, "properties": properties}
    if info["kind"] != "rows":
        return row
    return {"type": "object", "title": row["title"], "properties": {"rows": {"type": "array", "items": row}}}


class Encoder:
    """Messages of one channel."""

    def __init__(self, info: Info) -> None:
        self._names = fields_of(info)
        self._flags = [
            (at, _flag(name, bit), int(bit["low"]))
            for at, (name, column) in enumerate(zip(self._names, info["columns"], strict=True))
            for bit in _flags(column)
        ]
        self._table = info["kind"] == "rows"

    def messages(self, samples: Samples) -> Iterator[tuple[int, bytes]]:
        """Each sample, or table, as (time in ns since 1970: device time where there is one, JSON)."""
        columns = [column.tolist() for column in samples.columns[2:]]
        times = stamps(samples)
        rows = [self._object(row) for row in zip(*columns, strict=True)]
        if not self._table:
            for time, row in zip(times, rows, strict=True):
                yield time, json.dumps(row).encode()
            return
        first = 0
        for i in range(1, len(rows) + 1):
            if i == len(rows) or times[i] != times[first]:
                yield times[first], json.dumps({"rows": rows[first:i]}).encode()
                first = i

    def _object(self, row: Sequence[Any]) -> dict[str, Any]:
        out = {name: value for name, value in zip(self._names, row, strict=True) if math.isfinite(value)}
        for at, name, low in self._flags:
            out[name] = bool(int(row[at]) >> low & 1)
        return out


def stamps(samples: Samples) -> list[int]:
    """Nanoseconds since 1970 of each sample: its device time mapped to the host's, or its arrival."""
    pairs = zip(samples.columns[0].tolist(), samples.columns[1].tolist(), strict=True)
    return [int((time if math.isfinite(time) else arrival) * 1e9) for arrival, time in pairs]


def _word(text: str) -> str:
    """Letters, digits, hyphen and underscore."""
    return re.sub(r"(?:[^\w-]|_)+", "_", text.translate(_LETTERS), flags=re.ASCII).strip("_") or "_"


def _flags(column: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [bit for bit in column["bits"] if bit["width"] == 1]


def _flag(field: str, bit: Mapping[str, Any]) -> str:
    name = _word(str(bit["name"]))
    return name if field == "value" else f"{field}_{name}"


def _words(column: Mapping[str, Any]) -> str:
    choices = ", ".join(f"{value}: {meaning}" for value, meaning in column["choices"].items())
    parts = (f"[{column['unit']}]" if column["unit"] else "", column["label"], column["doc"], choices)
    return " ".join(part for part in parts if part)
