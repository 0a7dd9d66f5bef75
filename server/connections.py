"""The connections of a server, and the choice of the one that is closed when the server is full.

    HTTP         if the server is full, the connection that has been idle longest is closed for the new one: a client
                 that opens many idle connections loses them, and new requests are served
    handshake    of TLS (server/handshakes.py): counted and closed like HTTP
    WebSocket    at most half of the room: they stay open for hours, and are not closed for others

A connection is active when a part of a request arrives, or a part of an answer has been sent.
"""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary


class Connections:
    """Open connections by time of last activity: HTTP, and pending handshakes; `len` counts HTTP."""

    def __init__(self) -> None:
        self._moved: dict[Any, None] = {}  # in order of last activity, newest last
        self._handshaking: set[Any] = set()

    def __len__(self) -> int:
        return len(self._moved) - len(self._handshaking)

    def moved(self, one: Any) -> None:
        """Note activity of a connection."""
        self._moved.pop(one, None)
        self._moved[one] = None

    @property
    def shaking(self) -> list[Any]:
        """Connections whose TLS handshake is pending."""
        return list(self._handshaking)

    def add(self, one: Any) -> None:
        """Add a connection whose TLS handshake is pending."""
        self._handshaking.add(one)
        self.moved(one)

    def remove(self, one: Any) -> None:
        """Remove a connection that is closed, upgraded to WebSocket, or past its handshake."""
        self._handshaking.discard(one)
        self._moved.pop(one, None)

    def close_idlest(self) -> Any:
        """Remove and return the connection that has been idle longest; None if there is none."""
        one = next(iter(self._moved), None)
        self.remove(one)
        return one


_of: WeakKeyDictionary[Any, Connections] = WeakKeyDictionary()


def connections_of(server: object) -> Connections:
    """The connections of one server (uvicorn.server.ServerState)."""
    return _of.setdefault(server, Connections())
