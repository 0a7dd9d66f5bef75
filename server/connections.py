"""The connections of a server, and which of them goes when there is no room for one more.

    HTTP         of a full server the one on which nothing has moved for longest is closed for the newcomer: who opens
                 many and keeps them silent loses them, and a request that comes, comes through
    handshake    of TLS (server/handshakes.py): counted with HTTP, and closed like it
    WebSocket    at most half of the room: they live for hours, and none is closed for another

A connection moves when a part of a request comes, or when a part of an answer has gone out.
"""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary


class Connections:
    """Those of HTTP, and those whose handshake is not over, by when they moved last; `len` is how many are of HTTP."""

    def __init__(self) -> None:
        self._moved: dict[Any, None] = {}  # the one that moved last is last in it
        self._shaking: set[Any] = set()

    def __len__(self) -> int:
        return len(self._moved) - len(self._shaking)

    def moved(self, one: Any) -> None:
        """Something came from it, or went out to it."""
        self._moved.pop(one, None)
        self._moved[one] = None

    @property
    def shaking(self) -> list[Any]:
        """Those of them whose TLS handshake is not over."""
        return list(self._shaking)

    def began(self, one: Any) -> None:
        """Its TLS handshake is to come."""
        self._shaking.add(one)
        self.moved(one)

    def gone(self, one: Any) -> None:
        """It is closed, or a WebSocket from here on; or its handshake is over, and what follows counts by itself."""
        self._shaking.discard(one)
        self._moved.pop(one, None)

    def idlest(self) -> Any:
        """Take out the one on which nothing has moved for longest; None where there is none."""
        one = next(iter(self._moved), None)
        self.gone(one)
        return one


_of: WeakKeyDictionary[Any, Connections] = WeakKeyDictionary()


def connections_of(server: object) -> Connections:
    """The connections of one server (uvicorn.server.ServerState)."""
    return _of.setdefault(server, Connections())
