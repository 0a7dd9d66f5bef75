"""Lines of a log of CAN frames, as `candump -l` writes them; the stream of protocols/can/ consists of them.

    (1609459200.123456) can0 021#7FFF000000000000          data; with 8 digits the identifier has 29 bits
    (1609459200.123456) can0 021#R8                        a request without data
    (1609459200.123456) can0 021##1AABB                    CAN FD: flags, then data
    (1609459200.123456) can0 20000088#0000000000000000     an error that the controller reports
    #CAN {"identifiers": {"021": "Quaternion"}}            a definition (definition.py)

Source: can-utils, lib.h (the "logfile" format of sprint_canframe) and candump(1); linux/can.h (flags of an identifier).
"""

import numpy as np

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.framing.stream_buffer import (
    BAD_ITEM,
    BODY,
    FRAME,
    ID,
    LENGTH,
    OFFSET,
    QUANTITIES,
    SENDER,
    SIZE,
    STATUS,
    TRUNCATED,
)
from imuscope.protocols.native.kernels import BYTES, FLAG, FOUR, INT, INTS, NOTHING, PAIR, ROWS, TABLE, compiled

DATA, REQUEST, FD, ERROR, DEFINITION = range(5)
"""Kinds of lines, in the row SENDER of a table."""
STAMP, BUS, BUS_KEY = range(QUANTITIES, QUANTITIES + 3)
"""Further quantities of a line: ns since 1970 (-1 without one), place of the name of the bus, a number made of it."""
LINE = QUANTITIES + 3
EXTENDED_BIT = 1 << 31
"""Added to an identifier of 29 bits."""
MARK = b"#CAN "
_MARK, _MARK_SIZE = np.frombuffer(MARK, np.uint8), len(MARK)
DAMAGED = -1
UNFINISHED = -2
MAX_LINE_BYTES = 512  # bytes of a line with 64 bytes of data, and more than any
LONGEST_DEFINITION = 16_384
LONGEST_NAME = 16  # of a bus; IFNAMSIZ of Linux
_OPEN, _CLOSE, _HASH, _BLANK, _DOT, _NEWLINE, _R, _LONG_CODE = b"()# .\nR_"
_ZERO, _NINE = b"09"
_ERROR_FLAG = 0x2000_0000
_SECOND_NS = 1_000_000_000
_KEY_BITS = (1 << 48) - 1
_LATEST_S = 4_102_444_800  # 2100: a later time is damage
_LEAST_STAMP = 3


@compiled(INT, INT)
def hex_digit(byte: int) -> int:
    """Value of a hexadecimal digit; -1 for another character."""
    if 48 <= byte <= 57:
        return byte - 48
    if 65 <= byte <= 70:
        return byte - 55
    if 97 <= byte <= 102:
        return byte - 87
    return -1


@compiled(PAIR, BYTES, INT, INT)
def seconds_at(data: Bytes, at: int, end: int) -> tuple[int, int]:
    """A decimal number of seconds: (ns, the place after it); DAMAGED without one, UNFINISHED if it reaches the end."""
    first = at
    seconds = 0
    while at < end and _ZERO <= int(data[at]) <= _NINE:
        if seconds > _LATEST_S:
            return DAMAGED, at
        seconds = 10 * seconds + int(data[at]) - _ZERO
        at += 1
    if seconds > _LATEST_S:
        return DAMAGED, at
    if at == end:
        return UNFINISHED, at
    if at == first or int(data[at]) != _DOT:
        return DAMAGED, at
    at += 1
    scale = _SECOND_NS // 10
    ns = 0
    while at < end and _ZERO <= int(data[at]) <= _NINE:
        ns += (int(data[at]) - _ZERO) * scale
        scale //= 10
        at += 1
    if at == end:
        return UNFINISHED, at
    return seconds * _SECOND_NS + ns, at


