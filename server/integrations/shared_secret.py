"""Who may come through a viewer's own port? We may, and nobody else.

    browser ──our port, our rules──> server/integrations/proxy.py ──secret──> 127.0.0.1:PORT of the viewer's process

A port on loopback is open to every user of this machine and to every page in a browser on it: a page of strangers may
not read what it is answered, but a WebSocket it may talk to. So whoever comes says a secret, in a header that no page
can set. It is made anew for each process and told to it on its standard input: it stands in no command line, in no
environment and in no file.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

HEADER = "x-imuscope-door"


@dataclass(frozen=True, slots=True)
class SecretEndpoint:
    """Where a viewer's process listens, and what to say there."""

    port: int
    secret: str = field(repr=False)

    @property
    def headers(self) -> dict[str, str]:
        return {HEADER: self.secret}


def new_secret() -> str:
    return secrets.token_urlsafe(24)


def has_secret(headers: Mapping[str, str], secret: str) -> bool:
    """Does this request come from us?"""
    return hmac.compare_digest(headers.get(HEADER, "").encode(), secret.encode())


@contextmanager
def require_secret(secret: str) -> Iterator[None]:
    """A server of the `websockets` library that a library of others starts within the block lets nobody else in."""
    serve = websockets.asyncio.server.serve

    def serve_us(handler: Any, host: str, port: int, *, process_request: Any = None, **options: Any) -> Any:
        def at_the_door(connection: ServerConnection, request: Request) -> Response | None:
            if not has_secret(request.headers, secret):
                return connection.respond(HTTPStatus.FORBIDDEN, "Open it through imuscope.\n")
            answer: Response | None = process_request(connection, request) if process_request else None
            return answer

        return serve(handler, host, port, process_request=at_the_door, **options)

    websockets.asyncio.server.serve = serve_us  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
