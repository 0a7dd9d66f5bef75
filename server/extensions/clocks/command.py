"""Arguments of `imuscope time`, and what it does with them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

from imuscope.server.commands.common import (
    UsageError,
    checked_protocol,
    decode_options_of,
    readable,
    seekable,
    size_of,
    warn_if_interpreted,
)
from imuscope.server.commands.file_arguments import add_file, add_table


def add(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add `imuscope time`."""
    command = add_parser("time", help="list the clocks of a file, and which of them is its time axis")
    add_file(command)
    words = "table for people (the default), json for programs"
    command.add_argument("--format", choices=("table", "json"), default="table", help=words)
    command.add_argument("--json", dest="format", action="store_const", const="json", help="same as --format json")
    add_table(command)
    return command


def run(options: argparse.Namespace) -> None:
    file = readable(str(options.file))
    decode_options = decode_options_of(options)
    warn_if_interpreted(size_of(file))
    from imuscope.server.commands.decoded import DecodedFileError
    from imuscope.server.extensions.clocks.print_clocks import print_clocks

    decode_options = checked_protocol(decode_options)
    try:
        with seekable(file) as path:
            print_clocks(path, decode_options, sys.stdout, sys.stderr, format=options.format)
    except DecodedFileError as error:
        raise UsageError(str(error)) from None