@compiled(FOUR, BYTES, INT, INT)
def identifier_at(data: Bytes, at: int, end: int) -> tuple[int, int, int, int]:
    """An identifier in hexadecimal digits: (its number, the kind of its frame, its digits, the place after it)."""
    first = at
    number = 0
    while at < end and at - first < 8 and hex_digit(int(data[at])) >= 0:
        number = 16 * number + hex_digit(int(data[at]))
        at += 1
    digits = at - first
    if digits == 8:
        if number & _ERROR_FLAG:
            return number & (_ERROR_FLAG - 1), ERROR, digits, at
        return (number & (_ERROR_FLAG - 1)) + EXTENDED_BIT, DATA, digits, at
    return number & 0x7FF, DATA, digits, at


@compiled(PAIR, BYTES, INT, INT)
def pairs_at(data: Bytes, at: int, end: int) -> tuple[int, int]:
    """Pairs of hexadecimal digits, which dots may separate: (their number, the place after them)."""
    count = 0
    while at + 1 < end:
        if int(data[at]) == _DOT:
            at += 1
            continue
        if hex_digit(int(data[at])) < 0 or hex_digit(int(data[at + 1])) < 0:
            break
        count += 1
        at += 2
    return count, at


@compiled(PAIR, BYTES, INT, INT)
def name_at(data: Bytes, at: int, end: int) -> tuple[int, int]:
    """A name without blanks: (a number made of it, the place after it)."""
    key = 7
    while at < end and int(data[at]) > _BLANK and int(data[at]) != _OPEN:
        key = (key * 131 + int(data[at])) & _KEY_BITS
        at += 1
    return key, at


@compiled(INT, BYTES, INT, INT)
def line_end(data: Bytes, at: int, end: int) -> int:
    """The place of the next line feed; the end without one."""
    while at < end and int(data[at]) != _NEWLINE:
        at += 1
    return at


@compiled(INT, INTS, INT, INT, INT, INT, INT, INT, INT)
def fill_line(line: Ints, body: int, length: int, number: int, kind: int, stamp: int, bus: int, key: int) -> int:
    """Set the quantities of a line but its place and its size."""
    line[BODY] = body
    line[LENGTH] = length
    line[ID] = number
    line[SENDER] = kind
    line[STATUS] = FRAME
    line[STAMP] = stamp
    line[BUS] = bus
    line[BUS_KEY] = key
    return 0


@compiled(INT, BYTES, INT, INT, INTS)
def frame_at(data: Bytes, at: int, end: int, line: Ints) -> int:
    """Read the line of a frame that begins at a place, into the LINE quantities of `line`.

    Returns:
        the place after it; DAMAGED if it is no such line, UNFINISHED if it may become one.
    """
    stop = line_end(data, at, min(end, at + MAX_LINE_BYTES))
    after = stop + 1
    if stop == end or int(data[stop]) != _NEWLINE:
        if stop - at >= MAX_LINE_BYTES:
            return DAMAGED
        after = UNFINISHED
    place = at + 1
    stamp, place = seconds_at(data, place, stop)
    if stamp < 0:
        return UNFINISHED if after == UNFINISHED and stamp == UNFINISHED else DAMAGED
    if place - at < _LEAST_STAMP or int(data[place]) != _CLOSE:
        return DAMAGED
    place += 1
    if place < stop and int(data[place]) != _BLANK:
        return DAMAGED
    while place < stop and int(data[place]) == _BLANK:
        place += 1
    bus = place
    key, place = name_at(data, place, stop)
    if place == stop:
        return after if after == UNFINISHED else DAMAGED
    if place == bus or place - bus > LONGEST_NAME or int(data[place]) != _BLANK:
        return DAMAGED
    number, kind, digits, place = identifier_at(data, place + 1, stop)
    if place == stop:
        return after if after == UNFINISHED else DAMAGED
    if (digits != 3 and digits != 8) or int(data[place]) != _HASH:
        return DAMAGED
    place += 1
    count = 0
    if place < stop and int(data[place]) == _HASH:
        kind = FD
        place += 2
    elif place < stop and int(data[place]) == _R:
        kind = REQUEST
        place += 1
        if place < stop and hex_digit(int(data[place])) >= 0:
            place += 1
    body = place
    if kind != REQUEST:
        count, place = pairs_at(data, place, stop)
    if after == UNFINISHED:
        return after
    if place < stop and int(data[place]) > _BLANK and int(data[place]) != _LONG_CODE:
        return DAMAGED
    if count > 64 or (kind == DATA and count > 8):
        return DAMAGED
    line[OFFSET] = at
    line[SIZE] = after - at
    fill_line(line, body, count, number, kind, stamp, bus, key)
    return after


