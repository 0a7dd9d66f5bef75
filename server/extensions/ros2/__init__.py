"""ROS 2 over Zenoh, as rmw_zenoh defines it: names on the wire, attachments, types. No ROS installation is needed."""

from collections.abc import Iterator

from imuscope.server.extension import Extension
from imuscope.server.parts import ServicePart
from imuscope.server.services import Services


def parts(services: Services) -> Iterator[ServicePart]:
    """The devices of a server as nodes."""
    from imuscope.server.devices.protocol_set import sensors_of
    from imuscope.server.extensions.ros2.service import Ros2

    nodes = Ros2(services.telemetry, services.config, sensors_of)
    yield ServicePart("ROS 2", nodes, nodes.close, nodes.start)


EXTENSION = Extension("ros2", "ROS 2", parts, ("imuscope.server.extensions.ros2.routes",))
