"""IDTP frames: how one is delimited, found in a stream, and built.

    I D T P   TIMESTAMP   SEQUENCE   DEVICE   SIZE    VERSION   MODE   TYPE   CRC8   PAYLOAD   TRAILER
    0         4           8          12       14      16        17     18     19     20        20 + SIZE

Little-endian. SIZE counts the payload, at most 972 bytes in every mode. CRC8 covers bytes 0 to 18. The trailer covers
header (CRC8 included) and payload, and depends on the mode, which the sender chooses:

    0  Lite     none: a damaged payload goes unnoticed
    1  Safety   CRC-32/AUTOSAR, 4 bytes
    2  Secure   HMAC-SHA256, 32 bytes

A candidate is checked in this order, and fails at the first check that it does not pass:

    bad_crc8         needs the whole header, 20 bytes
    bad_version      the major number, the high nibble, is not 2
    bad_mode         none of the three
    below_min_mode   weaker than this source accepts (a Lite header must not swallow the Secure frame that it covers)
    bad_size         more than 972: at once, without waiting for 65 kB
    (complete?)      an incomplete one waits; at the end of a file, or after a stall, it is `truncated`
    bad_crc32, bad_hmac; no_key: a Secure frame without a key to check it

After a failure the search resumes 4 bytes later, right after the preamble, never after the claimed length. `INDT` is
the preamble of a successor protocol: a candidate that fails under that name.

## Secure frames

The loop below is compiled and cannot compute an HMAC. It treats every Secure frame as genuine; `scanner` checks them
afterwards, in order. After a forged one it discards the rest of the result and searches again from there, a few frames
ahead only, so that a stream of forgeries costs little more than a stream of good ones.

Source: IDTP v2.1.0, sections 3 to 6, with its errata 1 to 5 and 7.
"""

import hashlib
import hmac
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.framing.checksums import CRC8_END, CRC8_START, crc8_autosar, crc8_block, crc32_autosar
from imuscope.protocols.framing.stream_buffer import (
    BAD_CRC8,
    BAD_CRC32,
    BAD_HMAC,
    BAD_MODE,
    BAD_SIZE,
    BAD_VERSION,
    BELOW_MIN_MODE,
    BODY,
    FRAME,
    ID,
    LENGTH,
    NO_KEY,
    OFFSET,
    SENDER,
    SIZE,
    STATUS,
    SUCCESSOR,
    TRUNCATED,
    Scan,
)
from imuscope.protocols.native.kernels import BYTES, FLAG, FOUR, INT, TABLE, compiled, inlined, unsigned

PREAMBLE, SUCCESSOR_PREAMBLE = b"IDTP", b"INDT"
HEADER = struct.Struct("<4sIIHHBBB")  # without its CRC-8
HEADER_SIZE = 20
TIMESTAMP_AT, SEQUENCE_AT, DEVICE_AT, SIZE_AT, VERSION_AT, MODE_AT, TYPE_AT, CRC_AT = 4, 8, 12, 14, 16, 17, 18, 19
MAX_PAYLOAD = 972
MAX_FRAME = 1024
MAJOR, VERSION = 2, 0x21

LITE, SAFETY, SECURE = range(3)
MODES = ("Lite", "Safety", "Secure")
TRAILERS = (0, 4, 32)


def version_at(data: bytes, at: int) -> str:
    """The version that the frame at `at` claims: "3.1"."""
    return f"{data[at + VERSION_AT] >> 4}.{data[at + VERSION_AT] & 0xF}"


_I, _D, _T, _N = b"IDTN"
_IDTP, _INDT = (int.from_bytes(word, "little") for word in (PREAMBLE, SUCCESSOR_PREAMBLE))
_FRAMES_AHEAD = 8  # frames to scan ahead after a forged one


@inlined
def _u2(data: Bytes, at: Any) -> int:
    """The unsigned 16-bit number at `at`; unsigned, as in all of these."""
    return int(data[at]) | int(data[at + unsigned(1)]) << 8


@inlined
def _u4(data: Bytes, at: Any) -> int:
    return _u2(data, at) | _u2(data, at + unsigned(2)) << 16


@compiled(FLAG, BYTES, INT, INT)
def _may_begin(data: Bytes, at: int, left: int) -> bool:
    """Whether the last `left` bytes, 1 to 3 and the first an I, may begin a preamble."""
    if left == 1:
        return True
    second = int(data[at + 1])
    third = int(data[at + 2]) if left == 3 else -1
    return (second == _D and third in (-1, _T)) or (second == _N and third in (-1, _D))


