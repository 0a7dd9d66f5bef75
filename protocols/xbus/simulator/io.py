"""How does the simulated MTi find the requests in what it hears, and what becomes of its answers?

Requests by the resync rule of protocols/framing.py, on the few bytes a host sends: noise is skipped, a candidate that
fails gives way to the next preamble, one that is not complete waits, and is forgotten when the host falls silent.
Answers leave at once, unless its moods (simulator/faults.py) have it otherwise.

Source: MT0101P 2020.A, 5.1.
"""

from __future__ import annotations

import random
from collections.abc import Collection, Iterator

from protocols.xbus import frames
from protocols.xbus.simulator.faults import FaultInjection

STALL_NS = 200_000_000  # an incomplete request older than this is forgotten
ADDRESSES = (0xFF, 0x01)  # bus identifiers to which a device answers that has its line to itself


class RequestParser:
    """Bytes in, requests out.

    Args:
        addresses: bus identifiers under which it is addressed.
    """

    def __init__(self, addresses: Collection[int] = ADDRESSES) -> None:
        self._addresses = addresses
        self._heard = bytearray()
        self._heard_ns = 0

    def clear(self) -> None:
        """Forget what was begun."""
        self._heard.clear()

    def hear(self, data: bytes, now: int) -> None:
        """Bytes that came at a device time, ns."""
        if now - self._heard_ns > STALL_NS:
            self._heard.clear()
        self._heard += data
        self._heard_ns = now

    def requests(self) -> Iterator[tuple[int, int, bytes]]:
        """The whole frames for this device, as (bus identifier, message, payload); those for others are passed over."""
        heard = self._heard
        while (at := heard.find(frames.PREAMBLE)) >= 0:
            del heard[:at]
            if len(heard) < 4:
                return
            head = 4 if heard[3] != frames.EXTENDED else 6
            if len(heard) < head:
                return
            size = heard[3] if head == 4 else heard[4] << 8 | heard[5]
            end = head + size + 1
            if size > frames.MAX_SENT:
                del heard[0]
            elif len(heard) < end:
                return
            elif sum(heard[1:end]) & 0xFF:
                del heard[0]
            else:
                frame = bytes(heard[:end])
                del heard[:end]
                if frame[1] in self._addresses:
                    yield frame[1], frame[2], frame[head:-1]
        heard.clear()


class PowerCutError(Exception):
    """The power fails now."""


class ReplyQueue:
    """Answers on their way out. Chance comes from a seed."""

    def __init__(self, moods: FaultInjection, seed: int = 0) -> None:
        self._moods = moods
        self._chance = random.Random(seed)
        self._held: list[tuple[int, bytes]] = []

    def say(self, frame: bytes, now: int) -> list[bytes]:
        """What of an answer leaves at once, at a device time."""
        chance = self._chance.random()
        if chance < self._moods.mute:
            return []
        if chance < self._moods.mute + self._moods.wrong:
            frame = frames.build(frame[2] + 2 & 0xFF, b"", frame[1])
        if self._moods.late_ns:
            self._held.append((now + self._moods.late_ns, frame))
            return []
        return [frame]

    @property
    def is_busy(self) -> bool:
        """True while late answers wait."""
        return bool(self._held)

    def due(self, now: int) -> list[bytes]:
        """Late answers whose time has come."""
        found = [frame for at, frame in self._held if at <= now]
        self._held = [(at, frame) for at, frame in self._held if at > now]
        return found
