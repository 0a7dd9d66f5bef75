"""Xbus frames: delimiting, search in a stream and building; cutting MTData2 into items.

    standard   FA  BID  MID  LEN           DATA (0..254 bytes)   CS
    extended   FA  BID  MID  FF   EXT LEN  DATA (0..8185 bytes)  CS
               0   1    2    3    4 5      4 or 6

BID is the bus identifier: 0xFF for a device that is its own master, but it can be configured, so any is accepted. MID
is the message. EXT LEN is big-endian and holds 255..2048 by the document; the vendor's own software accepts 8185 and
extended headers with shorter payloads, and so does this scan. CS makes all bytes after FA sum to 0 modulo 256. A frame
whose BID and MID are both 0 is rejected (a run of zeros after a stray FA would often checksum).

An MTData2 payload is a sequence of items, each a small frame of its own without a checksum:

    ID (2)  SIZE (1)  SIZE bytes  |  ID  SIZE  ...

so two payloads have the same layout exactly when their sequences of (ID, SIZE) agree. `walk` follows the items of many
frames at once, stops at the first item that does not fit (items before it stay valid), and sorts the frames into groups
of equal layout, from which columns are made without reading the items again. It also extracts the counter and the clock
of each frame, because these make sense in stream order only, across layouts.

Source: MT0101P 2020.A sections 5.1 and 5.3.6; the limits are explained in its errata (accept 8185, send 2048).
"""

import struct

import numpy as np

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.framing.checksums import check_sum8, sum8
from imuscope.protocols.framing.stream_buffer import (
    BAD_CHECKSUM,
    BAD_ID,
    BAD_SIZE,
    BODY,
    FRAME,
    ID,
    LENGTH,
    OFFSET,
    SENDER,
    SIZE,
    STATUS,
    TRUNCATED,
)
from imuscope.protocols.native.kernels import (
    BYTES,
    FLAG,
    FOUR,
    INT,
    INTS,
    NOTHING,
    PAIR,
    ROWS,
    TABLE,
    compiled,
    unsigned,
)

PREAMBLE = 0xFA
EXTENDED = 0xFF
MASTER = 0xFF
MAX_STANDARD = 254
MAX_SENT = 2048  # the document's limit: no device has to accept more
MAX_ACCEPTED = 8185  # accepted by the vendor's own reader; bounds how long a false length can hold a stream up
MAX_FRAME = MAX_ACCEPTED + 7

MTDATA2 = 0x36

UTC_TIME, PACKET_COUNTER, SAMPLE_TIME_FINE, SAMPLE_TIME_COARSE = 0x1010, 0x1020, 0x1060, 0x1070


@compiled(FOUR, BYTES, INT, FLAG, TABLE)
def scan(data: Bytes, at: int, final: bool, table: Ints) -> tuple[int, int, int, int]:
    """Find candidates in `data[at:]`; see protocols/framing/stream_buffer.py for the table and the rule."""
    end = len(data)
    n = 0
    failed = 0
    framed = 0
    while at < end and n < table.shape[1]:
        if int(data[at]) != PREAMBLE:
            at += 1
            continue
        left = end - at
        body = at + 4
        length = 0
        size = 0  # 0: the header is not complete
        status = FRAME
        if left >= 3 and int(data[at + 1]) == 0 and int(data[at + 2]) == 0:
            status = BAD_ID
        elif left >= 4 and int(data[at + 3]) != EXTENDED:
            length = int(data[at + 3])
            size = length + 5
        elif left >= 6:
            length = int(data[at + 4]) * 256 + int(data[at + 5])
            body = at + 6
            size = length + 7
            if length > MAX_ACCEPTED:
                status = BAD_SIZE
                size = 6  # only the header was examined
        if status == FRAME:
            if size == 0 or size > left:
                if not final:
                    break
                status = TRUNCATED
            elif sum8(data, at + 1, at + size) != 0:
                status = BAD_CHECKSUM
        table[OFFSET, n] = at
        table[SIZE, n] = size
        table[BODY, n] = body
        table[LENGTH, n] = length
        table[ID, n] = int(data[at + 2]) if left >= 3 else -1
        table[SENDER, n] = int(data[at + 1]) if left >= 2 else -1
        table[STATUS, n] = status
        n += 1
        if status == FRAME:
            framed += size
            at += size
        else:
            failed += 1
            at += 1
    return n, at, failed, framed