@inlined
def _header(data: Bytes, at: Any, min_mode: int) -> int:
    """Reject reason for the complete header at `at`."""
    if crc8_block(data, at, np.int64(CRC8_START)) ^ CRC8_END != int(data[at + unsigned(CRC_AT)]):
        return BAD_CRC8
    if int(data[at + unsigned(VERSION_AT)]) >> 4 != MAJOR:
        return BAD_VERSION
    mode = int(data[at + unsigned(MODE_AT)])
    if mode > SECURE:
        return BAD_MODE
    if mode < min_mode:
        return BELOW_MIN_MODE
    if _u2(data, at + unsigned(SIZE_AT)) > MAX_PAYLOAD:
        return BAD_SIZE
    return FRAME


@inlined
def _trailer(data: Bytes, at: Any, end: Any, mode: int, secure: int) -> int:
    """Reject reason for the complete frame at `at`, whose trailer begins at `end`."""
    if mode == SAFETY:
        return FRAME if crc32_autosar(data, at, end) == _u4(data, end) else BAD_CRC32
    return NO_KEY if mode == SECURE and secure == 0 else FRAME


@compiled(FOUR, BYTES, INT, FLAG, INT, INT, TABLE, INT, INT)
def candidates(
    data: Bytes, at: int, final: bool, min_mode: int, secure: int, table: Ints, first: int, stop: int
) -> tuple[int, int, int, int]:
    """Find candidates in `data[at:]` and write them into the columns `first` to `stop` of `table`.

    Otherwise as framing.Scan; returns the column after the last one written. ID is the payload type, SENDER the device.

    Args:
        min_mode: weaker modes fail.
        secure: 0: Secure frames fail as `no_key`; 1: they are accepted unchecked.
    """
    end = len(data)
    n = first
    failed = 0
    framed = 0
    while at < end and n < stop:
        here = unsigned(at)
        if int(data[here]) != _I:
            at += 1
            continue
        left = end - at
        if left < 4:  # the start of a preamble is not a candidate yet
            if not final and _may_begin(data, at, left):
                break
            at += 1
            continue
        word = _u4(data, here)
        if word != _IDTP and word != _INDT:
            at += 1
            continue
        status = SUCCESSOR
        size = 4
        length = 0
        if word == _IDTP and left < HEADER_SIZE:
            status = TRUNCATED
            size = 0
        elif word == _IDTP:
            status = _header(data, here, min_mode)
            size = HEADER_SIZE
            if status == FRAME:
                mode = int(data[here + unsigned(MODE_AT)])
                length = _u2(data, here + unsigned(SIZE_AT))
                size += length
                body_end = unsigned(at + size)
                size += 32 if mode == SECURE else 4 * mode
                status = TRUNCATED if size > left else _trailer(data, here, body_end, mode, secure)
        if status == TRUNCATED and not final:
            break
        column = unsigned(n)
        table[OFFSET, column] = at
        table[SIZE, column] = size
        table[BODY, column] = at + HEADER_SIZE
        table[LENGTH, column] = length
        table[ID, column] = -1
        table[SENDER, column] = -1
        table[STATUS, column] = status
        if left >= HEADER_SIZE:
            table[ID, column] = int(data[here + unsigned(TYPE_AT)])
            table[SENDER, column] = _u2(data, here + unsigned(DEVICE_AT))
        n += 1
        if status == FRAME:
            framed += size
            at += size
        else:
            failed += 1
            at += 4
    return n, at, failed, framed


# -- Secure frames -----------------------------------------------------------------------------------------------------


class FrameAuthenticator:
    """HMAC-SHA256 with one key.

    Both hashes of the construction begin with a block that depends on the key alone; it is hashed once, and each frame
    continues from a copy (half the time of hmac.digest).

    Raises:
        ValueError: the key is empty.
    """

    def __init__(self, key: bytes) -> None:
        if not key:
            raise ValueError("a key has at least one byte")
        block = hashlib.sha256(key).digest() if len(key) > 64 else key
        block = block.ljust(64, b"\0")
        self._inner = hashlib.sha256(bytes(byte ^ 0x36 for byte in block))
        self._outer = hashlib.sha256(bytes(byte ^ 0x5C for byte in block))

    def of(self, data: bytes | memoryview) -> bytes:
        """The 32-byte HMAC of `data`."""
        inner, outer = self._inner.copy(), self._outer.copy()
        inner.update(data)
        outer.update(inner.digest())
        return outer.digest()

    def verifies(self, frame: memoryview) -> bool:
        """Whether this Secure frame is authentic. Runs in constant time."""
        return hmac.compare_digest(self.of(frame[:-32]), frame[-32:])


