"""Rows of a channel as a query gives them: exact, or summarised in buckets."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array, Floats, Ints
from imuscope.protocols.clocks.unix_time import seconds
from imuscope.recordings.columns.downsampling import reduce


@dataclass(frozen=True)
class ExactRows:
    """Rows as stored: (n,) each.

    Args:
        arrival_ns, time_ns: unix ns; NO_TIME where a row has no device time.
    """

    arrival_ns: Ints
    time_ns: Ints
    columns: list[Array]

    def __len__(self) -> int:
        return len(self.arrival_ns)

    @cached_property
    def arrival(self) -> Floats:
        """Unix s."""
        return seconds(self.arrival_ns)

    @cached_property
    def time(self) -> Floats:
        """Unix s; NaN where a row has no device time."""
        return seconds(self.time_ns)

    def picked(self, which: slice | Array, columns: Sequence[int] | None = None) -> "ExactRows":
        """Some of them, in this order; `columns` by position, None for all."""
        own = self.columns if columns is None else [self.columns[i] for i in columns]
        return ExactRows(self.arrival_ns[which], self.time_ns[which], [column[which] for column in own])


@dataclass(frozen=True, slots=True)
class MinMaxBuckets:
    """Summarised rows: (m,) each; a bucket without rows is left out.

    Args:
        t: the first key (or arrival) in the bucket, unix s.
        n: rows in it.
        low, high: of each column the least and greatest value; of a status word the bits of any row, and of all.
    """

    t: Floats
    n: NDArray[np.int64]
    low: list[Array]
    high: list[Array]

    def __len__(self) -> int:
        return len(self.t)


def downsample(
    columns: Sequence[Array], t: Floats, status: Sequence[bool], grid: tuple[float, float, int]
) -> MinMaxBuckets:
    """Buckets of rows in memory (a live ring): same result as a store's query for these rows.

    Args:
        columns: own columns of the channel.
        t: (n,) non-decreasing time of each row, unix s.
        status: for each column, whether it is a flag word.
        grid: t0, t1, number of buckets.
    """
    at = cuts(t, grid)
    return MinMaxBuckets(
        t[at],
        np.diff(at, append=len(t)),
        [reduce(column, at, flags, 0) for column, flags in zip(columns, status, strict=True)],
        [reduce(column, at, flags, 1) for column, flags in zip(columns, status, strict=True)],
    )


def cuts(t: Floats, grid: tuple[float, float, int]) -> NDArray[np.int64]:
    """Start in `t` of each non-empty bucket of the grid."""
    t0, t1, width = grid
    place = np.clip(((t - t0) * (width / max(t1 - t0, 1e-9))).astype(np.int64), 0, width - 1)
    return np.flatnonzero(np.diff(np.maximum.accumulate(place), prepend=-1))
