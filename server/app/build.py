"""Assembly of the server: configuration in, ASGI application out. No logic here."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from imuscope.server.access.auth import Access, Guard
from imuscope.server.app.application import Application
from imuscope.server.devices.decode.protocol_detection import ProtocolSet
from imuscope.server.devices.link.sessions import OpenLink
from imuscope.server.http.page_files import Files
from imuscope.server.links.source_url import open_link
from imuscope.server.services.extension import install_extensions
from imuscope.server.services.services import ViewerTimings, build_services
from imuscope.server.settings.config import Config

if TYPE_CHECKING:
    from starlette.types import ASGIApp


def create_app(
    config: Config,
    access: Access,
    *,
    open_link: OpenLink = open_link,
    protocol_set: ProtocolSet | None = None,
    now_ns: Callable[[], int] | None = None,
    page_files: Files | None = None,
    timings: ViewerTimings | None = None,
    brought: Sequence[object] = (),
    has_devices: bool = True,
) -> "ASGIApp":
    """The application, guarded.

    Args:
        open_link, protocol_set, now_ns, page_files, timings: links, protocols, clock, page and time limits; tests pass
            their own.
        brought: objects that an extension takes over: a fleet server, whose session is open.
        has_devices: False for a page of other robots: without sources, none is simulated.

    Raises:
        DecodeOptionError: the configuration has an invalid option of a source.
        FleetSettingsError: … or of the fleet.
    """
    page_files, timings = page_files or Files(), timings or ViewerTimings()
    services = build_services(
        config, access, open_link, protocol_set, now_ns, page_files, timings, tuple(brought), has_devices=has_devices
    )

    install_extensions(services)
    return Guard(Application(services), access)
