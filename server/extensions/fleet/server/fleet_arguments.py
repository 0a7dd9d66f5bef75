"""Argument parser of `imuscope fleet`."""

import argparse
from collections.abc import Callable
from pathlib import Path

from imuscope.server.commands.file_arguments import add_files, add_format, add_table
from imuscope.server.commands.page_arguments import add_page_address
from imuscope.server.extensions.fleet.model.settings import STORE_FORMS
from imuscope.server.extensions.fleet.query.prepared_queries import QUESTIONS


def add_fleet(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add `imuscope fleet`; returns its parser."""
    command = add_parser(
        "fleet",
        help="serve the fleet page, and the router that robots connect to",
        epilog="Robots join with `imuscope serve … --fleet tcp/HOST:PORT`. Settings of a file are in its table\n"
        "[fleet_server]: listen, router, robots, operators, certificate, key, ca, user, password; see docs/fleet.md.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument(
        "--listen",
        metavar="ADDRESS",
        help="address that robots connect to: tls/HOST:PORT or tcp/HOST:PORT (default tcp/127.0.0.1:7447)",
    )
    command.add_argument("--router", metavar="ADDRESS", help="use this Zenoh router instead of listening for robots")
    command.add_argument(
        "--robots",
        metavar="FILE",
        help="robots that may connect: one NAME:PASSWORD per line; others have no access",
    )
    command.add_argument(
        "--operators",
        metavar="FILE",
        help="users who may command robots of some groups: one NAME:TOKEN:GROUP,GROUP per line",
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
        "--router-config", action="store_true", help="print the configuration of a separate router (zenohd), and exit"
    )
    add_store(command, "store of recordings to query: ", required=False)
    add_page_address(command)
    command.add_argument("--config", type=Path, metavar="FILE", help="TOML file with settings")
    return command


def add_upload(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add `imuscope upload`; returns its parser."""
    command = add_parser("upload", help="upload a recording, log or capture into a store of many robots")
    add_files(command)
    add_store(command)
    command.add_argument("--robot", required=True, metavar="NAME", help="name of the robot that recorded it")
    add_format(command)
    add_table(command)
    return command


def add_query(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    command = add_parser(
        "query",
        help="query a store of recordings with SQL",
        epilog="prepared questions:\n" + "\n".join(f"  {name:<18}{one.title}" for name, one in QUESTIONS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument("sql", nargs="?", default="", metavar="SQL", help='"SELECT …"; "-" reads standard input')
    add_store(command)
    command.add_argument("--question", choices=list(QUESTIONS), help="prepared question in place of SQL; see below")
    command.add_argument("--show", action="store_true", help="print the SQL of the question, and exit")
    formats, words = (
        ("table", "csv", "json", "arrow"),
        "table for people (the default); csv, json or arrow for programs",
    )
    command.add_argument("--format", choices=formats, default="table", help=words)
    command.add_argument("--json", dest="format", action="store_const", const="json", help="same as --format json")
    command.add_argument(
        "--timeout", type=float, default=300.0, metavar="S", help="time limit, s (default 300; 0: none)"
    )
    command.add_argument("--memory", type=int, default=1024, metavar="MB", help="memory limit, MB (default 1024)")
    return command


def add_compact(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    command = add_parser("compact", help="merge the small files that uploads leave in a store")
    add_store(command)
    words = "remove files that nothing has needed for a week, those of uploads that were cut off too"
    command.add_argument("--remove-unused", action="store_true", help=words)
    add_format(command)
    return command


def add_store(command: argparse.ArgumentParser, words: str = "", *, required: bool = True) -> None:
    """Add `--store`.

    Args:
        words: before the forms of a URL in its help.
    """
    command.add_argument("--store", required=required, metavar="URL", help=words + STORE_FORMS)
