"""Numbers missing from a sequence, row by row: the loop of counters.SequenceCounter, compiled.

A row is late, or a repeat, when it is a little behind the newest; the clock of a device that restarts goes back to 0 or
jumps by more than an eighth of the modulus.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.native.kernels import INT, INTS, TRIPLE, compiled

Ints = NDArray[np.int64]

LATE_SHARE = 1024  # a row behind the newest by up to this share of the modulus is late
RESTART_SHARE = 8
RESTART_ROWS = 256  # missing before a number near 0: a restart


@compiled(TRIPLE, INTS, INT, INT, INTS, INTS)
def count_missing(values: Ints, last: int, modulus: int, lost: Ints, restarts: Ints) -> tuple[int, int, int]:
    """Count the numbers missing before each of the rows `values`.

    Args:
        values: (n,) as sent.
        last: the newest number before them.
        lost: (n,), written: numbers missing just before each.
        restarts: (n,), written: rows where the sequence restarts.

    Returns:
        the newest number, the total of missing numbers, the number of restarts.
    """
    total = 0
    restart_count = 0
    for row in range(len(values)):
        value = values[row]
        missing = value - last - 1
        if missing != 0:
            missing %= modulus
            if modulus - missing <= modulus // LATE_SHARE + 1:
                lost[row] = 0
                continue
            if missing > modulus // RESTART_SHARE or (missing >= RESTART_ROWS and value < 2):
                restarts[restart_count] = row
                restart_count += 1
                missing = 0
        lost[row] = missing
        total += missing
        last = value
    return last, total, restart_count
