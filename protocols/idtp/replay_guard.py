"""Replay detection by sequence numbers of each device, and loss counting.

    last accepted                       + 2^16                     + 2^31 = − 2^31
    ─────┼───────────────────────────────┼──────────────────────────────┼───────────────
         │ newer: accepted; the numbers  │ far ahead: below Secure the  │ not newer: stale, dropped
         │ between are lost              │ next must confirm it         │ and counted

The first frame of a device is accepted whatever its number. "Newer" is meant modulo 2^32: taken literally, the document
("less than or equal to the last") would lock a device out for good when its number wraps.

Weaker modes never lock a stronger one out, and no frame makes an old one of its own mode new: a frame that is newer
than all of its own and stronger modes, but not than the weaker ones, is accepted if these jumped (see "evidence"), or
if it continues another such frame (1 to 16 further). The first is dropped as stale.

Below Secure a number can be forged, and a damaged Lite header that passes its 8 bits of CRC is enough to set a false
one. Therefore

    far ahead   a jump of more than 2^16 is accepted when the next frame continues from there (1 to 2^16 further). The
                frame that jumped is dropped and counted.
    evidence    a jump of more than 16 is settled when 8 frames have been accepted from there on. Until then, frames
                whose numbers lie in what it skipped, each continuing the one before (1 to 16 further), are evidence
                that it was false. The first is dropped as stale; as soon as they are more than the frames accepted
                since the jump, the sequence goes back to them, and the count of losses is corrected. No frame
                that was accepted before the jump is accepted again.
    silence     after 3 s without an accepted frame of its mode, an older number is a restart. Measured by arrival time,
                so it never applies to a capture without arrival times.

In Secure mode, and for a device whose last frame was Secure, only the user restarts a sequence (`rearm`). The last
verified numbers outlive a decoder (`state`, `restore`), so a new connection does not accept an old frame. A frame
changes the state only after all its other checks have passed; a Secure frame that could not be verified never does, and
is not judged.

Source: IDTP v2.1.0, section 6.1, with its erratum 6.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from mmap import mmap
from typing import Any

import numpy as np

from imuscope.protocols.arrays import INT64, Bytes, Ints
from imuscope.protocols.framing.stream_buffer import FAR_AHEAD, FRAME, ID, LENGTH, OFFSET, SENDER, STALE, ScanCapacity
from imuscope.protocols.idtp.frames import MODE_AT, SECURE, SEQUENCE_AT, TIMESTAMP_AT, VERSION, VERSION_AT
from imuscope.protocols.native.kernels import (
    BYTES,
    FLAG,
    FOUR,
    INT,
    INTS,
    NOTHING,
    PAIR,
    STRIDED,
    TABLE,
    compiled,
    inlined,
    unsigned,
)

MAX_NUMBERS_AHEAD = 1 << 16
HALF = 1 << 31
MASK = 0xFFFFFFFF
SILENCE_NS = 3_000_000_000

SUDDEN_JUMP = 16  # a jump beyond it is settled only by the frames that follow; fewer are lost or overtaken every day
SETTLING_FRAMES = 8  # frames accepted from a jump on that settle it

# State of each device: a row for each mode, at `device << 2 | mode`, with the newest frame of that mode or a stronger
# one. A row is one cache line; memory is committed only to rows that are used. The fourth row keeps the mode of the
# device's last frame, in LAST.
KNOWN, LAST, ACCEPTED_NS, CANDIDATE, BEFORE, VOTES, WITNESS, RUN = range(8)
STATES = 8
MAX_DEVICES = 1 << 18  # with their modes; memory is committed to those that send
LAST_MODE = 3  # row of a device
#   CANDIDATE  1 + the number of a dropped frame that the next may confirm; 0 for none
#   BEFORE     the last number before a jump that is not settled
#   VOTES      frames accepted from the jump on; 0 if there is no such jump
#   WITNESS    the last number of the evidence against the jump, and RUN the number of its frames

# Verdicts like FRAME: after silence, by evidence, from far ahead, and against weaker modes.
RESTARTED, RETURNED, CONFIRMED, OVERRULED = -1, -2, -3, -4

LOST, TIMESTAMP, MODE, KEY, TAKEN_BACK = range(5)
JUDGED = 5
SOURCE_SHIFT = 21  # of a KEY: the source is above it, the layout below


@inlined
def _u4(data: Bytes, at: Any) -> Any:
    """The unsigned 32-bit number at `at`."""
    low = np.int64(data[at]) | np.int64(data[at + unsigned(1)]) << 8
    return low | np.int64(data[at + unsigned(2)]) << 16 | np.int64(data[at + unsigned(3)]) << 24


@compiled(INT, TABLE, INT, INT)
def _evidence(states: Ints, row: int, sequence: int) -> int:
    """Whether this old number, with those before it, outvotes the jump of a row (1 or 0)."""
    at = unsigned(row)
    if not states[at, VOTES]:
        return 0
    before = states[at, BEFORE]
    if not 0 < (sequence - before) & MASK < (states[at, LAST] - before) & MASK:
        return 0
    continues = states[at, RUN] and 0 < (sequence - states[at, WITNESS]) & MASK <= SUDDEN_JUMP
    states[at, RUN] = states[at, RUN] + 1 if continues else 1
    states[at, WITNESS] = sequence
    return int(states[at, RUN] > states[at, VOTES])


@compiled(INT, TABLE, INT, INT, INT, INT)
def _verdict(states: Ints, device: int, sequence: int, mode: int, arrival: int) -> int:
    """Verdict on one frame of a device that sent such a mode or a stronger one before."""
    row = device << 2 | mode
    at = unsigned(row)
    ahead = (sequence - states[at, LAST]) & MASK
    if mode == SECURE:
        return FRAME if 0 < ahead < HALF else STALE
    if 0 < ahead <= MAX_NUMBERS_AHEAD:
        return FRAME
    candidate = states[at, CANDIDATE]
    if candidate and 0 < (sequence - candidate + 1) & MASK <= MAX_NUMBERS_AHEAD:
        return CONFIRMED
    if _evidence(states, row, sequence):
        return RETURNED
    if 0 < ahead < HALF:
        states[at, CANDIDATE] = sequence + 1
        return FAR_AHEAD
    silent = arrival - states[at, ACCEPTED_NS] >= SILENCE_NS
    return RESTARTED if silent and states[unsigned(device << 2 | LAST_MODE), LAST] < SECURE else STALE


@compiled(INT, TABLE, INT, INT, INT, INT)
def _beside_weaker(states: Ints, device: int, sequence: int, mode: int, arrival: int) -> int:
    """Verdict on a frame that is new in its own mode, by the frames of weaker modes."""
    own, weakest = unsigned(device << 2 | mode), unsigned(device << 2)
    last = states[weakest, LAST]
    if not states[weakest, KNOWN] or 0 < (sequence - last) & MASK < HALF:
        return FRAME
    before = states[weakest, BEFORE]
    if states[weakest, VOTES] and 0 < (sequence - before) & MASK < (last - before) & MASK:
        return FRAME
    candidate = states[own, CANDIDATE]
    if candidate and 0 < (sequence - candidate + 1) & MASK <= SUDDEN_JUMP:
        return OVERRULED
    silent = arrival - states[weakest, ACCEPTED_NS] >= SILENCE_NS
    if silent and mode < SECURE and states[unsigned(device << 2 | LAST_MODE), LAST] < SECURE:
        return RESTARTED
    states[own, CANDIDATE] = sequence + 1
    return STALE


@compiled(INT, TABLE, INT, INT)
def _false_loss(states: Ints, row: int, sequence: int) -> int:
    """Number of samples counted as lost by a jump that this number, which it skipped, shows to be false."""
    at = unsigned(row)
    span = (states[at, LAST] - states[at, BEFORE]) & MASK
    if not states[at, VOTES] or span > MAX_NUMBERS_AHEAD or not 0 < (sequence - states[at, BEFORE]) & MASK < span:
        return 0
    return int(span - states[at, VOTES])


@compiled(NOTHING, TABLE, INT, INT, INT, INT)
def _advance(states: Ints, row: int, sequence: int, arrival: int, verdict: int) -> None:
    """Take over an accepted number in one row."""
    at = unsigned(row)
    ahead = (sequence - states[at, LAST]) & MASK
    if not states[at, KNOWN] or verdict in (RESTARTED, RETURNED, OVERRULED):
        states[at, VOTES] = states[at, RUN] = 0
    elif states[at, VOTES]:
        states[at, VOTES] = states[at, VOTES] + 1 if states[at, VOTES] + 1 < SETTLING_FRAMES else 0
    elif ahead > SUDDEN_JUMP:
        states[at, BEFORE] = states[at, LAST]
        states[at, VOTES] = 2 if verdict == CONFIRMED else 1
        states[at, RUN] = 0
    states[at, KNOWN] = 1
    states[at, LAST] = sequence
    states[at, ACCEPTED_NS] = arrival
    states[at, CANDIDATE] = 0


@compiled(PAIR, TABLE, INT, INT, INT, INT, INT)
def _accept(states: Ints, device: int, sequence: int, mode: int, arrival: int, verdict: int) -> tuple[int, int]:
    """Take over an accepted frame, in the rows of its mode and of all weaker ones.

    Returns:
        Numbers skipped just before it, and of those counted before, how many were not lost.
    """
    lowest = device << 2
    at = unsigned(lowest)
    ahead = (sequence - states[at, LAST]) & MASK
    before = states[at, BEFORE]
    lost = taken_back = accepted = 0
    own = unsigned(lowest | mode)
    if verdict == RESTARTED or not states[at, KNOWN]:
        lost = 0
    elif verdict == OVERRULED:
        lost = ((sequence - states[own, LAST]) & MASK) - 1 if states[own, KNOWN] else 0
    elif ahead < HALF or verdict == CONFIRMED:
        lost = max(ahead - 1, 0)  # a weaker frame may have the same number
    for weaker in range(mode):
        row = lowest | weaker
        newer = 0 < (sequence - states[unsigned(row), LAST]) & MASK < HALF
        how = verdict if newer or verdict != FRAME or not states[unsigned(row), KNOWN] else STALE
        if how == STALE and _evidence(states, row, sequence):
            how = RETURNED
            accepted = states[unsigned(row), RUN] - 1
        if how == RETURNED and not weaker:
            taken_back = _false_loss(states, row, sequence)
        if how != STALE:
            _advance(states, row, sequence, arrival, how)
    if verdict == RETURNED and not mode:
        taken_back = _false_loss(states, lowest, sequence)
    if taken_back:
        lost = ((sequence - before) & MASK) - 1 - accepted
    _advance(states, lowest | mode, sequence, arrival, verdict)
    states[unsigned(lowest | LAST_MODE), LAST] = mode
    return lost, taken_back


@compiled(FOUR, BYTES, STRIDED, INTS, TABLE, FLAG, FLAG, STRIDED)
def classify(
    data: Bytes, table: Ints, arrival: Ints, states: Ints, check: bool, keyed: bool, out: Ints
) -> tuple[int, int, int, int]:
    """Judge n frames in stream order, and read their headers.

    Args:
        table: of the accepted frames, see protocols/framing/stream_buffer.py.
        arrival: (n,) ns.
        states: (2^18, STATES), updated.
        check: False accepts every number, and only counts losses.
        keyed: Secure frames were verified.
        out: (JUDGED, n or more), written. LOST: numbers skipped just before; for a dropped frame, minus the reason
            (STALE, FAR_AHEAD). TAKEN_BACK: numbers counted as lost before that were not. KEY: equal for frames of the
            same device and layout, see `key_of`.

    Returns:
        Number of frames dropped, of frames that change the number of losses, of frames of another VERSION, and of
        frames of another device than the first (or of the same, but not verified).
    """
    dropped = 0
    gaps = 0
    other = 0
    mixed = 0
    for f in range(unsigned(table.shape[1])):
        at = unsigned(table[OFFSET, f])
        sequence = _u4(data, at + unsigned(SEQUENCE_AT))
        mode = int(data[at + unsigned(MODE_AT)])
        minor = int(data[at + unsigned(VERSION_AT)]) & 0xF
        unverified = mode == SECURE and not keyed
        source = table[SENDER, f] << 1 | int(unverified)
        key = (source << 1 | int(minor == 0)) << 20 | table[ID, f] << 12 | table[LENGTH, f]
        out[LOST, f] = 0
        out[TIMESTAMP, f] = _u4(data, at + unsigned(TIMESTAMP_AT))
        out[MODE, f] = mode
        out[KEY, f] = key
        out[TAKEN_BACK, f] = 0
        other += int(minor != VERSION & 0xF)
        mixed += int(source != out[KEY, 0] >> SOURCE_SHIFT)
        if unverified:
            continue
        device = table[SENDER, f]
        row = unsigned(device << 2)  # not a view of its own: that costs more than the rest of the loop
        if not check:
            ahead = (sequence - states[row, LAST]) & MASK
            if states[row, KNOWN] and 1 < ahead <= MAX_NUMBERS_AHEAD:
                out[LOST, f] = ahead - 1
                gaps += 1
            states[row, KNOWN] = 1
            states[row, LAST] = sequence
            continue
        own = row | unsigned(mode)
        verdict = FRAME
        if states[own, KNOWN]:
            last = states[row, LAST]
            settled = not (states[row, VOTES] | states[own, VOTES])
            if mode < SECURE and (sequence - last) & MASK == 1 and last == states[own, LAST] and settled:
                states[row, LAST] = states[own, LAST] = sequence  # the usual frame, as `_accept` does
                states[row, ACCEPTED_NS] = states[own, ACCEPTED_NS] = arrival[f]
                states[row, CANDIDATE] = states[own, CANDIDATE] = 0
                states[row | unsigned(LAST_MODE), LAST] = mode
                continue
            verdict = _verdict(states, device, sequence, mode, arrival[f])
        if mode and verdict == FRAME:
            verdict = _beside_weaker(states, device, sequence, mode, arrival[f])
        if verdict > FRAME:
            out[LOST, f] = -verdict
            dropped += 1
            continue
        lost, taken_back = _accept(states, device, sequence, mode, arrival[f], verdict)
        out[LOST, f] = lost
        out[TAKEN_BACK, f] = taken_back
        gaps += int(lost > 0 or taken_back > 0)
    return dropped, gaps, other, mixed


def source_of(source: int) -> tuple[int, bool]:
    """The device of a source, and whether its frames are unverified."""
    return source >> 1, bool(source & 1)


def key_of(key: int) -> tuple[int, bool, int, int]:
    """Source, whether the version is 2.0, payload type and payload length of a KEY."""
    return key >> SOURCE_SHIFT, bool(key >> 20 & 1), key >> 12 & 0xFF, key & 0xFFF


@dataclass(slots=True)
class ReplayVerdict:
    """Verdicts on n frames: `rows` is `out` of `classify`, the other fields are its counts."""

    rows: Ints
    dropped: int
    gaps: int
    other: int
    mixed: int


class ReplayGuard:
    """The sequences of all devices of one source.

    Args:
        check: False accepts frames whatever their numbers.
        keyed: Secure frames are verified before they are judged.
        arrivals: False: arrival times are not known, so no silence is.
    """

    def __init__(self, *, check: bool = True, keyed: bool = False, arrivals: bool = True) -> None:
        self._check = check
        self._arrivals = arrivals
        self._keyed = keyed
        self._states = np.frombuffer(mmap(-1, MAX_DEVICES * STATES * 8), np.int64).reshape(MAX_DEVICES, STATES)  # zeros
        self._room = ScanCapacity()

    def classify(self, data: Bytes, table: Ints, arrival_ns: Ints) -> ReplayVerdict:
        """Judge the frames of `table`; see `classify`. The result is valid until the next call."""
        n = table.shape[1]
        if not self._arrivals:
            arrival_ns = np.zeros(n, np.int64)
        rows = np.empty((JUDGED, 1), INT64) if n == 1 else self._room.table(JUDGED, n)[:, :n]
        return ReplayVerdict(rows, *classify(data, table, arrival_ns, self._states, self._check, self._keyed, rows))

    def state(self, devices: Iterable[int]) -> dict[int, int]:
        """The last verified number of each of these devices that has one."""
        rows = {one: self._states[one << 2 | SECURE] for one in devices}
        return {one: int(row[LAST]) for one, row in rows.items() if row[KNOWN]}

    def restore(self, numbers: Mapping[int, int]) -> None:
        """Restore the `state` of an earlier connection: verified frames up to these numbers are old."""
        for device, number in numbers.items():
            self._states[device << 2 | SECURE, [KNOWN, LAST]] = 1, number

    def last_of(self, device: int, mode: int) -> int:
        """The number that the next frame of a device in this mode is compared with."""
        return int(self._states[device << 2 | mode, LAST])

    def rearm(self, device: int | None = None) -> None:
        """Forget the sequence of a device, or of all: the next frame counts as a first one. On user request only."""
        self._states[slice(None) if device is None else slice(device << 2, (device + 1) << 2)] = 0
