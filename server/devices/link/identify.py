"""Identification request to a device, sent once for each connection."""

import asyncio
import contextlib
from collections.abc import Awaitable, Callable

from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.links.base import LinkError


class IdentifyRequest:
    """Identification request of one session.

    Args:
        send: writes to the device.
        source: source of its link, for the task's name.
    """

    def __init__(self, send: Callable[[bytes], Awaitable[object]], source: str) -> None:
        self._send = send
        self._source = source
        self._requested = False
        self._task: asyncio.Task[None] | None = None

    def restart(self) -> None:
        """Allow another request, on a new connection."""
        self._requested = False

    def request(self, identify_request: bytes) -> None:
        """Send the request (b"" for none), unless it was sent on this connection."""
        if self._requested:
            return
        self._requested = True

        async def send() -> None:
            with contextlib.suppress(LinkError):  # no way to send, or the link is gone: reading will report it
                await self._send(identify_request)

        if identify_request:
            self._task = asyncio.get_running_loop().create_task(send(), name=f"identification {self._source}")

    async def close(self) -> None:
        """Cancel a pending request."""
        await end_tasks(self._task)
