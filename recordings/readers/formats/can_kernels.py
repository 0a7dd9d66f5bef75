"""Loops over the lines of logs of CAN frames: those of `candump -l`, of candump on a terminal, and of Vector's ASC.

    (1609459200.123456) can0 021#7FFF000000000000
     (1609459200.123456)  can0  RX - -  021   [8]  7F FF 00 00 00 00 00 00   '........'
    can0  021   [8]  7F FF 00 00 00 00 00 00
       0.002481 1  21              Rx   d 8 7F FF 00 00 00 00 00 00

Source: can-utils, candump.c and lib.c; Vector, "CAN ASC Logging Files Format Description".
"""

import numpy as np

from imuscope.protocols.arrays import Array, Bytes, Ints
from imuscope.protocols.can.lines import (
    BUS,
    DAMAGED,
    DATA,
    ERROR,
    EXTENDED_BIT,
    FD,
    LINE,
    LONGEST_NAME,
    REQUEST,
    fill_line,
    frame_at,
    hex_digit,
    identifier_at,
    line_end,
    name_at,
    seconds_at,
)
from imuscope.protocols.framing.stream_buffer import BODY, ID, LENGTH, OFFSET, SIZE
from imuscope.protocols.native.kernels import BYTES, INT, INTS, PAIR, TABLE, TRIPLE, ArrayType, compiled

LOG, TERMINAL, ASC = range(3)
"""Forms of a log."""
_BLANK, _TAB, _RETURN, _NEWLINE, _OPEN, _CLOSE, _LEFT, _RIGHT, _HASH, _SLASH = b" \t\r\n()[]#/"
_MINUS, _COLON, _X, _R, _D, _E, _DOT = b"-:xrdE."
_NUL, _NINE = b"09"
_T, _CAPITAL_R, _LOWER_E = b"TRe"
_DAY_S, _SECOND_NS = 86_400, 1_000_000_000
_MIN_FD_DIGITS, _MAX_DATA_BYTES = 2, 64  # digits of the length of a frame of CAN FD; bytes


@compiled(INT, BYTES, INT, INT)
def _skip(data: Bytes, at: int, end: int) -> int:
    """The place after blanks."""
    while at < end and (int(data[at]) == _BLANK or int(data[at]) == _TAB or int(data[at]) == _RETURN):
        at += 1
    return at


@compiled(PAIR, BYTES, INT, INT)
def _number(data: Bytes, at: int, end: int) -> tuple[int, int]:
    """Decimal digits, at most 9: (the number, the place after them)."""
    number = 0
    first = at
    while at < end and at - first < 9 and _NUL <= int(data[at]) <= _NINE:
        number = 10 * number + int(data[at]) - _NUL
        at += 1
    return number, at


@compiled(PAIR, BYTES, INT, INT)
def _date(data: Bytes, at: int, end: int) -> tuple[int, int]:
    """2021-01-01 00:00:00.123456 as (ns since 1970, the place after it); DAMAGED if it is not one."""
    year, at = _number(data, at, end)
    if year < 1970 or year > 2200 or at + 12 > end:
        return DAMAGED, at
    month, at = _number(data, at + 1, end)
    day, at = _number(data, at + 1, end)
    hour, at = _number(data, at + 1, end)
    minute, at = _number(data, at + 1, end)
    if month < 1 or month > 12 or day < 1 or day > 31 or hour > 23 or minute > 59 or at >= end:
        return DAMAGED, at
    seconds, at = seconds_at(data, at + 1, end)
    if seconds < 0:
        return DAMAGED, at
    shifted = (month - 3) % 12
    march_year = year - (1 if month < 3 else 0)
    leap_days = march_year // 4 - march_year // 100 + march_year // 400
    days = 365 * march_year + leap_days + (153 * shifted + 2) // 5 + day - 1 - 719_468
    return ((days * 24 + hour) * 60 + minute) * 60 * _SECOND_NS + seconds, at


