"""Frames of a Betaflight blackbox log (blackbox.py): encodings of the numbers, and their predictions.

    'I' a whole main frame · 'P' differences to the main frames before · 'S' slow · 'G' GPS · 'H' GPS home · 'E' event

A frame has no length and no checksum: it is good if another kind of frame, or the end, follows it. After a damaged one
the search goes on at its second byte, and differences are left out until the next whole frame.

Source: Betaflight documentation, "Blackbox logging internals" (encodings, predictors, events).
"""

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.native.kernels import BYTES, INT, INTS, PAIR, TABLE, compiled

INTRA, INTER, SLOW, GPS, HOME, EVENT = range(6)
RESUMED_EVENT = 14  # an event: logging goes on after a pause
SIGNED_VB, UNSIGNED_VB, NEG_14BIT, TAG8_8SVB, TAG2_3S32, TAG8_4S16, NULL, TAG2_3SVARIABLE = 0, 1, 3, 6, 7, 8, 9, 10
(PREDICT_NOTHING, PREDICT_LAST, PREDICT_LINE, PREDICT_MEAN, PREDICT_MIN_THROTTLE, PREDICT_MOTOR, PREDICT_COUNT) = range(
    7
)
PREDICT_HOME, PREDICT_1500, PREDICT_VBATREF, PREDICT_TIME, PREDICT_MIN_MOTOR = range(7, 12)
(MIN_THROTTLE, VBATREF, MIN_MOTOR, MOTOR, TIME, VERSION, I_INTERVAL, P_NUMBER, P_DENOMINATOR) = range(9)
"""Positions in the parameters of a log."""
LAST, BEFORE, VALUES, HOMES = range(4)
"""Rows of the state: the last main frame, the one before, the frame being read, the GPS home."""
MAIN_COUNT, SLOW_COUNT, GPS_COUNT, DAMAGED, FOLLOWS, LOST, JUMPS, ODD_TIME = range(8)
"""Positions in the counters: frames written; bytes of damage; whether differences can follow; frames left out; whether
the time may jump; the time of a whole frame that was left out because of a jump.
"""
MAX_FRAME_BYTES = 512  # bytes of a frame, more than any has
_BITS_32 = 0xFFFFFFFF
_MOST_SKIPPED = 4096  # loops between two frames
_FURTHEST_US = 10_000_000  # between two main frames


@compiled(INT, INT, INT)
def _signed(value: int, bits: int) -> int:
    half = 1 << (bits - 1)
    return ((value & ((1 << bits) - 1)) ^ half) - half


@compiled(PAIR, BYTES, INT)
def _variable(data: Bytes, at: int) -> tuple[int, int]:
    """An unsigned number of variable length, and the position after it; beyond the end of data if it is not whole."""
    value = 0
    for place in range(5):
        if at >= len(data):
            return 0, len(data) + 1
        byte = int(data[at])
        at += 1
        value |= (byte & 127) << (7 * place)
        if byte < 128:
            return value & _BITS_32, at
    return 0, len(data) + 1


@compiled(PAIR, BYTES, INT)
def _signed_variable(data: Bytes, at: int) -> tuple[int, int]:
    value, at = _variable(data, at)
    return (value >> 1) ^ -(value & 1), at


@compiled(INT, BYTES, INT, INTS, INT)
def _three_sizes(data: Bytes, at: int, raw: Ints, first: int) -> int:
    """Three numbers of 8, 16, 24 or 32 bits each, whose sizes are in the byte before."""
    sizes = int(data[at - 1])
    for k in range(3):
        size = ((sizes >> (2 * k)) & 3) + 1
        if at + size > len(data):
            return len(data) + 1
        value = 0
        for place in range(size):
            value |= int(data[at + place]) << (8 * place)
        raw[first + k] = _signed(value, 8 * size)
        at += size
    return at


