"""Live devices for viewers of the Foxglove WebSocket protocol, on a port of its own and at /foxglove."""

from collections.abc import Iterator

from imuscope.server.extension import Extension
from imuscope.server.parts import ServicePart
from imuscope.server.services import Services


def parts(services: Services) -> Iterator[ServicePart]:
    """The bridge."""
    from imuscope.server.extensions.foxglove.service import Foxglove

    bridge = Foxglove(services.telemetry, services.config.foxglove, services.access)
    yield ServicePart("Foxglove", bridge, bridge.close, bridge.start)


EXTENSION = Extension("foxglove", "Foxglove", parts, ("imuscope.server.extensions.foxglove.routes",))
