"""3D scene of the devices, by viser, at /viser/."""

from collections.abc import Iterator

from imuscope.server.extension import Extension
from imuscope.server.parts import ServicePart
from imuscope.server.services import Services


def parts(services: Services) -> Iterator[ServicePart]:
    """The scenes of a server."""
    from imuscope.server.extensions.viser.service import Viser

    scenes = Viser(services.telemetry, services.timings.scene_idle_s)
    yield ServicePart("viser", scenes, scenes.close)


EXTENSION = Extension("viser", "3D scene (viser)", parts, ("imuscope.server.extensions.viser.routes",))
