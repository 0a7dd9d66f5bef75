"""Replay detection by sequence numbers of each device, and loss counting.

    last accepted                       + 2^16                     + 2^31 = − 2^31
    ─────┼───────────────────────────────┼──────────────────────────────┼───────────────
         │ newer: accepted; the numbers  │ far ahead: below Secure the  │ not newer: stale, dropped
         │ between are lost              │ next must confirm it         │ and counted

The first frame of a device is accepted whatever its number. "Newer" is meant modulo 2^32: taken literally, the document
("less than or equal to the last") would lock a device out for good when its number wraps.

Below Secure a number can be forged, and a damaged Lite header that passes its 8 bits of CRC is enough to set a false
one. Therefore

    far ahead   a jump of more than 2^16 is accepted when the next frame continues from there (1 to 2^16 further). The
                frame that jumped is dropped and counted.
    silence     after 3 s without an accepted frame of a device, an older number is a restart. Measured by arrival time,
                so it never applies to a file that is read without arrival times.

In Secure mode, and for a device whose last frame was Secure, only the user restarts a sequence (`rearm`). The last
verified numbers outlive a decoder (`state`, `restore`), so a new connection does not accept an old frame. Where weaker
frames are accepted beside Secure ones, a verified frame is judged only by the verified ones before it: a forged number
can neither lock the device out nor make an old frame new. A frame changes the state only after all its other checks
have passed; a Secure frame that could not be verified never does, and is not judged.

Source: IDTP v2.1.0, section 6.1, with its erratum 6.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from protocols.framing import FAR_AHEAD, FRAME, ID, INT64, LENGTH, OFFSET, SENDER, STALE, Bytes, Ints, ScanCapacity
from protocols.idtp.frames import MODE_AT, SECURE, SEQUENCE_AT, TIMESTAMP_AT, VERSION, VERSION_AT
from protocols.jit import BYTES, FLAG, FOUR, INT, INTS, STRIDED, TABLE, compiled, inlined, unsigned

FAR = 1 << 16
HALF = 1 << 31
MASK = 0xFFFFFFFF
SILENCE_NS = 3_000_000_000

# State of each device. The table has a row for each of the 2^16 possible devices; memory is committed only to rows that
# are used.
KNOWN, LAST, ACCEPTED_NS, LAST_MODE, CANDIDATE, VERIFIED, LAST_VERIFIED = range(7)
STATES = 8  # a power of two: a row is one cache line

LOST, TIMESTAMP, MODE, KEY = range(4)
JUDGED = 4
SOURCE_SHIFT = 21  # of a KEY: the source is above it, the layout below


@inlined
def _u4(data: Bytes, at: Any) -> Any:
    """The unsigned 32-bit number at `at`."""
    low = np.int64(data[at]) | np.int64(data[at + unsigned(1)]) << 8
    return low | np.int64(data[at + unsigned(2)]) << 16 | np.int64(data[at + unsigned(3)]) << 24


@inlined
def _agrees(candidate: int, sequence: int) -> bool:
    """Whether this number continues a far jump."""
    return bool(candidate >= 0 and 0 < (sequence - candidate) & MASK <= FAR)


@compiled(INT, TABLE, INT, INT, INT, INT)
def _verdict(states: Ints, sender: int, sequence: int, mode: int, arrival: int) -> int:
    """Verdict on one frame of a known device."""
    device = unsigned(sender)
    if mode == SECURE:
        newer = 0 < (sequence - states[device, LAST_VERIFIED]) & MASK < HALF
        return FRAME if newer or not states[device, VERIFIED] else STALE
    ahead = (sequence - states[device, LAST]) & MASK
    if 0 < ahead <= FAR or _agrees(states[device, CANDIDATE], sequence):
        return FRAME
    if 0 < ahead < HALF:
        states[device, CANDIDATE] = sequence
        return FAR_AHEAD
    silent = arrival - states[device, ACCEPTED_NS] >= SILENCE_NS
    return FRAME if silent and states[device, LAST_MODE] < SECURE else STALE


@compiled(FOUR, BYTES, STRIDED, INTS, TABLE, FLAG, FLAG, STRIDED)
def classify(
    data: Bytes, table: Ints, arrival: Ints, states: Ints, check: bool, keyed: bool, out: Ints
) -> tuple[int, int, int, int]:
    """Judge n frames in stream order, and read their headers.

    Args:
        table: of the accepted frames, see protocols/framing.py.
        arrival: (n,) ns.
        states: (2^16, STATES), updated.
        check: False accepts every number, and only counts losses.
        keyed: Secure frames were verified.
        out: (JUDGED, n or more), written. LOST: numbers skipped just before; for a dropped frame, minus the reason
            (STALE, FAR_AHEAD). KEY: equal for frames of the same device and layout, see `key_of`.

    Returns:
        Number of frames dropped, of frames after a gap, of frames of another VERSION, and of frames of another device
        than the first (or of the same, but not verified).
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
        other += int(minor != VERSION & 0xF)
        mixed += int(source != out[KEY, 0] >> SOURCE_SHIFT)
        if unverified:
            continue
        device = unsigned(table[SENDER, f])  # not a row of its own: a view costs more than the rest of the loop
        if not states[device, KNOWN]:
            recalled = mode == SECURE and check and states[device, VERIFIED] != 0
            if recalled and not 0 < (sequence - states[device, LAST_VERIFIED]) & MASK < HALF:
                out[LOST, f] = -STALE
                dropped += 1
                continue
        else:
            ahead = (sequence - states[device, LAST]) & MASK
            verdict = FRAME
            if check and (ahead != 1 or mode == SECURE):
                verdict = _verdict(states, table[SENDER, f], sequence, mode, arrival[f])
            if verdict != FRAME:
                out[LOST, f] = -verdict
                dropped += 1
                continue
            if ahead > 1 and (check or ahead <= FAR) and (ahead < HALF or _agrees(states[device, CANDIDATE], sequence)):
                out[LOST, f] = ahead - 1
                gaps += 1
        states[device, KNOWN] = 1
        states[device, LAST] = sequence
        states[device, ACCEPTED_NS] = arrival[f]
        states[device, LAST_MODE] = mode
        if mode == SECURE:
            states[device, VERIFIED] = 1
            states[device, LAST_VERIFIED] = sequence
        states[device, CANDIDATE] = -1
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
    """

    def __init__(self, *, check: bool = True, keyed: bool = False) -> None:
        self._check = check
        self._keyed = keyed
        self._states = np.zeros((1 << 16, STATES), np.int64)
        self._room = ScanCapacity()

    def classify(self, data: Bytes, table: Ints, arrival_ns: Ints) -> ReplayVerdict:
        """Judge the frames of `table`; see `classify`. The result is valid until the next call."""
        n = table.shape[1]
        rows = np.empty((JUDGED, 1), INT64) if n == 1 else self._room.table(JUDGED, n)[:, :n]
        return ReplayVerdict(rows, *classify(data, table, arrival_ns, self._states, self._check, self._keyed, rows))

    def state(self, devices: Iterable[int]) -> dict[int, int]:
        """The last verified number of each of these devices that has one."""
        return {one: int(self._states[one, LAST_VERIFIED]) for one in devices if self._states[one, VERIFIED]}

    def restore(self, numbers: Mapping[int, int]) -> None:
        """Restore the `state` of an earlier connection: verified frames up to these numbers are old."""
        for device, number in numbers.items():
            self._states[device, VERIFIED] = 1
            self._states[device, LAST_VERIFIED] = number

    def last_of(self, device: int, mode: int) -> int:
        """The number that the next frame of a device in this mode is compared with."""
        return int(self._states[device, LAST_VERIFIED if mode == SECURE else LAST])

    def rearm(self, device: int | None = None) -> None:
        """Forget the sequence of a device, or of all: the next frame counts as a first one. On user request only."""
        self._states[slice(None) if device is None else device] = 0
