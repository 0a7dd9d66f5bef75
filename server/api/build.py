"""What is running here? Version for people and scripts, and a health check for whoever restarts containers."""

from __future__ import annotations

import platform
from typing import Literal

from fastapi import APIRouter, Request
from pydantic import BaseModel

from server.auth import Role
from server.live.hub import Hub
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


class Healthy(BaseModel):
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
async def get_health(request: Request) -> Healthy:
    """Open to everybody; holds nothing of the devices but their number."""
    hub: Hub = request.app.state.hub
    return Healthy(devices=len(hub.devices), browsers=len(hub.outboxes))
