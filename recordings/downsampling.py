"""How are rows summarised, and where in a store's two files does each column of a block and of its summaries lie?

A *level* summarises every 16 (64, 256, 1024, 4096) rows: the first of each clock, and of each own column the least and
the greatest value, NaN left out; of a status word the bits that were set in any row and those that were set in all of
them, so that a fault of one sample is seen at every zoom.

    columns.bin     a block's clocks   key │ arrival │ time │ key, arrival of level 16 │ of level 64
                    and its values     own columns … │ low … high … of level 16 │ of level 64
    overview.bin    its clocks         key, arrival of level 256 │ of level 1024 │ of level 4096
                    and its values     low … high … of level 256 │ of level 1024 │ of level 4096

The coarse levels lie apart, because a whole recording is looked at first: of an hour at 1 kHz they are 4 MB, read at
once, where its blocks of 400 MB would be read at a thousand places, which a slow disk takes seconds for. From one level
to the next it is four times: what a query reads is at most four times what it needs.

Every column begins at a multiple of 64 bytes; where, follows from the number of rows and from what is before it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Ints = NDArray[np.int64]

NEAR, FAR = (16, 64), (256, 1024, 4096)
LEVELS = (*NEAR, *FAR)
ALIGN = 64  # bytes
CLOCK_BYTES = 8


def padding(size: int) -> int:
    """Bytes to the next place where a column may begin."""
    return -size % ALIGN


def reduce(column: Array, cuts: Ints, flags: bool, which: int) -> Array:
    """Each stretch between `cuts` as one value: least (`which` 0) or greatest; of flags the bits of any, or of all."""
    if flags:
        return np.bitwise_or.reduceat(column, cuts) if which == 0 else np.bitwise_and.reduceat(column, cuts)
    return np.fmin.reduceat(column, cuts) if which == 0 else np.fmax.reduceat(column, cuts)


@dataclass(frozen=True, slots=True)
class LevelOffsets:
    """Where the columns of each block of one channel begin: step (1, or of a level) → (blocks, columns) int64.

    Args:
        clocks: of step 1 key, arrival, time; of a level key, arrival.
        values: of step 1 the own columns; of a level their least values, then their greatest.
    """

    clocks: Mapping[int, Ints]
    values: Mapping[int, Ints]


def level_offsets(blocks: Array, sizes: Sequence[int]) -> LevelOffsets:
    """The places of a channel's columns.

    Args:
        blocks: its rows of the index: rows, clocks, values, far_clocks, far_values.
        sizes: bytes of one value of each own column.
    """
    own, rows = np.array(sizes, np.int64), blocks["rows"].astype(np.int64)
    clock = np.full(2, CLOCK_BYTES)
    near_clocks = {1: np.full(3, CLOCK_BYTES), **dict.fromkeys(NEAR, clock)}
    both = np.concatenate((own, own))
    return LevelOffsets(
        _begin(blocks["clocks"], rows, near_clocks) | _begin(blocks["far_clocks"], rows, dict.fromkeys(FAR, clock)),
        _begin(blocks["values"], rows, {1: own, **dict.fromkeys(NEAR, both)})
        | _begin(blocks["far_values"], rows, dict.fromkeys(FAR, both)),
    )


def _begin(at: Array, rows: Ints, steps: Mapping[int, Ints]) -> dict[int, Ints]:
    """Step → where each column begins, when they lie one after the other from `at`."""
    found = {}
    next_at = at.astype(np.int64)
    for step, sizes in steps.items():
        length = -(-rows // step)[:, None] * sizes
        length += -length % ALIGN
        ends = next_at[:, None] + np.cumsum(length, axis=1)
        found[step] = ends - length
        next_at = ends[:, -1] if ends.shape[1] else next_at
    return found
