"""What several commands need: what a person may be told in one line, the sources' reading, the compiled code."""

from __future__ import annotations

import argparse
import contextlib
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path

from server import logging_setup
from server.commands.arguments import COMMANDS
from server.config import load
from server.devices.decode_options import OPTIONS, DecodeOptions, key_text, parse_source_options, reading, schema_text
from server.jit_cache import compile_by_two, prepare_cache

BOTH = "--unverified shows Secure frames without a key, and a key is given (--key or IMUSCOPE_KEY); leave one out"
PIPE_BYTES = 1 << 20


class UsageError(Exception):
    """Something that the user can put right: printed as one line."""


def warm(data: Path | None) -> Path:
    """Import what is compiled, and say so when that takes a while; the folder for data, which keeps the result."""
    folder = load(data=data).data
    first, words = prepare_cache(folder)
    for sentence in words:
        logging_setup.print_or_log(f"imuscope: {sentence}")
    if first:
        logging_setup.print_or_log("imuscope: compiling the decoders; this is done once and takes some seconds.")
        compile_by_two()
    from protocols import jit, registry
    from recordings import mcap_reader  # noqa: F401 (it has compiled loops, too)

    registry.warm_up()
    try:
        jit.save()
    except OSError:
        logging_setup.print_or_log("imuscope: compiled code could not be kept; it is compiled again next time.")
    return folder


def reading_of(options: argparse.Namespace, protocol: str = "", *, replay_check: bool = True) -> DecodeOptions:
    """What the options of a command say about reading, those that it has.

    Raises:
        UsageError: two of them contradict each other.
        ReadingError: one of them cannot be used.
    """
    told = {name: getattr(options, name, None) for name in (*OPTIONS, "schema")}
    if told["key"] is not None and told["unverified"]:
        raise UsageError(BOTH)
    return reading(
        told["protocol"] or protocol,
        key_text(told["key"]) if told["key"] is not None else "",
        told["min_mode"] or "",
        bool(told["unverified"]),
        schema_text(told["schema"]) if told["schema"] else "",
        replay_check,
        told["time_unit"] or "",
        told["rotation"] or "",
    )


def settled(said: DecodeOptions) -> DecodeOptions:
    """The same with a protocol that there is; "" where it is to be recognised.

    Raises:
        UsageError: there is no such protocol.
    """
    check_protocol(said.protocol)
    return replace(said, protocol="" if said.protocol == "auto" else said.protocol)


def check_protocol(name: str) -> None:
    """UsageError: there is no protocol of that name."""
    from server.devices import protocol_set

    known = ("auto", *protocol_set.protocols())
    if name and name not in known:
        raise UsageError(f"there is no protocol {name!r}; there are: {', '.join(known)}.")


def readable(name: str) -> Path:
    """A file or pipe that can be read; "-" is standard input.

    Raises:
        UsageError: there is none.
    """
    path = Path("/dev/stdin") if name == "-" else Path(name)
    if not path.exists() or path.is_dir():
        raise UsageError(no_file(name))
    return path


@contextlib.contextmanager
def whole(path: Path) -> Iterator[Path]:
    """The same as a file in which one can go back and forth: what comes through a pipe is kept aside meanwhile."""
    if path.is_file():
        yield path
        return
    with path.open("rb") as pipe, kept_aside(iter(lambda: pipe.read(PIPE_BYTES), b"")) as aside:
        yield aside


@contextlib.contextmanager
def kept_aside(pieces: Iterable[bytes]) -> Iterator[Path]:
    """A file with those bytes, as long as it is needed."""
    with tempfile.NamedTemporaryFile(prefix="imuscope-", suffix=".bin") as aside:
        for piece in pieces:
            aside.write(piece)
        aside.flush()
        yield Path(aside.name)


def check_sources(sources: Sequence[str], given: DecodeOptions) -> None:
    """UsageError: one of them cannot be opened, ever."""
    from server.links import LinkError, open_link
    from server.links.capture_file import FileLink
    from server.links.pipe import PipeLink

    seen: set[str] = set()
    for source in sources:
        try:
            place, own = parse_source_options(source, given)
            link = open_link(place)
        except LinkError as error:
            raise UsageError(str(error)) from None
        check_protocol(own.protocol)
        if place in seen and not place.startswith("twin:"):
            raise UsageError(f"the source {place} is given twice; give it once")
        seen.add(place)
        if isinstance(link, FileLink) and not isinstance(link, PipeLink) and not link.path.is_file():
            # A port may be plugged in later; a file that is not there now is a slip of the fingers.
            near = get_close_matches(source, COMMANDS, 1)
            words = f" The nearest command is {near[0]}." if near else ""
            raise UsageError(f"{no_file(str(link.path))} See `imuscope --help` for commands and sources.{words}")
    check_protocol(given.protocol)


def placed(sources: Sequence[str]) -> list[str]:
    """Sources by the names that links know: "-" is standard input."""
    return ["/dev/stdin" if source == "-" else source for source in sources]


def no_file(path: str) -> str:
    """What is said of a path that is no file."""
    return f"{path} is a folder; name one capture in it." if Path(path).is_dir() else f"there is no file {path}."
