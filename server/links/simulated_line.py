"""Simulated line between a simulated device and the host's port: the effects of a real cable.

    device ─> [drop] ─> [corrupt] ─> [line at baud] ─> [adapter's bursts]  ─> [wrong rate] ─> host
               a frame   one bit      takes its time     62 bytes or a timer    other bytes

No I/O: time is passed in and randomness comes from a seed, so that faults are reproducible. Bytes from the device are
split into frames, by the lengths in their headers, only to drop or corrupt whole frames.
"""

import math
import random
from collections import deque
from dataclasses import dataclass

from imuscope.protocols.registry.families import PROTOCOLS

PACKET_BYTES = 62


class FtdiPacketizer:
    """The receiving side of an FTDI USB adapter.

        line     ▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯        ▯▯▯▯▯▯▯▯▯
        host              62 bytes ^              ^ expiry of the timer, started with the previous packet

    It sends a packet when 62 bytes are buffered (64 with two status bytes) or when its latency timer expires, whichever
    is first; either restarts the timer. So a frame waits for the following ones, or for the timer.

    Source: FTDI, AN232B-04 "Data Throughput, Latency and Handshaking", sections 3.2 and 3.3.

    Args:
        timer_ns: period of its latency timer.
        packet: number of buffered bytes that are sent at once; 0: always wait for the timer.
    """

    def __init__(self, timer_ns: float, packet: int = PACKET_BYTES) -> None:
        self._timer_ns = timer_ns
        self._packet = packet or math.inf
        self._held = b""
        self._started_ns = 0.0

    @property
    def next_ns(self) -> int | None:
        """Expiry of the latency timer; None when nothing is buffered."""
        return math.ceil(self._started_ns + self._timer_ns) if self._held else None

    def take(self, data: bytes, begin_ns: float, byte_ns: float) -> list[tuple[int, bytes]]:
        """Add bytes that arrive one after the other, the first complete at `begin_ns + byte_ns`.

        Returns:
            (time, bytes) of the packets that are full, or whose timer expires, before the last byte.
        """
        out: list[tuple[int, bytes]] = []
        while data:
            if not self._held:  # the timer also runs while nothing is buffered
                idle = (begin_ns + byte_ns - self._started_ns) // self._timer_ns
                self._started_ns += max(0.0, math.ceil(idle) * self._timer_ns)
            expires_ns = self._started_ns + self._timer_ns
            room = self._packet - len(self._held)
            full_ns = begin_ns + room * byte_ns
            if len(data) >= room and full_ns <= expires_ns:
                size, at_ns = int(room), full_ns
            else:
                arrived = (expires_ns - begin_ns) / byte_ns if byte_ns else (math.inf if begin_ns <= expires_ns else 0)
                if arrived >= len(data):
                    self._held += data
                    return out
                size, at_ns = max(0, math.floor(arrived)), expires_ns
            out.append((math.ceil(at_ns), self._held + data[:size]))
            self._held, self._started_ns = b"", at_ns
            data, begin_ns = data[size:], begin_ns + size * byte_ns
        return out

    def expired(self, now_ns: int) -> tuple[int, bytes] | None:
        """The packet whose timer has expired by `now_ns`; None if there is none."""
        at_ns = self.next_ns
        if at_ns is None or at_ns > now_ns:
            return None
        packet = at_ns, self._held
        self._held, self._started_ns = b"", float(at_ns)
        return packet


BITS_PER_BYTE = 10  # start, eight data bits, stop
FALLING = b"\1\0"  # of the levels of two bits

_LEVELS = [bytes([0, *(byte >> bit & 1 for bit in range(8)), 1]) for byte in range(256)]
"""For each byte the levels of its bits on the line, start bit first."""


def misread_at(data: bytes, sender_baud: int, receiver_baud: int) -> bytes:
    """Bytes reported by a receiver at `receiver_baud` if `data` is sent back to back at `sender_baud`.

    An asynchronous line idles high. A byte is one low start bit, eight data bits with the lowest first, a high
    stop bit:

        ‾‾‾\\_S_/0\\1/2\\3/4\\5/6\\7/‾P‾‾‾\\_S_/…

    A receiver waits for the falling edge and then samples the middle of each bit by its own clock. At another rate it
    samples the wrong bits and resynchronises on the next falling edge: not at random, so detection of the rate can be
    tested without a cable.

    The time is proportional to the number of bytes: a simulator that a busy host has delayed must catch up.
    """
    if sender_baud == receiver_baud or not data:
        return data
    line = b"".join([_LEVELS[byte] for byte in data])
    size = BITS_PER_BYTE * len(data)
    received = bytearray()
    step = sender_baud / receiver_baud  # the receiver's bit, in bits of the sender
    offsets = [(1.5 + bit) * step for bit in range(8)]  # middles of the data bits, after the start bit begins
    start = 0  # the line idles before the first byte
    while True:
        byte = 0
        for bit, offset in enumerate(offsets):
            index = int(start + offset)
            if index >= size or line[index]:  # after the data the line is idle, which is high
                byte |= 1 << bit
        received.append(byte)
        # The search for the next start bit begins in the middle of the stop bit.
        edge = line.find(FALLING, int(start + 9.5 * step))
        if edge < 0:
            return bytes(received)
        start = edge + 1


