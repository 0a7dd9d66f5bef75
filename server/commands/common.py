"""What several commands need: what a person may be told in one line, the sources' reading, the compiled code."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from server import logs
from server.compiled import compile_by_two, prepare_cache
from server.config import load
from server.live.reading import Reading, key_text, reading, schema_text


class UsageError(Exception):
    """Something that the user can put right: printed as one line."""


def warm(data: Path | None) -> Path:
    """Import what is compiled, and say so when that takes a while; the folder for data, which keeps the result."""
    folder = load(data=data).data
    first, words = prepare_cache(folder)
    for sentence in words:
        logs.say(f"imuscope: {sentence}")
    if first:
        logs.say("imuscope: compiling the decoders; this is done once and takes some seconds.")
        compile_by_two()
    from protocols import jit, registry
    from recordings import blocks  # noqa: F401 (it has compiled loops, too)

    registry.warm()
    try:
        jit.keep()
    except OSError:
        logs.say("imuscope: compiled code could not be kept; it is compiled again next time.")
    return folder


def reading_of(options: argparse.Namespace, protocol: str = "", *, replay_check: bool = True) -> Reading:
    """What the options say about reading."""
    return reading(
        options.protocol or protocol,
        key_text(options.key) if options.key is not None else "",
        options.min_mode or "",
        bool(options.unverified),
        schema_text(options.schema) if options.schema else "",
        replay_check,
        options.time_unit or "",
        options.rotation or "",
    )


def settled(said: Reading) -> Reading:
    """The same with a protocol that there is; "" where it is to be recognised.

    Raises:
        UsageError: there is no such protocol.
    """
    check_protocol(said.protocol)
    return replace(said, protocol="" if said.protocol == "auto" else said.protocol)


def check_protocol(name: str) -> None:
    """UsageError: there is no protocol of that name."""
    from server.live import speech

    known = ("auto", *speech.protocols())
    if name and name not in known:
        raise UsageError(f"there is no protocol {name!r}; there are: {', '.join(known)}.")


def no_file(path: str) -> str:
    """What is said of a path that is no file."""
    return f"{path} is a folder; name one capture in it." if Path(path).is_dir() else f"there is no file {path}."
