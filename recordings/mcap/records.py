"""Encoders of MCAP records.

    record    [opcode u8][length u64] body
    message   [5][22 + n]  channel u16 · sequence u32 · log time u64 · publish time u64 · data (n bytes)
    ending    [data end][summary: groups of equal records][one summary offset a group][footer][magic]

Messages are written thousands of times a second, so they are built here in one step; rare records use the mcap package.

Source: MCAP specification, "Records", "Summary Section", "Footer".
"""

import struct
import zlib
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Generic, TypeVar

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, Footer, McapRecord, Schema, Statistics, SummaryOffset

K = TypeVar("K", bound=Hashable)
SchemaKey = tuple[str, str, bytes]
"""Name, encoding, data."""

MAGIC = b"\x89MCAP0\r\n"
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
_MESSAGE_FIXED = MESSAGE_HEAD.size - 9


def bytes_of(record: McapRecord) -> bytes:
    """A record as in the file."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def message(channel: int, time_ns: int, data: bytes) -> bytes:
    """A message record; publish time = log time."""
    return MESSAGE_HEAD.pack(Opcode.MESSAGE, _MESSAGE_FIXED + len(data), channel, 0, time_ns, time_ns) + data


def messages(channel: int, chunks: Iterable[tuple[bytes, int]]) -> list[bytes]:
    """Message records of one channel: (data, time in ns) of each."""
    pack, opcode = MESSAGE_HEAD.pack, int(Opcode.MESSAGE)
    return [pack(opcode, _MESSAGE_FIXED + len(data), channel, 0, time_ns, time_ns) + data for data, time_ns in chunks]


class FileContents(Generic[K]):
    """Schemas and channels of a file being written, and the messages counted so far: what its summary says.

    Attributes:
        channels: by a key of the writer.
    """

    def __init__(self) -> None:
        self.channels: dict[K, Channel] = {}
        self._schemas: dict[SchemaKey, Schema] = {}
        self._counts: dict[int, int] = {}
        self._first: int | None = None
        self._last = 0

    def add(
        self, key: K, topic: str, encoding: str, schema: SchemaKey | None, metadata: Mapping[str, str], number: int = 0
    ) -> list[McapRecord]:
        """Records of a new channel, and of its schema if that is new; numbers are given in order."""
        records: list[McapRecord] = []
        if schema is not None and schema not in self._schemas:
            name, kind, data = schema
            self._schemas[schema] = Schema(id=len(self._schemas) + 1, data=data, encoding=kind, name=name)
            records.append(self._schemas[schema])
        self.channels[key] = Channel(
            id=number or len(self.channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata),
            schema_id=self._schemas[schema].id if schema is not None else 0,
        )
        return [*records, self.channels[key]]

    def count(self, channel: int, count: int, first_ns: int, last_ns: int) -> None:
        self._counts[channel] = self._counts.get(channel, 0) + count
        self._first = first_ns if self._first is None else min(self._first, first_ns)
        self._last = max(self._last, last_ns)

    def summary(
        self, metadata: Sequence[McapRecord], chunks: Sequence[McapRecord] = ()
    ) -> list[tuple[int, Sequence[McapRecord]]]:
        """Groups of records for `ending`, with those of the indexes of metadata and chunks."""
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self.channels),
            channel_message_counts=self._counts,
            chunk_count=len(chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(metadata),
            message_start_time=self._first or 0,
            message_end_time=self._last,
            schema_count=len(self._schemas),
        )
        return [
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self.channels.values())),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, chunks),
            (Opcode.METADATA_INDEX, metadata),
        ]


def ending(at: int, groups: Iterable[tuple[int, Sequence[McapRecord]]]) -> bytes:
    """All from the end of the data to the end of the file.

    Args:
        at: end of the data.
        groups: (opcode, records of that kind) of the summary.
    """
    end = bytes_of(DataEnd(0))
    start = at + len(end)
    summary = offsets = b""
    for opcode, records in groups:
        group = b"".join(bytes_of(record) for record in records)
        if group:
            where = start + len(summary)
            offsets += bytes_of(SummaryOffset(group_opcode=opcode, group_start=where, group_length=len(group)))
        summary += group
    offsets_at = start + len(summary)
    checked = summary + offsets + struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_at)
    footer = Footer(summary_start=start, summary_offset_start=offsets_at, summary_crc=zlib.crc32(checked))
    return end + summary + offsets + bytes_of(footer) + MAGIC
