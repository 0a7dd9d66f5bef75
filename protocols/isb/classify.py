"""Classification of packets by layout, continuation and time.

One pass over the DATA packets of a scan in stream order, because time and partial data make sense in that order only:

    KEY    the layout of the packet's columns. Packets of one key become one batch:
           firmware (4 bits) | DID (8) | offset (11) | size (11) | variant (8) | count (8)
    PART   the offset of a packet with a part of a set whose whole value was received before; else -1. It has the key of
           that value, and its row is the value with the part written over it.
    TIME, TIMED, STEP, BY      see time_base.py. A part has no time: the clock in its row is that of the value it
           changes, and a device that streams parts alone sends no whole value for hours.

`variant` separates the meanings of one set: the data type of raw GNSS data, the frame of a GNSS velocity. `count` is
the number of list elements in use. Rare sets (device information, configuration) have the key -1 - firmware and are
read one by one.
"""

from typing import Any

import numpy as np

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.framing.stream_buffer import BODY, FRAME, ID, LENGTH, OFFSET, STATUS
from imuscope.protocols.isb.frames import DATA, FLAGS, TYPE_MASK, WITH_OFFSET
from imuscope.protocols.isb.time_base import (
    DATED,
    FIX,
    GTIME,
    NO_STEP,
    NONE,
    ONE,
    RESET,
    SYNC,
    WEEK_TOW,
    S,
    correct_offset,
    double_ns,
    due,
    four,
    is_reset,
    restart,
    spacing,
    up_time,
    update_time,
)
from imuscope.protocols.native.kernels import (
    BYTES,
    INT,
    INTS,
    NOTHING,
    ROWS,
    STRIDED,
    TABLE,
    compiled,
    inlined,
    unsigned,
)

VIEW = STRIDED  # a scan's table is the filled part of a larger one

KEY, PART, TIME, TIMED, STEP, BY = range(6)
SORTED = 6
OFFSETS, ARRIVALS, TIMES = range(3)
ABOUT = 3

# Rules of each data set, one row per DID; see messages.rules().
STREAMS, CLOCK, CLOCK_AT, CLOCK_MS, WEEK_AT, LIST_AT, LIST_STEP, COUNT_AT, COUNT_SIZE = range(9)
VARIANT, FAMILY, HAS_FIRMWARE = range(9, 12)
RULES = 12
NO_VARIANT, RAW_DATA, VELOCITY, POSITION, EVENT = range(5)
EVENT_TYPE_AT, EVENT_TEXT = 16, 2

# The last whole value of each data set, one row per DID; the up-time of the last one since the device started, and the
# interval of two of them.
WHOLE_KEY, WHOLE_SIZE, WHOLE_UP, WHOLE_EVERY = range(4)
WHOLES = 4

DATA_TYPE_AT, OBSERVATIONS_AT, RAW_AT, OBSERVATION_SIZE = 1, 2, 4, 69
RAW_OBSERVATION = 1
VELOCITY_STATUS_AT, VELOCITY_NED = 20, 0x8000
TOW_OFFSET_AT = 80
FIRMWARE_AT = 12  # in a device information
MAX_COUNT = 255
FAMILIES = 3
NO_FIRMWARE = 15


def empty_state() -> Ints:
    """Initial state, before the first packet."""
    return np.full((256, WHOLES), -1, np.int64)


@inlined
def _number(data: Bytes, at: int, size: int) -> int:
    start = unsigned(at)
    value = 0
    for i in range(unsigned(size)):
        value |= int(data[start + i]) << 8 * int(i)
    return value


@inlined
def variant_of(data: Bytes, body: int, length: int, did: int, rules: Ints) -> int:
    """Variant of a complete set."""
    if rules[did, VARIANT] == RAW_DATA and length > RAW_AT:
        return int(data[body + DATA_TYPE_AT])
    if rules[did, VARIANT] == VELOCITY and length >= VELOCITY_STATUS_AT + 4:
        return 1 if int(data[body + VELOCITY_STATUS_AT + 1]) & VELOCITY_NED >> 8 else 0
    if rules[did, VARIANT] == EVENT and length >= EVENT_TYPE_AT + 2:
        return 1 if int(data[body + EVENT_TYPE_AT]) == EVENT_TEXT and int(data[body + EVENT_TYPE_AT + 1]) == 0 else 0
    return 0


