"""Check of `imuscope doctor`: is the router of ROS 2 there?"""

import socket
from collections.abc import Iterator

from imuscope.server.diagnostics.checks import Finding
from imuscope.server.extensions.ros2.session import router_host
from imuscope.server.extensions.ros2.settings import Ros2Settings
from imuscope.server.settings.config import Config

ABOUT = "ROS 2"
CONNECT_S = 1.0


def findings(config: Config) -> Iterator[Finding]:
    """Whether the Zenoh router accepts a connection; nothing where ROS 2 is off, or the router has no TCP."""
    settings = config.of(Ros2Settings)
    if not settings.ros2 or not settings.ros2_router.startswith("tcp/"):
        return
    try:
        socket.create_connection(router_host(settings.ros2_router), CONNECT_S).close()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        message = (
            f"The Zenoh router at {settings.ros2_router} does not answer ({reason}): no node of ROS 2 sees the devices."
        )
        yield Finding("warning", ABOUT, message, ("ros2 run rmw_zenoh_cpp rmw_zenohd",))
    else:
        yield Finding("ok", ABOUT, f"The Zenoh router at {settings.ros2_router} answers.")
