"""`imuscope inspect`: print one line for every frame of a file.

As JSON lines, for scripts:

    {"offset": 0, "size": 9, "protocol": "xbus", "id": 54, "message": "MTData2", "fields": {"PacketCounter": 7}}
    {"offset": 9, "size": 3, "reject": "bad_checksum"}                                           with --rejects

`fields` are wire values by name, `flags` the set bits of flag words, `wire` the remaining parts of the frame; the
protocol's own json_codec.py specifies them. Offsets are bytes from the start of the file. Or as a table with units and
the names of values, for reading (server/commands/inspect_table.py):

    offset    size  message     fields
         0       9  MTData2     PacketCounter 7

The file is read in pieces, so it can have any size.
"""

import contextlib
import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Literal, TextIO, cast

from imuscope.protocols.arrays import Ints
from imuscope.protocols.events import Decoder
from imuscope.protocols.registry.families import PROTOCOLS, ProtocolInfo, detect, family_of
from imuscope.protocols.registry.mixed_protocols import MixedProtocolDetector
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import GUESS_BYTES, GUESS_SCORE, CaptureSource, open_file
from imuscope.recordings.mcap.records import MAGIC
from imuscope.recordings.mcap.source import McapSource
from imuscope.recordings.readers.known_files import known_file
from imuscope.recordings.readers.message_source import MessageFile
from imuscope.recordings.readers.registry import marked_reader
from imuscope.server.commands.common import temporary_copy
from imuscope.server.commands.inspect_table import InspectTable
from imuscope.server.commands.replay import choose_device
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.errors import UsageError
from imuscope.server.text.printable import json_text

CHUNK_BYTES = 1 << 20
NO_DEVICES = "is not a recording, so it has no devices to choose from; leave --device out"

InspectLine = Mapping[str, Any]
Arrivals = tuple[Ints, Ints] | None  # end of each chunk, and its arrival, ns; None: not those of a link
TimedPiece = tuple[bytes, Arrivals]


def inspect_file(
    path: str | Path,
    out: TextIO,
    reading: DecodeOptions = DecodeOptions("auto"),  # noqa: B008 - frozen
    *,
    direction: Literal["rx", "tx"] = "rx",
    text_format: Literal["table", "jsonl"] = "table",
    rejects: bool = False,
    device: str = "",
    notes: TextIO | None = None,
) -> None:
    """Write one line for each frame.

    Args:
        reading: decode options; protocol is the name of a protocol, or "auto" to detect it from the beginning of
            the file.
        direction: "rx": sent by the device; "tx": sent to it. (Xbus message numbers include the direction.)
        rejects: also list frames that failed their checks.
        device: device to list, for a recording with several.
        notes: stream for a note if the file also has messages of other protocols.

    Raises:
        UsageError, RecordingError: unknown protocol, or no known frames in the file.
        OSError: the file cannot be read.
    """
    with _opened(Path(path), reading.protocol, device, direction) as (row, pieces):
        detector = MixedProtocolDetector(row.name)
        counts: Counter[str] = Counter()
        unclaimed = UnclaimedBytes()
        every = unclaimed.watch(_lines(unclaimed.count(pieces), row, reading.settings(row.name), detector))
        lines = _counted(every, counts, rejects)
        if text_format == "jsonl":
            for line in lines:
                out.write(json_text(line, allow_nan=False, default=str) + "\n")
        else:
            table = InspectTable(reading, row)
            out.write(table.head + "\n")
            for line in lines:
                out.write(table.row(line) + "\n")
    name = "standard input" if str(path) == "/dev/stdin" else Path(path).name
    if notes is not None and (others := [PROTOCOLS[one].title for one in detector.others]):
        notes.write(
            f"imuscope: {name} also has messages of {' and '.join(others)}; it is listed as {row.title}. "
            "Choose another with --protocol.\n"
        )
    if notes is not None and counts[""] and unclaimed.total:
        notes.write(f"imuscope: {name}: {unclaimed.words()}\n")
    _report_rejects(name, row, counts, rejects, notes)


