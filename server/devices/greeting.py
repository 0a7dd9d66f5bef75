"""The question who a device is, asked once for each connection."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable

from server.links.base import LinkError


class Greeting:
    """Of one session.

    Args:
        send: writes to the device.
        source: of its link, for the task's name.
    """

    def __init__(self, send: Callable[[bytes], Awaitable[None]], source: str) -> None:
        self._send = send
        self._source = source
        self._asked = False
        self._task: asyncio.Task[None] | None = None

    def anew(self) -> None:
        """There is a new connection: whoever is there may be asked again."""
        self._asked = False

    def ask(self, greeting: bytes) -> None:
        """Send it (b"" for nothing), unless that was done on this connection."""
        if self._asked:
            return
        self._asked = True

        async def send() -> None:
            with contextlib.suppress(LinkError):  # no way back, or nobody there any more: reading finds that out
                await self._send(greeting)

        if greeting:
            self._task = asyncio.get_running_loop().create_task(send(), name=f"greeting {self._source}")

    async def close(self) -> None:
        """Stop asking."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
