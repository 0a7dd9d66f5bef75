"""`imuscope fleet`: the page of many robots, and the router that they connect to."""

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imuscope.server.commands.serve import run
from imuscope.server.devices.decode.decode_options import secret_text
from imuscope.server.errors import UsageError
from imuscope.server.extensions.fleet.model.access import FleetAccessError, RouterSettings, as_document, read_robots
from imuscope.server.extensions.fleet.model.bus import BusCredentials, FleetBusError, client_settings
from imuscope.server.extensions.fleet.model.fleet_settings import FleetServerSettings, FleetSettings
from imuscope.server.extensions.fleet.model.operators import Operators
from imuscope.server.extensions.fleet.model.robots import Robots
from imuscope.server.extensions.fleet.model.settings import FleetTables
from imuscope.server.extensions.fleet.query.database import FleetDatabase, FleetDatabaseError
from imuscope.server.extensions.fleet.rollouts.group_profiles import GroupProfiles
from imuscope.server.extensions.fleet.rollouts.rollout_steps import RolloutTiming
from imuscope.server.extensions.fleet.rollouts.rollouts import RolloutFiles
from imuscope.server.extensions.fleet.server.fleet_alarms import FleetAlarms
from imuscope.server.extensions.fleet.server.fleet_server import FleetServer
from imuscope.server.settings.config import Config, load
from imuscope.server.settings.logging_setup import print_or_log

if TYPE_CHECKING:
    from starlette.types import ASGIApp

    from imuscope.server.access.auth import Access

DEFAULT_LISTEN = "tcp/127.0.0.1:7447"


def serve_fleet(options: argparse.Namespace) -> None:
    """Serve until stopped.

    Raises:
        UsageError, DomainError: the options cannot be fulfilled.
        ConfigError, DecodeOptionError: invalid options or configuration file.
    """
    config = _config(options)
    settings = config.of(FleetTables).fleet_server
    if settings.listen and settings.router:
        raise UsageError("--listen and --router exclude each other: give the one that robots connect to")
    try:
        bus_settings(settings)
        if options.router_config:
            print(json.dumps(as_document(bus_settings(settings)), indent=2), file=sys.stdout)
            return
    except FleetAccessError as error:
        raise UsageError(str(error)) from None

    def create(config: Config, access: "Access") -> "ASGIApp":
        from imuscope.server.app.build import create_app

        try:
            server = create_fleet_server(config)
            if settings.operators:
                access.operators = Operators(Path(settings.operators), server.group_of, server.group_of_rollout)
            if not settings.router:
                server.open()
        except (FleetDatabaseError, FleetBusError, FleetAccessError) as error:
            raise UsageError(str(error)) from None
        place = f"at the router {settings.router}" if settings.router else f"at {settings.listen or DEFAULT_LISTEN}"
        print_or_log(
            f"Robots join {place}: imuscope serve … --fleet {settings.router or settings.listen or DEFAULT_LISTEN}"
        )
        return create_app(config, access, brought=(server,), has_devices=False)

    tables = replace(config.of(FleetTables), fleet=FleetSettings())
    run(replace(config, sources=()).having(tables), create, is_robot=False)


def create_fleet_server(config: Config, timing: RolloutTiming | None = None) -> FleetServer:
    """The fleet server of a configuration; its session is not open yet.

    Args:
        timing: of rollouts; tests pass their own.

    Raises:
        DomainError, FleetDatabaseError: its stored state cannot be used.
    """
    folder, server_settings = config.data / "fleet", config.of(FleetTables).fleet_server
    profiles = GroupProfiles(folder)
    return FleetServer(
        Robots(),
        FleetDatabase(folder),
        lambda: bus_settings(server_settings),
        lambda: _version(server_settings),
        profiles=profiles,
        alarms=FleetAlarms(folder, server_settings, profiles.applies),
        rollouts=RolloutFiles(folder),
        timing=timing,
    )


def bus_settings(settings: FleetServerSettings) -> Mapping[str, Any]:
    """Settings of the session.

    Raises:
        FleetAccessError: they are not safe, or a file cannot be used.
    """
    if settings.router:
        password = secret_text(settings.password, "password") if settings.password else ""
        credentials = BusCredentials(settings.user, password, settings.ca, settings.certificate, settings.key)
        return client_settings(settings.router, credentials)
    robots = read_robots(Path(settings.robots)) if settings.robots else None
    router = RouterSettings(settings.listen or DEFAULT_LISTEN, robots, settings.certificate, settings.key, settings.ca)
    router.check(is_open=settings.anyone)
    return router.settings()


def _version(settings: FleetServerSettings) -> object:
    """A value that changes with the file of robots."""
    if not settings.robots or settings.router:
        return None
    try:
        state = Path(settings.robots).stat()
    except OSError:
        return None
    return state.st_mtime_ns, state.st_size, state.st_ino


def _config(options: argparse.Namespace) -> Config:
    table = {
        "listen": options.listen,
        "router": options.router,
        "robots": options.robots,
        "operators": options.operators,
        "certificate": options.bus_certificate,
        "key": options.bus_key,
        "ca": options.bus_ca,
        "anyone": options.anyone,
    }
    return load(
        options.config,
        host=options.host,
        port=options.port,
        data=options.data,
        tls=options.tls,
        tls_cert=options.tls_cert,
        tls_key=options.tls_key,
        store=None if options.store is None else {"url": options.store},
        fleet_server={name: value for name, value in table.items() if value is not None},
    )
