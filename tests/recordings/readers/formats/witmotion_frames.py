"""Frames of WitMotion sensors, by the formulas of their documents."""

import struct


def frame(kind: int, body: bytes) -> bytes:
    head = bytes((0x55, kind)) + body
    return head + bytes((sum(head) & 0xFF,))


def cycle(n: int, *, clock: bool) -> bytes:
    """Frames of one cycle, 20 ms after the one before."""
    ms = 20 * n
    out = frame(0x50, struct.pack("<6BH", 26, 5, 28, 20, 26, 40 + ms // 1000, ms % 1000)) if clock else b""
    out += frame(0x51, struct.pack("<4h", 100 * n, 0, 2048, 2500))
    out += frame(0x52, struct.pack("<4h", -100 * n, 0, 16384, 2500))
    out += frame(0x53, struct.pack("<4h", 0, 16384, -16384, 0))
    out += frame(0x56, struct.pack("<2i", 101_325, 50_000))
    out += frame(0x59, struct.pack("<4h", 32767, 0, 0, 0))
    return out + frame(0x5A, bytes(8))
