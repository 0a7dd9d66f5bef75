"""Argument parser of `imuscope fleet`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from imuscope.server.commands.page_arguments import add_page_address
from imuscope.server.extensions.fleet.server.store_arguments import add_store


def add_fleet(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add `imuscope fleet`; returns its parser."""
    command = add_parser(
        "fleet",
        help="serve the page of many robots, and the router that they connect to",
        epilog="Robots join with `imuscope serve … --fleet tcp/HOST:PORT`. Settings of a file are in its table\n"
        "[fleet_server]: listen, router, robots, operators, certificate, key, ca, user, password; see docs/fleet.md.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument(
        "--listen",
        metavar="ADDRESS",
        help="address for robots: tls/HOST:PORT or tcp/HOST:PORT (default tcp/127.0.0.1:7447)",
    )
    command.add_argument("--router", metavar="ADDRESS", help="use this Zenoh router instead of listening for robots")
    command.add_argument(
        "--robots",
        metavar="FILE",
        help="robots that may connect: NAME:PASSWORD in each line; without a line, no access",
    )
    command.add_argument(
        "--operators",
        metavar="FILE",
        help="users who may command robots of some groups: NAME:TOKEN:GROUP,GROUP in each line",
    )
    command.add_argument("--bus-certificate", metavar="FILE", help="certificate for tls/ (PEM); requires --bus-key")
    command.add_argument("--bus-key", metavar="FILE", help="private key of --bus-certificate (PEM)")
    command.add_argument(
        "--bus-ca", metavar="FILE", help="authority (PEM) that signed the certificates of robots, or of the router"
    )
    command.add_argument(
        "--anyone-may-join-and-listen",
        action="store_true",
        default=None,
        dest="anyone",
        help="listen to a network without TLS and passwords: anyone there can pose as a robot and read all reports",
    )
    command.add_argument(
        "--router-config", action="store_true", help="print the configuration of a separate router (zenohd), and end"
    )
    add_store(command, "store of recordings to answer questions about: ", required=False)
    add_page_address(command)
    command.add_argument("--config", type=Path, metavar="FILE", help="TOML file with settings")
    return command