GROUP, GOOD, COUNTER, FINE, COARSE, UTC_AT, GNSS = range(7)
WALKED = 7
NO_GNSS, NO_FIX, FIX, FIX_UNKNOWN = range(4)  # GNSS: fix of the receiver, for a message with nothing but GNSS items
GNSS_PVT, PVT_SIZE, FIX_TYPE_AT, FIX_2D = 0x7010, 94, 20, 2
_SPOTS = 7
_MAX_ITEMS = MAX_ACCEPTED // 3 + 1
ONE, TWO = unsigned(1), unsigned(2)


@compiled(FLAG, BYTES, INT, INT, INT)
def same_items(data: Bytes, a: int, b: int, length: int) -> bool:
    """Whether the item sequences at `a` and `b`, both `length` bytes long, have the same identifiers and sizes."""
    i = unsigned(a)
    k = unsigned(b)
    one, two, header = unsigned(1), unsigned(2), unsigned(3)
    stop = unsigned(a + length)
    while i < stop:
        if data[i] != data[k] or data[i + one] != data[k + one] or data[i + two] != data[k + two]:
            return False
        step = header + unsigned(data[i + two])
        i += step
        k += step
    return True


@compiled(FLAG, BYTES, INT, INT, TABLE, INT, INT)
def same_headers(data: Bytes, a: int, b: int, headers: Ints, row: int, count: int) -> bool:
    """As `same_items` for payloads of one length, with the item headers at `a` known: `headers[row, :count]`.

    No step depends on the one before; in `same_items` each item gives the position of the next.
    """
    one, two = unsigned(a), unsigned(b)
    differing = 0
    for i in range(unsigned(count)):
        at = unsigned(headers[row, i])
        differing |= int(data[one + at] ^ data[two + at])
        differing |= int(data[one + at + ONE] ^ data[two + at + ONE])
        differing |= int(data[one + at + TWO] ^ data[two + at + TWO])
    return differing == 0


@compiled(INT, BYTES, INT)
def _u4(data: Bytes, at: int) -> int:
    return int(data[at]) << 24 | int(data[at + 1]) << 16 | int(data[at + 2]) << 8 | int(data[at + 3])


@compiled(PAIR, BYTES, INT, INT, INTS, INTS)
def follow_items(data: Bytes, start: int, stop: int, spots: Ints, headers: Ints) -> tuple[int, int]:
    """The items of one payload, `data[start:stop]`.

    Args:
        spots: (_SPOTS,), written: offsets from `start` of the values of PacketCounter, SampleTimeFine,
            SampleTimeCoarse, UtcTime and a GNSS solution's type of fix; 0 if absent. Of repeated ones the last counts.
            Then 1 if the message has GNSS items and, except for counters, clocks and status, no others; and the number
            of items.
        headers: (_MAX_ITEMS,), written: offset from `start` of each item.

    Returns:
        End of the items that fit, and a hash that is equal for equal sequences of (identifier, size).
    """
    spots[:] = 0
    gnss = samples = False
    mark = 0
    count = 0
    at = start
    while at + 3 <= stop:
        ident = int(data[at]) << 8 | int(data[at + 1])
        size = int(data[at + 2])
        if at + 3 + size > stop:
            break
        mark = (mark * 1000003 + (ident << 8 | size) + 1) % 2147483647
        headers[count] = at - start
        count += 1
        spot = at + 3 - start
        if ident == PACKET_COUNTER and size == 2:
            spots[0] = spot
        elif ident == SAMPLE_TIME_FINE and size == 4:
            spots[1] = spot
        elif ident == SAMPLE_TIME_COARSE and size == 4:
            spots[2] = spot
        elif ident == UTC_TIME and size == 12:
            spots[3] = spot
        elif ident == GNSS_PVT and size == PVT_SIZE:
            spots[4] = spot + FIX_TYPE_AT
        kind = ident >> 8
        if kind in (0x70, 0x88):
            gnss = True
        elif kind not in (0x10, 0xE0):
            samples = True
        at += 3 + size
    spots[5] = 1 if gnss and not samples else 0
    spots[6] = count
    return at, mark


