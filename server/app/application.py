"""The application: services from the start, routes at the first request.

A robot without viewers needs no routes: they, their framework and their models take a quarter of the memory of a
server. They are imported in a thread while the first request waits; devices are decoded and recorded as before. Pages
for programs that watch over a server (server/api/status_pages.py) are answered without them.

    Heads ─> RateLimiter ─> /healthz, /metrics, or the routes (server/api/framework.py)
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import logging
import traceback
from typing import TYPE_CHECKING

from imuscope.server.access.auth import refuse
from imuscope.server.access.rate_limit import RateLimiter
from imuscope.server.access.security_headers import Heads
from imuscope.server.api.status_pages import device_list, health, metrics_page
from imuscope.server.errors import DomainError
from imuscope.server.services.extension import start_page_parts
from imuscope.server.services.services import Services
from imuscope.server.text.prometheus import CONTENT_TYPE

if TYPE_CHECKING:
    from fastapi import FastAPI
    from starlette.types import ASGIApp, Receive, Scope, Send


log = logging.getLogger("imuscope.api")


class Application:
    """ASGI application of a server, without its guard."""

    def __init__(self, services: Services) -> None:
        self.services = services
        self._bounded = Heads(RateLimiter(self._answer))
        self._routes: FastAPI | None = None
        self._opening: asyncio.Future[FastAPI] | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        answer: ASGIApp = self._live if scope["type"] == "lifespan" else self._bounded
        await answer(scope, receive, send)

    def framework(self) -> FastAPI:
        """All routes; imports what they need, which takes a while."""
        from imuscope.server.api.framework import build_framework

        return build_framework(self.services)

    def _early(self, path: str) -> tuple[str, str] | None:
        """Content type and text of an answer before the routes are imported; None for other paths."""
        if path in ("/healthz", "/api/devices"):
            body = health(self.services) if path == "/healthz" else device_list(self.services)
            return "application/json", json.dumps(body, ensure_ascii=False, separators=(",", ":"))
        return (CONTENT_TYPE, metrics_page(self.services)) if path == "/metrics" else None

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        if self._routes is None and scope["type"] == "http" and scope["method"] == "GET":
            early: tuple[str, str] | None = None
            with contextlib.suppress(Exception):  # the routes report it
                early = self._early(scope["path"])
            if early is not None:
                await send_text(send, *early)
                return
        if self._routes is None:
            if self._opening is None:
                self._opening = asyncio.ensure_future(self._open())
            try:
                self._routes = await asyncio.shield(self._opening)  # other requests wait for it, too
            except Exception as error:
                words = f"The pages cannot be served: {type(error).__name__}. Devices are decoded and recorded."
                await refuse(scope, receive, send, DomainError("fault", words, "The log has details."))
                return
        await self._routes(scope, receive, send)

    async def _open(self) -> FastAPI:
        try:
            framework = await asyncio.to_thread(self.framework)
            await start_page_parts(self.services)
        except Exception:
            log.exception("the routes cannot be built")
            raise
        self.services.catalogue.prepare()
        if gc.get_freeze_count():  # imported objects stay, as those of the start (server/http/server.py)
            gc.freeze()
        return framework

    async def _live(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Run the services from the start of the server to its end."""
        phase = "startup"
        await receive()
        try:
            async with self.services.running():
                self.services.parts.serve(self)
                await send({"type": "lifespan.startup.complete"})
                await receive()
                phase = "shutdown"
        except BaseException:
            await send({"type": f"lifespan.{phase}.failed", "message": traceback.format_exc()})
            raise
        await send({"type": "lifespan.shutdown.complete"})


async def send_text(send: Send, kind: str, text: str) -> None:
    """Answer with a text of a media type, which is not to be stored."""
    body = text.encode()
    head = {"content-type": kind, "content-length": str(len(body)), "cache-control": "no-store"}
    headers = [(name.encode(), value.encode()) for name, value in head.items()]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": body})
