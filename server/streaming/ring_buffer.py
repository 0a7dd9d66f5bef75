"""Ring buffer of a channel, read as sample frames.

A ring is a sequence of blocks. A block is memory for a fixed number of samples, filled from left to right and never
moved; when the channel has more history than allowed, whole blocks are dropped from the left. Samples have sequence
numbers, counted from 0 since the creation of the channel, so that history and live data are separated exactly:

    block 0        block 1        block 2
    [seq 0 ..255]  [256 ..767]    [768 .. 912 ......]
     ^first                             ^total (the next sequence number)

Within a block, neighbouring columns of one dtype share one two-dimensional array, so that a range of samples of all of
them is converted to bytes in one call:

    group f8: arrival, time        group f4: x, y, z, …      group u4: flags
    rows = columns, each row `capacity` samples long and then some slack

The newest two blocks are read all the time. Older ones are packed (packed_columns.py), each column alone, and unpacked
by each reader: ten minutes of history take less than half of the memory.

Samples are as the device sent them, and converted to the page's units as they are read.

Each column of a frame is padded to 8 bytes (server/wire/). A range is therefore read rounded up to whole groups of
8 bytes; the bytes beyond its end are later samples or slack, without meaning. Because of that rounding a frame never
crosses a block.
"""

from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from itertools import chain, groupby, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.recordings.columns.units import scaled
from imuscope.server.streaming.channel_rows import WireRows
from imuscope.server.streaming.packed_columns import packed, unpack
from imuscope.server.streaming.ring_kernel import append_rows
from imuscope.server.wire import HEADER
from imuscope.server.wire.codec import sample_header

# Small enough that dropping a block is not noticeable and a frame of a whole block is sent in one piece (a socket
# accepts 64 KiB at once), large enough that Python's cost per block is negligible. The first block is small because
# many channels are slow.
FIRST_BLOCK = 64
BLOCK_BYTES = 64 * 1024
_SLACK_ROWS = 8
_UNPACKED_BLOCKS = 2  # newest blocks
_PACKED_BYTES = 8 * 1024  # a smaller block is not worth it
_NO_MEMORY = np.zeros(0, np.uint8), np.zeros(0, np.float64)


class RingBlock:
    """Memory for `capacity` samples, the first of which has sequence number `first`."""

    __slots__ = (
        "_arrays",
        "_groups",
        "_packed",
        "begins",
        "capacity",
        "first",
        "last_arrival",
        "memory",
        "n",
        "nbytes",
    )

    def __init__(self, first: int, capacity: int, groups: Sequence[tuple[np.dtype[Any], int]]) -> None:
        self.first = first
        self.capacity = capacity
        self.n = 0
        self.last_arrival = 0.0
        self._groups = groups
        self._packed: list[bytes] = []
        length = capacity + _SLACK_ROWS  # a multiple of 8: each column begins at one
        sizes = [length * dtype.itemsize for dtype, rows in groups for _ in range(rows)]
        self.begins = np.cumsum([0, *sizes[:-1]])
        memory = np.zeros(sum(sizes), np.uint8)
        self.memory = memory, memory.view(np.float64)
        self._arrays = []
        for dtype, rows in groups:
            size = rows * length * dtype.itemsize
            self._arrays.append(memory[:size].view(dtype).reshape(rows, length))
            memory = memory[size:]
        self.nbytes = sum(sizes)

    def _memory(self) -> list[NDArray[Any]]:
        return [np.zeros((rows, self.capacity + _SLACK_ROWS), dtype) for dtype, rows in self._groups]

    @property
    def arrays(self) -> list[NDArray[Any]]:
        """An array for each group of columns, (columns, capacity and some slack)."""
        if not self._packed:
            return self._arrays
        arrays = self._memory()
        for data, row in zip(self._packed, chain(*arrays), strict=True):
            unpack(data, row[: self.n])
        return arrays

    def columns(self, start: int, is_wanted: Callable[[int], bool]) -> list[NDArray[Any]]:
        """The samples of some columns, chosen by position, from the sequence number `start` on."""
        begin = max(start - self.first, 0)
        if not self._packed:
            return [row[begin : self.n] for at, row in enumerate(chain(*self._arrays)) if is_wanted(at)]
        dtypes = (dtype for dtype, rows in self._groups for _ in range(rows))
        columns = [(data, np.empty(self.n, dtype)) for data, dtype in zip(self._packed, dtypes, strict=True)]
        columns = [column for at, column in enumerate(columns) if is_wanted(at)]
        for data, out in columns:
            unpack(data, out)
        return [out[begin:] for _, out in columns]

    def pack(self) -> None:
        """Pack a full block."""
        if self.nbytes >= _PACKED_BYTES:
            self._packed = [packed(row[: self.n]) for row in chain(*self._arrays)]
            self._arrays, self.memory = [], _NO_MEMORY
            self.nbytes = sum(map(len, self._packed))