@compiled(NOTHING, BYTES, INT, INT, INTS, TABLE)
def _pick_up(data: Bytes, frame: int, start: int, spots: Ints, out: Ints) -> None:
    """Write counter and clocks of one payload, whose items are at `spots`, into column `frame` of `out`."""
    counter, fine, coarse, utc = spots[0], spots[1], spots[2], spots[3]
    out[COUNTER, frame] = int(data[start + counter]) << 8 | int(data[start + counter + 1]) if counter else -1
    out[FINE, frame] = _u4(data, start + fine) if fine else -1
    out[COARSE, frame] = _u4(data, start + coarse) if coarse else -1
    out[UTC_AT, frame] = start + utc if utc else -1
    fix = NO_GNSS
    if spots[5]:
        fix = FIX_UNKNOWN
        if spots[4]:
            fix = FIX if int(data[start + spots[4]]) >= FIX_2D else NO_FIX
    out[GNSS, frame] = fix


@compiled(NOTHING, INTS, INT, INTS, INTS)
def _sort_by_group(group: Ints, groups: int, order: Ints, bounds: Ints) -> None:
    """Counting sort: `order[bounds[g] : bounds[g + 1]]` are the frames of group g, in stream order."""
    bounds[: groups + 1] = 0
    for f in range(len(group)):
        bounds[group[f] + 1] += 1
    for g in range(groups):
        bounds[g + 1] += bounds[g]
    for f in range(len(group)):
        order[bounds[group[f]]] = f
        bounds[group[f]] += 1
    for g in range(groups, 0, -1):
        bounds[g] = bounds[g - 1]
    bounds[0] = 0


@compiled(FOUR, BYTES, INTS, INTS, TABLE, INTS, INTS)
def walk(data: Bytes, body: Ints, length: Ints, out: Ints, order: Ints, bounds: Ints) -> tuple[int, int, int, int]:
    """Follow the items of n MTData2 payloads and group those of equal layout.

    Args:
        body, length: (n,) start of each payload in `data`, and its length.
        out: (WALKED, n), written. GROUP: number of the layout, by first appearance. GOOD: bytes up to the first bad
            item. COUNTER, FINE, COARSE: PacketCounter, SampleTimeFine, SampleTimeCoarse, -1 where absent. UTC_AT:
            offset of the value of UtcTime in `data`, or -1. GNSS: whether a message of GNSS items has a fix.
        order: (n,), written: the frames sorted by group, in stream order within each.
        bounds: (n + 1,), written: group g is `order[bounds[g] : bounds[g + 1]]`.

    Returns:
        Number of groups, and number of frames with a bad tail, without a SampleTimeFine that is surely the sample's
        (absent, or that of a GNSS message), and without a PacketCounter.
    """
    n = len(body)
    slots = 4
    while slots < 2 * n:
        slots *= 2
    first_of = np.full(slots, -1, np.int64)  # an open-addressed table: slot → first frame of a layout
    groups = bad = without_fine = without_counter = 0
    # Most frames have the layout of one of the two frames before: those are compared first.
    recent = np.full(2, -1, np.int64)
    spots = np.zeros((2, _SPOTS), np.int64)
    headers = np.empty((2, _MAX_ITEMS), np.int64)
    for f in range(n):
        start, size = int(body[f]), int(length[f])
        same = -1
        for r in range(2):
            model = recent[r]
            whole = model >= 0 and length[model] == size and out[GOOD, model] == size
            if whole and same_headers(data, int(body[model]), start, headers, r, spots[r, 6]):
                same = r
                break
        if same >= 0:
            out[GROUP, f] = out[GROUP, recent[same]]
            out[GOOD, f] = size
        else:
            same = 0 if recent[0] < recent[1] else 1  # replace the older of the two
            end, mark = follow_items(data, start, start + size, spots[same], headers[same])
            good = end - start
            out[GOOD, f] = good
            slot = mark & (slots - 1)
            while first_of[slot] >= 0:
                first = first_of[slot]
                if out[GOOD, first] == good and same_items(data, int(body[first]), start, good):
                    break
                slot = (slot + 1) & (slots - 1)
            if first_of[slot] < 0:
                first_of[slot] = f
                out[GROUP, f] = groups
                groups += 1
            else:
                out[GROUP, f] = out[GROUP, first_of[slot]]
            bad += good < size
        recent[same] = f
        without_counter += spots[same, 0] == 0
        without_fine += spots[same, 1] == 0 or spots[same, 5] != 0
        _pick_up(data, f, start, spots[same], out)
    _sort_by_group(out[GROUP], groups, order, bounds)
    return groups, bad, without_fine, without_counter


