"""Min/max summaries of rows, and their offsets in the two files of a store.

A *level* summarises every 16 (64, 256, 1024, 4096) rows: the first of each clock, and of each own column the least and
the greatest value, NaN left out; of a status word the bits set in any row and those set in all of them, so that a fault
of one sample is visible at every zoom.

    columns.bin     a block's clocks   key │ arrival │ time │ place │ key, arrival of level 16 │ of level 64
                    and its values     own columns … │ low … high … of level 16 │ of level 64
    overview.bin    its clocks         key, arrival of level 256 │ of level 1024 │ of level 4096
                    and its values     low … high … of level 256 │ of level 1024 │ of level 4096

The coarse levels are stored apart, because a whole recording is shown first: for an hour at 1 kHz they are 4 MB, read
at once, while its blocks of 400 MB would be read at a thousand places, which takes a slow disk seconds. Levels differ
by a factor of four: a query reads at most four times what it needs.

Every column begins at a multiple of 64 bytes; its offset follows from the number of rows and the columns before it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Array, Ints

NEAR_LEVELS, FAR_LEVELS = (16, 64), (256, 1024, 4096)
LEVELS = (*NEAR_LEVELS, *FAR_LEVELS)
ALIGN_BYTES = 64
CLOCK_BYTES = 8


def padding(size: int) -> int:
    """Bytes to the next possible start of a column."""
    return -size % ALIGN_BYTES


def reduce(column: Array, cuts: Ints, flags: bool, which: int) -> Array:
    """Each range between `cuts` as one value: least (`which` 0) or greatest; of flags the bits of any, or of all."""
    if flags:
        return np.bitwise_or.reduceat(column, cuts) if which == 0 else np.bitwise_and.reduceat(column, cuts)
    return np.fmin.reduceat(column, cuts) if which == 0 else np.fmax.reduceat(column, cuts)


@dataclass(frozen=True, slots=True)
class LevelOffsets:
    """Offsets of the columns of each block of one channel: step (1, or of a level) → (blocks, columns) int64.

    Args:
        clocks: of step 1 key, arrival, time, place; of a level key, arrival.
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
    near_clocks = {1: np.full(4, CLOCK_BYTES), **dict.fromkeys(NEAR_LEVELS, clock)}
    both = np.concatenate((own, own))
    return LevelOffsets(
        _begin(blocks["clocks"], rows, near_clocks)
        | _begin(blocks["far_clocks"], rows, dict.fromkeys(FAR_LEVELS, clock)),
        _begin(blocks["values"], rows, {1: own, **dict.fromkeys(NEAR_LEVELS, both)})
        | _begin(blocks["far_values"], rows, dict.fromkeys(FAR_LEVELS, both)),
    )


def _begin(at: Array, rows: Ints, steps: Mapping[int, Ints]) -> dict[int, Ints]:
    """Step → start of each column, for columns stored consecutively from `at`."""
    levels = {}
    next_at = at.astype(np.int64)
    for step, sizes in steps.items():
        length = -(-rows // step)[:, None] * sizes
        length += -length % ALIGN_BYTES
        ends = next_at[:, None] + np.cumsum(length, axis=1)
        levels[step] = ends - length
        next_at = ends[:, -1] if ends.shape[1] else next_at
    return levels
