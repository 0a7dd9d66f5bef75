"""The two binary string outputs of an MTi: framing and fields.

An MTi can send strings that are not Xbus messages (MT0101P 2020.A, 5.3.5 SetStringOutputType). Most are NMEA
sentences and belong to protocols/embedded/nmea.py. Two are not:

    TSS2      :DDDDDSMHHHHQMRRRRSMPPPPE     25 characters; CR LF after it in most makers' versions
              D heading × 100 · S space · M " " or "-" · H heave, cm · Q status · R roll × 100 · P pitch × 100
              E heading status

    EM1000    00 90 RR RR PP PP AA AA HH HH     10 bytes; roll, pitch, heave, heading; 0.01° and cm
              least significant byte first, as in Kongsberg's definition; the Xsens document does not say

Neither has a checksum. TSS2 has 25 characters, each with few possible values: one is accepted. EM1000 has four fixed
bytes (an MTi's heave is always 0) and three ranges: a record is accepted if it is in a row of three, each at most
`WINDOW_BYTES` after the one before. One in 10^10 random positions looks like a record; three near each other do not
happen. The others of a row may be in other stretches (`Em1000Row`): a device that sends one now and then, or between
frames, loses only the first two, which count as bytes that belong to no message.
"""

import re
import struct
from bisect import bisect_right
from dataclasses import dataclass

from imuscope.protocols.events import ParsedMessage

TSS2 = re.compile(
    rb":(?P<heading>[0-3]\d{4}) (?P<heave>[ -]\d{4})(?P<status>[A-Za-z])"
    rb"(?P<roll>[ -]\d{4}) (?P<pitch>[ -]\d{4})(?P<flag>[A-Za-z])(?:\r\n)?"
)
_DIGIT, _SIGN, _LETTER = b"0123456789", b" -", bytes(range(65, 91)) + bytes(range(97, 123))
_NUMBER = (_SIGN, *[_DIGIT] * 4)
_TSS2_PLACES = (b":", *[_DIGIT] * 5, b" ", *_NUMBER, _LETTER, *_NUMBER, b" ", *_NUMBER, _LETTER, b"\r", b"\n")
_TSS2_SIZE = 25
EM1000 = struct.Struct("<2xhhhH")
EM1000_HEAD = b"\x00\x90"
_EM1000_START = re.compile(rb"\x00(?:\x90|\Z)")
WINDOW_BYTES = 13 * 82 + 27  # a device may send all kinds of strings in turn: 13 of the longest sentences and a TSS2
_MORE = 2


@dataclass(slots=True)
class Em1000Row:
    """The records before a stretch: end of the last one, relative to the stretch (0 or less), and how many."""

    end: int
    count: int = _MORE


def find(data: bytes | memoryview, *, final: bool, row: Em1000Row | None = None) -> tuple[list[ParsedMessage], int]:
    """The binary strings in `data`, a stretch without frames of another protocol.

    Args:
        final: no data follows.
        row: the EM1000 records before; updated.

    Returns:
        the strings in order, and the position from which bytes must be kept because a string may be incomplete.
    """
    data = bytes(data)
    tss2, keep_tss2 = _find_tss2(data, final)
    row = row if row is not None else Em1000Row(-WINDOW_BYTES - 1, 0)
    em1000, keep_em1000 = _find_em1000(data, final, row, [one.offset for one in tss2], keep_tss2)
    keep = min(keep_tss2, keep_em1000)
    messages = sorted(tss2 + em1000, key=lambda one: one.offset)
    return [one for one in messages if one.offset < keep], keep


def _find_tss2(data: bytes, final: bool) -> tuple[list[ParsedMessage], int]:
    messages: list[ParsedMessage] = []
    at = 0
    while (at := data.find(b":", at)) >= 0:
        match = TSS2.match(data, at)
        whole = final or data[at + _TSS2_SIZE : at + _TSS2_SIZE + 2] not in (b"", b"\r")
        if match and whole and int(match["heading"]) < 36000:
            messages.append(
                ParsedMessage(at, len(match.group()), "tss2", "TSS2", match.group().decode().rstrip(), _tss2(match))
            )
            at = match.end()
        elif not final and _may_become_tss2(data[at : at + 27]):
            return messages, at
        else:
            at += 1
    return messages, len(data)


def _may_become_tss2(tail: bytes) -> bool:
    """Whether these truncated bytes may begin a string."""
    if len(tail) >= len(_TSS2_PLACES):
        return False
    return all(byte in allowed for byte, allowed in zip(tail, _TSS2_PLACES, strict=False))


def _tss2(match: re.Match[bytes]) -> dict[str, float | str]:
    def signed(name: str) -> int:
        return int(match[name].replace(b" ", b""))

    return {
        "heading": int(match["heading"]) / 100,
        "heave": signed("heave") / 100,
        "status": match["status"].decode(),
        "roll": signed("roll") / 100,
        "pitch": signed("pitch") / 100,
        "headingStatus": match["flag"].decode(),
    }


def _find_em1000(
    data: bytes, final: bool, row: Em1000Row, tss2: list[int], decided: int
) -> tuple[list[ParsedMessage], int]:
    """Records, except those that end where a TSS2 string begins; `tss2` are all of these before `decided`."""
    messages: list[ParsedMessage] = []
    at = 0
    while start := _EM1000_START.search(data, at):
        at = start.start()
        if at + EM1000.size > len(data):
            if not final and _may_become_em1000(data[at:]):
                return messages, at
            at += 1
            continue
        if not _is_em1000(data, at):
            at += 1
            continue
        if at + EM1000.size > decided:
            return messages, at
        after = bisect_right(tss2, at)
        if after < len(tss2) and tss2[after] < at + EM1000.size:
            at += 1
            continue
        before = row.count if 0 <= at - row.end <= WINDOW_BYTES else 0
        more = before >= _MORE or _followed(data, at, _MORE - before, final)
        if more is None:
            return messages, at
        row.end, row.count = at + EM1000.size, before + 1
        if not more:
            at += 1
            continue
        record = data[at : at + EM1000.size]
        roll, pitch, heave, heading = EM1000.unpack(record)
        fields = {"roll": roll / 100, "pitch": pitch / 100, "heave": heave / 100, "heading": heading / 100}
        messages.append(ParsedMessage(at, EM1000.size, "em1000", "EM1000", record.hex(" "), fields))
        at += EM1000.size
    return messages, len(data)


def _is_em1000(data: bytes, at: int) -> bool:
    if not data.startswith(EM1000_HEAD, at) or at + EM1000.size > len(data):
        return False
    roll, pitch, heave, heading = EM1000.unpack_from(data, at)
    return bool(heave == 0 and abs(roll) <= 18000 and abs(pitch) <= 9000 and heading < 36000)


def _may_become_em1000(tail: bytes) -> bool:
    head = tail[: len(EM1000_HEAD)]
    return EM1000_HEAD.startswith(head) and not any(tail[6:8])


def _followed(data: bytes, at: int, expected: int, final: bool) -> bool | None:
    """Whether so many records follow in the row; None: more data decides."""
    for _ in range(expected):
        at += EM1000.size
        limit = at + WINDOW_BYTES
        while (at := data.find(EM1000_HEAD, at, limit + len(EM1000_HEAD))) >= 0 and not _is_em1000(data, at):
            at += 1
        if at < 0:
            return None if not final and len(data) < limit + EM1000.size else False
    return True
