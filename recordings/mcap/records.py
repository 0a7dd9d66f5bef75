"""Encoders of MCAP records.

    record    [opcode u8][length u64] body
    message   [5][22 + n]  channel u16 · sequence u32 · log time u64 · publish time u64 · data (n bytes)
    ending    [data end][summary: groups of equal records][one summary offset a group][footer][magic]

Messages are written thousands of times a second, so they are built here in one step; rare records use the mcap package.

Source: MCAP specification, "Records", "Summary Section", "Footer".
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Sequence

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import DataEnd, Footer, McapRecord, SummaryOffset

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
