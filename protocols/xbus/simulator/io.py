"""Request parser and reply queue of the simulated MTi.

Requests by the resync rule of protocols/framing/stream_buffer.py, on the few bytes sent by a host: noise is skipped, a
failed candidate gives way to the next preamble, an incomplete one waits, and is dropped when the host is silent.
Answers leave at once, unless faults are injected (simulator/faults.py).

Source: MT0101P 2020.A, 5.1.
"""

import random
from collections.abc import Collection, Iterator

from imuscope.protocols.xbus import frames
from imuscope.protocols.xbus.simulator.faults import FaultInjection

STALL_NS = 200_000_000  # age at which an incomplete request is dropped
ADDRESSES = (0xFF, 0x01)  # bus identifiers to which a device alone on its line answers


class RequestParser:
    """Bytes in, requests out.

    Args:
        addresses: bus identifiers under which it is addressed.
    """

    def __init__(self, addresses: Collection[int] = ADDRESSES) -> None:
        self._addresses = addresses
        self._received = bytearray()
        self._received_ns = 0

    def clear(self) -> None:
        """Drop an incomplete request."""
        self._received.clear()

    def receive(self, data: bytes, now: int) -> None:
        """Add bytes received at a device time, ns."""
        if now - self._received_ns > STALL_NS:
            self._received.clear()
        self._received += data
        self._received_ns = now

    def requests(self) -> Iterator[tuple[int, int, bytes]]:
        """The whole frames for this device, as (bus identifier, message, payload); those for others are skipped."""
        buffer = self._received
        while (at := buffer.find(frames.PREAMBLE)) >= 0:
            del buffer[:at]
            if len(buffer) < 4:
                return
            head = 4 if buffer[3] != frames.EXTENDED else 6
            if len(buffer) < head:
                return
            size = buffer[3] if head == 4 else buffer[4] << 8 | buffer[5]
            end = head + size + 1
            if size > frames.MAX_SENT:
                del buffer[0]
            elif len(buffer) < end:
                return
            elif sum(buffer[1:end]) & 0xFF:
                del buffer[0]
            else:
                frame = bytes(buffer[:end])
                del buffer[:end]
                if frame[1] in self._addresses:
                    yield frame[1], frame[2], frame[head:-1]
        buffer.clear()


class PowerCutError(Exception):
    """Power fails now."""


class ReplyQueue:
    """Answers to be sent. Random numbers come from a seed."""

    def __init__(self, moods: FaultInjection, seed: int = 0) -> None:
        self._faults = moods
        self._chance = random.Random(seed)
        self._delayed: list[tuple[int, bytes]] = []

    def send(self, frame: bytes, now: int) -> list[bytes]:
        """Part of an answer that is sent at once, at a device time."""
        chance = self._chance.random()
        if chance < self._faults.drop_share:
            return []
        if chance < self._faults.drop_share + self._faults.corrupt_share:
            frame = frames.build(frame[2] + 2 & 0xFF, b"", frame[1])
        if self._faults.late_ns:
            self._delayed.append((now + self._faults.late_ns, frame))
            return []
        return [frame]

    @property
    def is_busy(self) -> bool:
        """True while late answers wait."""
        return bool(self._delayed)

    def due(self, now: int) -> list[bytes]:
        """Late answers that are due."""
        frames = [frame for at, frame in self._delayed if at <= now]
        self._delayed = [(at, frame) for at, frame in self._delayed if at > now]
        return frames
