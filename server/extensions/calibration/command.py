"""Arguments of `imuscope calibrate`, and what it does with them."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from imuscope.server.commands.common import file_to_decode, seekable
from imuscope.server.commands.file_arguments import add_files, add_range, add_table
from imuscope.server.errors import UsageError

CALIBRATIONS = ("gyroscope", "magnetometer", "accelerometer", "mounting")


def add(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add `imuscope calibrate`."""
    command = add_parser("calibrate", help="calibrate a sensor with a recording, log or capture")
    add_files(command, has_titles=True)
    command.add_argument("kind", choices=CALIBRATIONS, metavar="KIND", help=", ".join(CALIBRATIONS))
    add_range(command)
    add_table(command)
    command.add_argument("--device", default="", metavar="D", help="device to calibrate, if there are several")
    command.add_argument(
        "--field", type=float, default=0.0, metavar="F", help="magnetometer: field strength, in the unit of the signal"
    )
    command.add_argument("--gravity", type=float, default=0.0, metavar="G", help="accelerometer: local gravity, m/s²")
    command.add_argument(
        "--square", action="store_true", help="accelerometer: the housing is square and rests on a level table"
    )
    command.add_argument(
        "--vertical", choices=("up", "down"), default="up", help="mounting: where z of the vehicle points (default up)"
    )
    command.add_argument(
        "--format", choices=("text", "json", "yaml", "csv", "c"), help="default: that of the suffix of OUT, else text"
    )
    command.add_argument("--json", dest="format", action="store_const", const="json", help="same as --format json")
    words = 'file to write (default, and "-": standard output)'
    command.add_argument("-o", "--output", type=Path, metavar="OUT", help=words)
    return command


def run(options: argparse.Namespace) -> None:
    file, decode_options = file_to_decode(options)
    from imuscope.server.commands.decode import time_range_of
    from imuscope.server.commands.decoded import decoded
    from imuscope.server.extensions.calibration.calibrate import calibrated, format_of, text_of
    from imuscope.server.extensions.calibration.kinds import CalibrationOptions

    facts = CalibrationOptions(options.field, options.gravity, options.square, options.vertical)
    if options.output == Path("-"):
        options.output = None
    if options.output is not None and options.output.exists() and options.output.samefile(file):
        raise UsageError("OUT is the input file; give another name")
    form = format_of(options.format or "", options.output)
    with seekable(file) as path, decoded(path, decode_options, sys.stderr) as store:
        span = time_range_of(store, path.name, options.begin, options.end)
        text = text_of(calibrated(store, path.name, options.kind, options.device, span, facts), form)
    if options.output is None:
        sys.stdout.write(text)
        return
    try:
        options.output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{options.output}: {(error.strerror or 'it cannot be written').lower()}") from None
    print(options.output)