class UnclaimedBytes:
    """Counter of the bytes of a file that belong to no accepted frame and no known message."""

    def __init__(self) -> None:
        self._size = 0
        self._claimed = 0
        self._end = 0  # of the claimed bytes
        self._first = -1  # position of the first unclaimed byte; -1: none before the end of the claimed ones

    @property
    def total(self) -> int:
        return self._size - self._claimed

    def count(self, pieces: Iterable[TimedPiece]) -> Iterator[TimedPiece]:
        """Pass on the pieces of the file."""
        for piece in pieces:
            self._size += len(piece[0])
            yield piece

    def watch(self, lines: Iterator[InspectLine]) -> Iterator[InspectLine]:
        """Pass on the lines of its frames and messages, by offset."""
        for line in lines:
            if "reject" not in line:
                begin, end = int(line["offset"]), int(line["offset"]) + int(line["size"])
                if begin > self._end and self._first < 0:
                    self._first = self._end
                self._claimed += max(end - max(begin, self._end), 0)
                self._end = max(end, self._end)
            yield line

    def words(self) -> str:
        first = self._first if self._first >= 0 else self._end
        return (
            f"{self.total} of {self._size} bytes belong to no accepted frame and no known message, the first at offset "
            f"{first}."
        )


def _report_rejects(name: str, row: ProtocolInfo, counts: Counter[str], rejects: bool, notes: TextIO | None) -> None:
    """Report frames that were rejected for a reason that another option would avoid.

    Raises:
        UsageError: no line was written.
    """
    reasons = [reason for reason in row.decoding.remedies if counts[reason]]
    words = "; ".join(f"{counts[one]} frames are not accepted: {row.decoding.remedies[one].listed}" for one in reasons)
    if counts[""] or (rejects and counts.total()):
        if words and notes is not None:
            notes.write(f"imuscope: {name}: {words}.\n")
        return
    if rejected := next((reason for reason in row.decoding.refusals if counts[reason]), ""):
        what, hint = row.decoding.refusals[rejected]
        raise UsageError(f"{name}: {counts[rejected]} frames are not accepted. {what} {hint}")
    others = ", ".join(f"{count} {reason}" for reason, count in counts.most_common(3) if reason)
    raise UsageError(
        words or f"{name} has no valid frame of {row.title}" + (f": {others} (--rejects)" if others else "")
    )


def _counted(lines: Iterator[InspectLine], counts: Counter[str], rejects: bool) -> Iterator[InspectLine]:
    """The lines to show. Accepted frames ("") and reject reasons are counted."""
    for line in lines:
        counts[line.get("reject", "")] += 1
        if rejects or "reject" not in line:
            yield line


@contextlib.contextmanager
def _opened(
    path: Path, protocol: str, device: str, direction: str
) -> Iterator[tuple[ProtocolInfo, Iterator[TimedPiece]]]:
    """The protocol of a file and its bytes in pieces, by the rules of recordings/importers/open_file.py. A pipe is read
    as a stream, and its beginning decides the protocol; a recording from a pipe is copied to a file first, because its
    index is at its end.

    Raises:
        UsageError: unknown protocol, no known frames, or no device bytes.
    """
    if protocol != "auto" and protocol not in PROTOCOLS:
        raise UsageError(f"unknown protocol {protocol!r}; available: {', '.join(PROTOCOLS)}")
    named = "" if protocol == "auto" else protocol
    if path.is_file() or path.is_dir():
        with _of_file(path, path.name, named, device, direction) as stream:
            yield stream
        return
    name = "standard input" if str(path) == "/dev/stdin" else path.name
    with path.open("rb") as pipe:
        head = _head(pipe)
        if head.startswith(MAGIC):
            every = itertools.chain((head,), _pieces(pipe))
            with temporary_copy(every) as copy, _of_file(copy, name, named, device, direction) as stream:
                yield stream
            return
        if device:
            raise UsageError(f"{name} {NO_DEVICES}")
        yield PROTOCOLS[named or _guessed(head, name)], _untimed(itertools.chain((head,), _pieces(pipe)))


