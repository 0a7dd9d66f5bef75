"""Computed signals of a server that starts: those stored. Without any, the first request makes their service."""

from collections.abc import Iterator

from imuscope.server.library.signal_definitions import FILE
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services


def parts(services: Services) -> Iterator[ServicePart]:
    if (services.config.data / FILE).exists():
        from imuscope.server.extensions.analysis.expressions.derived_channels import signals_part

        yield signals_part(services)
