"""What is running here, and how does it do? Version for people and scripts, a health check for whoever restarts
containers, figures for Prometheus."""

from __future__ import annotations

import platform
from typing import Literal

from fastapi import APIRouter, Request
from fastapi.responses import Response
from pydantic import BaseModel

from server.auth import Role
from server.metrics import Metrics, Sources
from server.prometheus_text import CONTENT_TYPE
from server.streaming.hub import Hub
from server.version import VERSION
from server.wire import SUBPROTOCOL

router = APIRouter(tags=["build"])


class Build(BaseModel):
    """Which imuscope this is."""

    name: Literal["imuscope"] = "imuscope"
    version: str
    wire: str
    python: str
    machine: str
    run: str
    protocols: list[str]
    role: Role  # what whoever asks may do


class HealthStatus(BaseModel):
    """The server answers."""

    status: Literal["ok"] = "ok"
    devices: int
    browsers: int


@router.get("/api/build")
async def get_build(request: Request) -> Build:
    """Versions, the id of this run, and what the token that asks allows."""
    hub: Hub = request.app.state.hub
    return Build(
        version=VERSION,
        wire=SUBPROTOCOL,
        python=platform.python_version(),
        machine=platform.machine(),
        run=hub.run,
        protocols=list(request.app.state.protocols()),
        role=request.state.role,
    )


@router.get("/healthz")
async def get_health(request: Request) -> HealthStatus:
    """Open to everybody; holds nothing of the devices but their number."""
    hub: Hub = request.app.state.hub
    return HealthStatus(devices=len(hub.devices), browsers=hub.browsers)


@router.get("/metrics", responses={200: {"content": {"text/plain": {}}}})
async def get_metrics(request: Request) -> Response:
    """Figures for Prometheus, in its text form (server/metrics.py). They tell of devices, so beyond this machine a
    token is needed, as a bearer: a view token will do."""
    state = request.app.state
    metrics: Metrics = state.metrics
    sources = Sources(state.hub, state.sessions.all, state.recorder.state, state.exports.jobs, state.data)
    return Response(metrics.text(sources), media_type=CONTENT_TYPE, headers={"cache-control": "no-store"})
