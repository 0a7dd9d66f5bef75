"""Packets: several rows with one time, as loggers write samples that came together. They are spread over the packet.

    Timestamp    5000  5000  5000  5000  5077  5077  5077  5077       ms, of the first sample of each packet
    axis         5000  5019  5038  5058  5077  5096  5115  5135

Which end of a packet its time belongs to is an option. Without it, the time that a program wrote is that of the last
sample, since the packet had to arrive first; that of a device belongs to the first one. Rows of several sensors at one
time, which a column or the empty cells distinguish, are not one.
"""

import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.recordings.tables.clock import TableClock
from imuscope.recordings.tables.clocks.sample import TableSample
from imuscope.recordings.tables.options import PacketStamp

FEWEST_PACKETS = 3
PACKET_SHARE = 0.5  # of the rows have the time of the row before
MAX_LENGTHS = 1.5  # usual lengths of a packet: after a longer one samples are missing
WHOLE = 0.01  # of a count, by which times may differ from whole ones
_OF_PROGRAM = re.compile(
    r"(?:^|_)(?:phone|host|pc|computer|server|client|received?|recv|rx|arrival|log|logging|wall|system)(?:_|$)"
)


class PacketSpread:
    """Times of rows inside of their packets.

    Args:
        stamp: which sample of a packet has its time.
        why: the reason, as words in brackets.
        row_s: time from row to row.
        is_counted: whether the clock counts in steps, so that the first packet may have begun before the file.
    """

    def __init__(self, stamp: PacketStamp, why: str, row_s: float, *, is_counted: bool = False) -> None:
        self.stamp, self.why, self._row_s, self._is_counted = stamp, why, row_s, is_counted
        self._rows = 0
        self._last = float("nan")
        self._pieces: list[tuple[NDArray[np.int64], Floats]] = []
        self._starts: NDArray[np.int64] = np.zeros(0, np.int64)
        self._bases = self._steps = np.zeros(0)

    def feed(self, times: Floats) -> None:
        """Add the times of further rows, all known."""
        begins = np.flatnonzero(np.diff(times, prepend=self._last) != 0)
        self._pieces.append((self._rows + begins, times[begins]))
        self._rows += len(times)
        self._last = float(times[-1]) if len(times) else self._last

    def end(self) -> None:
        """Compute the times of all packets."""
        if not self._pieces:
            return
        self._starts, times = (np.concatenate(part) for part in zip(*self._pieces, strict=True))
        sizes = np.diff(np.append(self._starts, self._rows))
        lengths = np.diff(times)
        usual = (sizes[:-1] if self.stamp == "first" else sizes[1:]) * self._row_s
        inner = np.where((lengths > 0) & (lengths <= MAX_LENGTHS * usual), lengths / np.maximum(usual, 1e-300), 1.0)
        inner = np.append(inner, 1.0) if self.stamp == "first" else np.insert(inner, 0, 1.0)
        if self._is_counted:
            inner[:1] = 1.0
        self._steps = inner * self._row_s
        self._bases = times if self.stamp == "first" else times - (sizes - 1) * self._steps
        if self._is_counted and self.stamp == "first" and len(times) > 1 and 0 < lengths[0] <= 1 / WHOLE * usual[0]:
            self._bases = np.append(times[1] - usual[0], times[1:])
        self._pieces.clear()

    def times(self, first_row: int, count: int) -> Floats:
        """Times of rows, s."""
        rows = np.arange(first_row, first_row + count)
        packet = np.searchsorted(self._starts, rows, "right") - 1
        spread: Floats = self._bases[packet] + (rows - self._starts[packet]) * self._steps[packet]
        return spread

    def words(self, name: str) -> str:
        """A sentence for people."""
        sizes = np.diff(self._starts)
        other = "last" if self.stamp == "first" else "first"
        count = f"{float(np.median(sizes)):.0f}" if len(sizes) else "Several"
        return (
            f"{count} rows share each time of {name}: they are spread over the packet, whose {self.stamp} sample has "
            f"it ({self.why}; to change it: --packet-stamp {other})."
        )


def spread_of(sample: TableSample, clock: TableClock, times: Floats, row_s: float) -> PacketSpread | None:
    """The packets of a table; None if its rows have times of their own.

    Args:
        times: of the first rows, all known.
    """
    steps, chosen = np.diff(times), sample.options.packet_stamp
    repeats = int(np.count_nonzero(steps == 0))
    if not row_s or not repeats or len(np.unique(times)) < FEWEST_PACKETS or sample.is_common(clock):
        return None
    if not chosen and (repeats <= PACKET_SHARE * len(times) or _are_of_several(sample, clock)):
        return None
    count = float(f"{steps[steps > 0].min():.3g}")
    counts = times / count
    is_counted = bool(np.abs(counts - np.round(counts)).max() < WHOLE)
    words = " ".join(sample.words(column) for column in clock.columns).replace(" ", "_")
    stamp: PacketStamp
    if chosen:
        stamp, why = chosen, "as chosen"
    elif is_counted and sample.epoch(float(times[0])) == "1970":
        stamp, why = "first", f"it counts steps of {count:g} s"
    elif _OF_PROGRAM.search(words):
        stamp, why = "last", "a program stamps a packet that has arrived"
    else:
        stamp, why = "first", "as most devices do"
    return PacketSpread(stamp, why, row_s, is_counted=is_counted)


def _are_of_several(sample: TableSample, clock: TableClock) -> bool:
    """Whether the rows of one time are of several sensors: a column distinguishes them, in the same way each time, or
    they fill different columns.
    """
    rows = sample.form.sample
    keys = [tuple(row[column] for column in clock.columns) for row in rows]
    begins = [i for i in range(1, len(rows)) if keys[i] != keys[i - 1]]
    packets = [range(*edges) for edges in pairwise(begins)]
    forms = [{tuple(map(bool, map(str.strip, rows[i]))) for i in packet} for packet in packets]
    if sum(len(one) > 1 for one in forms) > PACKET_SHARE * len(packets):  # each fills other columns
        return True
    return any(
        _is_key([[rows[i][column] for i in packet] for packet in packets])
        for column in range(len(sample.headings))
        if column not in clock.columns
    )


def _is_key(packets: Sequence[Sequence[str]]) -> bool:
    return len({tuple(one) for one in packets}) == 1 and len({*packets[0]}) == len(packets[0]) > 1
