"""Reader thread: from a file descriptor to the event loop, with arrival times.

    reading thread                                     event loop
    wait ─> read ─> now_ns() ─> ChunkQueue.put_all  ──wake──>  ChunkQueue.take ──> session
      ^ self-pipe: stop                             <────────  ChunkQueue.take_now ──> session, before it decodes

The event loop is the wrong place to stamp arrivals: while it serves a browser, bytes wait in the kernel and would all
be stamped late. So one small thread per link sleeps until bytes arrive, reads, and takes the time before anything else
runs. A link with one descriptor does so in a compiled loop (read_loop.py), from whose memory the chunks are taken,
because Python's part costs more than the read itself.

The thread wakes the loop at most once per `WAKE_NS`, because that costs even more. While bytes arrive it hardly ever
does: a session takes the received chunks on its own before it decodes, and a recording the bytes before it writes, so
they are never late and already stamped. While an answer is expected, wake-ups come sooner, because their delay would
add up over a dialogue of fifty requests.
"""

import asyncio
import contextlib
import errno
import logging
import os
import select
import selectors
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

from imuscope.protocols.arrays import Ints
from imuscope.recordings.mcap.read_memory import ReadFollower
from imuscope.server.links.base import CHUNK_COST, MAX_HELD, SESSION_DEADLINE, Chunk, Link, LinkError
from imuscope.server.links.read_loop import ReadLoop

log = logging.getLogger(__name__)

WAKE_NS = 13_000_000  # longer than the flush interval of a browser, 12 ms, so that a flush comes first
LATE_NS = 4_000_000  # a taker may be late by this
GATHER_NS = 2_000_000  # a tenth of the time that bytes may take to the page
ANSWER_NS, AWAITED_NS = 2_000_000, 1_000_000_000  # wake-up interval while an answer is expected, and for how long
HOLD_S = 0.005  # between two checks whether a sender must still be held back
MIN_BYTES = 1024  # a chunk is not cut into smaller pieces
READ_BYTES = 1 << 16  # a tty returns at most 4 kB at once, a socket the requested size
DISCONNECTED_ERRNOS = frozenset({errno.EIO, errno.ENODEV, errno.ENXIO, errno.EBADF, errno.ENOENT})


