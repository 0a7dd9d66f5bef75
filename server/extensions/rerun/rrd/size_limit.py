"""Size limit for the viewer in a browser, and what it omits. Pure; does not need Rerun.

A viewer in a browser keeps samples in memory, which is limited to 4 GB (32-bit addresses in WebAssembly), and drops the
oldest before that; without a GPU it also draws each of them. So there are two limits, in rows of all quantities
together: up to MAX_WHOLE_ROWS a range is opened whole; up to MAX_ROWS, on request. Beyond, every quantity with more
than `most` rows is thinned to as many (server/extensions/rerun/rrd/writer.py explains how), and the page reports it.

    rows of the quantities      900 000   900 000    6 000
    kept, most = 20 000          20 000    20 000    6 000      one of 45 samples of those that have the most
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from imuscope.recordings.columns.store import ColumnStore

MAX_WHOLE_ROWS = 1_000_000
MAX_ROWS = 4_000_000
ROWS_PER_QUANTITY = 20_000  # rows of a quantity when thinned to the default limit


@dataclass(frozen=True, slots=True)
class ViewerLimit:
    """Share of a range that is shown.

    Args:
        rows: of all quantities together in the range.
        shown: of those.
        most: rows of one quantity; 0: all.
        every: of the quantity with the most rows, one in this many is shown; 1: all.
    """

    rows: int
    shown: int
    most: int
    every: int


def limit_of(
    columns: ColumnStore, t0: float = -math.inf, t1: float = math.inf, *, as_much: bool = False
) -> ViewerLimit:
    """Limit for an opened recording, or a range of it.

    Args:
        t0, t1: unix s of device time, both included.
        as_much: as much as a browser can hold, instead of what it draws at once.
    """
    return limit_for([hi - lo for lo, hi in (columns.between(number, t0, t1) for number in columns.shapes)], as_much)


def limit_for(counts: Sequence[int], as_much: bool = False) -> ViewerLimit:
    """The same, from the number of rows of each quantity."""
    rows = sum(counts)
    if rows <= (MAX_ROWS if as_much else MAX_WHOLE_ROWS):
        return ViewerLimit(rows, rows, 0, 1)
    most = _share(counts, MAX_ROWS) if as_much else min(ROWS_PER_QUANTITY, _share(counts, MAX_WHOLE_ROWS))
    return ViewerLimit(rows, sum(min(count, most) for count in counts), most, math.ceil(max(counts) / most))


def _share(counts: Sequence[int], whole: int) -> int:
    """Rows for each quantity so that all together have no more than `whole`; at least one."""
    left = whole
    waiting = sorted(counts)
    while waiting and waiting[0] * len(waiting) <= left:
        left -= waiting.pop(0)  # it has less than its share: the others get the rest
    return max(1, left // len(waiting)) if waiting else max(1, *counts)
