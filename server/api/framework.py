"""All routes of a server, as the framework's application: those of the heart, those of its extensions, the page."""

import json
from collections.abc import Mapping
from http.client import responses as phrases
from typing import Any

from fastapi import FastAPI
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from imuscope.server.access.auth import MAX_BODY, refuse
from imuscope.server.access.route_rules import RouteRules
from imuscope.server.api import (
    configure,
    devices,
    errors,
    exports,
    extension_pages,
    forms,
    map_tiles,
    packets,
    ports,
    recorder,
    recording_data,
    recordings,
    reference,
    snapshots,
    static_files,
    status,
    websocket,
    workspaces,
)
from imuscope.server.api.errors import ProblemBody
from imuscope.server.errors import DomainError
from imuscope.server.reference.pages import ReferencePages
from imuscope.server.services.extension import extension_routers
from imuscope.server.services.services import Services
from imuscope.server.version import VERSION

ROUTERS = tuple(
    module.router
    for module in (
        devices,
        configure,
        forms,
        snapshots,
        packets,
        recorder,
        exports,
        recordings,
        recording_data,
        workspaces,
        ports,
        status,
        map_tiles,
        websocket,
        reference,
        extension_pages,
    )
)
"""Before those of extensions. The page comes last: it matches every remaining path.

They are added directly: `include_router` would build every route and its validators again for each application, at the
first request, which would take a second longer.
"""


def build_framework(services: Services) -> FastAPI:
    """The routes of these services. They are started and closed elsewhere (server/app/application.py)."""
    app = FastAPI(
        title="imuscope",
        version=VERSION,
        summary="Live view of inertial sensors. Samples come over the WebSocket at /ws (see server/wire/).",
        docs_url=None,  # these two pages load scripts from other hosts
        redoc_url=None,
    )
    app.state.services = services
    app.state.reference = ReferencePages()
    errors.install(app)
    app.add_middleware(UnicodeGuard)
    for router in (*ROUTERS, *extension_routers(services), static_files.router):
        app.router.routes.extend(router.routes)
    of_every_route = errors.responses(401, 403, 411, 413, 415, 429, 500)
    describe(app, services.access.routes, of_every_route)
    return app


BEARER = {
    "type": "http",
    "scheme": "bearer",
    "description": "The view or control token that the server printed at its start. Not needed on loopback.",
}


def describe(app: FastAPI, rules: RouteRules, common: Mapping[int | str, Mapping[str, Any]]) -> None:
    """Add the token that server/access/auth.py asks for, and the shape of errors, to the OpenAPI description.

    Loopback needs no token. The description is the same for every server, so the empty requirement is listed beside the
    token's.

    Args:
        rules: which routes need a token.
        common: responses that every route can give besides its own.
    """
    original = app.openapi
    everywhere = {str(status): {"description": phrases[int(status)], **answer} for status, answer in common.items()}

    def openapi() -> dict[str, Any]:
        schema = original()
        components = schema.setdefault("components", {})
        components["securitySchemes"] = {"token": BEARER}
        shapes = {**components.get("schemas", {}), ProblemBody.__name__: ProblemBody.model_json_schema()}
        components["schemas"] = dict(sorted(shapes.items()))
        for path, methods in schema["paths"].items():
            for operation in methods.values():
                operation["responses"] = {**everywhere, **operation["responses"]}
                operation["security"] = [{"token": []}, {}] if rules.is_protected(path) else []
        return schema

    app.openapi = openapi  # type: ignore[method-assign]


SURROGATE = b"\\ud"


class UnicodeGuard:
    r"""ASGI middleware that rejects JSON bodies with an unpaired surrogate ("\ud83d"), which cannot be encoded in a
    file, log or answer (RFC 8259 §8.2), and passes others on. Their size was checked before (server/access/auth.py).
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
