"""Arguments of `imuscope analyse`, its help, and what it does with them."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from imuscope.server.commands.common import file_to_decode, readable, seekable
from imuscope.server.commands.file_arguments import add_files, add_range, add_signal, add_table
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.errors import UsageError

_NAME_CHARS = 34


def add(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add `imuscope analyse`."""
    command = add_parser("analyse", help="print statistics, spectra and other figures of signals in a file")
    add_files(command, has_titles=True)
    command.add_argument("analysis", metavar="ANALYSIS", help="name of an analysis, see below; or comparison")
    words = "SIGNAL.COLUMN, or SIGNAL for all its columns; DEVICE/… or MESSAGE/… if there are several; may be repeated"
    add_signal(command, f"{words} (default: all)")
    add_range(command)
    add_table(command)
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
    group.add_argument(
        "--offset", type=float, default=0.0, metavar="S", help="seconds to add to the times of B (default 0)"
    )
    group.add_argument(
        "--search", type=float, metavar="S", help="how far correlation searches on both sides of --offset, s"
    )
    return command


def analysis_list() -> str:
    """Analyses with their options, a line for each."""
    from imuscope.server.extensions.analysis.noise.registry import analyses

    lines = ["analyses, with their options for --option:"]
    for one in analyses():
        lines.append(f"  {one.name:<{_NAME_CHARS - 2}}{one.words}")
        for option in one.options:
            if option.choices:
                form, limits = f"{option.name}={option.choices[int(option.default)]}", ", ".join(option.choices)
            else:
                form = f"{option.name}={option.default:g}"
                limits = f"{option.low:.12g} to {option.high:.12g} {option.unit}".strip()
            lines.append(f"    {form:<{_NAME_CHARS - 4}}{option.doc} {limits}.")
        lines += [f"    --format {name}" for name in one.formats]
    return "\n".join(lines) + "\n"


def run(options: argparse.Namespace) -> None:
    file, decode_options = file_to_decode(options)
    from imuscope.server.commands.decoded import decoded
    from imuscope.server.extensions.analysis.jobs.analyse import (
        AnalyseRequest,
        print_json,
        print_table,
        print_text,
        reports_of,
    )

    if options.analysis == "comparison":
        _compare(options, file, decode_options)
        return
    if options.other is not None:
        raise UsageError("--with belongs to the comparison of two files: imuscope analyse A comparison --with B")
    request = AnalyseRequest(options.analysis, options.signal, options.begin, options.end, options.option or ())
    with seekable(file) as path, decoded(path, decode_options, sys.stderr) as store:
        reports = reports_of(store, path.name, request)
    if options.format not in ("table", "json"):
        print_text(request.analysis, options.format, reports, sys.stdout)
        return
    (print_json if options.format == "json" else print_table)(reports, sys.stdout)


def _compare(options: argparse.Namespace, file: Path, decode_options: DecodeOptions) -> None:
    from imuscope.server.commands.decoded import decoded
    from imuscope.server.extensions.analysis.compare.two_sides import ComparisonOptions, compared
    from imuscope.server.extensions.analysis.jobs.compare import print_comparison, print_json, side_of

    if options.other is None:
        raise UsageError("a comparison needs two files; give the other one with --with B")
    if not options.signal:
        raise UsageError("a comparison needs signals; name each with --signal")
    if options.option or options.format not in ("table", "json"):
        raise UsageError("a comparison has no --option, and --format is table or json")
    if options.search is not None and not options.search > 0:
        raise UsageError(f"--search {options.search:g} is not a valid time, in seconds; it must be more than 0")
    signals_b = options.signal_b or options.signal
    if len(options.signal) != len(signals_b):
        raise UsageError("--signal and --signal-b differ in number; name one signal of B for each of A")
    begin_b = options.begin if options.from_b is None else options.from_b
    end_b = options.end if options.to_b is None else options.to_b
    with (
        seekable(file) as a,
        seekable(readable(str(options.other))) as b,
        decoded(a, decode_options, sys.stderr) as store_a,
        decoded(b, decode_options, sys.stderr) as store_b,
    ):
        sides = [
            side_of(store_a, a.name, options.signal, options.begin, options.end),
            side_of(store_b, b.name, signals_b, begin_b, end_b),
        ]
        answer = compared(sides, sides, ComparisonOptions(options.align, options.offset, options.search))
    (print_json if options.format == "json" else print_comparison)(answer, sys.stdout)
