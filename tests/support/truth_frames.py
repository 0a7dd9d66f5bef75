"""Frames written from the documents alone, without the product's encoders: streams whose truth is exact."""

import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np

import imuscope

GRAVITY = (0.0, 0.0, 9.81)


def xbus(counter: int, ticks: int, *items: tuple[int, str, tuple[float, ...]]) -> bytes:
    """An MTData2 with PacketCounter, SampleTimeFine and further items (identifier, struct format, values).

    Source: MT0101P 2020.A, sections 5.1 and 5.3.6.
    """
    payload = struct.pack(">HBHHBI", 0x1020, 2, counter % 65_536, 0x1060, 4, ticks % 2**32)
    for identifier, form, values in items or ((0x4020, "3f", GRAVITY),):
        data = struct.pack(f">{form}", *values)
        payload += struct.pack(">HB", identifier, len(data)) + data
    body = bytes((0xFF, 0x36, len(payload))) + payload
    return b"\xfa" + body + bytes((-sum(body) & 0xFF,))


def xbus_stream(counters: Iterable[int], ticks: Iterable[int]) -> bytes:
    """Frames of these counters and ticks of 0.1 ms."""
    return b"".join(xbus(int(counter), int(tick)) for counter, tick in zip(counters, ticks, strict=True))


def opened(path: Path, data: bytes) -> imuscope.Recording:
    """A file of these bytes, opened."""
    path.write_bytes(data)
    return imuscope.open(path)


def even_ticks(count: int, rate: float = 100.0, start: float = 1000.0) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Ticks of 0.1 ms of a device that samples evenly."""
    return np.rint((start + np.arange(count) / rate) * 10_000).astype(np.int64)
