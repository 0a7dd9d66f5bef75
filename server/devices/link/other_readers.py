"""Another program that opens the port of a link after this server: each would get a part of the bytes.

Nothing is known about it beforehand, because few programs lock a port. It is looked for when bytes are damaged, missing
or absent, and the port is then left to it until it ends: it may be the robot's driver.
"""

import asyncio

from imuscope.server.devices.device.link_stats import LinkStatistics
from imuscope.server.links.base import Link

SEARCH_S, SILENT_SEARCH_S = 5.0, 30.0  # between two searches of all programs, which take some milliseconds


class OtherReaders:
    """The watch over the port of one link."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._faults = 0
        self._due = self._silent_due = 0.0
        self._search: asyncio.Task[None] | None = None

    def tick(self, now: float, stats: LinkStatistics, *, is_silent: bool) -> None:
        """Look for other programs if bytes were lost since the last search, or none come."""
        faults = stats.rejects + stats.lost
        if now < self._due or (faults <= self._faults and not (is_silent and now >= self._silent_due)):
            return
        self._faults, self._due, self._silent_due = faults, now + SEARCH_S, now + SILENT_SEARCH_S
        if self._search is None or self._search.done():
            self._search = asyncio.get_running_loop().create_task(self._find(), name="other readers")

    async def _find(self) -> None:
        error = await asyncio.to_thread(self._link.other_reader)
        if error is not None:
            self._link.fail(error)
