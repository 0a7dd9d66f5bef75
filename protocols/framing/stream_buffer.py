"""Frame scanning: frames in a stream that may be cut anywhere.

A link gives chunks: pieces of the byte stream with their arrival times. Frames straddle them. `StreamBuffer` keeps the
undecided bytes and the arrival time of each; a protocol's `scan` (a plain loop, compiled) goes over them and writes its
findings into a table.

## The resync rule, the same for every protocol

    1. Search for the preamble. Bytes before it belong to no frame.
    2. A candidate with an invalid header is rejected as soon as the header is complete: never wait for its length.
    3. An incomplete candidate waits. The wait is bounded by the protocol's largest frame, and on a live link by a stall
       time, after which it is given up as `truncated`.
    4. A candidate that fails is rejected, and the search resumes right after its preamble: never skip the claimed
       length, because a good frame may lie inside it. The first valid frame from the left wins.

Two properties follow, and the tests hold them: the result does not depend on how the stream was cut, and a good frame
survives any corruption before it.

    stream     ···noise···[frame][frame]·noise·[FA ······ rejected ······]
                                                 └─ the search resumes here ─┘
    decided    ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    Buffer                                       ^^^^^^^^^^ from the first byte that is still undecided

## The table of a scan

`table` is int64, one row per quantity and one column per candidate, in stream order, accepted and rejected alike:

    OFFSET    where the candidate begins, in bytes from the start of the scanned data
    SIZE      its length on the wire, header and checksum included; of a failed one, the bytes that were examined, or
              the claimed length where it is truncated (0: the header is too short to give one)
    BODY      where its payload begins
    LENGTH    its payload's length
    ID        message number
    SENDER    bus or device number
    STATUS    0: a frame; otherwise an index into REASONS
"""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import INT64, Bytes, Ints
from imuscope.protocols.native.kernels import INT, INTS, NOTHING, STRIDED, compiled

OFFSET, SIZE, BODY, LENGTH, ID, SENDER, STATUS = range(7)
QUANTITIES = 7

REASONS = (
    *("", "bad_checksum", "bad_size", "bad_id", "truncated", "bad_item", "bad_type", "bad_crc8", "bad_version"),
    *("bad_mode", "below_min_mode", "bad_crc32", "bad_hmac", "no_key", "successor", "stale", "far_ahead"),
)
FRAME, BAD_CHECKSUM, BAD_SIZE, BAD_ID, TRUNCATED, BAD_ITEM, BAD_TYPE, BAD_CRC8, BAD_VERSION = range(9)
BAD_MODE, BELOW_MIN_MODE, BAD_CRC32, BAD_HMAC, NO_KEY, SUCCESSOR, STALE, FAR_AHEAD = range(9, 17)

REFUSED = frozenset(
    ("bad_version", "bad_mode", "below_min_mode", "no_key", "successor", "stale", "far_ahead", "repeated")
)
"""Reasons of frames that are intact but not accepted as they are: nothing was damaged on the wire."""

Scan = Callable[[Bytes, int, bool, Ints], tuple[int, int, int, int]]
"""scan(data, at, final, table) -> (columns written, where to resume, failed candidates, bytes in frames).

Stops at the end of the data or of the table.
"""

_TABLE_COLUMNS = 1 << 14  # 900 kB: the table stays in the second-level cache
_SMALL_BYTES = 1 << 11
TINY_BYTES = 1 << 8  # of a single frame, as in most drains of a live stream
_KEPT_COLUMNS = 1 << 16  # frames of 16 bytes in a chunk of 1 MB; memory is committed only to columns that are written


@compiled(NOTHING, INTS, INTS, INTS, INTS)
def _arrivals_of(last: Ints, ends: Ints, arrivals: Ints, out: Ints) -> None:
    """Arrival of the chunk of each of the bytes at the positions `last`, which ascend; see StreamBuffer."""
    chunk = 1
    for i in range(len(last)):
        while chunk < len(ends) - 1 and ends[chunk] <= last[i]:
            chunk += 1
        out[i] = arrivals[chunk]