@compiled(INT, BYTES, INT, INTS, INT, INT)
def _three(data: Bytes, at: int, raw: Ints, first: int, encoding: int) -> int:
    """Three numbers in one, two or three bytes together, or of their own sizes: TAG2_3S32 and TAG2_3SVARIABLE."""
    if at >= len(data):
        return len(data) + 1
    lead = int(data[at])
    kind = lead >> 6
    if kind == 3:
        return _three_sizes(data, at + 1, raw, first)
    if at + kind >= len(data):
        return len(data) + 1
    second = int(data[at + 1]) if kind >= 1 else 0
    third = int(data[at + 2]) if kind == 2 else 0
    if kind == 0:
        raw[first] = _signed(lead >> 4, 2)
        raw[first + 1] = _signed(lead >> 2, 2)
        raw[first + 2] = _signed(lead, 2)
    elif kind == 1 and encoding == TAG2_3S32:
        raw[first] = _signed(lead, 4)
        raw[first + 1] = _signed(second >> 4, 4)
        raw[first + 2] = _signed(second, 4)
    elif kind == 1:
        raw[first] = _signed(lead >> 1, 5)
        raw[first + 1] = _signed((lead & 1) << 4 | second >> 4, 5)
        raw[first + 2] = _signed(second, 4)
    elif encoding == TAG2_3S32:
        raw[first] = _signed(lead, 6)
        raw[first + 1] = _signed(second, 6)
        raw[first + 2] = _signed(third, 6)
    else:
        raw[first] = _signed((lead & 63) << 2 | second >> 6, 8)
        raw[first + 1] = _signed((second & 63) << 1 | third >> 7, 7)
        raw[first + 2] = _signed(third, 7)
    return at + kind + 1


@compiled(INT, BYTES, INT, INTS, INT, INT)
def _tag8_4s16(data: Bytes, at: int, raw: Ints, first: int, version: int) -> int:
    """Four numbers of 0, 4, 8 or 16 bits; from version 2 on they follow each other without padding to bytes."""
    if at >= len(data):
        return len(data) + 1
    sizes = int(data[at])
    bit = 8 * (at + 1)
    for k in range(4):
        size = ((sizes >> (2 * k)) & 3) << 2
        if size == 12:
            size = 16
        value = 0
        if version < 2 and size == 16:
            bit = ((bit + 7) >> 3) << 3
            if bit + 16 > 8 * len(data):
                return len(data) + 1
            value = int(data[bit >> 3]) | int(data[(bit >> 3) + 1]) << 8
            bit += 16
        else:
            if version < 2 and size == 8:
                bit = ((bit + 7) >> 3) << 3
            if bit + size > 8 * len(data):
                return len(data) + 1
            for _ in range(size >> 2):
                nibble = int(data[bit >> 3])
                value = value << 4 | ((nibble >> 4) if bit & 7 == 0 else (nibble & 15))
                bit += 4
        raw[first + k] = _signed(value, size) if size > 0 else 0
    return (bit + 7) >> 3


@compiled(INT, BYTES, INT, TABLE, INT, INT, INT, INTS)
def _numbers(data: Bytes, at: int, forms: Ints, row: int, count: int, version: int, raw: Ints) -> int:
    """Read the numbers of a frame; returns the position after it, beyond the end of data if it is not whole."""
    field = 0
    while field < count and at <= len(data):
        encoding = forms[row, field]
        if encoding == SIGNED_VB:
            raw[field], at = _signed_variable(data, at)
            field += 1
        elif encoding == UNSIGNED_VB:
            raw[field], at = _variable(data, at)
            field += 1
        elif encoding == NEG_14BIT:
            value, at = _variable(data, at)
            raw[field] = -_signed(value, 14)
            field += 1
        elif encoding == TAG8_8SVB:
            group = 1
            while group < 8 and field + group < count and forms[row, field + group] == TAG8_8SVB:
                group += 1
            if group == 1:
                raw[field], at = _signed_variable(data, at)
            elif at >= len(data):
                return len(data) + 1
            else:
                present = int(data[at])
                at += 1
                for k in range(group):
                    raw[field + k] = 0
                    if (present >> k) & 1 == 1:
                        raw[field + k], at = _signed_variable(data, at)
            field += group
        elif encoding in (TAG2_3S32, TAG2_3SVARIABLE):
            at = _three(data, at, raw, field, encoding)
            field += 3
        elif encoding == TAG8_4S16:
            at = _tag8_4s16(data, at, raw, field, version)
            field += 4
        else:
            raw[field] = 0
            field += 1
    return at


