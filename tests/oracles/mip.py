"""Slow and simple MIP decoder, the reference for the plug-in's.

Written from the vendor's public SDK (tests/plugins/plugin_family/README.md names its files), one byte at a time.
"""

from __future__ import annotations

import struct
from typing import Any

from tests.oracles.checksums import fletcher

# (set, descriptor) → names and how many of which type, big-endian.
DATA: dict[tuple[int, int], list[tuple[str, str]]] = {
    (0x80, 0x04): [("Acceleration", "3f")],
    (0x80, 0x05): [("RateOfTurn", "3f")],
    (0x80, 0x06): [("MagneticField", "3f")],
    (0x80, 0x12): [("tow", "d"), ("week", "H"), ("time_flags", "H")],
    (0x82, 0x01): [("LatLon", "2d"), ("Height", "d"), ("position_valid", "H")],
    (0x82, 0x03): [("Quaternion", "4f"), ("quaternion_valid", "H")],
    (0x82, 0x05): [("EulerAngles", "3f"), ("euler_valid", "H")],
    (0x82, 0x11): [("tow", "d"), ("week", "H"), ("time_flags", "H")],
}


def scan(data: bytes) -> tuple[list[tuple[int, bytes]], list[tuple[int, str]]]:
    """Every packet, and every failed candidate with its reason; the search continues after its preamble."""
    packets, rejects = [], []
    at = 0
    while at + 1 < len(data):
        if (data[at], data[at + 1]) != (0x75, 0x65):
            at += 1
            continue
        verdict = _candidate(data[at:])
        if isinstance(verdict, str):
            rejects.append((at, verdict))
            at += 2
        else:
            packets.append((at, verdict))
            at += len(verdict)
    return packets, rejects


def _candidate(data: bytes) -> bytes | str:
    if len(data) < 4 or len(data) < 4 + data[3] + 2:
        return "truncated"
    if data[3] == 0:
        return "bad_size"
    body = 4 + data[3]
    if fletcher(data[:body]) != data[body : body + 2]:
        return "bad_checksum"
    at = 4
    while at < body:
        if data[at] < 2 or at + data[at] > body:
            return "bad_size"
        at += data[at]
    return data[: body + 2]


def values(packet: bytes) -> dict[str, list[Any]] | None:
    """Numbers by name; None where a field is not known, or is there twice."""
    results: dict[str, list[Any]] = {}
    at = 4
    while at < len(packet) - 2:
        size, descriptor = packet[at], packet[at + 1]
        rows = DATA.get((packet[2], descriptor))
        if rows is None or size - 2 != struct.calcsize(">" + "".join(kind for _, kind in rows)):
            return None
        place = at + 2
        for name, kind in rows:
            if name in results:
                return None
            results[name] = list(struct.unpack_from(">" + kind, packet, place))
            place += struct.calcsize(">" + kind)
        at += size
    return results
