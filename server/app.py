"""Assembly of the server: configuration in, ASGI application out. No logic here."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager

from fastapi import FastAPI
from starlette.types import ASGIApp

from imuscope.server.api import description, errors, static_files, unicode_guard
from imuscope.server.api.routers import ROUTERS
from imuscope.server.auth import Access, Guard
from imuscope.server.config import Config
from imuscope.server.devices.protocol_detection import ProtocolSet
from imuscope.server.devices.sessions import OpenLink
from imuscope.server.extension import install_extensions
from imuscope.server.links import open_link
from imuscope.server.page_files import Files
from imuscope.server.previous_names import PreviousPaths
from imuscope.server.rate_limit import RateLimiter
from imuscope.server.security_headers import Heads
from imuscope.server.services import build_services
from imuscope.server.timings import ViewerTimings
from imuscope.server.version import VERSION


def create_app(
    config: Config,
    access: Access,
    *,
    open_link: OpenLink = open_link,
    protocol_set: ProtocolSet | None = None,
    now_ns: Callable[[], int] | None = None,
    page_files: Files | None = None,
    timings: ViewerTimings | None = None,
    brought: Sequence[object] = (),
    has_devices: bool = True,
) -> ASGIApp:
    """The application, guarded.

    Args:
        open_link, protocol_set, now_ns, page_files, timings: links, protocols, clock, page and time limits; tests pass
            their own.
        brought: objects that an extension takes over: a fleet server, whose session is open.
        has_devices: False for a page of other robots: without sources, none is simulated.

    Raises:
        DecodeOptionError: the configuration has an invalid option of a source.
        FleetSettingsError: … or of the fleet.
    """
    page_files, timings = page_files or Files(), timings or ViewerTimings()
    services = build_services(
        config, access, open_link, protocol_set, now_ns, page_files, timings, tuple(brought), has_devices=has_devices
    )

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with services.running():
            services.parts.serve(app)
            yield

    app = FastAPI(
        title="imuscope",
        version=VERSION,
        summary="Live view of inertial sensors. Samples come over the WebSocket at /ws (see server/wire/).",
        lifespan=lifespan,
        docs_url=None,  # these two pages load scripts from other hosts
        redoc_url=None,
    )
    app.state.services = services
    errors.install(app)
    app.add_middleware(unicode_guard.UnicodeGuard)
    app.add_middleware(RateLimiter)
    app.add_middleware(Heads)
    app.add_middleware(PreviousPaths)
    for router in (*ROUTERS, *install_extensions(services), static_files.router):
        app.router.routes.extend(router.routes)
    of_every_route = errors.responses(401, 403, 411, 413, 415, 429, 500)
    description.install(app, access.routes, of_every_route)
    return Guard(app, access)
