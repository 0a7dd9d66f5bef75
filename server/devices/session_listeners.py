"""Listeners of a session: decoded events, received chunks and sent bytes."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import Literal

from imuscope.protocols.events import Event, sender_of
from imuscope.server.links.base import Chunk, Flow
from imuscope.server.listeners import CallbackList

log = logging.getLogger("imuscope.session")

Direction = Literal["rx", "tx"]


class SessionListeners:
    """The listeners of one session. All but chunk listeners are called in the event loop, so they must be quick.

    Args:
        flow: the flow of its link.
    """

    def __init__(self, flow: Flow) -> None:
        self._flow = flow
        self._events: dict[str, CallbackList[[Event]]] = {"": CallbackList()}  # by the sender's name in the stream
        self._sent: CallbackList[[bytes, int]] = CallbackList()
        self.turn = asyncio.Lock()  # held while a device is configured: one at a time on a link
        self._closing: list[Callable[[], Awaitable[None]]] = []

    @property
    def left_out(self) -> int:
        """Bytes dropped so far because they arrived faster than they could be decoded; a recording has them."""
        return self._flow.dropped

    def on_sent(self, callback: Callable[[bytes, int], None]) -> Callable[[], None]:
        """Call `callback(data, time)` with all sent data; returns a function that removes it."""
        return self._sent.add(callback)

    def note_sent(self, data: bytes, time_ns: int) -> None:
        """Pass bytes that another client of a shared port sent to the device to the listeners."""
        self._sent.call(data, time_ns)

    def listen(self, callback: Callable[[Event], None], sender: str = "") -> Callable[[], None]:
        """Call `callback` with every event of one device, in the decoder's order; returns a function that removes it.
        It stays over reconnections, after which offsets count from 0 again.

        Args:
            sender: name in the stream of a further device of the link; "" for the link's own.
        """
        return self._events.setdefault(sender, CallbackList()).add(callback)

    def chunks(self, callback: Callable[[bytes, int, Direction], None]) -> Callable[[], None]:
        """Call `callback(data, time, direction)` once with every chunk that was received ("rx", in the link's reading
        thread) or sent ("tx"); time in ns since the Unix epoch. Returns a function that removes it.
        """

        def each(chunks: Sequence[Chunk], direction: Direction) -> None:
            for chunk in chunks:
                callback(chunk.data, chunk.arrival_ns, direction)

        return self.chunk_batches(each)

    def chunk_batches(self, callback: Callable[[Sequence[Chunk], Direction], None]) -> Callable[[], None]:
        """As `chunks`, with all chunks that were received together at once."""
        off_sent = self._sent.add(lambda data, time_ns: callback((Chunk(data, time_ns),), "tx"))
        off_came = self._flow.arrivals.add(lambda chunks: callback(chunks, "rx"))

        def off() -> None:
            off_came()
            off_sent()

        return off

    def before_close(self, last: Callable[[], Awaitable[None]]) -> Callable[[], None]:
        """Run a coroutine before the link is closed for good; returns a function that forgets it."""
        self._closing.append(last)
        return lambda: self._closing.remove(last)

    async def close(self) -> None:
        """Run what was to be run before the link is closed. An error of one must not leave the link open for ever."""
        for last in tuple(self._closing):
            try:
                await last()
            except Exception:
                log.exception("an end of work on a link failed")

    def publish(self, events: Sequence[Event], own: str) -> None:
        """Pass events to the listeners of their sender; `own` is the link's own device in the stream."""
        if any(self._events.values()):
            for event in events:
                name = sender_of(event)
                if (listeners := self._events.get("" if name == own else name)) is not None:
                    listeners.call(event)
