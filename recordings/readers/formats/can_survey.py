"""First pass over a log of CAN frames: its buses and identifiers, and how its times go."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.can.lines import BUS, BUS_KEY, DATA, STAMP, payloads
from imuscope.protocols.can.survey import CanIdentifier
from imuscope.protocols.framing.stream_buffer import BODY, ID, LENGTH, SENDER

Since = Literal["1970", "start", "line", "none"]
"""What the times of a log are counted from."""

SAMPLE = 256  # frames of an identifier that are examined
MOST_IDENTIFIERS = 4096
MOST_STEPS = 1000
SECOND_NS = 1_000_000_000
BACK_NS = 1_000_000  # frames of two buses may be out of order by less
DATED_NS = 315_532_800 * SECOND_NS  # 1980: a later time is not since the start
STRAY_NS = 1_000_000_000
UNORDERED = 0.1  # of the times go back: they are those since the line before
NEXT_LINES = 8  # within which a time that is only out of order returns
FRAME_BYTES = 8


def strays(stamps: Ints) -> NDArray[np.bool_]:
    """(n,) whether a time since 1970 is far ahead of the one before and the one after, which are in order: damage."""
    is_stray = np.zeros(len(stamps), np.bool_)
    if len(stamps) > 2 and stamps[0] >= DATED_NS:
        before, now, after = stamps[:-2], stamps[1:-1], stamps[2:]
        is_stray[1:-1] = (now - before > STRAY_NS) & (now - after > STRAY_NS) & (after >= before)
    return is_stray


@dataclass(slots=True)
class LogSurvey:
    """Findings of the first pass.

    Args:
        identifiers: by the key of the bus and the number.
        buses: names by their keys.
        kinds: number of lines by kind.
        odd: lines without a frame.
        first: time of the first frame, ns.
        back: rows, from 0, at which the time goes back, and by how much, ns.
    """

    identifiers: dict[tuple[int, int], CanIdentifier] = field(default_factory=dict)
    buses: dict[int, str] = field(default_factory=dict)
    kinds: Counter[int] = field(default_factory=Counter)
    rows: int = 0
    odd: int = 0
    first: int = 0
    back: list[tuple[int, int]] = field(default_factory=list)
    _without: int = 0
    _unordered: int = 0
    _previous: int = 0
    _sum: int = 0
    _sums: dict[tuple[int, int], Ints] = field(default_factory=dict)

    def add(self, data: Bytes, table: Ints) -> None:
        """Add a block: its bytes, and the table of its frames (can_kernels.py)."""
        if not table.shape[1]:
            return
        kinds, counts = np.unique(table[SENDER], return_counts=True)
        for kind, count in zip(kinds.tolist(), counts.tolist(), strict=True):
            self.kinds[kind] += count
        sums = self._sum + np.cumsum(table[STAMP])
        self._sum = int(sums[-1])
        self._add_times(table[STAMP])
        is_data = table[SENDER] == DATA
        frames, sums = np.ascontiguousarray(table[:, is_data]), sums[is_data]
        _, numbers, counts = np.unique(frames[BUS_KEY] ^ frames[ID] << 15, return_inverse=True, return_counts=True)
        order, last = np.argsort(numbers, kind="stable"), 0
        for count in counts.tolist():
            self._add_frames(data, frames, order[last : last + count], sums)
            last += count

    def since(self, *, is_relative: bool) -> Since:
        """Origin of its times; `is_relative`: its head says that they are those since the line before."""
        if self._without == self.rows:
            return "none"
        if is_relative or self._unordered > UNORDERED * self.rows:
            for key, sums in self._sums.items():
                self.identifiers[key].stamps = sums
            return "line"
        return "1970" if self.first >= DATED_NS else "start"

    def of_bus(self, bus: str) -> Mapping[int, CanIdentifier]:
        """Identifiers of a bus, by number."""
        return {one.number: one for one in self.identifiers.values() if one.bus == bus}

    def _add_times(self, stamps: Ints) -> None:
        if not self.rows:
            self.first = self._previous = int(stamps[0])
        self._without += int(np.count_nonzero(stamps < 0))
        before = np.concatenate(([self._previous], stamps[:-1]))
        self._unordered += int(np.count_nonzero(stamps < before))
        for row in np.flatnonzero(before - stamps > BACK_NS)[:MOST_STEPS].tolist():
            is_back = not (stamps[row : row + NEXT_LINES] > before[row]).any()
            if is_back and len(self.back) < MOST_STEPS:
                self.back.append((self.rows + row, int(before[row] - stamps[row])))
        self._previous = int(stamps[-1])
        self.rows += len(stamps)

    def _add_frames(self, data: Bytes, frames: Ints, which: Ints, sums: Ints) -> None:
        bus, number = int(frames[BUS_KEY, which[0]]), int(frames[ID, which[0]])
        if bus not in self.buses:
            begin = int(frames[BUS, which[0]])
            self.buses[bus] = bytes(data[begin : begin + 32]).split()[0].decode(errors="replace")
        key = bus, number
        if key not in self.identifiers and len(self.identifiers) >= MOST_IDENTIFIERS:
            return
        one = self.identifiers.setdefault(key, CanIdentifier(self.buses[bus], number))
        lengths, counts = np.unique(frames[LENGTH, which], return_counts=True)
        for length, count in zip(lengths.tolist(), counts.tolist(), strict=True):
            one.of_length[length] = one.of_length.get(length, 0) + count
        chosen = which[: SAMPLE - len(one.stamps)]
        if len(chosen):
            rows = np.empty((len(chosen), FRAME_BYTES), np.uint8)
            payloads(data, frames[BODY, chosen], frames[LENGTH, chosen], rows)
            one.data = np.concatenate((one.data, rows))
            one.stamps = np.concatenate((one.stamps, frames[STAMP, chosen]))
            self._sums[key] = np.concatenate((self._sums.get(key, one.stamps[:0]), sums[chosen]))
