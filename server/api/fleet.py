"""Routes of a fleet server: its robots."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Query
from fastapi.responses import Response

from server.api.dependencies import TheServices
from server.api.errors import responses
from server.errors import DomainError
from server.fleet.robots import Robots
from server.fleet.summaries import FleetRobots

router = APIRouter(prefix="/api/fleet", tags=["fleet"])


async def robots_of(services: TheServices) -> Robots:
    if services.robots is None:
        hint = "It shows the devices of one robot. Open the page of the server that was started with `imuscope fleet`."
        raise DomainError("not-found", "This is not a fleet server.", hint)
    return services.robots


TheRobots = Annotated[Robots, Depends(robots_of)]


@router.get("/robots", response_model=FleetRobots, responses=responses(404, 422))
async def list_robots(
    robots: TheRobots,
    after: Annotated[
        int | None, Query(ge=0, description="a revision: only what changed after it; without it, all robots")
    ] = None,
) -> Response:
    """Robots of the fleet, at a glance.

    Figures keep their value until they differ by about 1 %, so that a robot that is well does not change. A revision of
    an earlier run of the server is answered with all robots, and `complete`.
    """
    return Response(robots.since(after), media_type="application/json", headers={"cache-control": "no-store"})
