"""Bytes seen by a receiver at the wrong baud rate.

An asynchronous line idles high. A byte is one low start bit, eight data bits with the lowest first, one high stop bit:

    ‾‾‾\\_S_/0\\1/2\\3/4\\5/6\\7/‾P‾‾‾\\_S_/…

A receiver waits for the falling edge and then samples the middle of each bit by its own clock. At another rate it
samples the wrong bits and resynchronises on the next falling edge: the reported bytes are a function of the sent ones,
not random. This file computes that function, so that a simulated device on a pseudo-terminal has a rate like a real
one, and baud rate detection can be tested without a cable.
"""

from __future__ import annotations

BITS = 10  # start, eight data bits, stop
FALLING = b"\1\0"  # of the levels of two bits

_LEVELS = [bytes([0, *(byte >> bit & 1 for bit in range(8)), 1]) for byte in range(256)]
"""For each byte the levels of its bits on the line, start bit first."""


def misread_at(data: bytes, sender_baud: int, receiver_baud: int) -> bytes:
    """Bytes reported by a receiver at `receiver_baud` if `data` is sent back to back at `sender_baud`.

    The time is proportional to the number of bytes: a simulator that a busy host has delayed must catch up.
    """
    if sender_baud == receiver_baud or not data:
        return data
    line = b"".join([_LEVELS[byte] for byte in data])
    size = BITS * len(data)
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
