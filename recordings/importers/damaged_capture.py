"""Bytes of a known protocol that no checksum confirms: frames with a wrong one, and sentences without any."""

import re
from collections.abc import Iterable, Iterator

from imuscope.protocols.embedded.gnss_time import TIME_AT
from imuscope.protocols.embedded.nmea import checksum
from imuscope.protocols.events import RejectedFrame
from imuscope.protocols.registry.families import PROTOCOLS, permissive_decoder

MIN_FRAMES = 5  # frames
MIN_SHARE = 0.8  # of the frames or lines are such
UBX, UBX_SIZE = b"\xb5\x62", 8  # mark of a frame, and its bytes beside the payload
_COMMENTS = re.compile(rb"\A(?:\xef\xbb\xbf)?(?:[ \t]*(?:#[^\r\n]*)?[\r\n]+)*+[ \t]*")
_SENTENCE = re.compile(rb"^[$!][A-Z][A-Z0-9]{2,9},[^*\r\n]*(\*[0-9A-Fa-f]{2})?\s*$")


def without_comments(data: bytes) -> bytes:
    """The first bytes of a file without blank lines and comments above sentences of NMEA; others as they are."""
    rest = _COMMENTS.sub(b"", data, 1)
    return rest if rest.startswith(b"$") else data


def has_unchecked_sentences(data: bytes) -> bool:
    """Whether the lines of a file are sentences of a GNSS receiver without a checksum."""
    sums = list(_sums(data))
    return len(sums) >= MIN_FRAMES and sums.count(b"") >= MIN_SHARE * len(sums)


def damaged_sentences(data: bytes) -> str:
    """Words on sentences of a GNSS receiver, in a file where none has a right checksum; "" if there are none."""
    sums = list(_sums(data))
    is_damaged = len(sums) >= MIN_FRAMES and sums.count(b"") < MIN_SHARE * len(sums)
    return f"{len(sums)} sentences of NMEA" if is_damaged else ""


def damaged_frames(data: bytes) -> str:
    """Words on frames in the first bytes of a file: "100 frames of UBX"; "" if there are none, or whole ones."""
    if words := damaged_sentences(data):
        return words
    if (count := _ubx_frames(data)) >= MIN_FRAMES:
        return f"{count} frames of UBX"
    for name, row in PROTOCOLS.items():
        decoder = permissive_decoder(name)
        decoder.feed(data, 0)
        events = decoder.drain(stalled=True)
        rejects = [one for one in events if isinstance(one, RejectedFrame) and one.reason == "bad_checksum"]
        ends = {one.offset + one.size for one in rejects}  # others have the mark of a frame by chance
        following = sum(1 for one in rejects if one.offset in ends)
        if len(rejects) >= max(MIN_FRAMES, MIN_SHARE * len(events)) and following >= MIN_SHARE * (len(rejects) - 1):
            return f"{len(rejects)} frames of {row.page.short or name}"
    return ""


def _ubx_frames(data: bytes) -> int:
    """Number of frames from the first mark on, each where the one before ends."""
    at, count = data.find(UBX), 0
    while at >= 0 and data.startswith(UBX, at) and at + 6 <= len(data):
        at += UBX_SIZE + int.from_bytes(data[at + 4 : at + 6], "little")
        count += 1
    return count


def _sums(data: bytes) -> Iterator[bytes]:
    """Checksums of whole lines, b"" for one without; nothing if few lines are sentences, or none has a time."""
    lines = [line for line in data.splitlines()[:-1] if line.strip()]
    matches = [match for line in lines if (match := _SENTENCE.match(line)) is not None]
    kinds = {match[0].partition(b",")[0][-3:].decode() for match in matches}
    if lines and len(matches) >= MIN_SHARE * len(lines) and kinds & TIME_AT.keys():
        yield from (match[1] or b"" for match in matches)


def checked(blocks: Iterable[bytes]) -> Iterator[bytes]:
    """The lines of a file, sentences of NMEA with a checksum."""
    held = b""
    for block in blocks:
        held += block
        cut = held.rfind(b"\n") + 1
        yield b"".join(map(_checked, held[:cut].splitlines(keepends=True)))
        held = held[cut:]
    yield _checked(held)


def _checked(line: bytes) -> bytes:
    match = _SENTENCE.match(line)
    if match is None or match[1]:
        return line
    text = line.strip()
    return text + b"*%02X\r\n" % checksum(text[1:])
