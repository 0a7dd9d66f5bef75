"""All routes of a server, as the framework's application: those of the heart, those of its extensions, the page."""

from __future__ import annotations

from fastapi import FastAPI

from imuscope.server.api import description, errors, static_files, unicode_guard
from imuscope.server.api.routers import ROUTERS
from imuscope.server.reference.pages import ReferencePages
from imuscope.server.services.extension import extension_routers
from imuscope.server.services.services import Services
from imuscope.server.version import VERSION


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
    app.add_middleware(unicode_guard.UnicodeGuard)
    for router in (*ROUTERS, *extension_routers(services), static_files.router):
        app.router.routes.extend(router.routes)
    of_every_route = errors.responses(401, 403, 411, 413, 415, 429, 500)
    description.install(app, services.access.routes, of_every_route)
    return app
