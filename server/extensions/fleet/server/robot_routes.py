"""Routes of a fleet server: its robots and their events."""

import asyncio
from typing import Annotated

from fastapi import Depends, Query
from fastapi.responses import Response
from pydantic import BaseModel, Field

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.robots import Robots
from imuscope.server.extensions.fleet.model.summaries import FleetRobots
from imuscope.server.extensions.fleet.server.fleet_server import FleetServer

router = lazy_router(prefix="/api/fleet", tags=["fleet"])


async def robots_of(services: TheServices) -> Robots:
    robots = services.parts.find(Robots)
    if robots is None:
        hint = "It shows the devices of one robot. Open the page of the server that was started with `imuscope fleet`."
        raise DomainError("not-found", "This is not a fleet server.", hint)
    return robots


async def fleet_server_of(services: TheServices) -> FleetServer:
    await robots_of(services)
    server = services.parts.find(FleetServer)
    if server is None:
        raise DomainError("not-now", "This server does not collect robots.", "Start it with `imuscope fleet`.")
    return server


TheFleetServer = Annotated[FleetServer, Depends(fleet_server_of)]
TheRobots = Annotated[Robots, Depends(robots_of)]


class FleetEvent(BaseModel):
    """An event of a robot, or of a device of it."""

    id: int = Field(description="rises with each event that the fleet server receives")
    robot: str
    time: float = Field(description="clock of the robot, unix s")
    kind: str = Field(description="link, device, alarm, marker, command, clock, or another one that is not info")
    level: str = Field(description="info, warning or error")
    text: str
    device: str = Field(description="id of the robot's device; empty if it is of none")


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


@router.delete("/robots/{robot}", status_code=204, responses=responses(404, 409, 422))
async def remove_robot(robot: str, server: TheFleetServer) -> Response:
    """Remove a robot that is lost, for good, from the list. Its events stay. One that joins again is listed again."""
    if server.robots.get(robot) is None:
        raise DomainError(
            "not-found", f"Robot {robot:.80} not found.", "It may have been removed; choose one of the list."
        )
    if not server.collector.remove(robot):
        hint = "To keep it out, remove its line from the file of robots."
        raise DomainError("not-now", f"Robot {robot:.80} is live and would come back at once.", hint)
    return Response(status_code=204)


class FleetAcknowledgement(BaseModel):
    """Acknowledgement of a fleet alarm by an operator."""

    condition: str = Field(max_length=40, description="as in RobotAlarm")
    by: str = Field(max_length=200, description="name of the person")


@router.post("/robots/{robot}/acknowledge", status_code=204, responses=responses(404, 409, 422))
async def acknowledge_alarm(robot: str, body: FleetAcknowledgement, server: TheFleetServer) -> Response:
    """Acknowledge an alarm of the fleet server. Those of a robot are acknowledged on its own page."""
    server.acknowledge(robot, body.condition, body.by)
    return Response(status_code=204)


@router.get("/events", responses=responses(404, 409, 422))
async def list_events(
    server: TheFleetServer,
    robot: Annotated[str, Query(max_length=64, description="of this robot only")] = "",
    before: Annotated[int | None, Query(ge=0, le=2**53, description="id of an event: only older ones")] = None,
    limit: Annotated[int, Query(ge=1, le=1000)] = 200,
) -> list[FleetEvent]:
    """Events of all robots, the newest first, each once. They are stored within a second of their arrival."""
    events = await asyncio.to_thread(server.database.events, robot, before, limit)
    names = ("robot", "time", "kind", "level", "text", "device")
    return [FleetEvent(id=event_id, **{name: getattr(event, name) for name in names}) for event_id, event in events]
