"""The unit of a device's timestamps, judged by when its frames arrive.

The document only recommends microseconds. A device that counts milliseconds advances by 1000 in a second, one that
counts microseconds by 1 000 000: three powers of ten lie between two units, and no clock or network is off by that
much. So the ticks that pass in two stretches of half a second or more of arrival are compared; both must say the same,
because what a link held back before it was opened arrives at once, in the first of them.

Source: IDTP v2.1.0, section 4.1, with its erratum 9.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from protocols.framing import Ints

UNITS: Mapping[str, int] = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": 1_000_000_000}
NAMES: Mapping[str, str] = {"ns": "nanoseconds", "us": "microseconds", "ms": "milliseconds", "s": "seconds"}

STRETCH_NS = 500_000_000
STRETCHES = 2
FEWEST_TICKS = 4  # a clock of seconds takes as long as it takes
NEAR = 0.5  # powers of ten by which the ticks may be off a unit
MOST_ROWS = 20_000  # looked at; a file without arrival times never tells
WRAP = 1 << 32


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Another unit than the one that is read would fit, and why."""

    unit: str
    reason: str


class UnitWatch:
    """Timestamps of one device beside their arrival.

    Args:
        unit: as which they are read.
    """

    def __init__(self, unit: str) -> None:
        self._unit = unit
        self._said: list[str] = []
        self._rows = 0
        self._raw = self._begin_ns = -1
        self._ticks = 0  # in this stretch
        self.found: Contradiction | None = None

    @property
    def done(self) -> bool:
        """No more rows are needed."""
        return len(self._said) == STRETCHES or self._rows > MOST_ROWS

    def look(self, raw: Ints, arrival_ns: Ints) -> None:
        """Rows of the device, in the order of the stream."""
        for stamp, arrival in zip(raw.tolist(), arrival_ns.tolist(), strict=True):
            if self.done:
                return
            self._rows += 1
            if self._begin_ns >= 0:
                self._ticks += (stamp - self._raw) % WRAP
            else:
                self._begin_ns = arrival
            self._raw = stamp
            if arrival - self._begin_ns >= STRETCH_NS and self._ticks >= FEWEST_TICKS:
                self._judge(arrival - self._begin_ns)
                self._begin_ns, self._ticks = arrival, 0

    def _judge(self, passed_ns: int) -> None:
        """One stretch is over."""
        rate = self._ticks / (passed_ns / 1e9)
        fits = [unit for unit, tick in UNITS.items() if rate and abs(math.log10(rate * tick / 1e9)) <= NEAR]
        self._said.append(fits[0] if fits else "")
        if len(self._said) < STRETCHES:
            return
        unit = self._said[0]
        if unit and unit != self._unit and len(set(self._said)) == 1:
            reason = (
                f"they advance by {rate:.0f} in a second of arrival, which fits {NAMES[unit]}, not {NAMES[self._unit]}"
            )
            self.found = Contradiction(unit, reason)
