"""Argument parsers of the commands on a store of many robots."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from imuscope.server.commands.file_arguments import add_table
from imuscope.server.extensions.fleet.model.store_settings import STORE_FORMS
from imuscope.server.extensions.fleet.query.prepared_queries import QUESTIONS


def add_upload(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add `imuscope upload`; returns its parser."""
    command = add_parser("upload", help="upload a recording, log or capture into a store of many robots")
    command.add_argument("file", metavar="FILE", help='recording, vendor log or capture; "-" reads standard input')
    add_store(command)
    command.add_argument("--robot", required=True, metavar="NAME", help="name of the robot that recorded it")
    add_table(command)
    return command


def add_query(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    command = add_parser(
        "query",
        help="ask a store of recordings questions, in SQL",
        epilog="prepared questions:\n" + "\n".join(f"  {name:<18}{one.title}" for name, one in QUESTIONS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument("sql", nargs="?", default="", metavar="SQL", help='"SELECT …"; "-" reads standard input')
    add_store(command)
    command.add_argument("--question", choices=list(QUESTIONS), help="prepared question in place of SQL; see below")
    command.add_argument("--show", action="store_true", help="print the SQL of the question, and end")
    formats, words = (
        ("table", "csv", "json", "arrow"),
        "table for people (the default); csv, json or arrow for programs",
    )
    command.add_argument("--format", choices=formats, default="table", help=words)
    command.add_argument("--json", dest="format", action="store_const", const="json", help="same as --format json")
    command.add_argument(
        "--timeout", type=float, default=300.0, metavar="S", help="longest time, s (default 300; 0: none)"
    )
    command.add_argument("--memory", type=int, default=1024, metavar="MB", help="most memory, MB (default 1024)")
    return command


def add_compact(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    command = add_parser("compact", help="join the small files that uploads left in a store")
    add_store(command)
    words = "remove files that nothing has needed for a week, those of uploads that were cut off too"
    command.add_argument("--remove-unused", action="store_true", help=words)
    return command


def add_store(command: argparse.ArgumentParser, words: str = "", *, required: bool = True) -> None:
    """Add `--store`.

    Args:
        words: before the forms of a URL in its help.
    """
    command.add_argument("--store", required=required, metavar="URL", help=words + STORE_FORMS)
