"""The connections of a server, and the choice of the one that is closed when the server is full.

    HTTP         if the server is full, the connection that has been idle longest is closed for the new one: a client
                 that opens many idle connections loses them, and new requests are served
    handshake    of TLS (server/http/handshakes.py): counted and closed like HTTP
    WebSocket    at most half of the room: they stay open for hours, and are not closed for others

A connection is active when a part of a request arrives, or a part of an answer has been sent.
"""

from __future__ import annotations

import resource
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Limits of connections. Tests pass smaller ones.

    Args:
        head_s: for the head of a request; precedents: nginx 60, lighttpd 30, for slower networks.
        handshake_s: for the handshake of TLS; precedent: nginx 60 s; our page is used near the robot.
        most: number of connections.
    """

    head_s: float = 10.0
    handshake_s: float = 5.0
    most: int = 1000

    @property
    def connections(self) -> int:
        """Maximum number of connections of browsers and programs: half of the descriptors at most."""
        return min(self.most, resource.getrlimit(resource.RLIMIT_NOFILE)[0] // 2)


class Connections:
    """Open connections by time of last activity: HTTP, and pending handshakes; `len` counts HTTP.

    Attributes:
        limits: set once, before the server listens.
    """

    def __init__(self) -> None:
        self.limits = ConnectionLimits()
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
