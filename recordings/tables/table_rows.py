"""Rows of one table, as readers pass them on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from imuscope.protocols.arrays import Floats, Ints
from imuscope.protocols.clocks.unix_time import nanoseconds


@dataclass(frozen=True, slots=True)
class TableRows:
    """Rows of one table: (n,) each; a missing number is NaN.

    Args:
        table: its name.
        time, arrival: unix s; time NaN if unknown.
        columns: by heading, (values, unit). The headings are the same in every block of a table.
        done: share of the file read, 0..1.
        frames: of the columns that have one, by heading.
        segment: number of the segment of the clock, where the file says it.
        time_ns, arrival_ns: unix ns, where the file has more digits than these.
    """

    table: str
    time: Floats
    arrival: Floats
    columns: Mapping[str, tuple[Floats, str]]
    done: float
    frames: Mapping[str, str] = field(default_factory=dict)
    segment: Floats | None = None
    time_ns: Ints | None = None
    arrival_ns: Ints | None = None


def in_order_of_time(blocks: Sequence[TableRows]) -> TableRows:
    """The rows of all blocks as one, by their times."""
    last = blocks[-1]
    times = np.concatenate([np.where(np.isnan(one.time), one.arrival, one.time) for one in blocks])
    order = np.argsort(times, kind="stable")

    def joined(pieces: Sequence[Floats]) -> Floats:
        values: Floats = np.concatenate(pieces)[order]
        return values

    columns = {name: (joined([one.columns[name][0] for one in blocks]), last.columns[name][1]) for name in last.columns}
    segment = None if last.segment is None else joined([one.segment for one in blocks if one.segment is not None])
    time, arrival = joined([one.time for one in blocks]), joined([one.arrival for one in blocks])
    time_ns = [nanoseconds(one.time) if one.time_ns is None else one.time_ns for one in blocks]
    arrival_ns = [nanoseconds(one.arrival) if one.arrival_ns is None else one.arrival_ns for one in blocks]
    whole = [np.concatenate(ns)[order] for ns in (time_ns, arrival_ns)]
    return TableRows(last.table, time, arrival, columns, last.done, last.frames, segment, *whole)