WRONG_RATE_SHARE = 0.77  # edges so late that every byte is read as at another rate
FULL_NS = 500_000_000  # a device drops frames if its line is this far behind, like a full output buffer


@dataclass(frozen=True, slots=True)
class LineFaults:
    """Faults of the line.

    Args:
        drop: share of frames that are lost, 0..1.
        corrupt: share of frames with one bit flipped, 0..1.
        burst_ms: latency timer of a USB adapter (FtdiPacketizer); 0: none, bytes arrive at once.
        packet: number of bytes that the adapter sends before that; 0: it waits for its timer.
        baud: the line's rate; a receiver at another one gets noise. None: no line, bytes arrive at once.
        dead_baud: a rate that the line cannot carry (cable too long, driver too slow): only noise arrives. None: none.
    """

    drop: float = 0.0
    corrupt: float = 0.0
    burst_ms: float = 0.0
    packet: int = PACKET_BYTES
    baud: int | None = None
    dead_baud: int | None = None


class SimulatedLine:
    """One direction of a cable.

    Args:
        protocol: protocol of the frames that are dropped or corrupted.

    Attributes:
        baud: present rate of the sending device; bytes under way keep the rate at which they were sent.
        overflowed: number of bytes dropped because the line was too slow.
    """

    def __init__(self, faults: LineFaults, seed: int, protocol: str) -> None:
        self.faults = faults
        self._protocol = protocol
        self.baud = faults.baud
        self.overflowed = 0
        self._chance = random.Random(seed)
        self._under_way: deque[tuple[int, bytes, int | None]] = deque()  # arrival time, bytes, rate
        self._packets = FtdiPacketizer(faults.burst_ms * 1e6, faults.packet) if faults.burst_ms else None
        self._free_ns = 0  # when the line has sent all earlier bytes
        self._partial = b""  # beginning of an incomplete frame

    def send(self, data: bytes, now_ns: int) -> None:
        """Put bytes on the line."""
        frames, self._partial = frames_of(self._partial + data, self._protocol)
        for frame in frames:
            if self._chance.random() < self.faults.drop:
                continue
            if self._chance.random() < self.faults.corrupt:
                corrupted = bytearray(frame)
                corrupted[self._chance.randrange(len(corrupted))] ^= 1 << self._chance.randrange(8)
                frame = bytes(corrupted)
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
        """Arrival of the next bytes; None when nothing is under way."""
        if self._under_way:
            return self._under_way[0][0]
        return self._packets.next_ns if self._packets is not None else None

    def arrived(self, now_ns: int, receiver_baud: int | None = None) -> bytes:
        """Bytes received until `now_ns` at `receiver_baud`."""
        packet = self._packets.expired(now_ns) if self._packets is not None else None
        if packet is not None:
            self._under_way.append((*packet, self.baud))
        out = b""
        while self._under_way and self._under_way[0][0] <= now_ns:
            rate = self._under_way[0][2]
            data = bytearray()
            while self._under_way and self._under_way[0][0] <= now_ns and self._under_way[0][2] == rate:
                data += self._under_way.popleft()[1]
            out += self._as_received(bytes(data), rate, receiver_baud)
        return out

    def _as_received(self, data: bytes, rate: int | None, receiver_baud: int | None) -> bytes:
        if rate and rate == self.faults.dead_baud:
            return misread_at(data, rate, round(rate * WRONG_RATE_SHARE))
        if rate and receiver_baud and receiver_baud != rate:
            return misread_at(data, rate, receiver_baud)
        return data


# -- frames ------------------------------------------------------------------------------------------------------------


_HEAD_BYTES = 20


def frames_of(data: bytes, protocol: str) -> tuple[list[bytes], bytes]:
    """Split bytes into frames.

    Returns:
        The pieces (whole frames, and bytes between them), and the incomplete frame at the end.
    """
    simulator = PROTOCOLS[protocol].simulator
    assert simulator is not None
    preamble, size_of = simulator.preamble, simulator.frame_size
    pieces: list[bytes] = []
    at = 0
    while at < len(data):
        start = data.find(preamble, at)
        if start < 0:
            start = len(data) - _preamble_start(data[at:], preamble)
            pieces.append(data[at:start])
            at = start
            break
        pieces.append(data[at:start])
        at = start
        size = size_of(data[start : start + _HEAD_BYTES])
        if not size or start + size > len(data):
            break
        pieces.append(data[start : start + size])
        at = start + size
    return [piece for piece in pieces if piece], data[at:]


def _preamble_start(data: bytes, preamble: bytes) -> int:
    """Number of bytes at the end of `data` that could be the beginning of a preamble."""
    return next((n for n in range(len(preamble) - 1, 0, -1) if data.endswith(preamble[:n])), 0)