class RingBuffer:
    """The last samples of one channel.

    Args:
        dtypes: of the channel's own columns; `arrival` and `time` (float64) come before them.
        factors: from these columns, as sent, to those in the page's units; none if all are 1.
    """

    def __init__(self, dtypes: Sequence[str], factors: Sequence[float] = ()) -> None:
        columns = [np.dtype("<f8"), np.dtype("<f8"), *(np.dtype("<" + name) for name in dtypes)]
        self.columns = len(columns)
        self.sample_bytes = sum(dtype.itemsize for dtype in columns)
        self._groups = [(dtype, len(list(run))) for dtype, run in groupby(columns)]
        self._factors = (1.0, 1.0, *(factors or (1.0,) * len(dtypes)))
        self._scales = [
            _scales(list(islice(each, rows)), dtype) for each in [iter(self._factors)] for dtype, rows in self._groups
        ]
        self._per_8_bytes = [8 // dtype.itemsize for dtype, _ in self._groups]
        self._blocks: deque[RingBlock] = deque()
        self.total = 0
        self.nbytes = 0

    @property
    def first(self) -> int:
        """Sequence number of the oldest stored sample."""
        return self._blocks[0].first if self._blocks else self.total

    def __len__(self) -> int:
        return self.total - self.first

    @property
    def oldest_end(self) -> float:
        """Arrival of the newest sample in the oldest block; `drop_oldest` drops only samples up to this time."""
        return self._blocks[0].last_arrival if self._blocks else float("inf")

    @property
    def newest(self) -> float:
        """Arrival of the newest stored sample, unix s; minus infinity without one."""
        return self._blocks[-1].last_arrival if self._blocks else float("-inf")

    @property
    def blocks(self) -> int:
        return len(self._blocks)

    def append(self, columns: Sequence[NDArray[Any]]) -> None:
        """Add samples: `arrival`, `time`, then the channel's columns; 1-d, equal length, converted to our dtypes."""
        for block, at, take in self._room(len(columns[0])):
            column = iter(columns)
            for array in block.arrays:
                for row in array:
                    row[block.n : block.n + take] = next(column)[at : at + take]

    def append_wire(self, rows: WireRows) -> None:
        """Add samples as they were on the wire."""
        columns, n = (rows.bytes, rows.copies, rows.arrival_ns, rows.time), len(rows)
        block = self._blocks[-1] if self._blocks else self._grow()
        if 0 < n <= block.capacity - block.n:  # the usual case, in a third of the time
            append_rows(*columns, *block.memory, block.begins, block.n, 0, n)
            block.n += n
            block.last_arrival = block.memory[1].item(block.n - 1)
            self.total += n
            return
        for block, at, take in self._room(n):
            append_rows(*columns, *block.memory, block.begins, block.n, at, take)

    def _room(self, n: int) -> Iterator[tuple[RingBlock, int, int]]:
        """Blocks that have room for n samples: (block, first of the samples, how many); they are there afterwards."""
        at = 0
        while at < n:
            block = self._blocks[-1] if self._blocks else self._grow()
            if block.n == block.capacity:
                block = self._grow()
            take = min(n - at, block.capacity - block.n)
            yield block, at, take
            block.n += take
            block.last_arrival = float(block.arrays[0][0, block.n - 1])
            self.total += take
            at += take

    def _grow(self) -> RingBlock:
        most = max(FIRST_BLOCK, BLOCK_BYTES // self.sample_bytes & ~7)
        last = self._blocks[-1].capacity if self._blocks else FIRST_BLOCK // 2
        if len(self._blocks) >= _UNPACKED_BLOCKS:
            older = self._blocks[-_UNPACKED_BLOCKS]
            self.nbytes -= older.nbytes
            older.pack()
            self.nbytes += older.nbytes
        block = RingBlock(self.total, min(2 * last, most), self._groups)
        self._blocks.append(block)
        self.nbytes += block.nbytes
        return block

    def drop_oldest(self) -> None:
        """Drop the oldest block; the newest one is never dropped."""
        if len(self._blocks) > 1:
            self.nbytes -= self._blocks.popleft().nbytes

    def drop_before(self, arrival: float) -> None:
        """Drop the blocks without samples newer than `arrival` (unix seconds)."""
        while len(self._blocks) > 1 and self._blocks[0].last_arrival < arrival:
            self.drop_oldest()

    def sequence_at(self, arrival: float) -> int:
        """Sequence number of the first sample that arrived at or after `arrival`; `total` if there is none."""
        for block in self._blocks:
            if block.last_arrival >= arrival:
                (arrivals,) = block.columns(0, (0).__eq__)
                return block.first + int(np.searchsorted(arrivals, arrival))
        return self.total

    def frames(
        self, channel: int, start: int, stop: int, now: float, *, as_sent: bool = False
    ) -> Iterator[tuple[int, bytes]]:
        """Sample frames of the sequence numbers `start` ≤ s < `stop`, oldest first, as (samples, bytes)."""
        encode = partial(self._encode, channel=channel, now=now, history=False, as_sent=as_sent)
        if self._blocks and start >= self._blocks[-1].first:  # the usual case: samples since the last flush
            newest = self._blocks[-1]
            yield stop - start, encode(newest.arrays, start, stop, newest.first)
            return
        for block in self._blocks:
            a, b = max(start, block.first), min(stop, block.first + block.n)
            if a < b:
                yield b - a, encode(block.arrays, a, b, block.first)

    def history_frame(
        self, channel: int, start: int, stop: int, now: float, *, as_sent: bool = False
    ) -> tuple[int, float, bytes] | None:
        """The newest part of `start` ≤ s < `stop` that fits in one frame.

        Returns:
            Its first sequence number, the arrival of its first sample, the frame; None if nothing of it is stored.
        """
        for block in reversed(self._blocks):
            a, b = max(start, block.first), min(stop, block.first + block.n)
            if a < b:
                arrays = block.arrays
                arrival = float(arrays[0][0, a - block.first])
                with np.errstate(over="ignore"):
                    frame = self._encode(
                        arrays, a, b, block.first, channel=channel, now=now, history=True, as_sent=as_sent
                    )
                return a, arrival, frame
        return None

    def _encode(
        self,
        arrays: Sequence[NDArray[Any]],
        start: int,
        stop: int,
        first: int,
        *,
        channel: int,
        now: float,
        history: bool,
        as_sent: bool,
    ) -> bytes:
        """One frame of samples in the arrays of a block, whose first sequence number is `first`."""
        n, at = stop - start, start - first
        parts = [b""]
        size = HEADER.size
        for array, per, scales in zip(arrays, self._per_8_bytes, self._scales, strict=True):
            part = array[:, at : at + (n + per - 1) // per * per]
            for operation, by in () if as_sent else scales:
                part = operation(part, by)
            data = part.tobytes()
            size += len(data)
            parts.append(data)
        parts[0] = sample_header(channel, start, n, self.columns, size, now, history=history)
        return b"".join(parts)

    def read(self, start: int = 0, columns: Collection[int] | None = None) -> list[NDArray[Any]]:
        """Copies of columns in the page's units, all or those at some positions, from sequence number `start` on."""
        pieces: list[list[NDArray[Any]]] = []
        is_wanted: Callable[[int], bool] = (lambda at: True) if columns is None else columns.__contains__
        for block in reversed(self._blocks):  # the newest rows are read most often
            if start - block.first < block.n:
                pieces.insert(0, block.columns(start, is_wanted))
            if block.first <= start:
                break
        dtypes = [dtype for dtype, rows in self._groups for _ in range(rows)]
        if not pieces:
            return [np.zeros(0, dtype) for at, dtype in enumerate(dtypes) if is_wanted(at)]
        factors = [factor for at, factor in enumerate(self._factors) if is_wanted(at)]
        whole = [np.concatenate(column) for column in zip(*pieces, strict=True)]
        return [scaled(column, by) if by != 1 else column for column, by in zip(whole, factors, strict=True)]


def _scales(factors: Sequence[float], dtype: np.dtype[Any]) -> list[tuple[np.ufunc, NDArray[Any]]]:
    """Operations that convert the columns of a group, as `scaled` does; (columns, 1) operands."""
    exact = [factor < 1 and (1 / factor).is_integer() for factor in factors]
    times = [1.0 if is_exact else factor for factor, is_exact in zip(factors, exact, strict=True)]
    parts = [round(1 / factor) if is_exact else 1 for factor, is_exact in zip(factors, exact, strict=True)]
    both = ((np.multiply, times), (np.divide, parts))
    return [(operation, np.array(by, dtype)[:, None]) for operation, by in both if {*by} != {1}]