class StreamBuffer:
    """The undecided end of a stream, with the arrival time of each byte.

    Positions are absolute: bytes since the stream began.
    """

    def __init__(self) -> None:
        self.start = 0  # position of the first byte kept
        self._rest = b""
        self._chunks: list[bytes] = []
        self._ends = [0]  # position after each remembered chunk …
        self._arrivals = [0]  # … and its arrival time; the first entry covers the bytes decided before

    def __len__(self) -> int:
        return self._ends[-1] - self.start

    def append(self, data: bytes, arrival_ns: int) -> None:
        """Add a chunk."""
        if data:
            self._chunks.append(bytes(data))
            self._ends.append(self._ends[-1] + len(data))
            self._arrivals.append(arrival_ns)

    def extend(self, data: bytes, ends: Ints, arrival_ns: Ints) -> None:
        """Add many consecutive chunks; ends, arrival_ns: (n,) end of each in `data` and its arrival time."""
        if data:
            base = self._ends[-1]
            self._chunks.append(bytes(data))
            self._ends += (ends + base).tolist()
            self._arrivals += arrival_ns.tolist()

    def data(self) -> bytes:
        """All bytes kept, as one immutable piece that begins at `start`."""
        if self._chunks:
            chunks = self._chunks
            self._rest = chunks[0] if len(chunks) == 1 and not self._rest else b"".join([self._rest, *chunks])
            self._chunks = []
        return self._rest

    def release(self, position: int) -> None:
        """Forget the bytes before `position`."""
        if position == self._ends[-1]:  # all of them, the usual case between two frames of a live stream
            self.start = position
            self._rest = b""
            self._chunks = []
            self._ends, self._arrivals = [position], self._arrivals[-1:]
            return
        self.data()
        self._rest = self._rest[position - self.start :]
        self.start = position
        done = bisect_right(self._ends, position) - 1
        if done > 0:
            del self._ends[:done], self._arrivals[:done]

    def arrival(self, last: int) -> int:
        """Arrival of the byte at position `last`, ns."""
        return self._arrivals[min(bisect_right(self._ends, last), len(self._arrivals) - 1)]

    @property
    def arrived_at_once(self) -> bool:
        """Whether all buffered bytes came in one chunk."""
        return len(self._arrivals) == 2

    def same_arrivals(self, n: int) -> Ints:
        """(n,) int64: arrival time of the newest chunk."""
        return one_number(self._arrivals[-1]) if n == 1 else np.full(n, self._arrivals[-1], np.int64)

    def arrivals(self, last: Ints) -> Ints:
        """Arrival of each of the bytes at the positions `last` (ascending), ns: (n,) int64."""
        if self.arrived_at_once or len(last) == 0:
            return self.same_arrivals(len(last))
        out = np.empty(len(last), np.int64)
        last, ends = np.ascontiguousarray(last, np.int64), np.array(self._ends, np.int64)
        _arrivals_of(last, ends, np.array(self._arrivals, np.int64), out)
        return out


@dataclass(slots=True)
class ScanResult:
    """Result of a scan.

    Args:
        table: (QUANTITIES, n).
        at: where the next scan resumes: at a candidate that waits for more bytes, or at the end.
        failed: how many of the candidates failed.
        framed: bytes in accepted frames.
    """

    table: Ints
    at: int
    failed: int
    framed: int


class ScanCapacity:
    """Memory that one stream reuses in every drain: allocating memory of this size can cost more than the work in it.

    Contents are valid until the next drain.
    """

    def __init__(self) -> None:
        self._tables: dict[int, Ints] = {}
        self.tiny: Ints = np.empty((QUANTITIES, TINY_BYTES), np.int64)  # for fewer bytes than it has columns

    def table(self, rows: int, columns: int) -> Ints:
        """An array of (rows, at least columns), with leftover contents; small ones are newly allocated."""
        if columns < _SMALL_BYTES:
            return np.empty((rows, columns), np.int64)
        cached = self._tables.get(rows)
        if cached is None or cached.shape[1] < columns:
            # the odd width keeps the starts of the rows on different cache sets
            cached = self._tables[rows] = np.empty((rows, max(columns, _KEPT_COLUMNS) + 56), np.int64)
        return cached


@compiled(INT, STRIDED)
def compact_rejected(table: Ints) -> int:
    """Move the accepted candidates of a scan's table to its first columns, in order; returns their number.

    In place, because a numpy mask costs several times the scan.
    """
    count = 0
    for k in range(table.shape[1]):
        if table[STATUS, k] == FRAME:
            for row in range(QUANTITIES):
                table[row, count] = table[row, k]
            count += 1
    return count


def one_number(value: int) -> Ints:
    """(1,) int64; `np.array` takes twice as long."""
    made = np.empty(1, INT64)
    made[0] = value
    return made


def scan_all(scan: Scan, data: Bytes, at: int, *, final: bool, room: ScanCapacity | None = None) -> ScanResult:
    """Run `scan` from `at` to the end of `data`; with a `room`, the table is valid until its next use."""
    columns = len(data) - at + 1
    if columns < _SMALL_BYTES:  # a column for each byte is always enough
        table = np.empty((QUANTITIES, columns), np.int64)
        frames, at, failed, framed = scan(data, at, final, table)
        return ScanResult(table[:, :frames], at, failed, framed)
    columns = min(_TABLE_COLUMNS, columns)
    parts: list[Ints] = []
    all_failed = all_framed = 0
    while True:
        if room is not None and not parts:
            table = room.table(QUANTITIES, columns)
            columns = table.shape[1]
        else:
            table = np.empty((QUANTITIES, columns), np.int64)
        frames, at, failed, framed = scan(data, at, final, table)
        parts.append(table[:, :frames])
        all_failed += failed
        all_framed += framed
        if frames < columns:
            break
    return ScanResult(parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1), at, all_failed, all_framed)
