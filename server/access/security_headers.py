"""Default security headers of every response; routes may set their own (pages do).

    content-security-policy      nothing in the response may run, load or be framed: a response is data
    x-content-type-options       no type sniffing: an uploaded recording is never taken for a page or a script
    cross-origin-resource-policy no page of another origin may embed it as an image, a script or a style
    referrer-policy              addresses are not sent to other sites

Policies of pages: server/api/static_files.py (`/`), server/extensions/rerun/routes.py (`/rerun/`),
server/integrations/proxy.py (`/viser/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send


DEFAULTS = (
    (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"no-referrer"),
)
WEBHOOK_HEADER = "imuscope-webhook"  # of requests that webhooks of alarms make (server/extensions/alarms/webhooks.py)
WITHOUT_HEAD = ("/api/", "/healthz", "/metrics")  # the other paths answer HEAD themselves
STARTS = ("http.response.start", "websocket.http.response.start")


def with_defaults(send: Send) -> Send:
    """`send` that adds the missing headers of `DEFAULTS` to a response."""

    async def sending(message: Message) -> None:
        if message["type"] in STARTS:
            present = {name.lower() for name, _ in message["headers"]}
            missing = [header for header in DEFAULTS if header[0] not in present]
            message = {**message, "headers": [*message["headers"], *missing]}
        await send(message)

    return sending


class Heads:
    """ASGI middleware: HEAD on a path with GET gives the same response without its body (RFC 9110, 9.3.2); the
    framework routes HEAD only if a route names it.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] != "HEAD" or not scope["path"].startswith(WITHOUT_HEAD):
            await self._app(scope, receive, send)
            return

        async def sending(message: Message) -> None:
            await send({**message, "body": b""} if message["type"] == "http.response.body" else message)

        await self._app({**scope, "method": "GET"}, receive, sending)
