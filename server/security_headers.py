"""What does every answer say to a browser about itself? Unless its route says more (pages do), this.

    content-security-policy      nothing in it may run, load or be framed: an answer is data, whoever made it
    x-content-type-options       and it is what it says it is: a recording of strangers is no page and no script
    cross-origin-resource-policy no page of another origin may take it in as a picture, a script or a style
    referrer-policy              addresses stay here

Policies of pages: server/api/static_files.py (`/`), server/api/rerun.py (`/rerun/`), server/integrations/proxy.py
(`/viser/`).
"""

from __future__ import annotations

from starlette.types import ASGIApp, Message, Receive, Scope, Send

DEFAULTS = (
    (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"no-referrer"),
)
WITHOUT_HEAD = ("/api/", "/healthz", "/metrics")  # of the other paths each answers it by itself
STARTS = ("http.response.start", "websocket.http.response.start")


def with_defaults(send: Send) -> Send:
    """`send`, where an answer's head gets those of `DEFAULTS` that it has not."""

    async def sending(message: Message) -> None:
        if message["type"] in STARTS:
            there = {name.lower() for name, _ in message["headers"]}
            missing = [header for header in DEFAULTS if header[0] not in there]
            message = {**message, "headers": [*message["headers"], *missing]}
        await send(message)

    return sending


class Heads:
    """ASGI middleware: HEAD of what has a GET is that without its body, as RFC 9110 (9.3.2) wants it; frameworks route
    it only where it is named."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] != "HEAD" or not scope["path"].startswith(WITHOUT_HEAD):
            await self._app(scope, receive, send)
            return

        async def sending(message: Message) -> None:
            await send({**message, "body": b""} if message["type"] == "http.response.body" else message)

        await self._app({**scope, "method": "GET"}, receive, sending)
