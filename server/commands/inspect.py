"""What is in this file? One line for every frame: `imuscope inspect`.

As JSON lines, for scripts:

    {"offset": 0, "size": 9, "protocol": "xbus", "id": 54, "message": "MTData2", "fields": {"PacketCounter": 7}}
    {"offset": 9, "size": 3, "reject": "bad_checksum"}                                           with --rejects

`fields` are wire values by name, `flags` the set bits of flag words, `wire` what names do not carry; the protocol's own
json_codec.py specifies them. Offsets are bytes from the start of the file. Or as a table, for people, with units and
the names of values (server/commands/inspect_table.py):

    offset    size  message     fields
         0       9  MTData2     PacketCounter 7

The file is read in pieces, so its size does not matter.
"""

from __future__ import annotations

import contextlib
import itertools
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal, TextIO

from protocols.mixed_protocols import MixedProtocolDetector
from protocols.registry import PROTOCOLS, ProtocolInfo, detect
from recordings.importers import GUESS_BYTES, GUESS_SCORE, CaptureSource, open_file
from recordings.mcap_reader import MAGIC
from recordings.mcap_writer import RecordingError
from recordings.sources import McapSource
from server.commands.common import kept_aside
from server.commands.inspect_table import EXPLAINED, InspectTable
from server.commands.replay import ReplayError, chosen
from server.devices.decode_options import DecodeOptions
from server.printable import json_text

CHUNK = 1 << 20
NO_DEVICES = "is no recording, and has no devices to choose from; leave --device out"
TELL = ("no_key", "bad_hmac", "below_min_mode")
"""Reasons that an option would change."""

InspectLine = Mapping[str, Any]


def inspect_file(
    path: str | Path,
    out: TextIO,
    reading: DecodeOptions = DecodeOptions("auto"),  # noqa: B008 - frozen
    *,
    direction: Literal["rx", "tx"] = "rx",
    format: Literal["table", "jsonl"] = "table",
    rejects: bool = False,
    device: str = "",
    notes: TextIO | None = None,
) -> None:
    """Write one line a frame.

    Args:
        reading: protocol, a name of protocols.registry, or "auto" to guess it from the beginning of the file; key and
            what else the protocol can be told.
        direction: "rx": what a device sent; "tx": what was sent to it. (Xbus numbers tell by themselves.)
        rejects: also what failed its checks.
        device: of a recording with several.
        notes: where to say that the file holds messages of other protocols too.
    Raises:
        ValueError: no such protocol, or nothing known in the file.
        OSError: the file cannot be read.
    """
    with _opened(Path(path), reading.protocol, device, direction) as (row, pieces):
        mixture = MixedProtocolDetector(row.name)
        counts: Counter[str] = Counter()
        lines = _counted(_lines(pieces, row, reading.settings(row.settings), mixture), counts, rejects)
        if format == "jsonl":
            for line in lines:
                out.write(json_text(line, allow_nan=False, default=str) + "\n")
        else:
            table = InspectTable(reading.schema)
            out.write(table.head + "\n")
            for line in lines:
                out.write(table.row(line) + "\n")
    name = "standard input" if str(path) == "/dev/stdin" else Path(path).name
    if notes is not None and (others := [PROTOCOLS[one].title for one in mixture.others]):
        notes.write(
            f"imuscope: {name} holds messages of {' and '.join(others)} too; it is listed as {row.title}. "
            "--protocol chooses another.\n"
        )
    _judge(name, row, counts, rejects, notes)


def _judge(name: str, row: ProtocolInfo, counts: Counter[str], rejects: bool, notes: TextIO | None) -> None:
    """Say what was refused for a reason that an option would change; a list without a line is no success.

    Raises:
        ValueError: not one line was written.
    """
    worth = [reason for reason in TELL if counts[reason]]
    words = "; ".join(f"{counts[one]} frames are not accepted: {EXPLAINED[one]}" for one in worth)
    if counts[""] or (rejects and counts.total()):
        if words and notes is not None:
            notes.write(f"imuscope: {name}: {words}.\n")
        return
    if counts["indt"]:
        raise ValueError(f"{name} holds {counts['indt']} times INDT, the successor of IDTP, which is not read here")
    others = ", ".join(f"{count} {reason}" for reason, count in counts.most_common(3) if reason)
    raise ValueError(
        words or f"{name} has no valid frame of {row.title}" + (f": {others} (--rejects)" if others else "")
    )


