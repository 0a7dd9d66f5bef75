"""What is in this file? One line for every frame: `imuscope inspect`.

As JSON lines, for scripts:

    {"offset": 0, "size": 9, "protocol": "xbus", "id": 54, "message": "MTData2", "fields": {"PacketCounter": 7}}
    {"offset": 9, "size": 3, "reject": "bad_checksum"}                                           with --rejects

`fields` are wire values by name, `flags` the set bits of flag words, `wire` what names do not carry; the protocol's own
plain.py specifies them. Offsets are bytes from the start of the file. Or as a table, for people:

    offset    size  message     fields
         0       9  MTData2     PacketCounter 7

The file is read in pieces, so its size does not matter.
"""

from __future__ import annotations

import contextlib
import itertools
import json
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal, TextIO

from protocols.mixture import Mixture
from protocols.registry import PROTOCOLS, ProtocolInfo, guess
from recordings.blocks import MAGIC
from recordings.container import RecordingError
from recordings.importers import GUESS_BYTES, GUESS_SCORE, CaptureSource, open_file
from recordings.parts import McapSource
from server.commands.replaying import ReplayError, chosen
from server.live.reading import Reading

CHUNK = 1 << 20
LONGEST_WORD = 64  # characters of a word or of bytes shown in the table; jsonl has all of them
TELL = ("no_key", "bad_hmac", "below_min_mode")
"""Reasons that an option would change."""

EXPLAINED: Mapping[str, str] = {
    "bad_checksum": "the checksum does not fit the bytes",
    "bad_size": "it claims a length that no frame has",
    "bad_type": "it claims a packet type that there is not",
    "bad_item": "an item of it claims more bytes than are left, or a size that its kind has not",
    "bad_id": "bus identifier and message are both 0",
    "bad_crc8": "the header is damaged, or this is no header",
    "bad_version": "unsupported version",
    "bad_mode": "unknown mode",
    "below_min_mode": "intact, but of a weaker mode than is accepted (--min-mode)",
    "bad_crc32": "the payload is damaged",
    "bad_hmac": "damaged, forged, or made with another key",
    "no_key": "a Secure frame, and no key to check it with (--key)",
    "stale": "intact, but old: its sequence number has passed (--no-replay-check)",
    "far_ahead": "intact, but its sequence number is far ahead, and no second frame agrees",
    "truncated": "the bytes end before it does",
    "indt": "the preamble of IDTP's successor",
}
"""What each reason means, for a person."""

Line = Mapping[str, Any]


def inspect_file(
    path: str | Path,
    out: TextIO,
    reading: Reading = Reading("auto"),  # noqa: B008 - frozen
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
        mixture = Mixture(row.name)
        counts: Counter[str] = Counter()
        lines = _counted(_lines(pieces, row, reading.settings(row.settings), mixture), counts, rejects)
        if format == "jsonl":
            for line in lines:
                out.write(json.dumps(line, ensure_ascii=False, allow_nan=False, default=str) + "\n")
        else:
            out.write(f"{'offset':>10}  {'size':>5}  {'message':<26}  fields\n")
            for line in lines:
                out.write(_table_row(line) + "\n")
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


def _counted(lines: Iterator[Line], counts: Counter[str], rejects: bool) -> Iterator[Line]:
    """The lines to show; what was accepted ("") and why the others were not is counted."""
    for line in lines:
        counts[line.get("reject", "")] += 1
        if rejects or "reject" not in line:
            yield line


@contextlib.contextmanager
def _opened(path: Path, protocol: str, device: str, direction: str) -> Iterator[tuple[ProtocolInfo, Iterator[bytes]]]:
    """The protocol of a file and its bytes in pieces, by the one rule of recordings/importers.py. A pipe is read as it
    comes; its beginning decides.

    Raises:
        ValueError: no such protocol, nothing known in it, or no bytes of a device.
    """
    if protocol != "auto" and protocol not in PROTOCOLS:
        raise ValueError(f"there is no protocol {protocol!r}; known are {', '.join(PROTOCOLS)}")
    named = "" if protocol == "auto" else protocol
    if not path.is_file():
        with path.open("rb") as pipe:
            head = _head(pipe)
            if head.startswith(MAGIC):
                raise ValueError("a recording cannot be read from a pipe; name its file")
            yield PROTOCOLS[named or _guessed(head, "standard input")], itertools.chain((head,), _pieces(pipe))
        return
    try:
        source = open_file(path, named)
    except RecordingError as error:
        with path.open("rb") as file:
            head = file.read(GUESS_BYTES)
        if head and not head.startswith(MAGIC):
            _guessed(head, path.name)  # says more exactly why
        raise ValueError(f"{error.message} {error.hint}".strip()) from None
    if isinstance(source, CaptureSource):
        with contextlib.closing(source.stream()) as file:
            yield PROTOCOLS[source.protocol], _pieces(file)
        return
    if not isinstance(source, McapSource) or not source.devices:
        raise ValueError(f"{path.name} holds no bytes of a device; `imuscope decode` reads its numbers")
    try:
        one = chosen(source, device)
    except ReplayError as error:
        raise ValueError(str(error)) from None
    parts = (part.data for part in source.parts() if part.device == one and part.way == direction)
    spoken = named or source.devices[one].protocol
    if spoken not in PROTOCOLS:
        head = next(parts, b"")
        spoken, parts = _guessed(head[:GUESS_BYTES], path.name), itertools.chain((head,), parts)  # type: ignore[assignment]
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
    best = guess(head)[0]
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


def _lines(pieces: Iterator[bytes], row: ProtocolInfo, settings: Mapping[str, Any], mixture: Mixture) -> Iterator[Line]:
    listing = row.listing(**settings)
    for chunk in pieces:
        mixture.feed(chunk)
        listing.feed(chunk)
        yield from listing.drain()
    mixture.feed(b"", final=True)
    yield from listing.drain(stalled=True)


def _table_row(line: Line) -> str:
    head = f"{line['offset']:>10}  {line['size']:>5}  "
    if "reject" in line:
        why = EXPLAINED.get(line["reject"], "")
        return head + f"{'—':<26}  {line['reject']}" + (f": {why}" if why else "")
    flags = line.get("flags", {})
    words = [f"{name} {_readable(value, flags, name)}" for name, value in line["fields"].items()]
    wire = line.get("wire", {})
    words += [f"({name} {_readable(wire[name], {}, '')})" for name in ("bid", "trailing") if name in wire]
    words += [f"({note})" for note in line.get("notes", ())] + ["(unverified)"] * (line.get("verified") is False)
    name = line["message"] if line["id"] is not None else f"{line['protocol']} {line['message']}"
    return (head + f"{name:<26}  " + "  ".join(words)).rstrip()


def _readable(value: Any, flags: Mapping[str, list[str]], path: str) -> str:
    """A value for a person: six digits, flag words with the names of their bits."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name} {_readable(v, flags, f'{path}.{name}')}" for name, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_readable(v, flags, f"{path}[{i}]") for i, v in enumerate(value)) + "]"
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    if isinstance(value, str) and len(text) > LONGEST_WORD:
        text = f"{text[: LONGEST_WORD - 1]}…"
    return f"{text} ({', '.join(flags[path])})" if flags.get(path) else text
