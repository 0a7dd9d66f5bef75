"""Helpers shared by several commands: files and decode options of sources."""

import argparse
import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from imuscope.recordings.readers.folders import is_bag_folder, packet_folder, sensor_folders
from imuscope.recordings.system.temporary_folder import TemporaryFolder
from imuscope.recordings.tables.options import TableOptions, read_columns
from imuscope.server.commands.arguments import COMMANDS
from imuscope.server.devices.decode.decode_options import (
    DecodeOptions,
    checked_options,
    declared_options,
    option_text,
    parse_source_options,
)
from imuscope.server.errors import UsageError
from imuscope.server.settings import logging_setup

PIPE_BYTES = 1 << 20
SLOW_BYTES = 1 << 20
"""Plain Python decodes it in some seconds."""
INTERPRETED = (
    "Decoding runs as plain Python, about 100 times slower: there is no machine code for this source and processor. "
    "Install imuscope again, or build it (python -m imuscope.protocols.native.compiler)."
)


def warn_if_interpreted(size: int | None) -> None:
    """Say so where decoding `size` bytes takes long, because it runs as plain Python (None: an unknown number)."""
    if size is not None and size < SLOW_BYTES:
        return
    from imuscope.protocols.native.kernels import is_complete
    from imuscope.protocols.registry import families as registry  # noqa: F401 (its modules have the loops)

    if not is_complete():
        print_status(INTERPRETED)


def print_status(sentence: str) -> None:
    """Print or log a status line."""
    logging_setup.print_or_log(f"imuscope: {sentence}")


def size_of(path: Path) -> int | None:
    """Bytes of a file; None for a pipe."""
    return path.stat().st_size if path.is_file() else None


def given_options(options: argparse.Namespace) -> dict[str, str | bool]:
    """Decode options given to a command, as written.

    Raises:
        UsageError: two of them contradict each other.
    """
    declared = declared_options()
    values = {name: value for name in declared if (value := getattr(options, name, None)) not in (None, False)}
    for name in values:
        for other, reason in declared[name].conflicts.items():
            if other in values:
                raise UsageError(reason)
    return values


def decode_options_of(options: argparse.Namespace, protocol: str = "") -> DecodeOptions:
    """Decode options given to a command.

    Raises:
        UsageError: two options contradict each other.
        DecodeOptionError: an option is invalid.
    """
    declared = declared_options()
    texts = {name: option_text(declared[name], value) for name, value in given_options(options).items()}
    made = checked_options(getattr(options, "protocol", None) or protocol, texts)
    if not hasattr(options, "time_column"):
        return made
    return replace(made, table=_table_options(options, texts), clock=options.clock)


def _table_options(options: argparse.Namespace, texts: Mapping[str, str]) -> TableOptions:
    """Options of a table given to a command.

    Raises:
        UsageError: the file with their names cannot be read.
    """
    try:
        columns = read_columns(options.columns) if options.columns is not None else {}
    except ValueError as error:
        raise UsageError(str(error)) from None
    unit = next((text for name, text in texts.items() if declared_options()[name].table_role == "unit"), "")
    return TableOptions(options.time_column, unit, options.date_order, options.rate, columns, options.packet_stamp)


def checked_protocol(options: DecodeOptions) -> DecodeOptions:
    """The options with a checked protocol, "" instead of "auto".

    Raises:
        UsageError: the protocol is unknown.
    """
    check_protocol(options.protocol)
    return replace(options, protocol="" if options.protocol == "auto" else options.protocol)


def file_to_decode(options: argparse.Namespace) -> tuple[Path, DecodeOptions]:
    """The file of a command with its decode options; says so where decoding it takes long.

    Raises:
        UsageError: there is no such file, or an option cannot be fulfilled.
        DecodeOptionError: an option is invalid.
    """
    file = readable(str(options.file))
    decode_options = decode_options_of(options)
    warn_if_interpreted(size_of(file))
    return file, checked_protocol(decode_options)


def check_protocol(name: str) -> None:
    """Raise UsageError for an unknown protocol."""
    from imuscope.server.devices.decode import protocol_set

    known = ("auto", *protocol_set.protocols())
    if name and name not in known:
        raise UsageError(f"unknown protocol {name!r}; available: {', '.join(known)}.")


def readable(name: str) -> Path:
    """Path of a file, pipe or bag folder; "-" is standard input.

    Raises:
        UsageError: it does not exist, or is a folder.
    """
    path = Path("/dev/stdin") if name == "-" else Path(name)
    is_known = is_bag_folder(path) or bool(sensor_folders(path)) or packet_folder(path) is not None
    if not path.exists() or (path.is_dir() and not is_known):
        raise UsageError(missing_file_text(name))
    return path


@contextlib.contextmanager
def seekable(path: Path) -> Iterator[Path]:
    """A seekable file with the same content; a pipe is copied into a temporary file. A bag folder stays as it is."""
    if path.is_file() or path.is_dir():
        yield path
        return
    with path.open("rb") as pipe, temporary_copy(iter(lambda: pipe.read(PIPE_BYTES), b"")) as file:
        yield file


@contextlib.contextmanager
def temporary_copy(pieces: Iterable[bytes]) -> Iterator[Path]:
    """A temporary file with those bytes."""
    with TemporaryFolder() as folder:
        copy = folder / "pipe.bin"
        with copy.open("wb") as file:
            file.writelines(pieces)
        yield copy


def check_sources(sources: Sequence[str], decode_options: DecodeOptions) -> None:
    """Raise UsageError for a source that can never be opened."""
    from imuscope.server.links.base import LinkError
    from imuscope.server.links.capture_file import FileLink
    from imuscope.server.links.pipe import PipeLink
    from imuscope.server.links.simulator import SimulatorLink
    from imuscope.server.links.source_url import open_link

    known: set[str] = set()
    for source in sources:
        try:
            place, own = parse_source_options(source, decode_options)
            link = open_link(place)
        except LinkError as error:
            raise UsageError(str(error)) from None
        check_protocol(own.protocol)
        if place in known and not isinstance(link, SimulatorLink):
            raise UsageError(f"the source {place} is given twice; give it once")
        known.add(place)
        if isinstance(link, FileLink) and not isinstance(link, PipeLink) and not link.path.is_file():
            # A port may be plugged in later, but a missing file is probably a typing error.
            from difflib import get_close_matches

            near = get_close_matches(source, COMMANDS, 1)
            words = f" The nearest command is {near[0]}." if near else ""
            raise UsageError(
                f"{missing_file_text(str(link.path))} See `imuscope --help` for commands and sources.{words}"
            )
    check_protocol(decode_options.protocol)


def normalized_sources(sources: Sequence[str]) -> list[str]:
    """Sources with "-" replaced by the path of standard input."""
    return ["/dev/stdin" if source == "-" else source for source in sources]


def missing_file_text(path: str) -> str:
    """Error text for a path that is not a file."""
    return f"{path} is a folder; name one capture in it." if Path(path).is_dir() else f"file not found: {path}."
