"""What happens to bytes between a simulated device and the host's port: everything that a real cable does to them.

    device ─> [drop] ─> [corrupt] ─> [line at baud] ─> [adapter's bursts]  ─> [wrong rate] ─> host
               a frame   one bit      takes its time     62 bytes or a timer    other bytes

Pure: time is passed in, chance comes from a seed, so that a fault found once is found again. What a device sends is cut
into frames, by the lengths in their headers (`SIZES`), only in order to lose or harm whole ones.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from server.links.baud_mismatch import misread_at
from server.links.ftdi_packets import PACKET, FtdiPacketizer

WORN = 0.77  # edges so late that every byte is read as at another rate
FULL_NS = 500_000_000  # a device whose line is so far behind drops what it cannot send, as a real output buffer does


@dataclass(frozen=True, slots=True)
class LineFaults:
    """What goes wrong on the way.

    Args:
        drop: share of frames that are lost, 0..1.
        corrupt: share of frames of which one bit is flipped, 0..1.
        burst_ms: latency timer of a USB adapter (ftdi_packets.py); 0: none, bytes are there at once.
        packet: bytes that the adapter hands over before that; 0: it waits for its timer.
        baud: the line's rate; a receiver set to another one hears noise. None: no line, bytes are there at once.
        dead_baud: a rate that the line cannot carry (too long, too slow a driver): all of it is noise. None: no such.
    """

    drop: float = 0.0
    corrupt: float = 0.0
    burst_ms: float = 0.0
    packet: int = PACKET
    baud: int | None = None
    dead_baud: int | None = None


class SimulatedLine:
    """One direction of a cable.

    Args:
        protocol: whose frames are lost or harmed, a key of SIZES.
    Attributes:
        baud: rate at which the device at one end speaks now; what is under way keeps the rate at which it was sent.
        overflowed: bytes that the line had no time for.
    """

    def __init__(self, faults: LineFaults, seed: int = 0, protocol: str = "xbus") -> None:
        self.faults = faults
        self._protocol = protocol
        self.baud = faults.baud
        self.overflowed = 0
        self._chance = random.Random(seed)
        self._under_way: deque[tuple[int, bytes, int | None]] = deque()  # when it arrives, what, at which rate
        self._packets = FtdiPacketizer(faults.burst_ms * 1e6, faults.packet) if faults.burst_ms else None
        self._free_ns = 0  # when the line has sent everything before
        self._kept = b""  # the beginning of a frame whose end has not been sent yet

    def send(self, data: bytes, now_ns: int) -> None:
        """The sender puts bytes on the line."""
        frames, self._kept = frames_of(self._kept + data, self._protocol)
        for frame in frames:
            if self._chance.random() < self.faults.drop:
                continue
            if self._chance.random() < self.faults.corrupt:
                harmed = bytearray(frame)
                harmed[self._chance.randrange(len(harmed))] ^= 1 << self._chance.randrange(8)
                frame = bytes(harmed)
            self._queue(frame, now_ns)

    def _queue(self, frame: bytes, now_ns: int) -> None:
        start_ns = max(now_ns, self._free_ns)
        if start_ns - now_ns > FULL_NS:
            self.overflowed += len(frame)
            return
        byte_ns = 10e9 / self.baud if self.baud else 0.0
        self._free_ns = start_ns + math.ceil(len(frame) * byte_ns)
        if self._packets is None:
            self._under_way.append((self._free_ns, frame, self.baud))
            return
        for at_ns, packet in self._packets.take(frame, start_ns, byte_ns):
            self._under_way.append((at_ns, packet, self.baud))

    @property
    def next_ns(self) -> int | None:
        """When the next bytes arrive, None when nothing is under way."""
        if self._under_way:
            return self._under_way[0][0]
        return self._packets.next_ns if self._packets is not None else None

    def arrived(self, now_ns: int, receiver_baud: int | None = None) -> bytes:
        """What has arrived by now at a receiver that is set to `receiver_baud`."""
        packet = self._packets.expired(now_ns) if self._packets is not None else None
        if packet is not None:
            self._under_way.append((*packet, self.baud))
        out = b""
        while self._under_way and self._under_way[0][0] <= now_ns:
            rate = self._under_way[0][2]
            data = bytearray()
            while self._under_way and self._under_way[0][0] <= now_ns and self._under_way[0][2] == rate:
                data += self._under_way.popleft()[1]
            out += self._as_heard(bytes(data), rate, receiver_baud)
        return out

    def _as_heard(self, data: bytes, rate: int | None, receiver_baud: int | None) -> bytes:
        if rate and rate == self.faults.dead_baud:
            return misread_at(data, rate, round(rate * WORN))
        if rate and receiver_baud and receiver_baud != rate:
            return misread_at(data, rate, receiver_baud)
        return data


# -- frames ------------------------------------------------------------------------------------------------------------


def _xbus(head: bytes) -> int:
    """FA BID MID LEN, payload, checksum; LEN 255 is followed by two bytes of length."""
    if len(head) < 4 or (head[3] == 255 and len(head) < 6):
        return 0
    return 5 + head[3] if head[3] != 255 else 7 + (head[4] << 8 | head[5])


def _isb(head: bytes) -> int:
    """EF 49 FLAGS ID SIZE (2), payload, two sums."""
    return 8 + (head[4] | head[5] << 8) if len(head) >= 6 else 0


def _idtp(head: bytes) -> int:
    """A header of 20 bytes with SIZE at 14 and MODE at 17, payload, a trailer that depends on the mode."""
    if len(head) < 20:
        return 0
    return 20 + (head[14] | head[15] << 8) + {1: 4, 2: 32}.get(head[17], 0)


SIZES: Mapping[str, tuple[bytes, Callable[[bytes], int]]] = {
    "xbus": (b"\xfa", _xbus),
    "isb": (b"\xef\x49", _isb),
    "idtp": (b"IDTP", _idtp),
}
"""Protocol → preamble, and the size of a frame by its first bytes (0: they are too few to tell)."""
_HEAD = 20


def frames_of(data: bytes, protocol: str = "xbus") -> tuple[list[bytes], bytes]:
    """Cut at frames.

    Returns:
        The pieces (whole frames, and whatever stands between them), and the rest that is not a whole frame yet.
    """
    preamble, size_of = SIZES[protocol]
    pieces: list[bytes] = []
    at = 0
    while at < len(data):
        start = data.find(preamble, at)
        if start < 0:
            start = len(data) - _begun(data[at:], preamble)
            pieces.append(data[at:start])
            at = start
            break
        pieces.append(data[at:start])
        at = start
        size = size_of(data[start : start + _HEAD])
        if not size or start + size > len(data):
            break
        pieces.append(data[start : start + size])
        at = start + size
    return [piece for piece in pieces if piece], data[at:]


def _begun(data: bytes, preamble: bytes) -> int:
    """How many bytes at the end of `data` may be the beginning of a preamble."""
    return next((n for n in range(len(preamble) - 1, 0, -1) if data.endswith(preamble[:n])), 0)
