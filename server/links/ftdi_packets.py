"""Packet timing of an FTDI USB adapter.

    line     ▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯▯        ▯▯▯▯▯▯▯▯▯
    host              62 bytes ^              ^ expiry of the timer, started with the previous packet

An FTDI adapter sends a packet when 62 bytes are buffered (64 with two status bytes) or when its latency timer expires,
whichever is first; either restarts the timer. So a frame waits for the following ones, or for the timer. A simulator
with `burst_ms` reproduces that to the byte.

Source: FTDI, AN232B-04 "Data Throughput, Latency and Handshaking", sections 3.2 and 3.3.
"""

from __future__ import annotations

import math

PACKET = 62


class FtdiPacketizer:
    """The receiving side of an adapter.

    Args:
        timer_ns: period of its latency timer.
        packet: number of buffered bytes that are sent at once; 0: always wait for the timer.
    """

    def __init__(self, timer_ns: float, packet: int = PACKET) -> None:
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
