"""The Rerun viewer at /rerun/, and a stream to one on another machine."""

from collections.abc import Iterator

from imuscope.server.extension import Extension
from imuscope.server.parts import ServicePart
from imuscope.server.services import Services


def parts(services: Services) -> Iterator[ServicePart]:
    """Live data for viewers."""
    from imuscope.server.extensions.rerun.service import Rerun

    viewers = Rerun(services.telemetry, services.config.rerun_connect)
    yield ServicePart("Rerun", viewers, viewers.close, viewers.start)


EXTENSION = Extension("rerun", "Rerun", parts, ("imuscope.server.extensions.rerun.routes",))
