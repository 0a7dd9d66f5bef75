"""Arguments of commands that read a file, and those of `imuscope decode`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

AddParser: TypeAlias = Callable[..., argparse.ArgumentParser]


def add_file(command: argparse.ArgumentParser) -> None:
    """Add the file to read."""
    command.add_argument(
        "file", type=Path, metavar="FILE", help='recording, vendor log or capture; "-" reads standard input'
    )


def add_range(command: argparse.ArgumentParser) -> None:
    """Add start and end of the part to read."""
    command.add_argument(
        "--from", dest="begin", type=float, default=0.0, metavar="S", help="start, in seconds from the beginning"
    )
    command.add_argument("--to", dest="end", type=float, metavar="S", help="end, in seconds from the beginning")


def add_decode(add_parser: AddParser, outputs: str) -> argparse.ArgumentParser:
    """Add `imuscope decode`, with help on the suffixes that can be written."""
    command = add_parser("decode", help="convert a recording, log or capture to other formats")
    add_file(command)
    command.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help=outputs)
    add_range(command)
    command.add_argument(
        "--device", default="", metavar="D", help="device to decode (default: all, if the format can hold them)"
    )
    command.add_argument(
        "--channel", action="append", metavar="NAME", help="channel to decode; may be repeated (default: all)"
    )
    command.add_argument(
        "--without-position",
        action="store_true",
        help="evidence (.html) leaves out everything that reveals where it was recorded",
    )
    return command
