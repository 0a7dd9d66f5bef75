"""Is this frame whole? The checksums of the protocols, compiled, each with its published check value.

    sum8    Xbus: every byte after the preamble, the checksum byte included, sums to 0 modulo 256
            (MT0101P 2020.A, section 5.1). Check value: FA FF 30 00 D1, the GoToConfig message of section 6.

A checksum is a function of `data[start:stop]` and returns an integer; what the result must be is the business of the
protocol's frames.py. `check_sum8` below is the value a sender appends.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from protocols.jit import BYTES, INT, compiled, unsigned


@compiled(INT, BYTES, INT, INT)
def sum8(data: NDArray[Any], start: int, stop: int) -> int:
    """The sum of `data[start:stop]` modulo 256."""
    total = 0
    for i in range(unsigned(start), unsigned(stop)):
        total += int(data[i])
    return total & 0xFF


def check_sum8(body: bytes) -> int:
    """The byte that makes `body` followed by it sum to 0 modulo 256."""
    return -sum(body) & 0xFF