@inlined
def count_of(data: Bytes, body: int, length: int, did: int, rules: Ints) -> int:
    """Number of elements in use in a set's list: its count, limited to the elements present."""
    if rules[did, VARIANT] == RAW_DATA:
        if length <= RAW_AT or int(data[body + DATA_TYPE_AT]) != RAW_OBSERVATION:
            return 0
        return min(int(data[body + OBSERVATIONS_AT]), (length - RAW_AT) // OBSERVATION_SIZE)
    step = rules[did, LIST_STEP]
    there = (length - rules[did, LIST_AT]) // step if step else 0
    if there <= 0:
        return 0
    count = _number(data, body + rules[did, COUNT_AT], rules[did, COUNT_SIZE])
    return min(min(count, there), MAX_COUNT)


@compiled(INT, BYTES, INT, INT)
def _since_1970(data: Bytes, at: int, end: int) -> int:
    """RTKLIB's time at `at`, whole seconds (i64) and their fraction (f64), as ns; -1 if it is not a time."""
    if end < at + 16:
        return -1
    seconds = _number(data, at, 8)
    fraction = double_ns(data, at + 8)
    return -1 if fraction < 0 or seconds < 0 or seconds > 1 << 33 else seconds * S + fraction


@compiled(INT, BYTES, INT, INTS)
def version_of(data: Bytes, body: int, versions: Ints) -> int:
    """The newest of `versions` not newer than the firmware of a device information; the first if all are newer."""
    firmware = int(data[body + FIRMWARE_AT]) << 16 | int(data[body + FIRMWARE_AT + 1]) << 8
    firmware |= int(data[body + FIRMWARE_AT + 2])
    n = len(versions) - 1
    while n > 0 and firmware < versions[n]:
        n -= 1
    return n


@compiled(NOTHING, BYTES, VIEW, TABLE, INTS, INTS, INTS, TABLE, VIEW)
def sort(
    data: Bytes, table: Ints, rules: Ints, versions: Ints, firmware: Ints, memory: Ints, wholes: Ints, out: Ints
) -> None:
    """Fill `out`, (SORTED, n), for the n candidates of `table`; see the module docstring.

    Args:
        rules: (256, RULES).
        versions: the firmware versions with layouts of their own, as major << 16 | minor << 8 | patch, ascending.
        firmware: index into `versions`, one per family of devices; NO_FIRMWARE until a device information gives it.
        memory, wholes: state kept from packet to packet; updated.
    """
    state = (memory[0], memory[1], memory[2], memory[3], memory[4], memory[5])
    for f in range(unsigned(table.shape[1])):
        out[KEY, f] = -1 - NO_FIRMWARE
        out[PART, f] = -1
        out[TIME, f] = 0
        out[TIMED, f] = 0
        out[STEP, f] = NO_STEP
        out[BY, f] = 0
        flags = table[FLAGS, f]
        did: Any = unsigned(table[ID, f])
        if table[STATUS, f] != FRAME or flags & TYPE_MASK != DATA:
            continue
        body = table[BODY, f]
        length = table[LENGTH, f]
        if rules[did, HAS_FIRMWARE] and length >= FIRMWARE_AT + 4 and flags & WITH_OFFSET == 0:
            firmware[rules[did, FAMILY]] = version_of(data, body, versions)
        if rules[did, STREAMS] == 0:
            out[KEY, f] = -1 - firmware[rules[did, FAMILY]]
            continue
        offset = _number(data, body - 2, 2) if flags & WITH_OFFSET else 0
        layout = firmware[rules[did, FAMILY]] << 46 | int(did) << 38
        if offset > 0:
            if wholes[did, WHOLE_KEY] >= 0 and offset + length <= wholes[did, WHOLE_SIZE]:
                out[KEY, f] = wholes[did, WHOLE_KEY]
                out[PART, f] = offset
            else:
                out[KEY, f] = layout | offset << 27 | length << 16
            continue
        clock = rules[did, CLOCK]
        if clock != NONE:
            at = rules[did, CLOCK_AT]
            week = -1
            ns = -1
            if clock == GTIME:
                if rules[did, VARIANT] != RAW_DATA or count_of(data, body, length, did, rules) > 0:
                    ns = _since_1970(data, body + at, body + length)
            elif rules[did, CLOCK_MS]:
                if length >= at + 4:
                    ns = four(data, body + at) * 1_000_000
            elif length >= at + 8:
                ns = double_ns(data, body + at)
            if clock in (WEEK_TOW, FIX) and length >= rules[did, WEEK_AT] + 4:
                week = four(data, body + rules[did, WEEK_AT])
            up = up_time(clock, ns, week)
            if is_reset(wholes[did, WHOLE_UP], up):
                state, time, timed, step, by = restart(state, up)
            else:
                if up == DATED:
                    state = due(state, week, wholes[did, WHOLE_UP], wholes[did, WHOLE_EVERY])
                state, time, timed, step, by = update_time(state, clock, ns, week)
            if step == RESET:
                wholes[:, WHOLE_UP:] = -1  # else each set in turn would report the same reset
            if up >= 0:
                if clock == WEEK_TOW:
                    wholes[did, WHOLE_EVERY] = spacing(wholes[did, WHOLE_EVERY], wholes[did, WHOLE_UP], up)
                wholes[did, WHOLE_UP] = up
            out[TIME, f] = time
            out[TIMED, f] = timed
            out[STEP, f] = step
            out[BY, f] = by
            if rules[did, VARIANT] == POSITION and timed and length >= TOW_OFFSET_AT + 8 and week > 0:
                state, _, _, step, by = correct_offset(state, week, double_ns(data, body + TOW_OFFSET_AT))
                if out[STEP, f] == SYNC:  # values from before the fix shift by the offset that is now exact
                    out[BY, f] += by
                elif step != NO_STEP and out[STEP, f] == NO_STEP:
                    out[STEP, f] = step
                    out[BY, f] = by
        variant = 0
        count = 0
        if rules[did, VARIANT] != NO_VARIANT:
            variant = variant_of(data, body, length, did, rules)
        if rules[did, LIST_STEP] != 0 or rules[did, VARIANT] == RAW_DATA:
            count = count_of(data, body, length, did, rules)
        out[KEY, f] = layout | length << 16 | variant << 8 | count
        wholes[did, WHOLE_KEY] = out[KEY, f]
        wholes[did, WHOLE_SIZE] = length
    memory[0], memory[1], memory[2], memory[3], memory[4], memory[5] = state


@compiled(INT, BYTES, VIEW, VIEW, INTS, INTS, BYTES, ROWS, TABLE)
def gather(
    data: Bytes, table: Ints, done: Ints, arrivals: Ints, which: Ints, whole: Bytes, rows: Bytes, about: Ints
) -> int:
    """Copy the packets of a group into the rows of one array; a part is written over the row before it.

    Args:
        table, done, arrivals: the scan's table, the output of `sort`, and the arrival of each packet.
        which: (n,) columns of `table` that belong to the group.
        whole: the value that a part in the first row changes; may be empty if no part needs it.
        rows: (n, size), written.
        about: (ABOUT, n), written: offset, arrival and time of each.

    Returns:
        Number of packets that have a time.
    """
    width = unsigned(rows.shape[1])
    timed = 0
    for f in range(unsigned(len(which))):
        k = unsigned(which[f])
        about[OFFSETS, f] = table[OFFSET, k]
        about[ARRIVALS, f] = arrivals[k]
        about[TIMES, f] = done[TIME, k]
        timed += done[TIMED, k]
        start = unsigned(table[BODY, k])
        if done[PART, k] < 0:
            for i in range(width):
                rows[f, i] = data[start + i]
            continue
        if f > 0:
            for i in range(width):
                rows[f, i] = rows[f - ONE, i]
        else:
            for i in range(width):
                rows[f, i] = whole[i]
        at = unsigned(done[PART, k])
        for i in range(unsigned(table[LENGTH, k])):
            rows[f, at + i] = data[start + i]
    return timed
