"""Arguments of the commands that read a file: `decode`, `analyse`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

AddParser: TypeAlias = Callable[..., argparse.ArgumentParser]


def add_decode(add_parser: AddParser, outputs: str) -> argparse.ArgumentParser:
    """Add `imuscope decode`, with help on the suffixes that can be written."""
    command = add_parser("decode", help="convert a recording, log or capture to other formats")
    command.add_argument(
        "file", type=Path, metavar="FILE", help='recording, vendor log or capture; "-" reads standard input'
    )
    command.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help=outputs)
    command.add_argument(
        "--from", dest="begin", type=float, default=0.0, metavar="S", help="start, in seconds from the beginning"
    )
    command.add_argument("--to", dest="end", type=float, metavar="S", help="end, in seconds from the beginning")
    command.add_argument(
        "--device", default="", metavar="D", help="device to decode (default: all, if the format can hold them)"
    )
    command.add_argument(
        "--channel", action="append", metavar="NAME", help="channel to decode; may be repeated (default: all)"
    )
    command.add_argument(
        "--without-position", action="store_true", help="evidence (.html) leaves out what tells where it was recorded"
    )
    return command


def add_analyse(add_parser: AddParser, analyses: str) -> argparse.ArgumentParser:
    """Add `imuscope analyse`, with help on the registered analyses."""
    command = add_parser(
        "analyse",
        help="print figures of signals of a recording, log or capture",
        epilog=analyses,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument(
        "file", type=Path, metavar="FILE", help='recording, vendor log or capture; "-" reads standard input'
    )
    command.add_argument("analysis", metavar="ANALYSIS", help="name of an analysis, see below; or comparison")
    command.add_argument(
        "--signal",
        action="append",
        required=True,
        metavar="NAME",
        help="CHANNEL.COLUMN, or CHANNEL for all its columns; DEVICE/… if there are several; may be repeated",
    )
    command.add_argument(
        "--from", dest="begin", type=float, default=0.0, metavar="S", help="start, in seconds from the beginning"
    )
    command.add_argument("--to", dest="end", type=float, metavar="S", help="end, in seconds from the beginning")
    command.add_argument(
        "--option", action="append", metavar="NAME=VALUE", help="option of the analysis; may be repeated"
    )
    command.add_argument(
        "--format",
        default="table",
        metavar="FORMAT",
        help="table for people (the default), json for programs, or a format of the analysis; see below",
    )
    command.add_argument("--json", dest="format", action="store_const", const="json", help="same as --format json")
    group = command.add_argument_group("comparison of FILE, which is A, with another file")
    group.add_argument("--with", dest="other", type=Path, metavar="B", help="the other file")
    group.add_argument(
        "--signal-b", action="append", metavar="NAME", help="signal of B for each --signal (default: the same names)"
    )
    group.add_argument("--from-b", type=float, metavar="S", help="start in B (default: that of --from)")
    group.add_argument("--to-b", type=float, metavar="S", help="end in B (default: that of --to)")
    group.add_argument(
        "--align",
        choices=("offset", "start", "correlation"),
        default="offset",
        help="offset: by the clock, B moved by --offset (default); start: the first samples coincide; correlation: "
        "where the signals fit best",
    )
    group.add_argument("--offset", type=float, default=0.0, metavar="S", help="s to add to the times of B (default 0)")
    group.add_argument(
        "--search", type=float, metavar="S", help="correlation searches as far as this on both sides of --offset"
    )
    return command
