"""Memory of the bytes of live links: the last minutes, received and sent, with their times.

    reading thread ──> LinkMemory ──> followers (a recording)
                          │ rx  [block][block][block] chunks
                          │ tx  [block] chunks
                          └──> runs(since): what a recording, an export or the view of packets reads

The reading thread only appends the chunks that it has anyway. When `BLOCK_BYTES` have gathered, they are packed into
one block: their bytes, where each chunk ends and when it arrived. A packed chunk costs half of its bytes and two more.

All links share one limit. Above it, the link that has most gives up its oldest block: a flood on one link shortens its
own memory, and a slow sensor beside it keeps its minutes. Bytes older than `history_s` before the newest of their link
are dropped, too; those of a silent link stay.

A follower continues exactly where the memory ends: `follow` returns the stored bytes and passes on every later chunk,
none twice and none lost, whatever the reading thread does at the same time.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Ints
from imuscope.server.devices.link.session import Session
from imuscope.server.links.base import CHUNK_COST, Chunk
from imuscope.server.streaming.packed_columns import packed, packed_bytes, unpack, unpacked_bytes

log = logging.getLogger("imuscope.bytes")

BLOCK_BYTES = 1 << 17  # of chunks and their objects, until they are packed; 0.3 s of a device at 2 kHz
BLOCK_COST = 400  # bytes of memory of a block's own objects
LATEST_NS = (1 << 63) - 1
RUN_CHUNKS = 512  # chunks of a run for a follower, so that several links can be merged by time

Direction = Literal["rx", "tx"]
Parts = tuple["Direction", list["PackedRun"], list[Sequence[Chunk]]]
"""Direction, packed and open chunks of a stream."""
Take = Callable[[Sequence[tuple[bytes, int]], Direction], None]
"""Takes chunks, (bytes, time in ns) each."""


@dataclass(frozen=True, slots=True)
class ByteRun:
    """Consecutive chunks of one direction of a link.

    Args:
        data: their bytes.
        ends: position in `data` at which each ends.
        arrival_ns: time of each, ns since the Unix epoch.
    """

    direction: Direction
    data: bytes
    ends: NDArray[np.int32] | Ints
    arrival_ns: Ints

    def between(self, since_ns: int, until_ns: int) -> ByteRun | None:
        """The chunks from the first at or after `since_ns` to the last before `until_ns`; None if there are none."""
        inside = np.flatnonzero((self.arrival_ns >= since_ns) & (self.arrival_ns < until_ns))
        if not len(inside):
            return None
        first, stop = int(inside[0]), int(inside[-1]) + 1
        if (first, stop) == (0, len(self.ends)):
            return self
        begin = int(self.ends[first - 1]) if first else 0
        data = self.data[begin : int(self.ends[stop - 1])]
        return ByteRun(self.direction, data, self.ends[first:stop] - begin, self.arrival_ns[first:stop])

    def pieces(self) -> Iterator[list[tuple[bytes, int]]]:
        """Its chunks as (bytes, time), `RUN_CHUNKS` at a time."""
        begins = [0, *self.ends[:-1].tolist()]
        chunks = zip(begins, self.ends.tolist(), self.arrival_ns.tolist(), strict=True)
        piece: list[tuple[bytes, int]] = []
        for begin, end, time_ns in chunks:
            piece.append((self.data[begin:end], time_ns))
            if len(piece) == RUN_CHUNKS:
                yield piece
                piece = []
        if piece:
            yield piece


class PackedRun:
    """A ByteRun that takes less memory.

    Attributes:
        first_ns, last_ns: time of its first and last chunk.
        nbytes: memory.
    """

    __slots__ = ("_arrivals", "_count", "_data", "_direction", "_ends", "first_ns", "last_ns", "nbytes")

    def __init__(self, run: ByteRun) -> None:
        self._direction = run.direction
        self._count = len(run.ends)
        self._data = packed_bytes(run.data)
        self._ends, self._arrivals = packed(run.ends), packed(run.arrival_ns)
        self.first_ns, self.last_ns = int(run.arrival_ns[0]), int(run.arrival_ns[-1])
        self.nbytes = len(self._data) + len(self._ends) + len(self._arrivals) + BLOCK_COST

    def run(self) -> ByteRun:
        ends, arrival_ns = np.empty(self._count, np.int32), np.empty(self._count, np.int64)
        unpack(self._ends, ends)
        unpack(self._arrivals, arrival_ns)
        return ByteRun(self._direction, unpacked_bytes(self._data), ends, arrival_ns)


def _run_of(direction: Direction, batches: Sequence[Sequence[Chunk]]) -> ByteRun:
    chunks = [chunk for batch in batches for chunk in batch]
    ends = np.array(list(accumulate(len(chunk.data) for chunk in chunks)), np.int32)
    times = np.array([chunk.arrival_ns for chunk in chunks], np.int64)
    return ByteRun(direction, b"".join([chunk.data for chunk in chunks]), ends, times)


class _Stream:
    """One direction of a link. The lock of its LinkMemory is held in every call."""

    def __init__(self, direction: Direction) -> None:
        self.direction = direction
        self.blocks: deque[PackedRun] = deque()
        self.open: list[Sequence[Chunk]] = []
        self.open_bytes = 0

    def append(self, chunks: Sequence[Chunk]) -> bool:
        """Append chunks; whether a block is full."""
        self.open.append(chunks)
        size = CHUNK_COST * len(chunks)
        for chunk in chunks:
            size += len(chunk.data)
        self.open_bytes += size
        return self.open_bytes >= BLOCK_BYTES

    def pack(self) -> int:
        """Pack the open chunks; returns the change of memory."""
        block, freed = PackedRun(_run_of(self.direction, self.open)), self.open_bytes
        self.blocks.append(block)
        self.open, self.open_bytes = [], 0
        return block.nbytes - freed


class LinkMemory:
    """Bytes of one link.

    Args:
        on_full: called in the reading thread after a block was packed, without a lock.
        history_s: how long bytes are kept.
    """

    def __init__(self, on_full: Callable[[], None], history_s: float) -> None:
        self._on_full = on_full
        self._history_ns = round(history_s * 1e9)
        self._lock = threading.Lock()
        self._streams: dict[str, _Stream] = {"rx": _Stream("rx"), "tx": _Stream("tx")}
        self._followers: tuple[Follower, ...] = ()
        self.nbytes = 0

    def append(self, chunks: Sequence[Chunk], direction: Direction) -> None:
        """Append chunks that were received or sent, and pass them to the followers."""
        if not chunks:
            return
        with self._lock:
            stream = self._streams[direction]
            before = stream.open_bytes
            full = stream.append(chunks)
            self.nbytes += stream.open_bytes - before
            if full:
                self.nbytes += stream.pack()
                self._forget(chunks[-1].arrival_ns - self._history_ns)
            followers = self._followers
        for follower in followers:
            try:
                follower.take(chunks, direction)
            except Exception:
                log.exception("a follower of a link failed and was removed")
                self.unfollow(follower)
        if full:
            self._on_full()

    def _forget(self, before_ns: int) -> None:
        for stream in self._streams.values():
            while stream.blocks and stream.blocks[0].last_ns < before_ns:
                self.nbytes -= stream.blocks.popleft().nbytes

    def drop_oldest(self) -> bool:
        """Drop the oldest block; False if there is none."""
        with self._lock:
            streams = [stream for stream in self._streams.values() if stream.blocks]
            if not streams:
                return False
            oldest = min(streams, key=lambda stream: stream.blocks[0].first_ns)
            self.nbytes -= oldest.blocks.popleft().nbytes
            return True

    def follow(self, take: Take, since_ns: int) -> Follower:
        """Pass stored chunks from a time on, and then every later one, to `take`; see Follower."""
        with self._lock:
            follower = Follower(self, take)
            parts = self._parts()
            self._followers = (*self._followers, follower)
        follower.past = _runs(parts, since_ns, LATEST_NS)
        return follower

    def unfollow(self, follower: Follower) -> None:
        """Pass nothing more to a follower."""
        with self._lock:
            self._followers = tuple(one for one in self._followers if one is not follower)

    def runs(self, since_ns: int = 0, until_ns: int = LATEST_NS) -> list[ByteRun]:
        """Stored chunks of both directions, each in order; times as for ByteRun.between."""
        with self._lock:
            parts = self._parts()
        return _runs(parts, since_ns, until_ns)

    def _parts(self) -> list[Parts]:
        return [(stream.direction, list(stream.blocks), list(stream.open)) for stream in self._streams.values()]

    @property
    def span(self) -> tuple[int, int] | None:
        """Times of the first and the last stored chunk that was received, ns; None without one."""
        with self._lock:
            ((_, blocks, waiting), *_) = self._parts()
        if not blocks and not waiting:
            return None
        first = blocks[0].first_ns if blocks else waiting[0][0].arrival_ns
        return first, waiting[-1][-1].arrival_ns if waiting else blocks[-1].last_ns


def _runs(parts: list[Parts], since_ns: int, until_ns: int) -> list[ByteRun]:
    runs: list[ByteRun] = []
    for direction, blocks, waiting in parts:
        stored = [block.run() for block in blocks if block.last_ns >= since_ns and block.first_ns < until_ns]
        if waiting:
            stored.append(_run_of(direction, waiting))
        runs += [run for block in stored if (run := block.between(since_ns, until_ns)) is not None]
    return runs


class Follower:
    """A reader of a link's memory that continues with what arrives.

    Chunks that arrive wait until `begin`, so that the past comes first; afterwards they are passed on in the thread
    that reads the link.

    Attributes:
        past: stored chunks; each direction in order.
    """

    def __init__(self, memory: LinkMemory, take: Take) -> None:
        self._memory = memory
        self._take = take
        self._lock = threading.Lock()
        self._waiting: list[tuple[Sequence[Chunk], Direction]] | None = []
        self.past: list[ByteRun] = []

    def take(self, chunks: Sequence[Chunk], direction: Direction) -> None:
        """Pass chunks on, or let them wait."""
        if self._waiting is not None:
            with self._lock:
                if self._waiting is not None:
                    self._waiting.append((chunks, direction))
                    return
        self._pass(chunks, direction)

    def _pass(self, chunks: Sequence[Chunk], direction: Direction) -> None:
        self._take([(chunk.data, chunk.arrival_ns) for chunk in chunks], direction)

    def begin(self) -> None:
        """Pass on the bytes received since, then everything at once. Call it after the past was taken."""
        with self._lock:  # a thread that has a chunk waits: there are few
            for chunks, direction in self._waiting or ():
                self._pass(chunks, direction)
            self._waiting = None

    def stop(self) -> None:
        """Take nothing more."""
        self._memory.unfollow(self)


class ByteMemory:
    """Memory of the bytes of all links.

    Args:
        limit: bytes of all links together.
        history_s: how long the bytes of a link are kept.
    """

    def __init__(self, limit: int, history_s: float) -> None:
        self._limit = limit
        self._history_s = history_s
        self._lock = threading.Lock()  # taken before that of a link
        self._links: dict[str, LinkMemory] = {}

    @property
    def nbytes(self) -> int:
        """Bytes used by the stored chunks of all links, with their objects."""
        return sum(link.nbytes for link in tuple(self._links.values()))

    def watch(self, session: Session) -> None:
        """Store the bytes of a session from now on, until it is closed."""
        device = session.info.id
        link = self._links[device] = LinkMemory(self._trim, self._history_s)
        off = session.listeners.chunks(link.append)

        async def removed() -> None:
            off()
            with self._lock:
                del self._links[device]

        session.listeners.before_close(removed)

    def of(self, device: str) -> LinkMemory | None:
        """The memory of the link of a device ("1", or "1.102"); None if it was removed."""
        return self._links.get(device.partition(".")[0])

    def _trim(self) -> None:
        with self._lock:
            links = list(self._links.values())
            while links and sum(link.nbytes for link in links) > self._limit:
                most = max(links, key=lambda link: link.nbytes)
                if not most.drop_oldest():
                    links.remove(most)
