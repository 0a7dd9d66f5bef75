"""Bytes seen by a receiver at the wrong baud rate.

An asynchronous line idles high. A byte is one low start bit, eight data bits with the lowest first, one high stop bit:

    ‾‾‾\\_S_/0\\1/2\\3/4\\5/6\\7/‾P‾‾‾\\_S_/…

A receiver waits for the falling edge and then samples the middle of each bit by its own clock. At another rate it
samples the wrong bits and resynchronises on the next falling edge: the reported bytes are a function of the sent ones,
not random. This file computes that function, so that a simulated device on a pseudo-terminal has a rate like a real
one, and baud rate detection can be tested without a cable.
"""

from __future__ import annotations

import math

BITS = 10  # start, eight data bits, stop


def misread_at(data: bytes, sender_baud: int, receiver_baud: int) -> bytes:
    """Bytes reported by a receiver at `receiver_baud` if `data` is sent back to back at `sender_baud`."""
    if sender_baud == receiver_baud or not data:
        return data
    line = 0
    for index, byte in enumerate(data):
        line |= (1 << 9 | byte << 1) << (BITS * index)  # bit 0 of each ten is the start bit, 0
    size = BITS * len(data)
    received = bytearray()
    step = sender_baud / receiver_baud  # the receiver's bit, in bits of the sender
    at = -1.0  # the line idles before the first byte
    while True:
        start = _falling_edge(line, size, at)
        if start is None:
            return bytes(received)
        byte = 0
        for bit in range(8):
            byte |= _level(line, size, start + (1.5 + bit) * step) << bit
        received.append(byte)
        at = start + 9.5 * step  # middle of the stop bit, where the search for the next start bit begins


def _level(line: int, size: int, at: float) -> int:
    """Level of the line at a time, in bits of the sender; before and after the data it is idle, which is high."""
    index = math.floor(at)
    return (line >> index) & 1 if 0 <= index < size else 1


def _falling_edge(line: int, size: int, at: float) -> int | None:
    """The first bit after `at` that is low and follows a high one; None if there is no such bit."""
    before = _level(line, size, at)
    for index in range(math.floor(at) + 1, size):
        level = (line >> index) & 1
        if before and not level:
            return index
        before = level
    return None
