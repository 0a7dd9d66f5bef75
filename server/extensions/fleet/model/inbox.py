"""Messages from threads of the bus to the event loop, limited for each sender and in all.

Messages that do not fit are dropped and counted; the receiver notices by the numbers of the stream.
"""

import asyncio
import contextlib
import logging
import threading
from collections import deque
from collections.abc import Callable

log = logging.getLogger("imuscope.fleet")

PER_SENDER = 2 * 1024 * 1024  # bytes
IN_ALL = 64 * 1024 * 1024
OVERHEAD_BYTES = 200  # bytes that a message costs beside its own
MESSAGES_PER_PASS = 50
"""Messages that are handled before others have a turn of the loop."""


class Inbox:
    """The queue.

    Args:
        handle: called in the event loop with sender and message.
    """

    def __init__(self, handle: Callable[[str, bytes], None]) -> None:
        self.dropped = 0
        self._handle = handle
        self._loop: asyncio.AbstractEventLoop | None = None
        self._lock = threading.Lock()
        self._queue: deque[tuple[str, bytes]] = deque()
        self._sizes: dict[str, int] = {}
        self._size = 0

    def start(self) -> None:
        """Begin to handle messages in the running loop. Earlier ones are dropped."""
        self._loop = asyncio.get_running_loop()

    def put(self, sender: str, data: bytes) -> None:
        """Queue a message. May be called from any thread, and never waits."""
        loop = self._loop
        size = len(data) + OVERHEAD_BYTES
        with self._lock:
            queued = self._sizes.get(sender, 0) + size
            if loop is None or queued > PER_SENDER or self._size + size > IN_ALL:
                self.dropped += 1
                return
            self._sizes[sender] = queued
            self._size += size
            is_first = not self._queue
            self._queue.append((sender, data))
        if is_first:
            with contextlib.suppress(RuntimeError):  # the loop is closed already
                loop.call_soon_threadsafe(self._drain, loop)

    def _drain(self, loop: asyncio.AbstractEventLoop) -> None:
        for _ in range(MESSAGES_PER_PASS):
            with self._lock:
                if not self._queue:
                    return
                sender, data = self._queue[0]
            try:
                self._handle(sender, data)
            except Exception:  # the others have to be handled all the same
                log.exception("a message of the fleet could not be handled")
            finally:
                with self._lock:
                    self._queue.popleft()
                    left = self._sizes[sender] - len(data) - OVERHEAD_BYTES
                    self._size -= len(data) + OVERHEAD_BYTES
                    self._sizes[sender] = left
                    if not left:
                        del self._sizes[sender]
                    is_empty = not self._queue
            if is_empty:
                return
        loop.call_soon(self._drain, loop)
