"""Time limits and retries of configuration. Tests pass shorter ones."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ConfigurationTimings:
    """Time limits, s, and numbers of retries.

    Args:
        rollback_s: time to confirm settings that could cut the link; then they are rolled back.
        rounds: number of attempts to find a device that restarts, at each of its possible rates in turn.
        restart_s: wait for the port of a restarting device, which answers after 2 s.
        port_back_s: wait for a port that vanished because USB restarts with the device.
        port_poll_s: interval of attempts to open it.
        return_s: wait for the user to cycle the power of the device.
        reopen_s: interval of attempts to open a port during `return_s`; a device accepts the call only for a moment
            after power-on.
        sample_s: wait for a sample, which shows that a device measures.
        patience: factor of the time that the answer to a request has (transaction_runner.py).
    """

    rollback_s: float = 20.0
    rounds: int = 4
    restart_s: float = 3.0
    port_back_s: float = 60.0
    port_poll_s: float = 1.0
    return_s: float = 120.0
    reopen_s: float = 0.05
    sample_s: float = 1.5
    patience: float = 1.0
