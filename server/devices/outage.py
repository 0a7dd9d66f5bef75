"""A link that was down: since when, and how many samples passed meanwhile.

A new connection has a new decoder, which cannot know what its predecessor missed. Where the device counts its frames
the numbers before and after tell. But a counter wraps, and one of a device that was switched off begins anew, so what
it says is believed only if the time that passed agrees, at the rate at which it counted before.

    last number ── link down for `seconds` ──> first number      missing = first - last - 1, modulo what it counts to
                                                                 believed if about seconds * rate
"""

from __future__ import annotations

from protocols.events import Count, Counts
from server.devices.device_demux import LinkDevice

SHORTEST_S = 1.0  # of a connection, from which a rate is learnt
SHARE = 0.2  # by which rate and time may be off,
SLACK_S = 0.5  # and what links and adapters may hold back


class Outage:
    """What is known of the connection before, while a link is down."""

    def __init__(self) -> None:
        self._since: float | None = None  # last arrival before the link went while it was live
        self._began: float | None = None  # of this connection: arrival of its first samples
        self._before: tuple[Count, float] | None = None  # of the connection before, and counts per second

    def begin(self, decoder: object, sender: LinkDevice) -> None:
        """The link went."""
        last = sender.figures.last_arrival
        if self._since is None and last is not None:
            self._since = last
            count = decoder.count_of(sender.name) if isinstance(decoder, Counts) else None
            length = last - self._began if self._began is not None else 0.0
            rate = count.passed / length if count and length >= SHORTEST_S else 0.0
            self._before = (count, rate) if count and rate > 0 else None
        self._began = None

    def over(self, decoder: object, sender: LinkDevice, now: float | None) -> None:
        """Samples come again: tell what was missed. `now`: arrival of the newest; None: nothing was."""
        if self._since is not None and now is not None:
            known = self._missing(decoder, sender.name, now - self._since)
            sender.incidents.outage((self._since, now), known)
            if known is not None:
                sender.figures.gaps += 1
                sender.figures.lost += known[1]
        self._since = self._before = None
        if self._began is None:
            self._began = sender.figures.last_arrival

    def _missing(self, decoder: object, device: str, seconds: float) -> tuple[str, int] | None:
        """Which counter says how many samples passed in an outage; None where none does that can be believed."""
        now = decoder.count_of(device) if isinstance(decoder, Counts) else None
        if now is None or self._before is None:
            return None
        before, rate = self._before
        if now.counter != before.counter or now.modulus != before.modulus:
            return None
        expected = seconds * rate
        unsure = SHARE * expected + SLACK_S * rate + 1
        if unsure >= now.modulus / 2:
            return None
        missing = (now.first - before.last - 1) % now.modulus
        missing += max(0, round((expected - missing) / now.modulus)) * now.modulus
        return (now.counter, missing) if abs(missing - expected) <= unsure else None
