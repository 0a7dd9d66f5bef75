"""How do bytes get from a file descriptor into the event loop, with a true arrival time?

    reading thread                                  event loop
    epoll ─> read ─> now_ns() ─> ChunkQueue.put  ──wake──>  Inbox.take ──> session
      ^ self-pipe: stop                     <──────  Inbox.take_now ─> session, before it decodes

The event loop is the wrong place to stamp arrivals: while it serves a browser, bytes wait in the kernel and would all
be stamped late. So one small thread per link sleeps in epoll, reads, and takes the time before anything else runs. It
wakes the loop at most once per `WAKE_NS`, because a wake-up costs more than the read itself, and hardly ever while
somebody looks: before it decodes, 60 or 125 times a second, a session takes what has come without being called. So what
has come is never late for that, and the stamp is already taken. Where an answer is awaited wake-ups come sooner: a
dialogue of fifty questions would feel the difference.
"""

from __future__ import annotations

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
from collections.abc import Callable

from server.links.base import CHUNK_COST, MOST_HELD, Chunk, Link, LinkError

log = logging.getLogger(__name__)

WAKE_NS = 9_000_000  # longer than between two flushes for a browser, 8 ms, so that these come first
ANSWER_NS, AWAITED_NS = 2_000_000, 1_000_000_000  # the same for so long after something was sent
HOLD_S = 0.005  # between two looks whether a sender must still be held back
LEAST_BYTES = 1024  # a chunk is not cut into smaller pieces
READ_BYTES = 1 << 16  # a tty gives at most 4 kB at once, a socket whatever is asked for
GONE = frozenset({errno.EIO, errno.ENODEV, errno.ENXIO, errno.EBADF, errno.ENOENT})


