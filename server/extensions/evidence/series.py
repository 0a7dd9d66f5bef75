"""Samples of a curve for evidence: all of them, or where they are too many the extremes of equal intervals of time.

    samples ──┬── fit ────────> every sample: time, value
              └── too many ───> of each interval its first time, least and greatest value

Times are whole ticks from the beginning of the range, 32 bits; values are 32-bit floats where that cannot be seen, else
64-bit. Curves with the same times share them. A line is broken where samples are missing, judged from all samples.
"""

import base64
import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.breaks import gaps_in

MAX_TICKS = 2**32 - 1
LEAST_TICK_S = 1e-7  # the resolution of a unix time as a 64-bit float
VISIBLE_SHARE = 1e-4  # of the values' range: a rounding error below this cannot be seen
FLOAT32_ROUNDING = 2.0**-24  # relative rounding error of a 32-bit float


def tick_of(span: float) -> float:
    """Length of a tick for a range, s: 1, 2 or 5 times a power of ten."""
    least = max(span / MAX_TICKS, LEAST_TICK_S)
    power = 10.0 ** math.floor(math.log10(least))
    return next(m * power for m in (1, 2, 5, 10) if m * power >= least * (1 - 1e-9))


@dataclass(slots=True)
class Blocks:
    """Binary blocks of a file, each kept once; `add` returns the number of a block."""

    texts: list[str] = field(default_factory=list)
    size: int = 0
    _known: dict[bytes, int] = field(default_factory=dict)

    def add(self, array: NDArray[Any]) -> int:
        """Add the values of an array."""
        data = np.ascontiguousarray(array).tobytes()
        mark = hashlib.sha256(data).digest()
        if mark not in self._known:
            self._known[mark] = len(self.texts)
            self.texts.append(base64.b64encode(data).decode())
            self.size += len(self.texts[-1])
        return self._known[mark]


def _packed(values: Floats) -> NDArray[Any]:
    """Values as 32-bit floats where that cannot be seen, else as they are."""
    with np.errstate(over="ignore"):
        single = values.astype("<f4")
    if np.array_equal(single.astype(np.float64), values):
        return single
    error = float(np.abs(values).max()) * FLOAT32_ROUNDING
    is_fine = np.isfinite(single).all() and error <= VISIBLE_SHARE * float(np.ptp(values))
    return single if is_fine else values.astype("<f8")


def embedded(time: Floats, values: Floats, span: tuple[float, float], intervals: int, blocks: Blocks) -> dict[str, Any]:
    """A curve as the viewer reads it; its blocks are added to `blocks`.

    Args:
        time: (n,) unix s, non-decreasing, within the span.
        values: (n,) finite.
        span: the range of the file, unix s.
        intervals: number of intervals in the span where not every sample is kept; 0: every sample is kept.
    """
    t0, t1 = span
    tick = tick_of(t1 - t0)
    content: dict[str, Any] = {"n": len(time), "step": float(np.median(np.diff(time))) if len(time) > 1 else 0.0}
    breaks = gaps_in(time)
    if intervals == 0 or len(time) <= 2 * intervals:
        content |= {"v": _block(blocks, _packed(values)), "shown": len(time)}
    else:
        place = ((time - t0) * (intervals / max(t1 - t0, 1e-9))).astype(np.int64)
        cuts = np.flatnonzero(np.diff(np.maximum.accumulate(place), prepend=-1))
        low, high = _packed(np.minimum.reduceat(values, cuts)), _packed(np.maximum.reduceat(values, cuts))
        content |= {"low": _block(blocks, low), "high": _block(blocks, high), "shown": len(cuts)}
        content["interval"] = (t1 - t0) / intervals
        breaks = np.unique(np.searchsorted(cuts, breaks[np.isin(breaks, cuts)]))
        time = time[cuts]
    ticks = np.clip(np.rint((time - t0) / tick), 0, MAX_TICKS).astype("<u4")
    return content | {"t": _block(blocks, ticks), "breaks": [int(row) for row in breaks]}


def _block(blocks: Blocks, array: NDArray[Any]) -> dict[str, Any]:
    return {"block": blocks.add(array), "type": array.dtype.str.lstrip("<|")}


def intervals_for(sizes: Sequence[tuple[int, int]], room: int) -> int:
    """Number of intervals with which the curves take at most `room` bytes; 0: every sample fits.

    Args:
        sizes: of each curve its samples, and the bytes of one value.
    """

    def bytes_with(intervals: int) -> int:
        whole = ((n * (4 + width), 2 * intervals >= n > 0) for n, width in sizes)
        return sum(
            size if fits else intervals * (4 + 2 * width) for (size, fits), (_, width) in zip(whole, sizes, strict=True)
        )

    if sum(n * (4 + width) for n, width in sizes) <= room:
        return 0
    low, high = 1, max(n for n, _ in sizes)
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if bytes_with(middle) <= room else (low, middle - 1)
    return low
