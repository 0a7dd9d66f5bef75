"""Long-lived objects of the fleet: a robot in its fleet, its uploads, and the fleet server.

Those of a robot and of a fleet server are imported where they are configured: most servers are neither.
"""

from collections.abc import Iterator

from imuscope.server.extensions.fleet.model.settings import FleetTables
from imuscope.server.extensions.fleet.upload.uploads import UploadService
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services


def parts(services: Services) -> Iterator[ServicePart]:
    config, compactor = services.config, services.recorder.compactor
    assert compactor is not None  # that of a server has one
    uploads = UploadService(config, services.catalogue, compactor, services.telemetry.bus)
    services.recorder.waiting = uploads.waiting_paths

    def start_uploads() -> None:
        # otherwise the other server uploads the existing recordings
        if services.folder_lock.is_alone and services.has_devices:
            uploads.start()

    yield ServicePart("an upload", uploads, uploads.close, start_uploads, metrics=uploads.add_metrics)
    if config.of(FleetTables).fleet.router:
        yield _publisher(services)
    if services.brought:
        yield from _fleet_server(services.brought)


def _publisher(services: Services) -> ServicePart:
    """A robot in its fleet."""
    from imuscope.server.extensions.alarms.service import AlarmService
    from imuscope.server.extensions.fleet.model.reports import ReportedAlarm
    from imuscope.server.extensions.fleet.robot.publisher import FleetPublisher, active_alarms
    from imuscope.server.extensions.fleet.store.known_settings import KnownSettings

    config = services.config

    def alarms() -> list[ReportedAlarm]:
        service = services.parts.find(AlarmService)  # without a stored alarm, it is made when someone looks
        return [] if service is None else active_alarms(service)

    known = KnownSettings(config.data / "fleet", services.controllers.get)
    publisher = FleetPublisher(services.telemetry, config, services.access.routes, alarms, known)
    return ServicePart("the fleet", publisher, publisher.close, publisher.start, serves=publisher.pages.serve)


def _fleet_server(brought: tuple[object, ...]) -> Iterator[ServicePart]:
    """A fleet server, which its command has made."""
    from imuscope.server.extensions.fleet.model.robots import Robots
    from imuscope.server.extensions.fleet.server.fleet_server import FleetServer

    for one in brought:
        if isinstance(one, FleetServer):
            yield ServicePart("the fleet server", one, one.close, one.start, metrics=one.add_metrics)
            yield ServicePart("robots", one.robots)
        elif isinstance(one, Robots):
            yield ServicePart("robots", one)