STARTS, OFFSETS, ARRIVALS, TIMES, TIMED = range(5)
ABOUT = 5


@compiled(INT, BYTES, TABLE, INTS, ROWS, TABLE)
def gather(data: Bytes, about: Ints, which: Ints, rows: Bytes, out: Ints) -> int:
    """Copy the payloads of a group into the rows of one array, with offset, arrival and time of each frame.

    Args:
        about: (ABOUT, frames). STARTS: start of each payload in `data`. TIMED: 1 if it has a time.
        which: (n,) columns of `about` that belong to the group.
        rows: (n, size), written.
        out: (ABOUT, n), written.

    Returns:
        Number of frames that have a time.
    """
    width = unsigned(rows.shape[1])
    timed = 0
    for f in range(unsigned(len(which))):
        k = unsigned(which[f])
        for row in range(ABOUT):
            out[row, f] = about[row, k]
        timed += about[TIMED, k]
        start = unsigned(about[STARTS, k])
        for i in range(width):
            rows[f, i] = data[start + i]
    return timed


def build(mid: int, payload: bytes = b"", bid: int = MASTER, *, extended: bool | None = None) -> bytes:
    """One frame.

    Args:
        extended: None lets the payload's size choose the header; True asks for the extended one.

    Raises:
        ValueError: the payload is longer than MAX_ACCEPTED, or the numbers are not bytes.
    """
    if not 0 <= mid <= 0xFF or not 0 <= bid <= 0xFF:
        raise ValueError(f"message and bus identifiers are bytes, given {mid} and {bid}")
    if len(payload) > MAX_ACCEPTED:
        raise ValueError(f"a payload has at most {MAX_ACCEPTED} bytes, given {len(payload)}")
    if extended or len(payload) > MAX_STANDARD:
        body = struct.pack(">BBBH", bid, mid, EXTENDED, len(payload)) + payload
    else:
        body = struct.pack(">BBB", bid, mid, len(payload)) + payload
    return bytes([PREAMBLE]) + body + bytes([check_sum8(body)])


def to_bus(frame: bytes, bid: int) -> bytes:
    """The same frame under another bus identifier; bytes that are not a frame stay as they are."""
    if len(frame) < 5 or frame[0] != PREAMBLE or frame[1] == bid or sum(frame[1:]) & 0xFF:
        return frame
    body = bytes([bid]) + frame[2:-1]
    return bytes([PREAMBLE]) + body + bytes([check_sum8(body)])


def items(payload: bytes) -> tuple[list[tuple[int, int, int]], int]:
    """The items of one MTData2 payload, as (identifier, offset of the value, size), and the bytes they cover."""
    spans: list[tuple[int, int, int]] = []
    at = 0
    while at + 3 <= len(payload):
        identifier, size = struct.unpack_from(">HB", payload, at)
        if at + 3 + size > len(payload):
            break
        spans.append((identifier, at + 3, size))
        at += 3 + size
    return spans, at
