"""Secret that restricts a viewer's own port to our proxy.

    browser ──our port, our rules──> server/integrations/proxy.py ──secret──> 127.0.0.1:PORT of the viewer's process

A loopback port is open to every user of this machine and to every page in a browser on it: a foreign page cannot read
HTTP answers, but it can use a WebSocket. So each request needs a secret in a header that no page can set. The secret is
generated for each process and passed on its standard input: no command line, environment or file contains it.
"""

import hmac
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

HEADER = "x-imuscope-door"


@dataclass(frozen=True, slots=True)
class SecretEndpoint:
    """Loopback address of a viewer's process, and its secret."""

    port: int
    secret: str = field(repr=False)

    @property
    def headers(self) -> dict[str, str]:
        return {HEADER: self.secret}


def new_secret() -> str:
    return secrets.token_urlsafe(24)


def has_secret(headers: Mapping[str, str], secret: str) -> bool:
    """Whether a request carries the secret."""
    return hmac.compare_digest(headers.get(HEADER, "").encode(), secret.encode())


@contextmanager
def require_secret(secret: str) -> Iterator[None]:
    """Restrict `websockets` servers that a third-party library starts within the block to clients with the secret."""
    import websockets.asyncio.server  # of a viewer's process; the server's own does without

    serve = websockets.asyncio.server.serve

    def serve_us(handler: Any, host: str, port: int, *, process_request: Any = None, **options: Any) -> Any:
        def check_secret(connection: "ServerConnection", request: "Request") -> "Response | None":
            if not has_secret(request.headers, secret):
                return connection.respond(HTTPStatus.FORBIDDEN, "Open it through imuscope.\n")
            answer: Response | None = process_request(connection, request) if process_request else None
            return answer

        return serve(handler, host, port, process_request=check_secret, **options)

    websockets.asyncio.server.serve = serve_us  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