@compiled(INT, INT, INTS)
def _skipped(iteration: int, parameters: Ints) -> int:
    """Loops after `iteration` that the settings of the log leave out."""
    interval, number, denominator = parameters[I_INTERVAL], parameters[P_NUMBER], parameters[P_DENOMINATOR]
    count = 0
    while count < min(interval, _MOST_SKIPPED):
        index = (iteration + 1 + count) % interval
        if index == 0 or (index + number - 1) % denominator < number:
            return count
        count += 1
    return 0


@compiled(INT, TABLE, INT, INT, INTS, INTS, TABLE)
def _predicted(forms: Ints, row: int, count: int, raw: Ints, parameters: Ints, state: Ints) -> int:
    """Add what each number is predicted from, and keep it within 32 bits; the state has the frame then."""
    homes = 0
    for field in range(count):
        how = forms[row + 1, field]
        base = 0
        if how == PREDICT_LAST:
            base = state[LAST, field]
        elif how == PREDICT_LINE:
            base = 2 * state[LAST, field] - state[BEFORE, field]
        elif how == PREDICT_MEAN:
            both = state[LAST, field] + state[BEFORE, field]
            base = both // 2 if both >= 0 else -(-both // 2)
        elif how == PREDICT_MIN_THROTTLE:
            base = parameters[MIN_THROTTLE]
        elif how == PREDICT_MOTOR:
            base = state[VALUES, parameters[MOTOR]]
        elif how == PREDICT_COUNT:
            base = state[LAST, field] + 1 + _skipped(state[LAST, field], parameters)
        elif how == PREDICT_HOME:
            base = state[HOMES, homes]
            homes += 1
        elif how == PREDICT_1500:
            base = 1500
        elif how == PREDICT_VBATREF:
            base = parameters[VBATREF]
        elif how == PREDICT_TIME:
            base = state[LAST, parameters[TIME]]
        elif how == PREDICT_MIN_MOTOR:
            base = parameters[MIN_MOTOR]
        value = (raw[field] + base) & _BITS_32
        state[VALUES, field] = value if forms[row + 2, field] == 0 else _signed(value, 32)
    return count


@compiled(INT, BYTES, INT)
def _event(data: Bytes, at: int) -> int:
    """The position after an event; −1 at the end of the log, beyond the end of data if it is not whole or unknown."""
    if at >= len(data):
        return len(data) + 1
    kind = int(data[at])
    at += 1
    count = 0
    if kind in (0, 15):  # the beep at the start, disarming
        count = 1
    elif kind in (RESUMED_EVENT, 30):  # logging resumes, flight mode
        count = 2
    elif kind == 13:  # adjustment in flight
        if at < len(data) and int(data[at]) >= 128:
            return at + 5
        at += 1
        count = 1
    elif kind == 255:
        return -1
    else:
        return len(data) + 1
    for _ in range(count):
        _, at = _variable(data, at)
    return at


@compiled(INT, INT)
def _row_of(kind: int) -> int:
    """Kind of a frame by its first byte; EVENT for an event, −1 for none."""
    if kind == 73:
        return INTRA
    if kind == 80:
        return INTER
    if kind == 83:
        return SLOW
    if kind == 71:
        return GPS
    if kind == 72:
        return HOME
    return EVENT if kind == 69 else -1