@compiled(FLAG, BYTES, INT, INT)
def _is_mark(data: Bytes, at: int, end: int) -> bool:
    """Whether a definition begins at a place, as far as there are bytes."""
    count = min(_MARK_SIZE, end - at)
    same = 0
    while same < count and int(data[at + same]) == int(_MARK[same]):
        same += 1
    return same == count


@compiled(INT, BYTES, INT, INT, INTS)
def definition_at(data: Bytes, at: int, end: int, line: Ints) -> int:
    """Read a definition that begins at a place; see `frame_at`."""
    stop = line_end(data, at, min(end, at + LONGEST_DEFINITION))
    if stop == end or int(data[stop]) != _NEWLINE:
        return DAMAGED if stop - at >= LONGEST_DEFINITION else UNFINISHED
    if stop - at < _MARK_SIZE:
        return DAMAGED
    line[OFFSET] = at
    line[SIZE] = stop + 1 - at
    line[BODY] = at + _MARK_SIZE
    line[LENGTH] = stop - at - _MARK_SIZE
    line[ID] = -1
    line[SENDER] = DEFINITION
    line[STATUS] = FRAME
    return stop + 1


@compiled(FOUR, BYTES, INT, FLAG, TABLE)
def scan(data: Bytes, at: int, final: bool, table: Ints) -> tuple[int, int, int, int]:
    """Find lines; see framing.Scan."""
    n = 0
    failed = 0
    framed = 0
    end = len(data)
    line = np.zeros(LINE, np.int64)
    while at < end and n < table.shape[1]:
        first = int(data[at])
        if first != _OPEN and (first != _HASH or not _is_mark(data, at, end)):
            at += 1
            continue
        limit = at + (MAX_LINE_BYTES if first == _OPEN else LONGEST_DEFINITION)
        stop = line_end(data, at, min(end, limit))
        if stop == end and stop < limit and not final:  # wait for the line feed, so that all is decided at once
            break
        after = frame_at(data, at, end, line) if first == _OPEN else definition_at(data, at, end, line)
        if after < 0:
            line[OFFSET] = at
            line[SIZE] = stop - at
            line[BODY] = at + 1
            line[LENGTH] = 0
            line[ID] = -1
            line[SENDER] = -1
            line[STATUS] = TRUNCATED if after == UNFINISHED else BAD_ITEM
            failed += 1
            at += 1
        else:
            framed += after - at
            at = after
        for quantity in range(QUANTITIES):
            table[quantity, n] = line[quantity]
        n += 1
    return n, at, failed, framed


@compiled(NOTHING, BYTES, INTS, INTS, ROWS)
def payloads(data: Bytes, starts: Ints, counts: Ints, out: Bytes) -> None:
    """Write the first bytes of frames from pairs of digits that single characters may separate.

    Args:
        starts, counts: (n,) place of the digits, and the number of pairs.
        out: (n, bytes), written; 0 behind the end of a frame.
    """
    for k in range(len(starts)):
        at = starts[k]
        for place in range(out.shape[1]):
            out[k, place] = 0
            if place < counts[k]:
                if hex_digit(int(data[at])) < 0:
                    at += 1
                out[k, place] = 16 * hex_digit(int(data[at])) + hex_digit(int(data[at + 1]))
                at += 2
