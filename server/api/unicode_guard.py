"""Middleware that rejects invalid Unicode. JSON can spell an unpaired surrogate, which cannot be encoded in a file,
log or answer.

    "\\ud83d\\ude80"    two surrogates: one character
    "\\ud83d"          unpaired: a valid str in Python until it is encoded

Rejecting it here covers all routes, before any of them uses the text. Source: RFC 8259 §8.2.
"""

from __future__ import annotations

import json

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from imuscope.server.access.auth import MAX_BODY, refuse
from imuscope.server.errors import DomainError

SURROGATE = b"\\ud"


class UnicodeGuard:
    """ASGI middleware that reads JSON bodies, checks them and passes them on. Their size was checked before
    (server/access/auth.py).
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or not _is_json(scope):
            await self._app(scope, receive, send)
            return
        messages: list[Message] = []
        size, more = 0, True
        while more and size <= MAX_BODY:
            messages.append(await receive())
            size += len(messages[-1].get("body", b""))
            more = messages[-1].get("more_body", False)
        if not is_whole(b"".join(message.get("body", b"") for message in messages)):
            why = DomainError("bad-request", "Invalid Unicode: unpaired surrogate.", "Resend the text as valid UTF-8.")
            await refuse(scope, receive, send, why)
            return
        pending = iter(messages)

        async def replay() -> Message:
            message = next(pending, None)
            return message if message is not None else await receive()

        await self._app(scope, replay, send)


def is_whole(body: bytes) -> bool:
    """False when a text in a JSON document cannot be encoded; invalid JSON is not checked here."""
    if SURROGATE not in body.lower():
        return True
    try:
        json.dumps(json.loads(body), ensure_ascii=False).encode()
    except UnicodeEncodeError:
        return False
    except (ValueError, RecursionError):
        return True
    return True


def _is_json(scope: Scope) -> bool:
    kinds = [value for name, value in scope["headers"] if name.lower() == b"content-type"]
    return any(kind.partition(b";")[0].strip().lower() == b"application/json" for kind in kinds)