@contextlib.contextmanager
def _of_file(
    path: Path, name: str, named: str, device: str, direction: str
) -> Iterator[tuple[ProtocolInfo, Iterator[TimedPiece]]]:
    try:
        source = open_file(path, named)
    except RecordingError:
        with path.open("rb") as file:
            head = file.read(GUESS_BYTES)
        if head and not head.startswith(MAGIC) and known_file(head) is None and marked_reader(head) is None:
            _guessed(head, name)  # raises a more exact error
        raise
    if device and not isinstance(source, McapSource | MessageFile):
        raise UsageError(f"{name} {NO_DEVICES}")
    if isinstance(source, CaptureSource):
        with contextlib.closing(source.stream()) as file:
            head = _head(file)
            decoded_by = PROTOCOLS[source.protocol or _guessed(head, name)]
            yield decoded_by, _untimed(itertools.chain((head,), _pieces(file)))
        return
    if not isinstance(source, McapSource | MessageFile) or not source.devices:
        raise UsageError(f"{name} has no device bytes; use `imuscope decode` to read its numbers")
    one = choose_device(source, device)
    has_arrivals = source.devices[one].identity.get("link", "file") != "file"
    parts = (
        (part.data, (part.ends, part.times) if has_arrivals else None)
        for part in source.parts()
        if part.device == one and part.direction == direction
    )
    protocol_name = named or source.devices[one].protocol
    if family_of(protocol_name) is None:
        first: TimedPiece = next(parts, (b"", None))
        protocol_name, parts = _guessed(first[0][:GUESS_BYTES], name), itertools.chain((first,), parts)  # type: ignore[assignment]
    family = family_of(protocol_name)
    assert family is not None
    yield family, parts


def _head(pipe: BinaryIO) -> bytes:
    """The first GUESS_BYTES bytes, or all if there are fewer; they decide the protocol."""
    head = b""
    while len(head) < GUESS_BYTES and (more := pipe.read(GUESS_BYTES - len(head))):
        head += more
    return head


def _guessed(head: bytes, name: str) -> str:
    """The protocol of some bytes.

    Raises:
        UsageError: no protocol matches enough of them.
    """
    if not head:
        raise UsageError(f"{name} is empty.")
    best = detect(head)[0]
    if best.score >= GUESS_SCORE:
        return best.protocol
    where = f"the first {GUESS_BYTES // 1024} kB of " if len(head) == GUESS_BYTES else ""
    at_best = f", at best {best.reason}" if best.score > 0 else ""
    raise UsageError(
        f"no known protocol in {where}{name}{at_best}. If you know it, add --protocol {' or '.join(PROTOCOLS)}."
    )


def _pieces(file: BinaryIO) -> Iterator[bytes]:
    while chunk := file.read(CHUNK_BYTES):
        yield chunk


def _untimed(pieces: Iterable[bytes]) -> Iterator[TimedPiece]:
    return ((piece, None) for piece in pieces)


def _lines(
    pieces: Iterator[TimedPiece], row: ProtocolInfo, settings: Mapping[str, Any], detector: MixedProtocolDetector
) -> Iterator[InspectLine]:
    listing = row.frames.listing(**settings)
    for chunk, arrivals in pieces:
        detector.feed(chunk)
        if arrivals is not None and row.stream.silence:
            cast(Decoder, listing).feed_chunks(chunk, *arrivals)
        else:
            listing.feed(chunk)
        yield from listing.drain()
    detector.feed(b"", final=True)
    yield from listing.drain(stalled=True)
