"""`imuscope serve`: the settings are checked, the port is opened, the page is served until somebody ends it."""

from __future__ import annotations

import argparse
import errno
import socket
import time
from typing import TYPE_CHECKING

from server import logging_setup
from server.commands.common import BOTH, UsageError, check_sources, placed, warm
from server.config import Config, load
from server.devices.decode_options import key_text
from server.version import VERSION

if TYPE_CHECKING:
    from server.auth import Access


def serve(options: argparse.Namespace) -> None:
    """Until it is ended.

    Raises:
        UsageError: what the options ask for is not to be had.
        ConfigError, ReadingError: they, or the configuration file, cannot be understood.
    """
    started = time.monotonic()
    if options.key is not None and options.unverified:
        raise UsageError(BOTH)
    config = _config(options)
    from server import http_server
    from server.auth import Access

    given, access = config.reading(), Access(config)
    keys = (access.view_token, access.control_token, config.key, given.key.hex() if given.key else "")
    logging_setup.install(config.log_format, config.log_level, logging_setup.secrets_of(*keys))
    keeper = http_server.keeper_of(config)
    warm(config.data)
    from server.app import create_app

    check_sources(config.sources, given)
    try:
        listener = http_server.listen(config.host, config.port)
    except OSError as error:
        hint = "Give another with --port, or 0 for any free one."
        if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
            hint = "Give an address of this machine with --host; 0.0.0.0 is all of them."
        raise UsageError(f"cannot listen on {config.host}:{config.port}: {error.strerror}. {hint}") from None
    url = _url(config, listener.getsockname()[1])

    def ready() -> None:
        logging_setup.print_or_log(f"imuscope {VERSION} ({time.monotonic() - started:.1f} s)")
        _tell(config, access, url, keeper.tls.fingerprint if keeper is not None else "")

    try:
        http_server.run(create_app(config, access), listener, ready, keeper)
    except RuntimeError as error:
        raise UsageError(str(error)) from None


def _config(options: argparse.Namespace) -> Config:
    return load(
        options.config,
        host=options.host,
        port=options.port,
        data=options.data,
        protocol="" if options.protocol == "auto" else options.protocol,
        key=None if options.key is None else key_text(options.key),
        min_mode=options.min_mode,
        schema=options.schema,
        unverified=options.unverified,
        time_unit=options.time_unit,
        rotation=options.rotation,
        sources=placed(options.sources) or None,
        tls=options.tls,
        tls_cert=options.tls_cert,
        tls_key=options.tls_key,
        record=options.record,
        foxglove=options.foxglove,
        rerun_connect=options.rerun_connect,
        log_format=options.log_format,
        log_level=options.log_level,
    )


def _tell(config: Config, access: Access, url: str, fingerprint: str) -> None:
    """Where the page is, for whom, and what a person should know at the start."""
    from server.login_throttle import UNGUESSABLE, short_tokens

    if access.control_token and not config.is_loopback:
        print(
            f"to look:    {url}?token={access.view_token}\nto control: {url}?token={access.control_token}",
            flush=True,
        )
    else:
        print(url, flush=True)
    if fingerprint:
        print(f"SHA-256 of its certificate: {fingerprint}", flush=True)
    for name in short_tokens(config):
        logging_setup.print_or_log(f"{name} could be guessed: give it {UNGUESSABLE} characters or more.")
    if not config.sources:
        words = "No source given: showing twins of an Xsens MTi, an Inertial Sense IMX and an IDTP device."
        logging_setup.print_or_log(f"{words} See `imuscope serve --help`.")


def _url(config: Config, port: int) -> str:
    """An address that a person can open: 0.0.0.0 is no place to go, the machine's name is."""
    import platform

    host = platform.node() if config.host in ("0.0.0.0", "::", "") else config.host
    return f"{config.scheme}://{f'[{host}]' if ':' in host else host}:{port}/"
