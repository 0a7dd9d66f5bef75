"""Fault injection for the answers of the simulated MTi.

    drop_share             an answer is lost
    corrupt_share          a valid message is sent, but not the requested one
    late_ns                the answer comes after the host has given up or repeated the request
    power_cut_at           power fails after a setting was accepted and before it was stored: no answer, a restart, the
                           old value
    ignores_goto_config    GoToConfig is ignored until the device has been Reset, as some devices do

Measured data are not affected: cables lose those (server/links/simulated_line.py). This module imports no compiled
    code.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FaultInjection:
    """Faults of answers.

    Args:
        drop_share, corrupt_share: share of answers, 0 to 1.
        late_ns: delay of every answer.
        power_cut_at: number of the store that fails, from 1; 0 for none.
        ignores_goto_config: whether GoToConfig is ignored until Reset.
    """

    drop_share: float = 0.0
    corrupt_share: float = 0.0
    late_ns: int = 0
    power_cut_at: int = 0
    ignores_goto_config: bool = False


NONE = FaultInjection()
