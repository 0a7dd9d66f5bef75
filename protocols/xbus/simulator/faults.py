"""What can go wrong with the answers of a simulated MTi, on purpose?

    mute     an answer never leaves the device
    wrong    it says something else: a valid message, but not the one that was asked for
    late     it comes so much later that the host has given up or asked again
    cut      power fails after a setting was taken and before it was stored: no answer, a restart, the old value
    stubborn GoToConfig is not heard until the device has been Reset, as some devices do

Measured data are not touched: cables lose those (server/links/simulated_line.py). This file loads nothing that is
compiled.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FaultInjection:
    """Faults of answers.

    Args:
        mute, wrong: share of answers, 0 to 1.
        late_ns: by how much every answer is late.
        cut: which store fails, counted from 1; 0 for none.
        stubborn: deaf to GoToConfig until Reset.
    """

    mute: float = 0.0
    wrong: float = 0.0
    late_ns: int = 0
    cut: int = 0
    stubborn: bool = False


NONE = FaultInjection()
