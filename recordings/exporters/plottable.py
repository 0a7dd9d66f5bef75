"""MCAP with decoded values, which Foxglove, Lichtblick and PlotJuggler plot without being told anything.

    topic        /<device>/<message>           schema  imuscope.<message>, JSON Schema
    log time     device time mapped to the host's clock; its arrival where it has none (or where the base is arrival)
    message      {"time": 1760000000.0123, "arrival": …, "Acceleration": {"x": …, "y": …, "z": …}, "PacketCounter": 17}

Names are nested at their dots: "Acceleration.x" is x of Acceleration. Unit and frame are in the schema.
What the device did not send at a moment, and what JSON has no number for (NaN, infinity), is left out.

Chunks of about a megabyte, zstd, with indexes; messages of different topics lie interleaved in time.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from mcap.writer import CompressionType, Writer

from recordings.exporters.joined import Table, batches, frame_of, tables
from recordings.exporters.naming import plain
from recordings.exporters.wish import Step, Wish

CHUNK_BYTES = 1 << 20
Tree = dict[str, "int | Tree"]


def write(wish: Wish, out: Path, step: Step) -> list[Path]:
    """One file."""
    found = tables(wish)
    with out.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="", library="imuscope")
        writer.add_metadata("export", {"recording": wish.title, "base": wish.base})
        streams = [_Stream(wish, table, _registered(writer, wish, table)) for table in found]
        _interleaved(writer, streams, step)
        writer.finish()  # type: ignore[no-untyped-call]
    return [out]


class _Stream:
    """The messages of one table, a stretch at a time."""

    def __init__(self, wish: Wish, table: Table, channel: int) -> None:
        self.channel = channel
        self.share = 0.0
        self._base = wish.base
        self._tree = _tree(table)
        self._batches = batches(wish, table, self._step)
        self.rows: Iterator[tuple[int, bytes]] = iter(())
        self.next: tuple[int, bytes] | None = None
        self.advance()

    def _step(self, share: float) -> None:
        self.share = share

    def advance(self) -> None:
        """To the next message; None at the end."""
        self.next = next(self.rows, None)
        while self.next is None:
            batch = next(self._batches, None)
            if batch is None:
                return
            self.rows = self._messages(batch)
            self.next = next(self.rows, None)

    def _messages(self, batch: pa.RecordBatch) -> Iterator[tuple[int, bytes]]:
        for start in range(0, batch.num_rows, 4096):  # what one loop holds as text
            piece = batch.slice(start, 4096)
            clock = piece.column(1) if self._base == "arrival" else pc.coalesce(piece.column(0), piece.column(1))
            times = np.round(clock.to_numpy(zero_copy_only=False) * 1e9).astype(np.int64).tolist()
            bodies = _objects(self._tree, [_texts(column) for column in piece.columns])
            for time, body in zip(times, bodies, strict=True):
                yield time, (body or "{}").encode()


def _objects(tree: Tree, texts: list[list[str]]) -> list[str]:
    """Each row of a tree as a JSON object; "" where there is nothing of it."""
    members = []
    for name, inside in tree.items():
        key = json.dumps(name)
        values = texts[inside] if isinstance(inside, int) else _objects(inside, texts)
        members.append([f"{key}:{value}" if value else "" for value in values])
    bodies = [",".join(filter(None, row)) for row in zip(*members, strict=True)]
    return [f"{{{body}}}" if body else "" for body in bodies]


def _texts(column: pa.Array) -> list[str]:
    """Numbers as JSON writes them, in full; "" where JSON has none."""
    if pa.types.is_floating(column.type):
        column = pc.if_else(pc.is_finite(column), column, None)
    texts = pc.fill_null(pc.cast(column, pa.string()), "")
    found: list[str] = texts.to_pylist()
    return found


def _tree(table: Table) -> Tree:
    """The members of a message, nested as their names are: "I.acc.x" is x of acc of I. Leaves: column of the batch."""
    root: Tree = {"time": 0, "arrival": 1}
    for at, (name, *_) in enumerate(table.columns, start=2):
        *path, last = name.split(".")
        node = root
        for part in path:
            below = node.setdefault(part, {})
            if isinstance(below, int):  # a number of that name stands there already
                below = node[part] = {"value": below}
            node = below
        if isinstance(node.get(last), dict):
            node = cast(Tree, node[last])
            last = "value"
        node[last] = at
    return root


def _registered(writer: Writer, wish: Wish, table: Table) -> int:
    columns = [*_TIMES, *({**column, "frame": frame_of(column, frame)} for _, column, frame in table.columns)]
    schema = {"title": table.name, **_schema(_tree(table), columns)}
    data = json.dumps(schema, ensure_ascii=False).encode()
    number = writer.register_schema(name=f"imuscope.{table.name}", encoding="jsonschema", data=data)
    device = plain(wish.device_name(table.device))
    return writer.register_channel(topic=f"/{device}/{table.name}", message_encoding="json", schema_id=number)


_TIMES: tuple[Mapping[str, Any], ...] = (
    {"dtype": "f8", "unit": "s", "doc": "Device time on the host's clock, unix seconds."},
    {"dtype": "f8", "unit": "s", "doc": "When its bytes arrived, unix seconds."},
)


def _schema(tree: Tree, columns: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    inside = {
        name: _number(columns[below]) if isinstance(below, int) else _schema(below, columns)
        for name, below in tree.items()
    }
    return {"type": "object", "properties": inside}


def _number(column: Mapping[str, Any]) -> dict[str, str]:
    words = " ".join(filter(None, (f"[{column['unit']}]" if column["unit"] else "", column["doc"])))
    kind = "number" if column["dtype"].startswith("f") else "integer"
    told = {"description": words, "unit": column["unit"], "frame": column.get("frame", "")}
    return {"type": kind, **{key: text for key, text in told.items() if text}}


def _interleaved(writer: Writer, streams: list[_Stream], step: Step) -> None:
    """The messages of all topics, the earliest first."""
    count = 0
    live = [stream for stream in streams if stream.next is not None]
    while live:
        stream = min(live, key=_when)
        limit = min((_when(other) for other in live if other is not stream), default=1 << 63)
        while stream.next is not None and stream.next[0] <= limit:
            time, data = stream.next
            writer.add_message(stream.channel, log_time=time, publish_time=time, data=data)
            stream.advance()
            count += 1
            if count % 4096 == 0:
                step(sum(one.share for one in streams) / len(streams))
        if stream.next is None:
            live.remove(stream)
    step(1.0)


def _when(stream: _Stream) -> int:
    return stream.next[0] if stream.next is not None else 1 << 63
