"""Schemas of channels for other viewers: topics, schemas, messages as JSON. Pure.

    topic     /MTi-630/Acceleration            device, message where it has several quantities, quantity
    field     x_m_s2                           the column, with its unit in letters: a plot's path needs no quotes
    schema    JSON Schema with the unit as written, the frame, and the meaning of the field and of its numbers

A number that is not finite is left out of its message, because JSON has none. Single flags of a status word are boolean
fields of their own, which a plot of states can show. A table (satellites) is one message a time: {"rows": []}.

Both the live Foxglove server and the decoded MCAP export use these: a layout made for one fits the other. `Encoder`
encodes a few rows at a time, `bodies` many at once; a test checks that both give the same text.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array
from imuscope.protocols.clocks.unix_time import NO_TIME, nanoseconds
from imuscope.protocols.messages.own_schema import LETTERS, letters

if TYPE_CHECKING:  # imported where many rows are encoded, so that a server starts sooner
    import pyarrow as pa

Info = Mapping[str, Any]  # a channel: server/wire/ ChannelInfo
EVENTS = "/events"


def topic_of(device: str, info: Info, in_use: Iterable[str]) -> str:
    """The topic of a channel; a number is appended if it is taken.

    Args:
        device: its unique name (recordings/file_names.py).
    """
    parts = [device, *([info["group"]] if info["group"] and info["group"] != info["title"] else [])]
    return named(*map(str, parts), str(info["title"] or info["name"]), in_use=in_use)


def named(*parts: str, in_use: Iterable[str]) -> str:
    """A topic of these words; a number is appended if it is taken."""
    topic = base = "/" + "/".join(map(_word, parts))
    count = 1
    while topic in in_use:
        count += 1
        topic = f"{base}_{count}"
    return topic


def fields_of(info: Info) -> list[str]:
    """The field of each column, with its unit in letters."""
    fields: list[str] = []
    for column in info["columns"]:
        unit = letters(str(column["unit"]))
        name = _word(f"{column['name']}_{unit}" if unit else str(column["name"]))
        fields.append(f"{name}_{len(fields)}" if name in fields else name)
    return fields


def schema_of(info: Info) -> dict[str, Any]:
    """JSON Schema of a channel's messages."""
    properties: dict[str, Any] = {}
    for name, column in zip(fields_of(info), info["columns"], strict=True):
        kind = "number" if column["dtype"].startswith("f") else "integer"
        details = {"description": _words(column), "unit": column["unit"], "frame": frame_of(column, str(info["frame"]))}
        properties[name] = {"type": kind, **{key: text for key, text in details.items() if text}}
        for bit in _flags(column):
            properties[_flag(name, bit)] = {"type": "boolean", "description": bit["doc"] or bit["name"]}
    words = " ".join(part for part in (info["doc"], f"Frame: {info['frame']}." if info["frame"] else "") if part)
    row = {"type": "object", "title": info["title"] or info["name"], "description": words, "properties": properties}
    if info["kind"] != "table":
        return row
    return {"type": "object", "title": row["title"], "properties": {"rows": {"type": "array", "items": row}}}


def frame_of(column: Mapping[str, Any], frame: str) -> str:
    """The frame of a column for metadata: axes of a quantity without a frame are those of the body."""
    return frame or ("body" if column.get("axis") in ("x", "y", "z") else "")


class Encoder:
    """Messages of one channel, a few at a time."""

    def __init__(self, info: Info) -> None:
        self._names = fields_of(info)
        self._flags = _flags_of(info)
        self._table = info["kind"] == "table"

    def messages(self, columns: Sequence[Array]) -> Iterator[tuple[int, bytes]]:
        """Each sample, or table, as (time in ns since 1970: device time if known, JSON).

        Args:
            columns: arrival, time, then the channel's own; (n,) each.
        """
        times = stamps(columns[0], columns[1]).tolist()
        rows = [self._object(row) for row in zip(*(column.tolist() for column in columns[2:]), strict=True)]
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


def bodies(info: Info, columns: Sequence[Array]) -> pa.Array:
    """The JSON of many samples at once.

    Args:
        columns: the channel's own, (n,) each.

    Returns:
        (n,) large strings, an object each, also of a table: `tables` combines those of a moment.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    def text(words: str) -> pa.Scalar:
        return pa.scalar(words, pa.large_string())

    members = []
    for name, column in zip(fields_of(info), columns, strict=True):
        values = pa.array(np.asarray(column))
        if pa.types.is_floating(values.type):
            values = pc.if_else(pc.is_finite(values), values, None)
        values = pc.cast(values, pa.large_string())
        members.append(pc.binary_join_element_wise(text(f"{json.dumps(name)}:"), values, text("")))
    for at, name, low in _flags_of(info):
        is_set = pa.array((np.asarray(columns[at]) >> low & 1).astype(bool))
        members.append(pc.if_else(is_set, text(f"{json.dumps(name)}:true"), text(f"{json.dumps(name)}:false")))
    empty = reduce(pc.and_, map(pc.is_null, members))
    members[0] = pc.if_else(empty, text(""), members[0])  # where all are missing, the join would leave the row out
    joined = pc.binary_join_element_wise(*members, text(","), null_handling="skip")
    return pc.binary_join_element_wise(text("{"), joined, text("}"), text(""))


def tables(rows: pa.Array, first: Array) -> pa.Array:
    """One message for the rows of each moment.

    Args:
        first: (m,) index of each moment's first row.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    def text(words: str) -> pa.Scalar:
        return pa.scalar(words, pa.large_string())

    lists = pa.LargeListArray.from_arrays(np.append(first, len(rows)).astype(np.int64), rows)
    joined = pc.binary_join(lists, text(","))
    return pc.binary_join_element_wise(text('{"rows":['), joined, text("]}"), text(""))


def stamps(arrival: Array, time: Array) -> NDArray[np.int64]:
    """Nanoseconds since 1970 of each sample: its device time mapped to the host's, or its arrival.

    Args:
        arrival, time: unix ns, or live ones in s.
    """
    exact = (one if one.dtype == np.int64 else nanoseconds(one) for one in (arrival, time))
    arrival, time = exact
    return np.where(time == NO_TIME, arrival, time)


def _word(text: str) -> str:
    """Letters, digits, hyphen and underscore."""
    return re.sub(r"(?:[^\w-]|_)+", "_", text.translate(LETTERS), flags=re.ASCII).strip("_") or "_"


def _flags(column: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [bit for bit in column["bits"] if bit["width"] == 1]


def _flags_of(info: Info) -> list[tuple[int, str, int]]:
    return [
        (at, _flag(name, bit), int(bit["low"]))
        for at, (name, column) in enumerate(zip(fields_of(info), info["columns"], strict=True))
        for bit in _flags(column)
    ]


def _flag(field: str, bit: Mapping[str, Any]) -> str:
    name = _word(str(bit["name"]))
    return name if field == "value" else f"{field}_{name}"


def _words(column: Mapping[str, Any]) -> str:
    choices = ", ".join(f"{value}: {meaning}" for value, meaning in column.get("choices", {}).items())
    parts = (f"[{column['unit']}]" if column["unit"] else "", column["label"], column["doc"], choices)
    return " ".join(part for part in parts if part)