@compiled(INT, INT, INT, INTS, TABLE, INTS, TABLE)
def _keep_main(row: int, count: int, parameters: Ints, state: Ints, counters: Ints, main: Ints) -> int:
    """Write a main frame, unless its time cannot follow that of the last one; how many were written."""
    time = state[VALUES, parameters[TIME]]
    step = (time - state[LAST, parameters[TIME]]) & _BITS_32
    if step > _FURTHEST_US and counters[JUMPS] == 0:
        near = (time - counters[ODD_TIME]) & _BITS_32 < _FURTHEST_US
        counters[ODD_TIME] = time
        if row == INTER or not near:  # two whole frames in a row that jump are right
            counters[FOLLOWS] = 0
            counters[LOST] += 1
            return 0
    counters[JUMPS] = 0
    counters[FOLLOWS] = 1
    for field in range(count):
        state[BEFORE, field] = state[VALUES if row == INTRA else LAST, field]
        state[LAST, field] = state[VALUES, field]
        main[field, counters[MAIN_COUNT]] = state[VALUES, field]
    counters[MAIN_COUNT] += 1
    return 1


@compiled(INT, BYTES, TABLE, INTS, INTS, TABLE, INTS, INTS, TABLE, TABLE, TABLE, INT)
def frames_of(
    data: Bytes,
    forms: Ints,
    counts: Ints,
    parameters: Ints,
    state: Ints,
    counters: Ints,
    raw: Ints,
    main: Ints,
    slow: Ints,
    gps: Ints,
    is_last: int,
) -> int:
    """Decode frames until the data end, or a table is full.

    Args:
        forms: three rows for each of INTRA, INTER, SLOW, GPS and HOME: encoding, predictor, whether it is signed.
        counts: fields of each.
        parameters: of the log.
        state: kept between calls.
        counters: MAIN_COUNT, SLOW_COUNT and GPS_COUNT are 0 before a call.
        raw: memory for the numbers of a frame.
        main, slow, gps: receive a column for each frame; the last row of slow is the time of the main frame before.
        is_last: whether no more data follow.

    Returns:
        Bytes used; −1 minus these at the end of the log.
    """
    at = 0
    while at < len(data):
        if len(data) - at < MAX_FRAME_BYTES and is_last == 0:
            return at
        n, m, k = counters[MAIN_COUNT], counters[SLOW_COUNT], counters[GPS_COUNT]
        if n == main.shape[1] or m == slow.shape[1] or k == gps.shape[1]:
            return at
        row = _row_of(int(data[at]))
        end = len(data) + 1
        if row == EVENT:
            end = _event(data, at + 1)
            if end < 0:
                return -1 - at
        elif row >= 0 and counts[row] > 0:
            end = _numbers(data, at + 1, forms, 3 * row, counts[row], parameters[VERSION], raw)
        if end > len(data) or (end < len(data) and _row_of(int(data[end])) < 0):
            counters[DAMAGED] += 1
            counters[FOLLOWS] = 0
            at += 1
            continue
        kind = int(data[at + 1])
        at = end
        if row == EVENT:
            if kind == RESUMED_EVENT:
                counters[JUMPS] = 1
            continue
        if row == INTER and counters[FOLLOWS] == 0:
            counters[LOST] += 1
            continue
        _predicted(forms, 3 * row, counts[row], raw, parameters, state)
        if row == SLOW:
            for field in range(counts[row]):
                slow[field, m] = state[VALUES, field]
            slow[counts[row], m] = state[LAST, parameters[TIME]]
            counters[SLOW_COUNT] += 1
        elif row == GPS:
            for field in range(counts[row]):
                gps[field, k] = state[VALUES, field]
            counters[GPS_COUNT] += 1
        elif row == HOME:
            for field in range(counts[row]):
                state[HOMES, field] = state[VALUES, field]
        else:
            _keep_main(row, counts[row], parameters, state, counters, main)
    return at
