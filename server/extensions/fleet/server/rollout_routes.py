"""Routes of a fleet server: the profile of a group, applied to its robots in waves."""

from typing import Annotated

from fastapi import Query
from fastapi.responses import Response
from pydantic import BaseModel, Field

from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.extensions.fleet.model.rollout_models import DEFAULT_WAVES, Rollout, RolloutHead, RolloutPlan
from imuscope.server.extensions.fleet.server.profile_routes import device_of
from imuscope.server.extensions.fleet.server.robot_routes import TheFleetServer

router = lazy_router(prefix="/api/fleet", tags=["fleet"])

WAVES = "sizes of waves, or percentages of the rest, separated by commas; the last one is repeated"
Waves = Annotated[str, Query(max_length=200, description=WAVES)]


class RolloutRequest(BaseModel):
    """The plan that a user has seen, and how it is to be carried out."""

    device: str = Field(max_length=100, description="id of a device of the robot, whose profile it is")
    plan: str = Field(max_length=40, description="id of the plan")
    by: str = Field(max_length=200, description="name of the person")
    waves: str = Field(DEFAULT_WAVES, max_length=200, description=WAVES)
    watch_s: float = Field(
        10.0, ge=1, le=300, description="time for which a device has to deliver before it is confirmed, s"
    )


class RolloutStopRequest(BaseModel):
    """A user who stops a rollout."""

    by: str = Field(max_length=200, description="name of the person")


@router.get("/robots/{robot}/rollout", responses=responses(404, 409, 422))
async def plan_rollout(
    robot: str,
    server: TheFleetServer,
    device: Annotated[str, Query(max_length=100, description="id of the robot's device, whose profile it is")],
    waves: Waves = DEFAULT_WAVES,
) -> RolloutPlan:
    """Plan of a rollout: devices of the group that differ from the profile that this one is compared with."""
    return server.rollouts.plan(*device_of(server, robot, device), waves)


@router.post("/robots/{robot}/rollout", status_code=202, responses=responses(404, 409, 412, 422, 507))
async def start_rollout(robot: str, body: RolloutRequest, server: TheFleetServer) -> Rollout:
    """Carry a plan out, in waves. Each device is written to with settings that are temporary until they are confirmed:
    once it has delivered for `watch_s` at the rate of the profile, with the settings of the profile. Otherwise the
    robot rolls back by itself, and no further wave begins. 412 if the plan has changed.
    """
    place = device_of(server, robot, body.device)
    return await server.rollouts.begin(*place, body.by, plan_id=body.plan, waves=body.waves, watch_s=body.watch_s)


@router.get("/rollouts", responses=responses(404, 409, 422))
async def list_rollouts(server: TheFleetServer) -> list[RolloutHead]:
    """Rollouts, the newest first."""
    left = {"devices", "changes"}
    return [RolloutHead.model_validate(one.model_dump(exclude=left)) for one in server.rollouts.all()]


@router.get("/rollouts/{rollout}", response_model=None, responses={200: {"model": Rollout}, **responses(404, 409, 422)})
async def get_rollout(rollout: int, server: TheFleetServer) -> Response:
    """A rollout, with the state of each device."""
    text = server.rollouts.get(rollout).model_dump_json()  # not checked again: thousands of devices, each second
    return Response(text, media_type="application/json", headers={"cache-control": "no-store"})


@router.post("/rollouts/{rollout}/stop", responses=responses(404, 409, 422))
async def stop_rollout(rollout: int, body: RolloutStopRequest, server: TheFleetServer) -> Rollout:
    """Begin with no further device. Those that are under way are finished: confirmed, or rolled back."""
    return server.rollouts.stop(rollout, body.by)
