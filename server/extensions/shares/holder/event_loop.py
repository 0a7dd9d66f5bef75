"""File descriptors and their handlers: the holder's one epoll."""

from __future__ import annotations

import contextlib
import select
from collections.abc import Callable

MOST_AT_ONCE = 16  # ready descriptors; epoll fills a buffer of 12 kB for the usual thousand, at each wake-up
READ, WRITE, GONE = select.EPOLLIN, select.EPOLLOUT, select.EPOLLHUP | select.EPOLLERR
RELAYED, ONCE = select.EPOLLIN | select.EPOLLRDNORM, select.EPOLLET
"""A port that machine code reads: the second bit is its own (the first alone wakes it in older kernels), and each
arrival is reported once. Another look at a terminal would wait for the kernel's thread that brought the last bytes,
which a holder of higher priority has interrupted: two more sleeps for each frame.
"""

Handler = Callable[[int], None]
"""Called with what a descriptor is ready for."""


class EventLoop:
    """Watched descriptors with their handlers."""

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._handlers: dict[int, Handler] = {}

    @property
    def fd(self) -> int:
        """Descriptor that is readable when a watched one is ready."""
        return self._epoll.fileno()

    def watch(self, fd: int, events: int, handler: Handler) -> None:
        """Call `handler` when a descriptor is ready."""
        self._handlers[fd] = handler
        self._epoll.register(fd, events)

    def expect(self, fd: int, events: int) -> None:
        """Change what a watched descriptor is expected to become ready for."""
        if fd in self._handlers:
            with contextlib.suppress(OSError):
                self._epoll.modify(fd, events)

    def forget(self, fd: int) -> None:
        """Stop watching a descriptor, before it is closed. Idempotent."""
        if self._handlers.pop(fd, None) is not None:
            with contextlib.suppress(OSError):
                self._epoll.unregister(fd)

    def run_once(self, timeout_s: float, first: int = -1) -> None:
        """Call the handlers of descriptors that are ready now, or within the time; `first` before others."""
        handlers = self._handlers
        for fd, event in sorted(self._epoll.poll(timeout_s, MOST_AT_ONCE), key=lambda one: one[0] != first):
            handler = handlers.get(fd)
            if handler is not None:  # else one before it has forgotten it
                handler(event)

    def close(self) -> None:
        self._epoll.close()
