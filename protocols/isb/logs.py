"""Inertial Sense logs: the vendor's log files, as the bytes that a device sends.

A log is a folder of consecutive files of at most some megabytes:

    LOG_SN60339_20261120_120000_0001.raw     the bytes of the port as received, nothing else
    LOG_SN60339_20261120_120000_0001.idx     beside it, sometimes: offsets in the log by millisecond
    LOG_SN60339_20261120_120000_0001.dat     data sets without their packets, in chunks with a header of 40 bytes

    .idx    time u32 (ms since the log began)   offset u32   messages u32   reserved u32
    .dat    32 EA 05 FC   version u8   dataOffset u8   protocol u8 ×2   name ×4   its inverse ×4
            dataSize u32   its inverse u32   group u32   serial number u32   port u16 ×2   firmware u8 ×4
            then records:  DID u8   size u16   offset u16   size bytes of the data set from that offset on

Version 1 of the header has the same length and the same sizes at the same places, with other fields between. A record
becomes the DATA packet that carried it, so that one decoder reads everything; a device information packet goes first if
the header has the firmware and the records have none yet.

After a header with wrong inverses the search for the next one continues, and the same goes for a record within a chunk;
the bytes between are reported as damage.

Source: inertial-sense-sdk 2.7.1, data_chunk.h, DeviceLogSerial, DeviceLogRaw.
"""

import re
import struct
from collections.abc import Collection, Iterator
from datetime import UTC, datetime

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.family.info import Damage, LogName
from imuscope.protocols.isb.frames import DATA, build

MARKER = bytes.fromhex("32EA05FC")
HEADER = struct.Struct("<4sBBBB4s4sIIIIHH4B")
MAX_CHUNK = 1 << 20  # the vendor writes 131 072 bytes; more is damage
MAX_RECORD, MAX_SET = 1024, 2048  # bytes of a packet's data, and of a whole data set
MIN_CHAIN_RECORDS = 4  # consecutive records that are not a coincidence
_RECORD = struct.Struct("<BHH")
_INDEX = np.dtype([("ms", "<u4"), ("offset", "<u4"), ("count", "<u4"), ("reserved", "<u4")])
_NAME = re.compile(r"(?P<stem>.*_?SN(?P<serial>\d+)_(?P<date>\d{8})_(?P<time>\d{6}))_(?P<part>\d{4,})$", re.IGNORECASE)


def read_name(stem: str) -> LogName | None:
    """Information from the name of a log file; None for any other name."""
    match = _NAME.match(stem)
    if match is None:
        return None
    try:
        started = datetime.strptime(match["date"] + match["time"], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    except ValueError:
        return None
    return LogName(match["stem"], match["serial"], round(started.timestamp()) * 1_000_000_000, int(match["part"]))


def read_index(data: bytes) -> tuple[Ints, Ints] | None:
    """(offsets, ms) of the index beside a raw log, ascending; None if it is unusable.

    The vendor's writer sometimes repeats an earlier offset: that row is skipped.
    """
    rows = np.frombuffer(data[: len(data) // _INDEX.itemsize * _INDEX.itemsize], _INDEX)
    offsets, ms = rows["offset"].astype(np.int64), rows["ms"].astype(np.int64)
    if not len(rows) or (np.diff(ms) < 0).any():
        return None
    ahead = offsets >= np.maximum.accumulate(offsets)
    return offsets[ahead], ms[ahead]


def packets(data: bytes, damage: Damage) -> Iterator[bytes]:
    """The records of a .dat file as packets, chunk by chunk."""
    at = 0
    while at < len(data):
        head = _header(data, at)
        if head is None:
            further = data.find(MARKER, at + 1)
            words = f"{(further if further >= 0 else len(data)) - at} bytes at {at} are not a log chunk."
            damage(at, words)
            if further < 0:
                return
            at = further
            continue
        start, size = head
        body = data[start : start + size]
        if len(body) < size:
            damage(start, f"The last chunk is truncated: {len(body)} of {size} bytes.")
        yield _packets_of(body, start, damage)
        at = start + size


def _header(data: bytes, at: int) -> tuple[int, int] | None:
    """Start and length of the data of a chunk; None without a header."""
    if len(data) - at < HEADER.size:
        return None
    marker, version, offset, _, _, name, inverse, size, unsize, *_ = HEADER.unpack_from(data, at)
    if marker != MARKER or size > MAX_CHUNK or size ^ unsize != 0xFFFFFFFF:
        return None
    if any(a ^ b != 0xFF for a, b in zip(name, inverse, strict=True)):
        return None
    return at + (6 + offset if version >= 2 else HEADER.size), size


def _packets_of(body: bytes, start: int, damage: Damage) -> bytes:
    """The records of a chunk as packets. After a damaged one the search continues: at the next place from which
    `MIN_CHAIN_RECORDS` follow each other, of consistent kinds and sizes.
    """
    out = []
    at = 0
    record_kinds: set[tuple[int, int]] = set()  # (data set, size) of records so far
    while at < len(body):
        record = _record(body, at)
        if record is not None:
            did, size, offset, end = record
            if end == len(body) or _record(body, end) is not None or (did, size) in record_kinds:
                record_kinds.add((did, size))
                out.append(build(DATA, did, body[end - size : end], offset=offset))
                at = end
                continue
        further = _resync(body, at + 1, record_kinds)
        words = f"{further - at} bytes at {start + at} are not a record."
        if further == len(body):
            words = f"From {start + at} on there are no complete records: {further - at} bytes."
        damage(start + at, words)
        at = further
    return b"".join(out)


def _record(body: bytes, at: int) -> tuple[int, int, int, int] | None:
    """Data set, size, offset and end of the record at `at`; None if it cannot be one."""
    if len(body) - at < _RECORD.size:
        return None
    did, size, offset = _RECORD.unpack_from(body, at)
    end = at + _RECORD.size + size
    if did == 0 or size == 0 or size > MAX_RECORD or offset + size > MAX_SET or end > len(body):
        return None
    return did, size, offset, end


def _resync(body: bytes, at: int, record_kinds: Collection[tuple[int, int]]) -> int:
    """The next place from which records follow each other; the end of the chunk if there is none."""
    for begin in range(at, len(body)):
        end, links, known = begin, 0, False
        while links < MIN_CHAIN_RECORDS and end < len(body):
            record = _record(body, end)
            if record is None:
                break
            known |= record[:2] in record_kinds
            end, links = record[3], links + 1
        if (links == MIN_CHAIN_RECORDS or (links and end == len(body))) and (known or not record_kinds):
            return begin
    return len(body)
