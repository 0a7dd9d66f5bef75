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

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, TextIO

from protocols.mixture import Mixture
from protocols.registry import PROTOCOLS, ProtocolInfo, guess
from server.live.reading import Reading

CHUNK = 1 << 20
LONGEST_WORD = 64  # characters of a word or of bytes shown in the table; jsonl has all of them
GUESSED_FROM = 1 << 16  # bytes of the file that decide the protocol

EXPLAINED: Mapping[str, str] = {
    "bad_checksum": "the checksum does not fit the bytes",
    "bad_size": "it claims a length that no frame has",
    "bad_type": "it claims a packet type that there is not",
    "bad_item": "an item of it claims more bytes than are left, or a size that its kind has not",
    "bad_id": "bus identifier and message are both 0",
    "bad_crc8": "the header is damaged, or this is no header",
    "bad_version": "a version that is not read here",
    "bad_mode": "a mode that there is not",
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
    notes: TextIO | None = None,
) -> None:
    """Write one line a frame.

    Args:
        reading: protocol, a name of protocols.registry, or "auto" to guess it from the beginning of the file; key and
            what else the protocol can be told.
        direction: "rx": what a device sent; "tx": what was sent to it. (Xbus numbers tell by themselves.)
        rejects: also what failed its checks.
        notes: where to say that the file holds messages of other protocols too.
    Raises:
        ValueError: no such protocol, or nothing known in the file.
        OSError: the file cannot be read.
    """
    row = _row(Path(path), reading.protocol)
    if notes is not None:
        _tell_mixture(Path(path), row, notes)
    lines = (
        line for line in _lines(Path(path), row, reading.settings(row.settings)) if rejects or "reject" not in line
    )
    if format == "jsonl":
        for line in lines:
            out.write(json.dumps(line, ensure_ascii=False, allow_nan=False, default=str) + "\n")
        return
    out.write(f"{'offset':>10}  {'size':>5}  {'message':<26}  fields\n")
    for line in lines:
        out.write(_table_row(line) + "\n")


def _row(path: Path, protocol: str) -> ProtocolInfo:
    if protocol != "auto":
        if protocol not in PROTOCOLS:
            raise ValueError(f"there is no protocol {protocol!r}; known are {', '.join(PROTOCOLS)}")
        return PROTOCOLS[protocol]
    with path.open("rb") as file:
        head = file.read(GUESSED_FROM)
    if not head:
        raise ValueError(f"{path.name} is empty.")
    guesses = guess(head)
    if not guesses or guesses[0].score == 0:
        where = f"the first {GUESSED_FROM // 1024} kB of " if len(head) == GUESSED_FROM else ""
        names = " or ".join(PROTOCOLS)
        raise ValueError(f"nothing known in {where}{path.name}. If you know better, add --protocol {names}.")
    return PROTOCOLS[guesses[0].protocol]


def _tell_mixture(path: Path, row: ProtocolInfo, notes: TextIO) -> None:
    """Say so when a file holds frames of another protocol, wherever in it."""
    mixture = Mixture(row.name)
    with path.open("rb") as file:
        while chunk := file.read(CHUNK):
            mixture.feed(chunk)
    mixture.feed(b"", final=True)
    if others := [PROTOCOLS[name].title for name in mixture.others]:
        notes.write(
            f"imuscope: {path.name} holds messages of {' and '.join(others)} too; it is listed as {row.title}. "
            "--protocol chooses another.\n"
        )


def _lines(path: Path, row: ProtocolInfo, settings: Mapping[str, Any]) -> Iterator[Line]:
    listing = row.listing(**settings)
    with path.open("rb") as file:
        while chunk := file.read(CHUNK):
            listing.feed(chunk)
            yield from listing.drain()
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
