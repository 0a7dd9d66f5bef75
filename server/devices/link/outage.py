"""Outage of a link: its duration, and the number of samples missed.

A new connection has a new decoder without knowledge of the previous one. If the device counts its frames, the numbers
before and after give the loss. But a counter wraps, and restarts if the device was switched off, so the result is
accepted only if it agrees with the elapsed time at the previous rate.

    last number ── link down for `seconds` ──> first number      missing = first - last - 1, modulo the counter's range
                                                                 accepted if about seconds * rate
"""

from imuscope.protocols.events import Count, Counts
from imuscope.server.devices.device.device_demux import LinkDevice

SHORTEST_S = 1.0  # of a connection from which a rate is measured
RATE_TOLERANCE = 0.2  # tolerance of rate and time,
SLACK_S = 0.5  # plus the time for which links and adapters may hold bytes back


class Outage:
    """Last connection before an outage."""

    def __init__(self) -> None:
        self._since: float | None = None  # last arrival before the link went down while it was live
        self._began: float | None = None  # of this connection: arrival of its first samples
        self._before: tuple[Count, float] | None = None  # of the previous connection, and counts per second

    def begin(self, decoder: object, sender: LinkDevice) -> None:
        """Note that the link went down."""
        last = sender.stats.last_arrival
        if self._since is None and last is not None:
            self._since = last
            count = decoder.count_of(sender.name) if isinstance(decoder, Counts) else None
            length = last - self._began if self._began is not None else 0.0
            rate = count.passed / length if count and length >= SHORTEST_S else 0.0
            self._before = (count, rate) if count and rate > 0 else None
        self._began = None

    def end(self, decoder: object, sender: LinkDevice, now: float | None) -> None:
        """Report the loss when samples arrive again. `now`: arrival of the newest; None if there was no outage."""
        if self._since is not None and now is not None:
            known = self._missing(decoder, sender.name, now - self._since)
            sender.events.outage((self._since, now), known)
            if known is not None:
                sender.stats.gaps += 1
                sender.stats.lost += known[1]
        self._since = self._before = None
        if self._began is None:
            self._began = sender.stats.last_arrival

    def _missing(self, decoder: object, device: str, seconds: float) -> tuple[str, int] | None:
        """Counter and number of samples missed in an outage; None if no counter is reliable."""
        now = decoder.count_of(device) if isinstance(decoder, Counts) else None
        if now is None or self._before is None:
            return None
        before, rate = self._before
        if now.counter != before.counter or now.modulus != before.modulus:
            return None
        expected = seconds * rate
        unsure = RATE_TOLERANCE * expected + SLACK_S * rate + 1
        if unsure >= now.modulus / 2:
            return None
        missing = (now.first - before.last - 1) % now.modulus
        missing += max(0, round((expected - missing) / now.modulus)) * now.modulus
        return (now.counter, missing) if abs(missing - expected) <= unsure else None
