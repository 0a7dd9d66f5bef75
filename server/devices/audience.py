"""Who listens to a session: to what its decoder gives, to its chunks, to what is sent."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from typing import Literal

from protocols.events import Event, sender_of
from server.links.base import Flow
from server.listeners import CallbackList

Direction = Literal["rx", "tx"]


class Audience:
    """The listeners of one session. Each is called in the event loop but for chunks, so it must be quick.

    Args:
        flow: of its link.
    """

    def __init__(self, flow: Flow) -> None:
        self._flow = flow
        self._events: dict[str, CallbackList[[Event]]] = {"": CallbackList()}  # by the sender's name in the stream
        self._sent: CallbackList[[bytes, int]] = CallbackList()
        self.turn = asyncio.Lock()  # of who configures a device: on one link one after the other
        self._closing: list[Callable[[], Awaitable[None]]] = []

    @property
    def left_out(self) -> int:
        """Bytes so far that came faster than they could be decoded, and were dropped; a recording has them."""
        return self._flow.left_out

    def on_sent(self, callback: Callable[[bytes, int], None]) -> Callable[[], None]:
        """Call `callback(data, time)` with all that is sent; returns what takes it off."""
        return self._sent.add(callback)

    def listen(self, callback: Callable[[Event], None], sender: str = "") -> Callable[[], None]:
        """Call `callback` with every event of one device, in the decoder's order; returns what takes it off. Goes on
        over reconnections, after which offsets count from 0 again.

        Args:
            sender: a further device of the link, by its name in the stream; "" is the link's own.
        """
        return self._events.setdefault(sender, CallbackList()).add(callback)

    def chunks(self, callback: Callable[[bytes, int, Direction], None]) -> Callable[[], None]:
        """Call `callback(data, time, direction)` with every chunk that came ("rx", in the link's reading thread) or was
        sent ("tx"), once each; time in ns since the Unix epoch. Returns what takes it off."""
        off_sent = self._sent.add(lambda data, time_ns: callback(data, time_ns, "tx"))
        off_came = self._flow.arrivals.add(lambda chunk: callback(chunk.data, chunk.arrival_ns, "rx"))

        def off() -> None:
            off_came()
            off_sent()

        return off

    def before_close(self, last: Callable[[], Awaitable[None]]) -> None:
        """Have something done before the link is closed for good."""
        self._closing.append(last)

    async def _tell_closing(self) -> None:
        for last in self._closing:
            await last()

    def _tell_events(self, events: Sequence[Event], own: str) -> None:
        """To who listens to its sender; `own` is what the stream calls the link's own device."""
        if any(self._events.values()):
            for event in events:
                name = sender_of(event)
                if (listeners := self._events.get("" if name == own else name)) is not None:
                    listeners.tell(event)
