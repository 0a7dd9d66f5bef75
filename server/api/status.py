"""Routes of status: version and build, capabilities, health check for container managers, metrics for
Prometheus.
"""

import platform
from typing import Any, Literal

from fastapi import Request
from fastapi.responses import Response
from pydantic import BaseModel, Field

from imuscope.server.access.auth import Role
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.api.status_pages import health, metrics_page
from imuscope.server.text.prometheus import CONTENT_TYPE
from imuscope.server.version import VERSION
from imuscope.server.wire import SUBPROTOCOL
from imuscope.server.wire.capabilities import Capabilities

router = lazy_router(tags=["build"])

FIGURES: dict[int | str, dict[str, Any]] = {200: {"content": {"text/plain": {"schema": {"type": "string"}}}}}


class Build(BaseModel):
    """Version and build of this imuscope."""

    name: Literal["imuscope"] = "imuscope"
    version: str
    wire: str
    python: str
    machine: str
    run: str
    protocols: list[str]
    role: Role  # of the token of this request
    fleet: bool = Field(description="whether this is a fleet server, which shows robots instead of devices")
    absent: list[str] = Field(description="names of extensions whose packages are not installed")


class HealthStatus(BaseModel):
    """The server answers."""

    status: Literal["ok"] = "ok"
    devices: int
    browsers: int


@router.get("/api/build")
async def get_build(request: Request, services: TheServices) -> Build:
    """Versions, the id of this run, and the role of the request's token."""
    return Build(
        version=VERSION,
        wire=SUBPROTOCOL,
        python=platform.python_version(),
        machine=platform.machine(),
        run=services.telemetry.bus.run,
        protocols=list(services.protocols()),
        role=request.state.role,
        fleet=not services.has_devices,
        absent=[one.name for one in services.telemetry.clients.capabilities.absent],
    )


@router.get("/healthz")
async def get_health(services: TheServices) -> HealthStatus:
    """Health check. Needs no token; contains no device data but the number of devices."""
    return HealthStatus(**health(services))


@router.get("/metrics", response_class=Response, responses=FIGURES)
async def get_metrics(services: TheServices) -> Response:
    """Metrics in the text format of Prometheus (server/diagnostics/metrics.py). They contain device data, so requests
    from other machines need a bearer token; a view token is sufficient.
    """
    return Response(metrics_page(services), media_type=CONTENT_TYPE, headers={"cache-control": "no-store"})


@router.get("/api/capabilities")
async def get_capabilities(services: TheServices) -> Capabilities:
    """Everything that is registered, as sent to the page in `hello`."""
    return services.telemetry.clients.capabilities
