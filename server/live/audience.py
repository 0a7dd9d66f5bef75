"""Who listens to a session: to what its decoder gives, to its chunks, to what is sent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

from protocols.events import Event
from server.listeners import Listeners

Direction = Literal["rx", "tx"]


class Audience:
    """The listeners of one session. Each is called in the event loop, so it must be quick."""

    def __init__(self) -> None:
        self._events: Listeners[[Event]] = Listeners()
        self._chunk_listeners: Listeners[[bytes, int, Direction]] = Listeners()
        self._sent: Listeners[[bytes, int]] = Listeners()

    def on_sent(self, callback: Callable[[bytes, int], None]) -> Callable[[], None]:
        """Call `callback(data, time)` with all that is sent; returns what takes it off."""
        return self._sent.add(callback)

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        """Call `callback` with every event of the decoder, in its order; returns what takes it off. Goes on over
        reconnections, after which offsets count from 0 again."""
        return self._events.add(callback)

    def chunks(self, callback: Callable[[bytes, int, Direction], None]) -> Callable[[], None]:
        """Call `callback(data, time, direction)` with every chunk that came ("rx") or was sent ("tx"), once each;
        time in ns since the Unix epoch. Returns what takes it off."""
        return self._chunk_listeners.add(callback)

    def _tell_events(self, events: Sequence[Event]) -> None:
        if self._events:
            for event in events:
                self._events.tell(event)
