"""Detection of the unit of a device's timestamps from the arrival of its frames.

The document only recommends microseconds. A device that counts milliseconds advances by 1000 in a second, one that
counts microseconds by 1 000 000: units differ by three powers of ten, and no clock or network is off by that much. So
the ticks in two stretches of half a second or more of arrival are compared; both must agree, because data held back
by a link before it was opened arrives at once, in the first stretch.

Source: IDTP v2.1.0, section 4.1, with its erratum 9.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Ints

UNITS: Mapping[str, int] = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}
NAMES: Mapping[str, str] = {"ns": "nanoseconds", "us": "microseconds", "ms": "milliseconds", "s": "seconds"}

STRETCH_NS = 500_000_000
STRETCHES = 2
FEWEST_TICKS = 4  # a clock of seconds needs some time
TICK_TOLERANCE = 0.5  # tolerance of the ticks, powers of ten
MAX_ROWS = 20_000  # examined; a file without arrival times never gives a result
WRAP = 1 << 32
MIN_ARRAY_ROWS = 64  # from this many rows on arrays are faster


@dataclass(frozen=True, slots=True)
class Contradiction:
    """A unit that would fit better than the configured one, and why."""

    value: str
    reason: str
    subject: str = "timestamps"


class UnitWatch:
    """Timestamps of one device beside their arrival.

    Args:
        unit: as configured.
    """

    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._reported: list[str] = []
        self._rows = 0
        self._raw = self._begin_ns = -1
        self._ticks = 0  # in this stretch
        self.contradiction: Contradiction | None = None

    @property
    def done(self) -> bool:
        """No more rows are needed."""
        return len(self._reported) == STRETCHES or self._rows > MAX_ROWS

    def observe(self, raw: Ints, arrival_ns: Ints) -> None:
        """Add rows of the device, in stream order."""
        if len(raw) >= MIN_ARRAY_ROWS:
            self._observe_many(raw, arrival_ns)
            return
        for stamp, arrival in zip(raw.tolist(), arrival_ns.tolist(), strict=True):
            if self.done:
                return
            self.add(stamp, arrival)

    def add(self, stamp: int, arrival_ns: int) -> bool:
        """The same for one row, while more are needed; whether it was the last one."""
        self._rows += 1
        if self._begin_ns >= 0:
            self._ticks += (stamp - self._raw) % WRAP
        else:
            self._begin_ns = arrival_ns
        self._raw = stamp
        if arrival_ns - self._begin_ns >= STRETCH_NS and self._ticks >= FEWEST_TICKS:
            self._judge(arrival_ns - self._begin_ns)
            self._begin_ns, self._ticks = arrival_ns, 0
            return self.done
        return self._rows > MAX_ROWS

    def _observe_many(self, raw: Ints, arrival_ns: Ints) -> None:
        """The same for many rows, a stretch at a time."""
        row = 0
        while row < len(raw) and not self.done:
            stop = min(len(raw), row + MAX_ROWS + 1 - self._rows)
            arrivals = arrival_ns[row:stop]
            if self._begin_ns < 0:
                self._begin_ns, self._raw = int(arrivals[0]), int(raw[row])
            ticks = self._ticks + np.cumsum(np.diff(raw[row:stop], prepend=self._raw) % WRAP)
            over = (arrivals - self._begin_ns >= STRETCH_NS) & (ticks >= FEWEST_TICKS)
            last = int(np.argmax(over)) if over.any() else stop - row - 1
            self._rows += last + 1
            self._raw, self._ticks = int(raw[row + last]), int(ticks[last])
            if over[last]:
                self._judge(int(arrivals[last]) - self._begin_ns)
                self._begin_ns, self._ticks = int(arrivals[last]), 0
            row += last + 1

    def _judge(self, passed_ns: int) -> None:
        """Judge a finished stretch."""
        rate = self._ticks / (passed_ns / 1e9)
        fits = [unit for unit, tick in UNITS.items() if rate and abs(math.log10(rate * tick / 1e9)) <= TICK_TOLERANCE]
        self._reported.append(fits[0] if fits else "")
        if len(self._reported) < STRETCHES:
            return
        unit = self._reported[0]
        if unit and unit != self._unit and len(set(self._reported)) == 1:
            reason = (
                f"they advance by {rate:.0f} in a second of arrival, which fits {NAMES[unit]}, not {NAMES[self._unit]}"
            )
            self.contradiction = Contradiction(unit, reason)