@compiled(INT, BYTES, INT, INT, INT)
def _count_pairs(data: Bytes, at: int, end: int, most: int) -> int:
    """Number of pairs of hexadecimal digits with one blank between them."""
    count = 0
    while at + 1 < end and count < most and hex_digit(int(data[at])) >= 0 and hex_digit(int(data[at + 1])) >= 0:
        count += 1
        at += 2
        if at < end and int(data[at]) == _BLANK:
            at += 1
    return count


@compiled(INT, BYTES, INT, INT, INTS)
def _terminal_line(data: Bytes, at: int, stop: int, line: Ints) -> int:
    """Read a line of candump on a terminal; 0, or DAMAGED."""
    place = _skip(data, at, stop)
    stamp = -1
    if place < stop and int(data[place]) == _OPEN:
        is_date = place + 5 < stop and int(data[place + 5]) == _MINUS
        if is_date:
            stamp, place = _date(data, place + 1, stop)
        else:
            stamp, place = seconds_at(data, place + 1, stop)
        if stamp < 0 or place >= stop or int(data[place]) != _CLOSE:
            return DAMAGED
        place = _skip(data, place + 1, stop)
    bus = place
    key, place = name_at(data, place, stop)
    if place == bus or place - bus > LONGEST_NAME:
        return DAMAGED
    place = _skip(data, place, stop)
    if place + 1 < stop and (int(data[place]) == _CAPITAL_R or int(data[place]) == _T):  # RX - -, of candump -x
        place = _skip(data, place + 2, stop)
        while place < stop and (int(data[place]) == _MINUS or int(data[place]) == 66 or int(data[place]) == 69):
            if place + 1 < stop and int(data[place + 1]) > _BLANK:
                break
            place = _skip(data, place + 1, stop)
    number, kind, digits, place = identifier_at(data, place, stop)
    if digits != 3 and digits != 8:
        return DAMAGED
    place = _skip(data, place, stop)
    if place >= stop or int(data[place]) != _LEFT:
        return DAMAGED
    length, after = _number(data, place + 1, stop)
    if after >= stop or int(data[after]) != _RIGHT or length > _MAX_DATA_BYTES:
        return DAMAGED
    if after - place - 1 >= _MIN_FD_DIGITS:
        kind = FD
    place = _skip(data, after + 1, stop)
    if kind == DATA and place < stop and int(data[place]) == _R:
        kind = REQUEST
    if kind == DATA and (length > 8 or _count_pairs(data, place, stop, length) != length):
        return DAMAGED
    fill_line(line, place, length, number, kind, stamp, bus, key)
    return 0


@compiled(INT, BYTES, INT, INT, INTS)
def _asc_line(data: Bytes, at: int, stop: int, line: Ints) -> int:
    """Read a line of an ASC log; 0, DAMAGED without a frame."""
    place = _skip(data, at, stop)
    stamp, place = seconds_at(data, place, stop)
    if stamp < 0:
        return DAMAGED
    bus = _skip(data, place, stop)
    key, place = name_at(data, bus, stop)
    if place - bus > LONGEST_NAME:
        return DAMAGED
    if place - bus == 5 and int(data[place - 1]) == 68:  # CANFD
        bus = _skip(data, place, stop)
        key, place = name_at(data, bus, stop)
        fill_line(line, place, 0, 0, FD, stamp, bus, key)
        return 0
    first = _skip(data, place, stop)
    number = 0
    place = first
    while place < stop and place - first < 8 and hex_digit(int(data[place])) >= 0:
        number = 16 * number + hex_digit(int(data[place]))
        place += 1
    if place < stop and int(data[place]) == _R and int(data[first]) == _E:  # ErrorFrame
        fill_line(line, place, 0, 0, ERROR, stamp, bus, key)
        return 0
    if place == first or place >= stop:
        return DAMAGED
    if int(data[place]) == _X:
        number = (number & 0x1FFF_FFFF) + EXTENDED_BIT
        place += 1
    if place >= stop or int(data[place]) != _BLANK:
        return DAMAGED
    place = _skip(data, place, stop)
    if place >= stop or (int(data[place]) != _CAPITAL_R and int(data[place]) != _T):
        return DAMAGED
    while place < stop and int(data[place]) > _BLANK:
        place += 1
    place = _skip(data, place, stop)
    if place >= stop:
        return DAMAGED
    if int(data[place]) == _R:
        fill_line(line, place, 0, number, REQUEST, stamp, bus, key)
        return 0
    if int(data[place]) != _D:
        return DAMAGED
    place = _skip(data, place + 1, stop)
    length = hex_digit(int(data[place])) if place < stop else -1
    body = _skip(data, place + 1, stop)
    if length < 0 or length > 8 or _count_pairs(data, body, stop, length) != length:
        return DAMAGED
    fill_line(line, body, length, number, DATA, stamp, bus, key)
    return 0


