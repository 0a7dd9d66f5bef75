"""Arguments of commands that read a file, and those of `imuscope decode`."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

AddParser: TypeAlias = Callable[..., argparse.ArgumentParser]


def add_format(
    command: argparse.ArgumentParser,
    known: tuple[str, str] = ("table", "json"),
    words: str = "table for people (the default), json for programs",
) -> None:
    """Add the options for the output format; --json is short for the format for programs."""
    command.add_argument("--format", choices=known, default=known[0], help=words)
    words = f"same as --format {known[1]}"
    command.add_argument("--json", dest="format", action="store_const", const=known[1], help=words)


def add_files(command: argparse.ArgumentParser, *, has_titles: bool = False) -> None:
    """Add the files of a command that runs for each of them (several_files.py).

    Args:
        has_titles: whether its output for people does not name the file.
    """
    command.set_defaults(has_titles=has_titles)
    command.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help='recording, vendor log or capture; "-" reads standard input'
    )


def add_signal(command: argparse.ArgumentParser, words: str) -> None:
    command.add_argument("--signal", action="append", default=[], metavar="NAME", help=words)


def add_range(command: argparse.ArgumentParser) -> None:
    """Add start and end of the part to read."""
    command.add_argument(
        "--from", dest="begin", type=float, default=0.0, metavar="S", help="start, in seconds from the beginning"
    )
    command.add_argument("--to", dest="end", type=float, metavar="S", help="end, in seconds from the beginning")


def add_table(command: argparse.ArgumentParser) -> None:
    """Add the options of the time axis and of a table; that for the unit of its times is a decode option."""
    command.add_argument(
        "--clock",
        choices=("device", "arrival"),
        default="",
        help="time axis of devices and messages: their own clock, or the arrival (log time)",
    )
    group = command.add_argument_group("tables, for what the file does not contain")
    group.add_argument(
        "--time-column",
        default="",
        metavar="NAME",
        help="heading or number of the column of times; none: count the rows",
    )
    group.add_argument(
        "--date-order", choices=("dmy", "mdy"), help="whether dates like 01/02/2026 begin with the day or the month"
    )
    group.add_argument(
        "--rate", type=_rate, default=0.0, metavar="HZ", help="samples per second, if no column has times or no unit"
    )
    group.add_argument(
        "--packet-stamp",
        choices=("first", "last"),
        default="",
        help="which sample of a packet has its time, where several rows share one",
    )
    group.add_argument(
        "--columns",
        type=Path,
        metavar="FILE",
        help="names and units of columns: lines of HEADING or NUMBER = NAME (UNIT); nothing after = leaves one out",
    )


def _rate(text: str) -> float:
    """A sampling rate, Hz."""
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 1e-6 <= rate <= 1e7:
        raise argparse.ArgumentTypeError(f"{text!r:.40} is not a sampling rate in Hz")
    return rate


def add_decode(add_parser: AddParser, outputs: str) -> argparse.ArgumentParser:
    """Add `imuscope decode`, with help on the suffixes that can be written."""
    command = add_parser("decode", help="convert a recording, log or capture to other formats")
    add_files(command)
    command.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help=outputs)
    add_range(command)
    command.add_argument(
        "--device", default="", metavar="D", help="device to decode (default: all, if the format can hold them)"
    )
    add_signal(command, "signal to decode, or message; may be repeated (default: all)")
    command.add_argument("--channel", dest="signal", action="append", help=argparse.SUPPRESS)  # its former name
    command.add_argument(
        "--units",
        choices=("shown", "SI", "device"),
        default="shown",
        help="of tables: as on the page (°/s, µT), in SI (rad/s, T) or as the device sent them (default: %(default)s)",
    )
    command.add_argument(
        "--without-position",
        action="store_true",
        help="evidence (.html) leaves out everything that reveals where it was recorded",
    )
    add_format(command)
    add_table(command)
    return command
