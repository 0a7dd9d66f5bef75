"""What does every answer say to a browser about itself? Unless its route says more (pages do), this.

    content-security-policy      nothing in it may run, load or be framed: an answer is data, whoever made it
    x-content-type-options       and it is what it says it is: a recording of strangers is no page and no script
    cross-origin-resource-policy no page of another origin may take it in as a picture, a script or a style
    referrer-policy              addresses stay here

Policies of pages: server/api/page.py (`/`), server/api/rerun.py (`/rerun/`), server/views/proxy.py (`/viser/`).
"""

from __future__ import annotations

from starlette.types import Message, Send

DEFAULTS = (
    (b"content-security-policy", b"default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"no-referrer"),
)
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