@compiled(TRIPLE, BYTES, INT, INT, TABLE)
def read_lines(data: Bytes, at: int, form: int, table: Ints) -> tuple[int, int, int]:
    """Read whole lines into a table of LINE quantities: (columns written, where it stopped, lines without a frame).

    Empty lines, comments, and further lines of an ASC log are not counted.
    """
    n = 0
    odd = 0
    end = len(data)
    line = np.zeros(LINE, np.int64)
    while at < end and n < table.shape[1]:
        stop = line_end(data, at, end)
        first = int(data[at])
        result = DAMAGED
        if form == LOG:
            result = frame_at(data, at, min(stop + 1, end), line) if first == _OPEN else DAMAGED
        elif form == TERMINAL:
            result = _terminal_line(data, at, stop, line)
        else:
            result = _asc_line(data, at, stop, line)
        if result >= 0:
            line[OFFSET] = at
            line[SIZE] = stop + 1 - at
            for quantity in range(LINE):
                table[quantity, n] = line[quantity]
            n += 1
        elif form != ASC and first != _HASH and first != _TAB and _skip(data, at, stop) < stop:
            odd += 1
        at = stop + 1
    return n, min(at, end), odd


@compiled(INT, ArrayType("uint8", 1), INT, INT, INT)
def _write_digits(out: Array, at: int, number: int, count: int) -> int:
    for place in range(count):
        out[at + count - 1 - place] = _NUL + number % 10
        number //= 10
    return at + count


@compiled(INT, ArrayType("uint8", 1), INT, INT, INT)
def _write_hex(out: Array, at: int, number: int, count: int) -> int:
    for place in range(count):
        digit = number & 15
        out[at + count - 1 - place] = digit + (_NUL if digit < 10 else 55)
        number >>= 4
    return at + count


@compiled(INT, BYTES, TABLE, INTS, ArrayType("uint8", 1), INTS)
def write_lines(data: Bytes, table: Ints, stamps: Ints, out: Array, ends: Ints) -> int:
    """Write frames as lines of `candump -l`; returns the bytes written.

    Args:
        stamps: (n,) ns since 1970.
        ends: (n,), written: the place after each line.
    """
    at = 0
    for k in range(table.shape[1]):
        out[at] = _OPEN
        at = _write_digits(out, at + 1, stamps[k] // _SECOND_NS, 10)
        out[at] = _DOT
        ns = stamps[k] % _SECOND_NS
        is_micro = ns % 1000 == 0
        at = _write_digits(out, at + 1, ns // 1000 if is_micro else ns, 6 if is_micro else 9)
        out[at] = _CLOSE
        out[at + 1] = _BLANK
        at += 2
        place = table[BUS, k]
        while place < len(data) and int(data[place]) > _BLANK:
            out[at] = int(data[place])
            at += 1
            place += 1
        out[at] = _BLANK
        number = table[ID, k]
        at = _write_hex(out, at + 1, number & (EXTENDED_BIT - 1), 8 if number >= EXTENDED_BIT else 3)
        out[at] = _HASH
        at += 1
        place = table[BODY, k]
        for _ in range(table[LENGTH, k]):
            if hex_digit(int(data[place])) < 0:
                place += 1
            byte = 16 * hex_digit(int(data[place])) + hex_digit(int(data[place + 1]))
            at = _write_hex(out, at, byte, 2)
            place += 2
        out[at] = _NEWLINE
        at += 1
        ends[k] = at
    return at
