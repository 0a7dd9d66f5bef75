"""Message records of a stream, found by a compiled loop, and their payloads as rows of one array.

    record   opcode u8 = 5, length u64, channel u16, sequence u32, log time u64, publish time u64, payload

Source: MCAP specification, "Message".
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.native.kernels import BYTES, INT, INTS, NOTHING, PAIR, ROWS, TABLE, compiled, unsigned

CHANNEL, SEQUENCE, PUBLISHED, START, SIZE = range(5)
RECORD_QUANTITIES = 5
OPCODE, HEAD_SIZE, FIXED = 5, 31, 22  # bytes before the payload, of them after the length
LATEST = (1 << 63) - 1


@compiled(INT, BYTES, INT, INT)
def _little(data: Bytes, at: int, size: int) -> int:
    """A number of up to 8 bytes; the largest that is signed if it is larger."""
    start = unsigned(at)
    if size == 8 and int(data[start + unsigned(7)]) > 0x7F:
        return LATEST
    value = 0
    for i in range(unsigned(size)):
        value |= int(data[start + i]) << 8 * int(i)
    return value


@compiled(PAIR, BYTES, INT, INT, TABLE)
def scan_messages(data: Bytes, at: int, longest: int, table: Ints) -> tuple[int, int]:
    """Write the whole message records from `at` on into the columns of `table`.

    Args:
        longest: bytes after the length; a longer one is not a record.
        table: (RECORD_QUANTITIES, columns), written. START and SIZE are those of the record in `data`.

    Returns:
        Their number, and the first byte that belongs to none of them: another record, a damaged or an incomplete one,
        or the end.
    """
    n = 0
    end = len(data)
    while end - at >= HEAD_SIZE and n < table.shape[1]:
        if int(data[at]) != OPCODE:
            break
        length = _little(data, at + 1, 8)
        if length < FIXED or length >= longest or length > end - at - 9:
            break
        table[CHANNEL, n] = _little(data, at + 9, 2)
        table[SEQUENCE, n] = _little(data, at + 11, 4)
        table[PUBLISHED, n] = _little(data, at + 23, 8)
        table[START, n] = at
        table[SIZE, n] = length + 9
        n += 1
        at += length + 9
    return n, at


@compiled(NOTHING, BYTES, INTS, ROWS)
def _gather(data: Bytes, starts: Ints, rows: Bytes) -> None:
    """Copy `data` from each of `starts` on into the rows of one array."""
    width = unsigned(rows.shape[1])
    for row in range(unsigned(len(starts))):
        start = unsigned(starts[row])
        for i in range(width):
            rows[row, i] = data[start + i]


@dataclass(frozen=True, slots=True)
class MessagePayloads(Sequence[bytes]):
    """MessagePayloads of messages within one piece of the stream.

    Args:
        starts, lengths: (n,) of each in `data`.
    """

    data: bytes
    starts: Ints
    lengths: Ints

    def __len__(self) -> int:
        return len(self.starts)

    @overload
    def __getitem__(self, at: int) -> bytes: ...
    @overload
    def __getitem__(self, at: slice) -> "MessagePayloads": ...
    def __getitem__(self, at: int | slice) -> "bytes | MessagePayloads":
        if isinstance(at, slice):
            return MessagePayloads(self.data, self.starts[at], self.lengths[at])
        start = int(self.starts[at])
        return self.data[start : start + int(self.lengths[at])]

    def __iter__(self) -> Iterator[bytes]:
        for start, length in zip(self.starts.tolist(), self.lengths.tolist(), strict=True):
            yield self.data[start : start + length]

    def rows(self, which: Ints, size: int) -> NDArray[np.uint8]:
        """(n, size) the first bytes of some of them, which are at least as long."""
        rows = np.empty((len(which), size), np.uint8)
        _gather(np.frombuffer(self.data, np.uint8), np.ascontiguousarray(self.starts[which]), rows)
        return rows