def _counted(lines: Iterator[InspectLine], counts: Counter[str], rejects: bool) -> Iterator[InspectLine]:
    """The lines to show; what was accepted ("") and why the others were not is counted."""
    for line in lines:
        counts[line.get("reject", "")] += 1
        if rejects or "reject" not in line:
            yield line


@contextlib.contextmanager
def _opened(path: Path, protocol: str, device: str, direction: str) -> Iterator[tuple[ProtocolInfo, Iterator[bytes]]]:
    """The protocol of a file and its bytes in pieces, by the one rule of recordings/importers.py. A pipe is read as it
    comes, and its beginning decides; a recording that comes through one is kept aside, because its index is at its end.

    Raises:
        ValueError: no such protocol, nothing known in it, or no bytes of a device.
    """
    if protocol != "auto" and protocol not in PROTOCOLS:
        raise ValueError(f"there is no protocol {protocol!r}; known are {', '.join(PROTOCOLS)}")
    named = "" if protocol == "auto" else protocol
    if path.is_file():
        with _of_file(path, path.name, named, device, direction) as found:
            yield found
        return
    name = "standard input" if str(path) == "/dev/stdin" else path.name
    with path.open("rb") as pipe:
        head = _head(pipe)
        if head.startswith(MAGIC):
            every = itertools.chain((head,), _pieces(pipe))
            with kept_aside(every) as aside, _of_file(aside, name, named, device, direction) as found:
                yield found
            return
        if device:
            raise ValueError(f"{name} {NO_DEVICES}")
        yield PROTOCOLS[named or _guessed(head, name)], itertools.chain((head,), _pieces(pipe))


@contextlib.contextmanager
def _of_file(
    path: Path, name: str, named: str, device: str, direction: str
) -> Iterator[tuple[ProtocolInfo, Iterator[bytes]]]:
    try:
        source = open_file(path, named)
    except RecordingError as error:
        with path.open("rb") as file:
            head = file.read(GUESS_BYTES)
        if head and not head.startswith(MAGIC):
            _guessed(head, name)  # says more exactly why
        raise ValueError(f"{error.message} {error.hint}".strip()) from None
    if device and not isinstance(source, McapSource):
        raise ValueError(f"{name} {NO_DEVICES}")
    if isinstance(source, CaptureSource):
        with contextlib.closing(source.stream()) as file:
            yield PROTOCOLS[source.protocol], _pieces(file)
        return
    if not isinstance(source, McapSource) or not source.devices:
        raise ValueError(f"{name} holds no bytes of a device; `imuscope decode` reads its numbers")
    try:
        one = chosen(source, device)
    except ReplayError as error:
        raise ValueError(str(error)) from None
    parts = (part.data for part in source.parts() if part.device == one and part.way == direction)
    spoken = named or source.devices[one].protocol
    if spoken not in PROTOCOLS:
        head = next(parts, b"")
        spoken, parts = _guessed(head[:GUESS_BYTES], name), itertools.chain((head,), parts)  # type: ignore[assignment]
    yield PROTOCOLS[spoken], parts


def _head(pipe: BinaryIO) -> bytes:
    """What decides: so many bytes, or all that there are."""
    head = b""
    while len(head) < GUESS_BYTES and (more := pipe.read(GUESS_BYTES - len(head))):
        head += more
    return head


def _guessed(head: bytes, name: str) -> str:
    """The protocol of some bytes. ValueError: none accounts for enough of them."""
    if not head:
        raise ValueError(f"{name} is empty.")
    best = detect(head)[0]
    if best.score >= GUESS_SCORE:
        return best.protocol
    where = f"the first {GUESS_BYTES // 1024} kB of " if len(head) == GUESS_BYTES else ""
    if b"INDT" in head and "INDT" in best.why:
        raise ValueError(f"{name} holds {best.why}")
    at_best = f", at best {best.why}" if best.score > 0 else ""
    raise ValueError(
        f"nothing known in {where}{name}{at_best}. If you know better, add --protocol {' or '.join(PROTOCOLS)}."
    )


def _pieces(file: BinaryIO) -> Iterator[bytes]:
    while chunk := file.read(CHUNK):
        yield chunk


def _lines(
    pieces: Iterator[bytes], row: ProtocolInfo, settings: Mapping[str, Any], mixture: MixedProtocolDetector
) -> Iterator[InspectLine]:
    listing = row.listing(**settings)
    for chunk in pieces:
        mixture.feed(chunk)
        listing.feed(chunk)
        yield from listing.drain()
    mixture.feed(b"", final=True)
    yield from listing.drain(stalled=True)
