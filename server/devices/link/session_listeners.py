"""Listeners of a session: decoded events, received chunks and sent bytes."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import Literal

from imuscope.protocols.events import Batch, Event, Reply, sender_of
from imuscope.server.concurrency.listeners import CallbackList
from imuscope.server.links.base import Chunk, Flow

log = logging.getLogger("imuscope.session")

Direction = Literal["rx", "tx"]


class SessionListeners:
    """The listeners of one session. All but chunk listeners are called in the event loop, so they must be quick.

    Args:
        flow: the flow of its link.

    Attributes:
        sent: called with all data sent to the device, and when, ns since the Unix epoch.
    """

    def __init__(self, flow: Flow) -> None:
        self._flow = flow
        self._events: dict[str, CallbackList[[Event]]] = {"": CallbackList()}  # by the sender's name in the stream
        self._news: dict[str, CallbackList[[Batch | Reply]]] = {}  # by the same name
        self._streaming: set[str] = set()  # senders of a batch after their last reply
        self.sent: CallbackList[[bytes, int]] = CallbackList()
        self.turn = asyncio.Lock()  # held while a device is configured: one at a time on a link
        self._closing: list[Callable[[], Awaitable[None]]] = []

    def listen(self, callback: Callable[[Event], None], sender: str = "") -> Callable[[], None]:
        """Call `callback` with every event of one device, in the decoder's order; returns a function that removes it.
        It stays over reconnections, after which offsets count from 0 again.

        Args:
            sender: name in the stream of a further device of the link; "" for the link's own.
        """
        return self._events.setdefault(sender, CallbackList()).add(callback)

    def listen_to_news(self, callback: Callable[[Batch | Reply], None], sender: str = "") -> Callable[[], None]:
        """Call `callback` with every reply of one device, and with its first samples after each; else as `listen`."""
        self.expect_samples(sender)  # it may be added after the first ones
        return self._news.setdefault(sender, CallbackList()).add(callback)

    def expect_samples(self, sender: str = "") -> None:
        """Take the next samples of a device for news, although no reply comes before them."""
        self._streaming.discard(sender)

    def chunks(self, callback: Callable[[Sequence[Chunk], Direction], None]) -> Callable[[], None]:
        """Call `callback(chunks, direction)` once with every chunk, received ("rx", in the reading thread) or sent
        ("tx"), those that came together at once. Returns a function that removes it.
        """
        off_sent = self.sent.add(lambda data, time_ns: callback((Chunk(data, time_ns),), "tx"))
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
        if any(self._events.values()) or any(self._news.values()):
            for event in events:
                sender = sender_of(event)
                name = "" if sender == own else sender
                self._publish_news(event, name)
                if (listeners := self._events.get(name)) is not None:
                    listeners.call(event)

    def _publish_news(self, event: Event, name: str) -> None:
        match event:
            case Reply():
                self._streaming.discard(name)
            case Batch() if name not in self._streaming:
                self._streaming.add(name)
            case _:
                return
        if (listeners := self._news.get(name)) is not None:
            listeners.call(event)