class ChunkQueue:
    """Chunks on their way from one thread to one event loop.

    Made inside the running loop that will `take`. `put`, `fail`, `flush` and `wait` belong to the reading thread.

    Args:
        link: whose they are; it says how they wait (server/links/base.py).
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._loop = asyncio.get_running_loop()
        self._ready = asyncio.Event()
        self._lock = threading.Lock()
        self._chunks: deque[Chunk] = deque()
        self._size = 0  # of what waits, CHUNK_COST for each chunk included
        self._error: LinkError | None = None
        self._asked = False  # a wake-up is under way that has not been answered by take()
        self._last_wake_ns = 0
        self._awaited_until_ns = 0

    def put(self, chunk: Chunk) -> None:
        """Add one chunk; the loop hears of it at the next `flush`."""
        self._link.flow.arrivals.tell(chunk)
        with self._lock:
            self._chunks.append(chunk)
            self._size += len(chunk.data) + CHUNK_COST
            if self._size > MOST_HELD and not self._link.waits:
                self._leave_out()

    def _leave_out(self) -> None:
        """Drop the oldest half: one long hole is less harm than many short ones."""
        while self._size > MOST_HELD // 2:
            size = len(self._chunks.popleft().data)
            self._size -= size + CHUNK_COST
            self._link.flow.left_out += size

    def fail(self, error: LinkError) -> None:
        """The link is dead: `take` raises `error` once it has given out what came before. The first failure counts."""
        with self._lock:
            self._error = self._error or error
        self._wake()

    def flush(self) -> float | None:
        """Wake the loop if it is time to.

        Returns:
            Seconds after which to call again because chunks are waiting, None when nothing is.
        """
        if not self._chunks or self._asked:
            return None
        now_ns = time.monotonic_ns()
        wait_ns = self._last_wake_ns + (ANSWER_NS if now_ns < self._awaited_until_ns else WAKE_NS) - now_ns
        if wait_ns > 0:
            return wait_ns / 1e9
        self._wake()
        return None

    def wait(self, most: int, stopped: Callable[[float], bool]) -> None:
        """Hold the sender back while more than that waits.

        Args:
            most: bytes.
            stopped: sleeps so many seconds; True when the link is being closed.
        """
        while self._size > most and self._link.waits and not stopped(HOLD_S):
            self.flush()

    def _wake(self) -> None:
        self._asked = True
        self._last_wake_ns = time.monotonic_ns()
        with contextlib.suppress(RuntimeError):  # the loop has been closed under us: nobody is left to hear it
            self._loop.call_soon_threadsafe(self._ready.set)

    def take_now(self) -> list[Chunk]:
        """What has arrived, in the event loop; the loop need not be woken for it any more."""
        if not self._chunks:
            return []
        with self._lock:
            chunks = self._some()
        self._last_wake_ns = time.monotonic_ns()
        return chunks

    def _some(self) -> list[Chunk]:
        """The oldest, about as many bytes as are wanted at once."""
        most, taken, chunks = self._link.flow.at_once, 0, []
        while self._chunks and taken < most:
            chunk = self._chunks.popleft()
            room = max(most - taken, LEAST_BYTES)
            if len(chunk.data) > room and not (self._link.datagrams and self._link.flow.whole):
                self._chunks.appendleft(Chunk(chunk.data[room:], chunk.arrival_ns))
                chunk = Chunk(chunk.data[:room], chunk.arrival_ns, chunk.anew)
                self._size += CHUNK_COST
            chunks.append(chunk)
            taken += len(chunk.data) + CHUNK_COST
        self._size -= taken
        return chunks

    def expect(self) -> None:
        """Something was sent: an answer may come."""
        self._awaited_until_ns = time.monotonic_ns() + AWAITED_NS

    @property
    def held(self) -> int:
        """Bytes that wait for `take`, with what they cost beside."""
        return self._size

    async def take(self) -> list[Chunk]:
        """Wait, then what has arrived.

        Raises:
            LinkError: the link is dead and drained.
        """
        while True:
            with self._lock:
                self._asked = False
                self._ready.clear()
                if self._chunks:
                    return self._some()
                if self._error is not None:
                    raise self._error
            await self._ready.wait()


class ReaderThread(threading.Thread):
    """One thread that calls a handler as soon as a file descriptor has something to read.

    A handler runs in the thread, reads without blocking, stamps and puts; it ends the link by raising LinkError.
    """

    def __init__(self, name: str, inbox: ChunkQueue) -> None:
        super().__init__(name=f"link {name}", daemon=True)
        self.inbox = inbox
        self._selector = selectors.DefaultSelector()
        self._stopped = False
        self._wake_read, self._wake_write = os.pipe()
        os.set_blocking(self._wake_write, False)
        self._selector.register(self._wake_read, selectors.EVENT_READ, None)

    def watch(self, fd: int, handler: Callable[[], None]) -> None:
        """Call `handler` whenever `fd` can be read. Before `start`, or from within a handler."""
        self._selector.register(fd, selectors.EVENT_READ, handler)

    def forget(self, fd: int) -> None:
        """Stop watching `fd`; to be called before it is closed."""
        self._selector.unregister(fd)

    def run(self) -> None:
        timeout: float | None = None
        try:
            while not self._stopped:
                for key, _ in self._selector.select(timeout):
                    if key.data is not None and not self._stopped:
                        key.data()
                timeout = self.inbox.flush()
                self.inbox.wait(MOST_HELD, self._sleep)
        except LinkError as error:
            self.inbox.fail(error)
        except Exception as error:  # the thread's top: a link must never die without a word
            log.exception("The reading thread of %s failed.", self.name)
            self.inbox.fail(LinkError("gone", f"Reading failed: {error}.", "The server's log has the details."))

    def _sleep(self, seconds: float) -> bool:
        time.sleep(seconds)
        return self._stopped

    def stop(self) -> None:
        """End the thread and free its descriptors; what it watched is the caller's. Idempotent."""
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
    """A link whose bytes come through a `ReaderThread`: what serial, TCP and UDP have in common."""

    _inbox: ChunkQueue | None = None
    _pump: ReaderThread | None = None

    def _start(self, fd: int, handler: Callable[[], None]) -> None:
        """Begin reading `fd`."""
        self._pump = self._new_pump()
        self._pump.watch(fd, handler)
        self._pump.start()

    def _new_pump(self) -> ReaderThread:
        self._inbox = ChunkQueue(self)
        return ReaderThread(self.source, self._inbox)

    async def read(self) -> list[Chunk]:
        if self._inbox is None:
            raise closed(self.source)
        return await self._inbox.take()

    def read_now(self) -> list[Chunk]:
        return [] if self._inbox is None else self._inbox.take_now()

    @property
    def held(self) -> int:
        return 0 if self._inbox is None else self._inbox.held

    def expect(self) -> None:
        if self._inbox is not None:
            self._inbox.expect()

    def give_up(self, error: LinkError) -> None:
        if self._inbox is not None:
            self._inbox.fail(error)

    async def close(self) -> None:
        if self._pump is not None:
            self._pump.stop()
            self._pump = None
        if self._inbox is not None:
            self._inbox.fail(closed(self.source))
            self._inbox = None
        await self._free()

    async def _free(self) -> None:
        """Close what `open` opened; called after the thread has ended, possibly more than once."""
        raise NotImplementedError


def hung_up(fd: int) -> bool:
    """True when the driver says that the port is gone."""
    poll = select.poll()
    poll.register(fd, select.POLLIN)
    return any(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL) for _, event in poll.poll(0))


def closed(source: str) -> LinkError:
    """What reading or writing a closed link raises."""
    return LinkError("gone", f"The link to {source} is closed.", "Open it again.")


def _resolve(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)


async def write_all(fd: int, data: bytes, timeout_s: float = 5.0) -> None:
    """Write all of `data` to a non-blocking descriptor.

    Raises:
        TimeoutError: the other side does not take it (flow control holds it back).
        OSError: as the kernel says.
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
