"""Is a text that comes whole? JSON can spell half of a character, which no file, log or answer can hold.

    "\\ud83d\\ude80"    two halves (surrogates): one character
    "\\ud83d"          one of them: a str in Python, until somebody writes it

So it is refused at the door, once for all routes, before anything is done with it. Source: RFC 8259 §8.2.
"""

from __future__ import annotations

import json

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.auth import MOST_BODY, refuse
from server.wire import Problem

HALF = b"\\ud"


class UnicodeGuard:
    """ASGI middleware: bodies of JSON, read and handed on. How large they may be was judged before (server/auth.py)."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or not _is_json(scope):
            await self._app(scope, receive, send)
            return
        came: list[Message] = []
        size, more = 0, True
        while more and size <= MOST_BODY:
            came.append(await receive())
            size += len(came[-1].get("body", b""))
            more = came[-1].get("more_body", False)
        if not is_whole(b"".join(message.get("body", b"") for message in came)):
            problem = Problem("bad-request", "A text in it holds half of a character.", "Was it cut in the middle?")
            await refuse(scope, receive, send, 422, problem)
            return
        waiting = iter(came)

        async def again() -> Message:
            message = next(waiting, None)
            return message if message is not None else await receive()

        await self._app(scope, again, send)


def is_whole(body: bytes) -> bool:
    """False when one of the texts in a JSON document could not be written; what is no JSON is not judged here."""
    if HALF not in body.lower():
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
