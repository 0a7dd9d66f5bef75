"""Parts of a server that its extensions bring: built from its services, started and closed with them."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from imuscope.server.errors import DomainError

T = TypeVar("T")


def _nothing() -> None:
    """Start nothing."""


@dataclass(frozen=True, slots=True)
class ServicePart:
    """One long-lived object of an extension.

    Args:
        name: in words, for the log: "viser".
        service: the object, which routes of the extension find by its type.
        close: frees everything; the end of the server waits a second for it.
        start: called once the sources are open.
        sends: it sends to devices, so that it is closed before them.
    """

    name: str
    service: object
    close: Callable[[], Awaitable[None]]
    start: Callable[[], Awaitable[None] | None] = _nothing
    sends: bool = False


class Parts:
    """All parts of a server, in the order in which they are started."""

    def __init__(self) -> None:
        self._all: list[ServicePart] = []

    def add(self, part: ServicePart) -> None:
        """Add a part, before the server is started."""
        self._all.append(part)

    def __iter__(self) -> Iterator[ServicePart]:
        return iter(self._all)

    def get(self, kind: type[T]) -> T:
        """The service of that type.

        Raises:
            DomainError: "no-extension": its extension is not installed.
        """
        for part in self._all:
            if isinstance(part.service, kind):
                return part.service
        raise DomainError(
            "no-extension", f"This server has no {kind.__name__}.", "Install the extension that brings it."
        )

    async def close_senders(self) -> None:
        """Close the parts that send to devices."""
        await asyncio.gather(*(part.close() for part in self._all if part.sends))

    async def start(self) -> None:
        """Start all parts, one after the other."""
        for part in self._all:
            started = part.start()
            if inspect.isawaitable(started):
                await started
