"""Blocks of a text table, and the numbers of those that hold nothing else (number_kernel.py)."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from imuscope.protocols.native.kernels import Kernel, kernel_of
from imuscope.recordings.sources import FileDamage
from imuscope.recordings.tables.number_kernel import numbers_of

if TYPE_CHECKING:
    import pyarrow as pa

BLOCK_BYTES = 4 << 20
HELD_BYTES = 144 << 20  # of the numbers of a table that is read once: a million rows of 18 columns


class FirstPass:
    """Rows of a first pass over a table that is not too large, so that a second one need not read them again.

    Attributes:
        odd, damage: reports, as of the second pass.
    """

    def __init__(self) -> None:
        self.odd: list[Any] = []
        self.damage: list[FileDamage] = []
        self._batches: list[pa.RecordBatch] = []
        self._size = 0

    def add(self, batch: "pa.RecordBatch") -> None:
        self._size += batch.nbytes
        self._batches.append(batch)
        if self._size > HELD_BYTES:
            self._batches = []

    def batches(self, odd: list[Any], damage: list[FileDamage]) -> "Iterator[pa.RecordBatch] | None":
        """All batches, once, with their reports; None if they are not held."""
        if not self._batches:
            return None
        odd += self.odd
        damage += self.damage
        batches, self._batches = self._batches[::-1], []
        return (batches.pop() for _ in range(len(batches)))  # each goes when it has been used


def is_fast() -> bool:
    """Whether numbers are read by machine code; without it pyarrow is faster."""
    kernel = kernel_of(numbers_of)
    return isinstance(kernel, Kernel) and kernel.native is not None


def lines_of(file: BinaryIO, skip: int) -> Iterator[bytes]:
    """A file behind its first lines, in blocks of whole lines; nothing if lines end with a carriage return alone."""
    head = file.read(BLOCK_BYTES)
    begin = 0
    for _ in range(skip):
        begin = head.find(b"\n", begin) + 1
        if not begin:
            return
    if b"\r" in head.replace(b"\r\n", b""):
        return
    block = head[begin:]
    while block:
        lines = block + file.readline(BLOCK_BYTES)
        yield lines if lines.endswith(b"\n") else lines + b"\n"
        block = file.read(BLOCK_BYTES)


def numbers_in(
    block: bytes, separator: str, names: Sequence[str], columns: Sequence[str], timed: Sequence[str] = ()
) -> "pa.RecordBatch | None":
    """Some columns of a block of lines, float64; None if a line has something else than numbers.

    Args:
        timed: columns whose numbers are wanted to their last digit: what the float64 lack are columns at the end.
    """
    import pyarrow as pa

    slots = np.array([columns.index(name) if name in columns else -1 for name in names])
    data = np.frombuffer(block, np.uint8)
    every = [*columns, *(f"rest of {name}" for name in timed)]
    rests = np.array([len(columns) + timed.index(name) if name in timed else -1 for name in columns])
    out = np.empty((len(every), np.count_nonzero(data == ord("\n"))))
    out[len(columns) :] = 0.0
    rows = numbers_of(data, ord(separator), slots, np.nan, rests, out)
    return None if rows < 0 else pa.RecordBatch.from_arrays([pa.array(one[:rows]) for one in out], names=every)
