"""`imuscope serve`: check the settings, open the port, serve the page until stopped."""

import argparse
import errno
import os
import socket
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imuscope.recordings.system.freed_memory import share_one_heap
from imuscope.recordings.system.resource_limits import history_room
from imuscope.server.commands.common import (
    check_sources,
    given_options,
    normalized_sources,
    warn_if_interpreted,
)
from imuscope.server.devices.decode.decode_options import declared_options, option_text
from imuscope.server.devices.decode.protocol_set import problems
from imuscope.server.errors import UsageError
from imuscope.server.links.simulated_device import simulators
from imuscope.server.services.extension import extension_problems, extensions
from imuscope.server.settings import logging_setup
from imuscope.server.settings.config import SIMULATORS, Config, load
from imuscope.server.settings.extension_settings import extension_settings
from imuscope.server.version import VERSION

if TYPE_CHECKING:
    from starlette.types import ASGIApp

    from imuscope.server.access.auth import Access


def serve(options: argparse.Namespace) -> None:
    """Serve until stopped.

    Raises:
        UsageError: the options cannot be fulfilled.
        ConfigError, DecodeOptionError: invalid options or configuration file.
    """
    from imuscope.server.app.build import create_app

    run(_config(options), create_app)


def run(config: Config, create: "Callable[[Config, Access], ASGIApp]", *, is_robot: bool = True) -> None:
    """Serve an application until stopped.

    Args:
        create: called when the port is open.
        is_robot: it has devices: simulators if none are given.

    Raises:
        UsageError: the port cannot be opened, or what `create` raises.
        ConfigError, DecodeOptionError: invalid options.
    """
    share_one_heap()
    from imuscope.server.access.auth import Access
    from imuscope.server.http import server as http_server

    decode_options, access = config.reading(), Access(config)
    secrets = decode_options.secrets
    secrets_in_config = [str(value) for name, value in config.decode_options.items() if name in secrets]
    keys = logging_setup.secrets_of(access.view_token, access.control_token, *secrets_in_config, *secrets.values())
    logging_setup.install(config.log_format, config.log_level, keys)
    config = within_memory(config)
    tls_renewal = http_server.keeper_of(config)
    _check_extensions(config)
    warn_if_interpreted(None)
    check_sources(config.sources if config.sources != SIMULATORS else (), decode_options)
    try:
        listener = http_server.listen(config.host, config.port)
    except OSError as error:
        hint = "Give another with --port, or 0 for any free one."
        if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
            hint = "Give an address of this machine with --host; 0.0.0.0 means all of them."
        raise UsageError(f"cannot listen on {config.host}:{config.port}: {error.strerror}. {hint}") from None
    url = _url(config, listener.getsockname()[1])

    def ready() -> None:
        logging_setup.print_or_log(f"imuscope {VERSION} ({_waited_s():.1f} s)")
        _print_addresses(config, access, url, tls_renewal.tls.fingerprint if tls_renewal is not None else "", is_robot)

    try:
        http_server.run(create(config, access), listener, ready, tls_renewal)
    except RuntimeError as error:
        raise UsageError(str(error)) from None


def _waited_s() -> float:
    """Seconds since this process began, most of which are imports."""
    began = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19]) / os.sysconf("SC_CLK_TCK")
    return time.clock_gettime(time.CLOCK_BOOTTIME) - began


def within_memory(config: Config) -> Config:
    """The configuration with a history for which this machine or unit has room; prints when that is less."""
    if (room := history_room() >> 20) >= config.memory_mb:
        return config
    words = f"The history of samples takes at most {room} MB in place of {config.memory_mb} (memory_mb)"
    logging_setup.print_or_log(f"{words}: a machine or unit with this much memory has no room for more.")
    return replace(config, memory_mb=room)


def _config(options: argparse.Namespace) -> Config:
    declared = declared_options()
    values = {
        name: option_text(declared[name], value) if declared[name].kind == "secret" else value
        for name, value in given_options(options).items()
    }
    of_extensions: dict[str, Any] = {}
    for kind in extension_settings():
        of_extensions |= kind.from_options(options)
    sources = normalized_sources(options.sources)
    return load(
        options.config,
        host=options.host,
        port=options.port,
        data=options.data,
        protocol="" if options.protocol == "auto" else options.protocol,
        sources=sources or None,
        tls=options.tls,
        tls_cert=options.tls_cert,
        tls_key=options.tls_key,
        record=options.record,
        log_format=options.log_format,
        log_level=options.log_level,
        **of_extensions,
        **values,
    )


def _check_extensions(config: Config) -> None:
    """Raise UsageError if an extension cannot use the configuration."""
    try:
        for extension in extensions():
            extension.check(config)
    except ValueError as error:
        raise UsageError(str(error)) from None


def _print_addresses(config: Config, access: "Access", url: str, fingerprint: str, is_robot: bool) -> None:
    """Print the address of the page, its tokens and start-up warnings."""
    from imuscope.server.access.login_throttle import MIN_UNGUESSABLE_CHARS, short_tokens

    if access.control_token and not config.is_loopback:
        print(
            f"to view:    {url}?token={access.view_token}\nto control: {url}?token={access.control_token}",
            flush=True,
        )
    else:
        print(url, flush=True)
    if fingerprint:
        print(f"SHA-256 of the certificate: {fingerprint}", flush=True)
    for name in short_tokens(config):
        logging_setup.print_or_log(f"{name} could be guessed: give it {MIN_UNGUESSABLE_CHARS} characters or more.")
    for problem in (*problems(), *extension_problems()):
        logging_setup.print_or_log(problem)
    if is_robot and config.sources == SIMULATORS:
        shown = [simulator.words for simulator in simulators().values() if simulator.usual]
        words = f"No source given: showing simulated devices: {', '.join(shown)}."
        logging_setup.print_or_log(f"{words} See `imuscope serve --help`.")


def _url(config: Config, port: int) -> str:
    """An address that a browser can open: the machine's name instead of 0.0.0.0."""
    import platform

    host = platform.node() if config.host in ("0.0.0.0", "::", "") else config.host
    return f"{config.scheme}://{f'[{host}]' if ':' in host else host}:{port}/"
