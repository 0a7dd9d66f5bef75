"""Do bytes come in which nothing can be read any more? A device that was there, at another rate or in another protocol.

A wrong rate is not silence: bytes go on to come, and no frame is in them. Some are refused, most never look like one.
So it is told by what is missing: for `DEAF_S` no frame, sentence or answer, among `LEAST_BYTES` at least.
"""

from __future__ import annotations

from collections.abc import Sequence

from server.devices.link_stats import LinkStatistics
from server.links.base import Link, LinkError

DEAF_S = 2.0
LEAST_BYTES = 100  # fewer may be one long frame that is still on its way


class DecodeWatchdog:
    """Of one link."""

    def __init__(self) -> None:
        self._read = -1  # frames so far
        self._since = 0.0  # when there was one last
        self._bytes = 0  # so far, then

    def look(self, now: float, figures: Sequence[LinkStatistics], meant: bool) -> bool:
        """Is it so now? To be asked a few times a second.

        Args:
            figures: of each device of the link: while one of them can be read, another is silent.
            meant: one is being configured.
        """
        read = sum(meter.total for one in figures for meter in one.messages.values())
        heard = figures[0].bytes.total  # the link's
        if read != self._read or meant:
            self._read, self._since, self._bytes = read, now, heard
            return False
        return now - self._since > DEAF_S and heard - self._bytes > LEAST_BYTES


def undecodable_text(link: Link) -> tuple[str, str]:
    """What a person is told of it, message and hint; a link that finds its rate by itself looks for it again."""
    text = f"Bytes come from {link.source}, but for {DEAF_S:g} s nothing in them could be read."
    if link.finds_rate:
        hint = "Has its rate changed? It is looked for again."
        link.give_up(LinkError("gone", text, hint))
    elif link.baud is not None:
        hint = f"Has its rate changed from {link.baud} Bd? Open it at the new one, or without one to have it found."
    else:
        hint = "Has the rate between the device and its adapter changed, or its protocol?"
    return text, hint
