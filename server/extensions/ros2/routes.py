"""Routes of ROS 2: state of the publisher, one switch for each topic."""

from pydantic import BaseModel, Field

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.extensions.ros2.service import Ros2
from imuscope.server.extensions.ros2.settings import Ros2Settings
from imuscope.server.services.services import Services

router = lazy_router(prefix="/api/ros2", tags=["ros2"])


class SwitchTopicRequest(BaseModel, extra="forbid"):
    """A topic to publish, or no longer."""

    key: str = Field(min_length=1, max_length=500, description="of the topic, as listed")
    enabled: bool


class RosTopic(BaseModel):
    """Published topic of a device: its type, rate, subscribers and switch."""

    key: str = Field(description="identifies the topic; devices share the names /diagnostics and /tf")
    device: str
    node: str = Field(description="with its namespace: `/imu0`")
    name: str = Field(description="with its namespace: `/imu0/imu/data`")
    type: str = Field(description="`sensor_msgs/msg/Imu`")
    hash: str = Field(description="of the type: `RIHS01_…`; empty while the topic is switched off")
    enabled: bool
    subscribers: int
    rate: float = Field(description="messages/s; 0 without subscribers")
    messages: int = Field(description="since the topic was announced")
    bytes: int = Field(description="of these messages")
    problem: str = Field(description="a subscriber that expects another type; empty if there is none")


class MissingTopic(BaseModel):
    """A topic that a device cannot have."""

    device: str
    topic: str
    reason: str


class RosState(BaseModel):
    """Connection to the router, and the published topics."""

    enabled: bool = Field(description="whether the server was started with --ros2")
    router: str = Field(description="address of the Zenoh router")
    domain: int
    namespace: str
    connected: bool = Field(description="whether the router is reached")
    peers: int = Field(description="other sessions that are reached directly")
    dropped: int = Field(description="samples that the publisher did not get in time")
    problem: str = Field(description="why the router is not reached; empty if it is")
    hint: str
    topics: list[RosTopic]
    missing: list[MissingTopic]


def _state(services: Services) -> RosState:
    settings, state = services.config.of(Ros2Settings), services.parts.get(Ros2).state
    return RosState(
        enabled=services.parts.get(Ros2).is_enabled,
        router=settings.ros2_router,
        domain=settings.ros2_domain,
        namespace=settings.ros2_namespace,
        connected=bool(state.routers),
        peers=state.peers,
        dropped=state.dropped,
        problem=state.problem,
        hint=state.hint,
        topics=[RosTopic.model_validate(row) for row in state.topics],
        missing=[MissingTopic.model_validate(row) for row in state.missing],
    )


@router.get("")
async def get_ros2(services: TheServices) -> RosState:
    """The publisher, its topics and their subscribers; figures are renewed once a second."""
    return _state(services)


@router.patch("/topics", responses=responses(404, 409, 422, 507))
async def switch_topic(body: SwitchTopicRequest, services: TheServices) -> RosState:
    """Publish a topic, or no longer; the choice outlasts the server."""
    services.parts.get(Ros2).switch(body.key, enabled=body.enabled)
    return _state(services)
