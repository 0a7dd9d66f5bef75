"""Kernels with everything that is translated, copied into a package of their own by test_kernels."""

from __future__ import annotations

from typing import Any

import numpy as np

from imuscope.protocols.native.kernels import (
    BYTES,
    FLAG,
    FLOAT,
    FLOATS,
    INT,
    INTS,
    NOTHING,
    PAIR,
    STRIDED,
    TABLE,
    compiled,
    inlined,
    several,
    short,
    unsigned,
)

FACTOR = 3
TWO = unsigned(2)
SQUARES = np.array([n * n for n in range(256)], np.uint32)
STATE = several(INT, INT)
REPORT = several(STATE, FLAG)


@inlined
def scaled(value: Any) -> Any:
    return value * FACTOR


@compiled(INT, BYTES, INTS)
def total(data: Any, weights: Any) -> int:
    value = 0
    for i in range(len(data)):
        value += scaled(int(data[i])) * weights[i]
    return value


@compiled(PAIR, INT, INT)
def parted(value: int, by: int) -> tuple[int, int]:
    return value // by, value % by


@compiled(INT, INT)
def last_digit(value: int) -> int:
    return parted(value, 10)[1]


@compiled(FLOAT, INT, INT)
def share(part: int, whole: int) -> float:
    return part / whole


@compiled(INT, BYTES, INT)
def short_sums(data: Any, start: int) -> int:
    """Numbers of 16 bits that wrap, also below 0."""
    total = short(start)
    factor = short(start - 1)
    for i in range(len(data)):
        byte = short(data[i])
        total = short(total + byte * factor)
        factor = short(3 * factor - 5)
    return int(total) << 16 | int(factor)


@compiled(INT, BYTES, INT, INT)
def squares(data: Any, start: int, stop: int) -> int:
    """Unsigned indices, a table of the module, and a loop that ends early."""
    value = 0
    at = unsigned(start)
    while at < unsigned(stop):
        if data[at] == 255:
            break
        value = value ^ int(SQUARES[int(data[at])]) << 3
        at += TWO if int(data[at]) & 1 else unsigned(1)
    return value if value > 0 else -1


@compiled(NOTHING, STRIDED, TABLE)
def turned(table: Any, out: Any) -> None:
    """Two dimensions with any steps, slices and rows."""
    out[:, 1:] = -7
    for row in range(table.shape[0]):
        for column in range(table.shape[1] - 1, -1, -1):
            if (row + column) % 3 == 0:
                continue
            out[row, column] = -table[row, column]
    for row in range(table.shape[0]):
        first = out[row]
        first[0] = max(first[0], min(row, 1))


@compiled(INT, INTS)
def distinct(values: Any) -> int:
    """Memory of a size that is not known before, and of one that is."""
    observed = np.full(len(values), -1, np.int64)
    few = np.zeros((2, 4), np.int64)
    count = 0
    for i in range(len(values)):
        known = False
        for k in range(count):
            known = known or observed[k] == values[i]
        if not known:
            observed[count] = values[i]
            count += 1
        few[1, values[i] & 3] += 1
    return count * 1000 + few[1, 0] + few[0, 1]


@compiled(REPORT, STATE, INT)
def stepped(state: tuple[int, int], by: int) -> tuple[tuple[int, int], bool]:
    """Tuples in and out, and two names that change places."""
    low, high = state
    low, high = high, low
    if by in (1, 2) or not -3 < by <= 40:
        high = low = by
    return (low + by, high), abs(low) > 2 and state[0] != state[1]


@compiled(INT, FLOATS, FLOAT, INTS)
def rounded(values: Any, step: float, out: Any) -> int:
    count = 0
    for i in range(len(values)):
        nearest = int(values[i] * 1e3 + step)
        out[i] = nearest
        count += nearest >= 0
    return count


@compiled(INT, INT, INT)
def shifts(value: int, by: int) -> int:
    return value << 3 >> by ^ (value & 0xFF | by)
