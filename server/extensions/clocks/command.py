"""Arguments of `imuscope time`, and what it does with them. A live source is recorded for some seconds first."""

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from imuscope.recordings.system.temporary_folder import TemporaryFolder
from imuscope.server.commands.common import check_sources, checked_protocol, decode_options_of, file_to_decode, seekable
from imuscope.server.commands.file_arguments import add_format, add_table
from imuscope.server.devices.decode.decode_options import DecodeOptions, parse_source_options
from imuscope.server.errors import UsageError
from imuscope.server.settings.config import load

MOST_S = 3600.0
PATIENCE_S = 30.0  # with a source that sends nothing: a serial port may be tried at several baud rates


def add(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add `imuscope time`."""
    command = add_parser("time", help="list the clocks of a file or a live source, and which of them is the time axis")
    words = 'recording, vendor log or capture ("-" reads standard input); or a live source, as for serve'
    command.set_defaults(has_titles=True)
    command.add_argument("files", nargs="+", metavar="FILE", help=words)
    command.add_argument(
        "--seconds", type=float, default=10.0, metavar="S", help="how long to receive a live source (default 10)"
    )
    add_format(command)
    add_table(command)
    return command


def run(options: argparse.Namespace) -> None:
    if not 0 < options.seconds <= MOST_S:
        raise UsageError(f"--seconds {options.seconds:g} is outside 0 … {MOST_S:g}")
    if _is_live(options.file):
        decode_options = checked_protocol(decode_options_of(options))
        opened = _received(options, decode_options)
    else:
        file, decode_options = file_to_decode(options)
        opened = seekable(file)
    from imuscope.server.extensions.clocks.print_clocks import print_clocks

    with opened as path:
        print_clocks(path, decode_options, sys.stdout, sys.stderr, text_format=options.format)


def _is_live(source: str) -> bool:
    """Whether it is a source of live data. A name that is neither counts as that of a missing file."""
    from imuscope.server.links.base import LinkError
    from imuscope.server.links.source_url import SourceUrl

    if source == "-":
        return False
    try:
        return SourceUrl.parse(source).kind != "file"
    except LinkError:
        return False


@contextlib.contextmanager
def _received(options: argparse.Namespace, reading: DecodeOptions) -> Iterator[Path]:
    """A recording of the source, which is gone afterwards."""
    from imuscope.server.commands.record import RecordRequest, record

    check_sources([options.file], reading)
    data = load(data=options.data).data
    with TemporaryFolder() as folder:
        path = folder / "live.mcap"
        source = parse_source_options(options.file, reading)
        record(RecordRequest((source,), path, options.seconds, data, PATIENCE_S), sys.stderr)
        yield path
