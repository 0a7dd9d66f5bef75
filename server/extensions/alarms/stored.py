"""Alarms of a server that starts: those that are stored. Without any, the first request makes their service."""

from collections.abc import Iterator

from imuscope.server.extensions.alarms.settings import FILE
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services


def parts(services: Services) -> Iterator[ServicePart]:
    if (services.config.data / FILE).exists():
        from imuscope.server.extensions.alarms.service import alarm_part

        yield alarm_part(services)