def scanner(key: bytes | None = None, min_mode: int = LITE, *, show_unverified: bool = False) -> Scan:
    """A scan for protocols/framing/stream_buffer.py.

    Args:
        key: for Secure frames.
        min_mode: LITE, SAFETY or SECURE; frames of weaker modes are rejected.
        show_unverified: without a key, accept Secure frames unchecked.
    """
    if key is not None:
        return _sealed(FrameAuthenticator(key), min_mode)
    secure = 1 if show_unverified else 0

    def scan(data: Bytes, at: int, final: bool, table: Ints) -> tuple[int, int, int, int]:
        return candidates(data, at, final, min_mode, secure, table, 0, table.shape[1])

    return scan


def _sealed(seal: FrameAuthenticator, min_mode: int) -> Callable[[Bytes, int, bool, Ints], tuple[int, int, int, int]]:
    def scan(data: Bytes, at: int, final: bool, table: Ints) -> tuple[int, int, int, int]:
        done, columns = 0, table.shape[1]
        ahead = columns
        view = data.data
        while done < columns:
            stop = min(done + ahead, columns)
            starts, at, _, _ = candidates(data, at, final, min_mode, 1, table, done, stop)
            forged = _first_forged(seal, data, view, table, done, starts)
            if forged < starts:
                table[STATUS, forged] = BAD_HMAC
                at = int(table[OFFSET, forged]) + 4
                done, ahead = forged + 1, _FRAMES_AHEAD
                continue
            done, ahead = starts, 2 * ahead
            if starts < stop:
                break
        good = table[STATUS, :done] == FRAME
        return done, at, done - int(good.sum()), int(table[SIZE, :done][good].sum())

    return scan


def _first_forged(seal: FrameAuthenticator, data: Bytes, view: memoryview, table: Ints, first: int, stop: int) -> int:
    """The first of the columns whose Secure frame is forged; `stop` if all are genuine."""
    offsets, good = table[OFFSET, first:stop], table[STATUS, first:stop] == FRAME
    for row in np.flatnonzero(good).tolist():
        at = int(offsets[row])
        if data[at + MODE_AT] == SECURE and not seal.verifies(view[at : at + int(table[SIZE, first + row])]):
            return first + row
    return stop


# -- building ----------------------------------------------------------------------------------------------------------


def build(
    kind: int,
    payload: bytes = b"",
    *,
    timestamp: int = 0,
    sequence: int = 0,
    device: int = 0,
    mode: int = LITE,
    version: int = VERSION,
    key: bytes | None = None,
) -> bytes:
    """One frame.

    Args:
        kind: payload type, 0 to 255.
        timestamp, sequence: 32 bits; device: 16 bits.
        mode: LITE, SAFETY or SECURE; Secure needs a key.

    Raises:
        ValueError: a number out of its range, a payload over 972 bytes, no key.
    """
    limits = {
        "payload type": (kind, 0xFF),
        "timestamp": (timestamp, 0xFFFFFFFF),
        "sequence": (sequence, 0xFFFFFFFF),
        "device_id": (device, 0xFFFF),
        "payload size": (len(payload), MAX_PAYLOAD),
        "mode": (mode, SECURE),
        "version": (version, 0xFF),
    }
    for name, (value, most) in limits.items():
        if not 0 <= value <= most:
            raise ValueError(f"{name} is 0 to {most}, given {value}")
    frame = HEADER.pack(PREAMBLE, timestamp, sequence, device, len(payload), version, mode, kind)
    frame += bytes([crc8_autosar(np.frombuffer(frame, np.uint8), 0, CRC_AT)]) + payload
    if mode == SAFETY:
        return frame + struct.pack("<I", crc32_autosar(np.frombuffer(frame, np.uint8), 0, len(frame)))
    if mode == SECURE:
        if key is None:
            raise ValueError("a Secure frame needs a key")
        return frame + FrameAuthenticator(key).of(frame)
    return frame
