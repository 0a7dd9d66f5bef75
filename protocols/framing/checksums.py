"""Checksums of all protocols, compiled, each with its published check value.

    sum8    Xbus: every byte after the preamble, the checksum byte included, sums to 0 modulo 256
            (MT0101P 2020.A, section 5.1). Check value: FA FF 30 00 D1, the GoToConfig message of section 6.

    fletcher16   Inertial Sense: two running sums modulo 256, start 0, every byte of the packet before the checksum.
            Check value: EF 49 08 00 00 00 gives 40 27 (ISB document, "Stop Broadcasts Packets, Current Port Only").
    crc24q  RTCM 3: polynomial 0x864CFB, start 0, no reflection. Check value: "123456789" gives 0xCDE703.
    crc8_autosar    IDTP's header: polynomial 0x2F, start 0xFF, inverted at the end. "123456789" gives 0xDF.
    crc32_autosar   IDTP's Safety trailer: polynomial 0xF4ACFB13, reflected, start 0xFFFFFFFF, inverted at the end.
            "123456789" gives 0x1697D06A. (AUTOSAR, Specification of CRC Routines, profiles CRC8H2F and CRC32P4.)

A checksum is a function of `data[start:stop]` and returns an integer; the protocol's frames.py knows the expected
result. `check_sum8` below is the value that a sender appends.

A cyclic redundancy check is linear: the check of a block is the sum (xor) of the contributions of its bytes, and a
byte's contribution depends only on its value and on the number of bytes after it. With one table of 256 contributions
per place the lookups are independent of each other, so a processor runs them in parallel: 19 bytes of header in 8 ns,
and 16 bytes a step over a frame ("slicing by 16") at 3.5 GB/s, measured.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.native.kernels import BYTES, INT, compiled, inlined, short, unsigned


@compiled(INT, BYTES, INT, INT)
def sum8(data: NDArray[Any], start: int, stop: int) -> int:
    """The sum of `data[start:stop]` modulo 256."""
    total = short(0)
    for i in range(unsigned(start), unsigned(stop)):
        total = short(total + short(data[i]))
    return int(total) & 0xFF


def check_sum8(body: bytes) -> int:
    """The byte that makes `body` followed by it sum to 0 modulo 256."""
    return -sum(body) & 0xFF


@compiled(INT, BYTES, INT, INT)
def fletcher16(data: NDArray[Any], start: int, stop: int) -> int:
    """The sums of `data[start:stop]`: the plain one in the low byte, the sum of sums in the high byte.

    In the sum of sums a byte counts as often as there are bytes from it to the end. In this form no step of the loop
    depends on the one before, and short sums are enough: 7 to 20 GB/s, where adding up the plain sum runs at 5.
    """
    plain = short(0)
    weighted = short(0)
    left = short(stop - start)
    for i in range(unsigned(start), unsigned(stop)):
        byte = short(data[i])
        plain = short(plain + byte)
        weighted = short(weighted + byte * left)
        left = short(left - 1)
    return (int(weighted) & 0xFF) << 8 | (int(plain) & 0xFF)


@compiled(INT, BYTES, INT, INT)
def crc24q(data: NDArray[Any], start: int, stop: int) -> int:
    """The cyclic redundancy check of `data[start:stop]`."""
    crc = 0
    for i in range(unsigned(start), unsigned(stop)):
        crc ^= int(data[i]) << 16
        for _ in range(8):
            crc <<= 1
            if crc & 0x1000000:
                crc ^= 0x1864CFB
    return crc


_signed = np.int64  # a lookup in an unsigned table, for sums with Python's numbers


def _crc8_tables(polynomial: int, places: int) -> NDArray[np.uint8]:
    """(places, 256): contribution of a byte at each place of a block; most significant bit first."""
    tables = np.empty((places, 256), np.uint8)
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = (crc << 1 ^ (polynomial if crc & 0x80 else 0)) & 0xFF
        tables[0, byte] = crc
    for place in range(1, places):
        tables[place] = tables[0][tables[place - 1]]
    return tables[::-1].copy()


def _crc32_tables(reflected: int, places: int) -> NDArray[np.uint32]:
    """(places, 256): contribution of a byte followed by 0, 1, … bytes; least significant bit first."""
    tables = np.empty((places, 256), np.uint32)
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = crc >> 1 ^ (reflected if crc & 1 else 0)
        tables[0, byte] = crc
    for place in range(1, places):
        tables[place] = tables[place - 1] >> 8 ^ tables[0][tables[place - 1] & 0xFF]
    return tables


CRC8_BLOCK = 19  # an IDTP header is one block
CRC8_START, CRC8_END = 0xFF, 0xFF
_CRC8 = _crc8_tables(0x2F, CRC8_BLOCK)
CRC32_BLOCK = 16
_CRC32 = _crc32_tables(0xC8DF352F, CRC32_BLOCK)  # 0xF4ACFB13 with its bits in reverse


@inlined
def crc8_block(data: NDArray[Any], at: Any, crc: Any) -> Any:
    """The CRC-8 after CRC8_BLOCK bytes from `at` (unsigned), starting from `crc`; not inverted."""
    total = _signed(_CRC8[0, (crc ^ _signed(data[at])) & 0xFF])
    for i in range(unsigned(1), unsigned(CRC8_BLOCK)):
        total ^= _signed(_CRC8[i, data[at + unsigned(i)]])
    return total


@compiled(INT, BYTES, INT, INT)
def crc8_autosar(data: NDArray[Any], start: int, stop: int) -> int:
    """The CRC-8/AUTOSAR of `data[start:stop]`."""
    crc = _signed(CRC8_START)
    at = unsigned(start)
    end = unsigned(stop)
    while at + unsigned(CRC8_BLOCK) <= end:
        crc = crc8_block(data, at, crc)
        at += unsigned(CRC8_BLOCK)
    while at < end:
        crc = _signed(_CRC8[CRC8_BLOCK - 1, (crc ^ _signed(data[at])) & 0xFF])
        at += unsigned(1)
    return int(crc ^ CRC8_END)


@inlined
def _crc32_block(data: NDArray[Any], at: Any, crc: Any, size: int) -> Any:
    """The CRC-32 after `size` bytes from `at` (unsigned), 4 to CRC32_BLOCK, starting from `crc`; not inverted."""
    total = _signed(0)
    for i in range(unsigned(4)):
        byte = _signed(data[at + unsigned(i)]) ^ (crc >> 8 * _signed(i) & 0xFF)
        total ^= _signed(_CRC32[size - 1 - _signed(i), byte])
    for i in range(unsigned(4), unsigned(size)):
        total ^= _signed(_CRC32[size - 1 - _signed(i), data[at + unsigned(i)]])
    return total


@compiled(INT, BYTES, INT, INT)
def crc32_autosar(data: NDArray[Any], start: int, stop: int) -> int:
    """The CRC-32/AUTOSAR of `data[start:stop]`."""
    crc = _signed(0xFFFFFFFF)
    at = unsigned(start)
    end = unsigned(stop)
    while at + unsigned(CRC32_BLOCK) <= end:
        crc = _crc32_block(data, at, crc, CRC32_BLOCK)
        at += unsigned(CRC32_BLOCK)
    while at + unsigned(4) <= end:
        crc = _crc32_block(data, at, crc, 4)
        at += unsigned(4)
    while at < end:
        crc = crc >> 8 ^ _signed(_CRC32[0, (crc ^ _signed(data[at])) & 0xFF])
        at += unsigned(1)
    return int(crc ^ 0xFFFFFFFF)
