"""Parts of a server that its extensions bring: built from its services, started and closed with them."""

import asyncio
import inspect
from collections import Counter
from collections.abc import Awaitable, Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from imuscope.server.errors import DomainError
from imuscope.server.text.prometheus import PrometheusText

if TYPE_CHECKING:
    from starlette.types import ASGIApp

T = TypeVar("T")


def _nothing() -> None:
    """Start nothing."""


async def _nothing_to_close() -> None:
    """Close nothing."""


@dataclass(frozen=True, slots=True)
class ServicePart:
    """One long-lived object of an extension.

    Args:
        name: in words, for the log: "viser".
        service: the object, which routes of the extension find by its type.
        close: frees everything; the end of the server waits a second for it.
        start: called once the sources are open; of a part for requests, at the first of them.
        before_recorder: called before the recorder ends, by a part that starts and stops recordings.
        sends: it sends to devices, so that it is closed before them.
        metrics: adds its figures to the page for Prometheus.
        viewed: called when a browser opens a page.
        serves: called with the application, which it may ask, before the start.
    """

    name: str
    service: object
    close: Callable[[], Awaitable[None]] = _nothing_to_close
    start: Callable[[], Awaitable[None] | None] = _nothing
    before_recorder: Callable[[], Awaitable[None]] | None = None
    sends: bool = False
    metrics: Callable[[PrometheusText], None] | None = None
    viewed: Callable[[], None] = _nothing
    serves: "Callable[[ASGIApp], None] | None" = None


class Parts:
    """All parts of a server, in the order in which they are started."""

    def __init__(self) -> None:
        self._all: list[ServicePart] = []

    def add(self, parts: Iterable[ServicePart]) -> list[ServicePart]:
        """Add the parts of an extension; returns them.

        Raises:
            ValueError: a name is taken; none is added.
        """
        new = [*parts]
        names = Counter(part.name for part in (*self._all, *new))
        if duplicates := [name for name, count in names.items() if count > 1]:
            raise ValueError(f"there is a part {duplicates[0]!r} already")
        self._all += new
        return new

    def __iter__(self) -> Iterator[ServicePart]:
        return iter(self._all)

    def get(self, kind: type[T]) -> T:
        """The service of that type.

        Raises:
            DomainError: "no-extension": its extension is not installed.
        """
        part = self.find(kind)
        if part is not None:
            return part
        raise DomainError(
            "no-extension", f"This server has no {kind.__name__}.", "Install the extension that brings it."
        )

    def find(self, kind: type[T]) -> T | None:
        """The service of that type; None without one."""
        return next((part.service for part in self._all if isinstance(part.service, kind)), None)

    def serve(self, app: "ASGIApp") -> None:
        """Give the application to the parts that answer requests with it."""
        for part in self._all:
            if part.serves is not None:
                part.serves(app)

    def viewed(self) -> None:
        """Notify the parts that a browser has opened a page."""
        for part in self._all:
            part.viewed()

    @property
    def metrics(self) -> list[Callable[[PrometheusText], None]]:
        """Functions that add figures of parts to the page for Prometheus."""
        return [part.metrics for part in self._all if part.metrics is not None]

    async def leave_recorder(self) -> None:
        """Let no part start or stop recordings any more."""
        await asyncio.gather(*(part.before_recorder() for part in self._all if part.before_recorder is not None))

    async def close_senders(self) -> None:
        """Close the parts that send to devices."""
        await asyncio.gather(*(part.close() for part in self._all if part.sends))

    async def start(self) -> None:
        await start(self._all)


async def start(parts: Iterable[ServicePart]) -> None:
    for part in parts:
        started = part.start()
        if inspect.isawaitable(started):
            await started
