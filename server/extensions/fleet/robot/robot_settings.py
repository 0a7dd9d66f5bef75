"""Settings of a robot in its fleet, checked: its name, its credentials, the rights of the fleet server at its pages."""

import os
import platform
from typing import TYPE_CHECKING

from imuscope.server.devices.decode.decode_options import secret_text
from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.bus import BusCredentials, is_loopback_address
from imuscope.server.extensions.fleet.model.fleet_settings import FleetSettings
from imuscope.server.settings.config import ConfigError

if TYPE_CHECKING:
    from imuscope.server.extensions.fleet.model.summaries import PagesAllowed


class FleetSettingsError(ConfigError):
    """Settings of a robot that cannot join a fleet."""


def robot_name(settings: FleetSettings) -> str:
    """Name of this robot.

    Raises:
        FleetSettingsError: it is not valid.
    """
    name = settings.name or platform.node().partition(".")[0]
    if not keys.is_robot_name(name):
        raise FleetSettingsError(
            f"{name!r:.120} is not a valid name of a robot. "
            f"Give --fleet-name, or name in [fleet], with {keys.NAME_RULE}."
        )
    return name


def credentials_of(settings: FleetSettings) -> BusCredentials:
    """Credentials that the robot shows to the router.

    Raises:
        FleetSettingsError: user without password, or a file is missing.
        DecodeOptionError: the file of the password cannot be read.
    """
    if bool(settings.user) != bool(settings.password):
        raise FleetSettingsError("fleet.user and fleet.password belong together: give both, or none.")
    if bool(settings.certificate) != bool(settings.key):
        raise FleetSettingsError("fleet.certificate and fleet.key belong together: give both, or none.")
    for name in ("ca", "certificate", "key"):
        path = getattr(settings, name)
        if path and not os.access(path, os.R_OK):
            raise FleetSettingsError(f"fleet.{name} {path!r} cannot be read.")
    password = secret_text(settings.password, "fleet.password") if settings.password else ""
    return BusCredentials(settings.user, password, settings.ca, settings.certificate, settings.key)


def allowed_pages(settings: FleetSettings) -> "PagesAllowed":
    """Rights of the fleet server at the pages of this robot.

    Raises:
        FleetSettingsError: it may command over a line that others can write to.
    """
    router = settings.router
    if settings.pages == "control" and not (router.startswith("tls/") or is_loopback_address(router)):
        raise FleetSettingsError(
            f'fleet.pages = "control" lets the fleet server command this robot, but {router} is reached without TLS, '
            'where others on the network could pose as it: use a router at tls/HOST:PORT, or pages = "view".'
        )
    return "control" if settings.pages == "control" else "view" if settings.pages == "view" else "off"