class ChunkQueue:
    """Chunks on their way from one thread to one event loop.

    Create it in the event loop that calls `take`; `put`, `fail`, `flush` and `wait` are called by the reading thread.

    Args:
        link: their link, which determines how they are queued (server/links/base.py).

    Attributes:
        source: memory of the loop from which chunks are taken; None if all are put.
        received: number of chunks so far.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self.source: ReadLoop | None = None
        self._deadlines = link.flow.deadlines
        self._deadlines[SESSION_DEADLINE] = 0  # the first bytes wake the loop
        self.received = 0
        self._loop = asyncio.get_running_loop()
        self._ready = asyncio.Event()
        self._collecting = threading.Lock()  # held while chunks are taken from the source and put; taken first
        self._lock = threading.Lock()
        self._chunks: deque[Chunk] = deque()
        self._size = 0  # of the queued chunks, including CHUNK_COST for each
        self._error: LinkError | None = None
        self._is_waking = False  # a wake-up was sent and take() has not run since
        self._last_wake_ns = 0
        self._awaited_until_ns = 0

    def put(self, chunk: Chunk) -> None:
        """Add one chunk; the loop is woken at the next `flush`."""
        self.put_all((chunk,))

    def put_all(self, chunks: Sequence[Chunk]) -> None:
        """Add chunks; the loop is woken at the next `flush`."""
        self._link.flow.arrivals.call(chunks)
        self.received += len(chunks)
        size = CHUNK_COST * len(chunks)
        for chunk in chunks:
            size += len(chunk.data)
        with self._lock:
            self._chunks.extend(chunks)
            self._size += size
            if self._size > MAX_HELD and not self._link.waits:
                self._drop_oldest()

    def _drop_oldest(self) -> None:
        """Drop the oldest half: one long gap does less harm than many short ones."""
        while self._size > MAX_HELD // 2:
            size = len(self._chunks.popleft().data)
            self._size -= size + CHUNK_COST
            self._link.flow.dropped += size

    def fail(self, error: LinkError) -> None:
        """Mark the link as failed: `take` raises `error` after all queued chunks. Only the first failure is kept."""
        with self._lock:
            self._error = self._error or error
        self._wake_loop()

    def flush(self) -> float | None:
        """Wake the loop if a wake-up is due.

        Returns:
            Seconds after which to call again because chunks are waiting; None if no call is needed.
        """
        if not self._chunks or self._is_waking:
            return None
        now_ns = time.monotonic_ns()
        if now_ns < self._awaited_until_ns:
            wait_ns = self._last_wake_ns + ANSWER_NS - now_ns
        else:
            wait_ns = (int(self._deadlines[SESSION_DEADLINE]) or self._last_wake_ns + WAKE_NS) - now_ns
        if wait_ns > 0:
            return wait_ns / 1e9
        self._wake_loop()
        return None

    def gather_until_ns(self) -> int:
        """Monotonic time until which the reading thread may gather chunks of which a taker is late; 0 if one must not
        wait for others.
        """
        now_ns = time.monotonic_ns()
        return 0 if now_ns < self._awaited_until_ns else now_ns + GATHER_NS

    def put_read(self) -> None:
        """Put what the loop has read; in the reading thread, between two calls of it."""
        assert self.source is not None
        with self._collecting:
            if chunks := self.source.take_last():
                self.put_all(chunks)
            self.source.wake_follower()

    def collect(self, again_ns: int) -> None:
        """Put what the loop has read, for the session, which will take again after `again_ns`."""
        if self.source is not None:
            with self._collecting:
                if chunks := self.source.take_for(
                    SESSION_DEADLINE, again_ns and time.monotonic_ns() + again_ns + LATE_NS
                ):
                    self.put_all(chunks)

    def follow(self) -> ReadFollower | None:
        """Put what the loop has read, and let a recording follow it from here; None if there is no loop."""
        source = self.source
        if source is None:
            return None
        if source.follower is not None:
            return source.follower
        with self._collecting:
            if chunks := source.take():
                self.put_all(chunks)
            return source.follow()

    def unfollow(self) -> None:
        """Put what the loop has read, and end its follower there."""
        if self.source is not None:
            with self._collecting:
                if chunks := self.source.take():
                    self.put_all(chunks)
                self.source.unfollow()

    def wait(self, most: int, stopped: Callable[[float], bool]) -> None:
        """Hold the sender back while more than `most` bytes are queued.

        Args:
            most: bytes.
            stopped: sleeps for the given seconds; returns True if the link is being closed.
        """
        while self._size > most and self._link.waits and not stopped(HOLD_S):
            self.flush()

    def _wake_loop(self) -> None:
        self._is_waking = True
        self._last_wake_ns = time.monotonic_ns()
        with contextlib.suppress(RuntimeError):  # the loop is closed already
            self._loop.call_soon_threadsafe(self._ready.set)

    def take_now(self, again_ns: int) -> list[Chunk]:
        """Take received chunks on the event loop, without another wake-up.

        Args:
            again_ns: see Link.read_now.
        """
        now_ns = time.monotonic_ns()
        if now_ns < self._awaited_until_ns:
            again_ns = 0
        self.collect(again_ns)
        if not self._chunks:
            self._deadlines[SESSION_DEADLINE] = 0
            return []
        with self._lock:
            chunks = self._take_some()
        self._last_wake_ns = now_ns
        self._deadlines[SESSION_DEADLINE] = again_ns and now_ns + again_ns + LATE_NS
        return chunks

    def _take_some(self) -> list[Chunk]:
        """Remove and return the oldest chunks, about `Flow.at_once` bytes."""
        most, size = self._link.flow.at_once, 0
        if self._size <= most:
            chunks = list(self._chunks)
            self._chunks.clear()
            self._size = 0
            return chunks
        chunks = []
        while self._chunks and size < most:
            chunk = self._chunks.popleft()
            room = max(most - size, MIN_BYTES)
            if len(chunk.data) > room and not (self._link.datagrams and self._link.flow.keep_datagrams):
                self._chunks.appendleft(Chunk(chunk.data[room:], chunk.arrival_ns))
                chunk = Chunk(chunk.data[:room], chunk.arrival_ns, chunk.restart)
                self._size += CHUNK_COST
            chunks.append(chunk)
            size += len(chunk.data) + CHUNK_COST
        self._size -= size
        return chunks

    def expect_reply(self) -> None:
        """Wake the loop sooner for a while, because an answer is expected."""
        self._awaited_until_ns = time.monotonic_ns() + AWAITED_NS
        self._deadlines[SESSION_DEADLINE] = 0

    @property
    def backlog(self) -> int:
        """Number of bytes queued for `take`, including overhead."""
        return self._size

    @property
    def waiting_since_ns(self) -> int | None:
        """Arrival of the oldest queued chunk, ns since the Unix epoch; None if there is none."""
        with self._lock:
            return self._chunks[0].arrival_ns if self._chunks else None

    async def take(self) -> list[Chunk]:
        """Wait for chunks and return them.

        Raises:
            LinkError: the link is dead and drained.
        """
        if not self._deadlines[SESSION_DEADLINE]:  # a session that took by itself was not woken for the last bytes
            self.collect(0)
        while True:
            with self._lock:
                self._is_waking = False
                self._ready.clear()
                if self._chunks:
                    return self._take_some()
                if self._error is not None:
                    raise self._error
            await self._ready.wait()


class ReaderThread(threading.Thread):
    """Thread that calls a handler as soon as a file descriptor is readable.

    A handler runs in the thread, reads without blocking, stamps and queues chunks; it ends the link by raising
    LinkError.
    """

    def __init__(self, name: str, inbox: ChunkQueue) -> None:
        super().__init__(name=f"link {name}", daemon=True)
        self.queue = inbox
        self._selector = selectors.DefaultSelector()
        self._stopped = False
        self._loop: tuple[ReadLoop, Callable[[], None]] | None = None  # with the handler of its failures
        self._wake_read, self._wake_write = os.pipe()
        os.set_blocking(self._wake_write, False)
        self._selector.register(self._wake_read, selectors.EVENT_READ, None)

    def watch(self, fd: int, handler: Callable[[], None]) -> None:
        """Call `handler` whenever `fd` can be read. Before `start`, or from within a handler."""
        self._selector.register(fd, selectors.EVENT_READ, handler)

    def forget(self, fd: int) -> None:
        """Stop watching `fd`; to be called before it is closed."""
        self._selector.unregister(fd)

    def gather(self, fd: int, handler: Callable[[], None], now_ns: Callable[[], int], deadlines: Ints) -> ReadLoop:
        """Read `fd` alone, in a compiled loop; `handler` is called when that fails. Before `start`."""
        loop = ReadLoop(fd, self._wake_read, now_ns, deadlines)
        self._loop = loop, handler
        return loop

    def run(self) -> None:
        timeout: float | None = None
        until_ns = 0
        try:
            while not self._stopped:
                if self._loop is not None:
                    loop, failed = self._loop
                    loop.read(timeout, until_ns)
                    self.queue.put_read()
                    while loop.is_far_ahead and not self._stopped:
                        time.sleep(HOLD_S)  # a disk that is slower than a link for minutes must not fill the memory
                    if loop.failed and not self._stopped:
                        self.queue.unfollow()
                        failed()
                    until_ns = self.queue.gather_until_ns()
                else:
                    self._call_handlers(timeout)
                timeout = self.queue.flush()
                self.queue.wait(MAX_HELD, self._sleep)
        except LinkError as error:
            self.queue.fail(error)
        except Exception as error:  # top of the thread: a link must never fail silently
            log.exception("The reading thread of %s failed.", self.name)
            self.queue.fail(LinkError("gone", f"Reading failed: {error}.", "The server's log has the details."))

    def _call_handlers(self, timeout: float | None) -> None:
        for key, _ in self._selector.select(timeout):
            if key.data is not None and not self._stopped:
                key.data()

    def _sleep(self, seconds: float) -> bool:
        time.sleep(seconds)
        return self._stopped

    def stop(self) -> None:
        """End the thread and free its own descriptors; the watched ones belong to the caller. Idempotent."""
        if self._wake_write < 0:
            return
        self._stopped = True
        os.write(self._wake_write, b"\0")
        if self.is_alive():
            self.join()
        self._selector.close()
        os.close(self._wake_read)
        os.close(self._wake_write)
        self._wake_write = -1


class ThreadedLink(Link):
    """A link that is read by a `ReaderThread`: base of serial, TCP and UDP."""

    _queue: ChunkQueue | None = None
    _reader: ReaderThread | None = None

    def _start(self, fd: int, handler: Callable[[], None]) -> None:
        """Start reading `fd`."""
        self._reader = self._new_reader()
        self._reader.watch(fd, handler)
        self._reader.start()

    def _start_loop(self, fd: int, handler: Callable[[], None]) -> None:
        """Start reading `fd`, a stream without other descriptors; `handler` reads once if the compiled loop failed."""
        self._reader = self._new_reader()
        self._reader.queue.source = self._reader.gather(fd, handler, self.settings.now_ns, self.flow.deadlines)
        self._reader.start()

    def _new_reader(self) -> ReaderThread:
        self._queue = ChunkQueue(self)
        return ReaderThread(self.source, self._queue)

    async def read(self) -> list[Chunk]:
        if self._queue is None:
            raise closed(self.source)
        return await self._queue.take()

    def read_now(self, again_ns: int) -> list[Chunk]:
        return [] if self._queue is None else self._queue.take_now(again_ns)

    def follow(self) -> ReadFollower | None:
        return None if self._queue is None else self._queue.follow()

    def unfollow(self) -> None:
        if self._queue is not None:
            self._queue.unfollow()

    @property
    def is_followed(self) -> bool:
        return self._queue is not None and self._queue.source is not None and self._queue.source.follower is not None

    @property
    def backlog(self) -> int:
        return 0 if self._queue is None else self._queue.backlog

    @property
    def waiting_since_ns(self) -> int | None:
        return None if self._queue is None else self._queue.waiting_since_ns

    def expect_reply(self) -> None:
        if self._queue is not None:
            self._queue.expect_reply()

    def fail(self, error: LinkError) -> None:
        if self._queue is not None:
            self._queue.fail(error)

    async def close(self) -> None:
        if self._reader is not None:
            self._reader.stop()
            self._reader = None
        if self._queue is not None:
            self._queue.unfollow()
            self._queue.fail(closed(self.source))
            self._queue = None
        await self._release()

    async def _release(self) -> None:
        """Close what `open` opened; called after the thread has ended, possibly more than once."""
        raise NotImplementedError


def hung_up(fd: int) -> bool:
    """Whether the driver reports that the port is gone."""
    poll = select.poll()
    poll.register(fd, select.POLLIN)
    return any(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL) for _, event in poll.poll(0))


def closed(source: str) -> LinkError:
    """Error for reading or writing a closed link."""
    return LinkError("gone", f"The link to {source} is closed.", "Open it again.")


def _resolve(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)


async def write_all(fd: int, data: bytes, timeout_s: float = 5.0) -> None:
    """Write all of `data` to a non-blocking descriptor.

    Raises:
        TimeoutError: the other side does not accept it (blocked by flow control).
        OSError: reported by the kernel.
    """
    loop = asyncio.get_running_loop()
    view = memoryview(data)
    async with asyncio.timeout(timeout_s):
        while view:
            try:
                view = view[os.write(fd, view) :]
            except BlockingIOError:
                writable: asyncio.Future[None] = loop.create_future()
                loop.add_writer(fd, _resolve, writable)
                try:
                    await writable
                finally:
                    loop.remove_writer(fd)
