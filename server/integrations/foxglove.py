"""Foxglove, Lichtblick, PlotJuggler: how do they attach to what is live? (`--foxglove`, which is off by default)

    ws://127.0.0.1:8765             on this machine; it can only be read
    ws://HOST:8080/foxglove         through our own port, with its TLS

The first listens on loopback only, whatever --host says; beyond this machine there is the second and nothing else. The
same rules hold for both (server/auth.py): where the server needs a token, each needs it (?token=…), and the web
application of Foxglove is a foreign page whose origin must be among `allowed_origins`.

The protocol is spoken in a process of its own (server/integrations/foxglove_worker.py), which is started after the
server serves and again when it has fallen over, later each time.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Mapping
from typing import Any

from server.auth import Access
from server.integrations.proxy import ViewError
from server.integrations.shared_secret import SecretEndpoint, new_secret
from server.integrations.viewer_process import ViewerProcess
from server.streaming.hub import Hub

MODULE = "server.integrations.foxglove_worker"
OFF = -1
DEFAULT_PORT = 8765  # where Foxglove's own tools look first
START_S = 60.0
AGAIN_S, LONGEST_S = 1.0, 60.0
STEADY_S = 120.0  # having run for so long, the next fall counts as the first

log = logging.getLogger("imuscope.foxglove")


class Foxglove:
    """The bridge of a server. To be used in its event loop.

    Args:
        wanted: port on loopback; 0 for any free one; OFF for none.
        access: the rules for whoever comes to that port.
    """

    def __init__(self, hub: Hub, wanted: int, access: Access) -> None:
        self._hub = hub
        self._wanted = wanted
        self._access = access
        self._secret = new_secret()
        self._task: asyncio.Task[None] | None = None
        self._aside: ViewerProcess | None = None
        self._ended = asyncio.Event()
        self._served: asyncio.Future[int] | None = None

    @property
    def pid(self) -> int | None:
        """Of its process; None while there is none."""
        return None if self._aside is None else self._aside.pid

    def start(self) -> None:
        """Begin, in the background, if it is wanted."""
        if self._wanted != OFF:
            self._served = asyncio.get_running_loop().create_future()
            self._task = asyncio.create_task(self._keep_running(), name="foxglove")

    async def door(self) -> SecretEndpoint:
        """Where it listens, on loopback, and what to say there.

        Raises:
            ViewError: it is not wanted, or not there.
        """
        if self._served is None:
            raise ViewError("This server does not speak the Foxglove protocol.", "Start it with --foxglove.")
        try:
            async with asyncio.timeout(START_S):
                return SecretEndpoint(await asyncio.shield(self._served), self._secret)
        except TimeoutError:
            raise ViewError("The Foxglove bridge is not there.", "The events of the page say why.") from None

    async def close(self) -> None:
        """End it."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        if self._served is not None:
            self._served.cancel()

    async def _keep_running(self) -> None:
        pause = AGAIN_S
        loop = asyncio.get_running_loop()
        while True:
            began = loop.time()
            self._ended.clear()
            self._aside = ViewerProcess(self._hub, MODULE, self._told, self._crashed)
            try:
                with contextlib.suppress(OSError):
                    await self._aside.start()
                    self._aside.say(op="serve", port=self._wanted, secret=self._secret, rules=self._access.rules())
                    await self._ended.wait()
            finally:
                aside, self._aside = self._aside, None
                await aside.stop()
            if self._served is None or self._served.done():
                self._served = loop.create_future()
            pause = AGAIN_S if loop.time() - began > STEADY_S else min(2 * pause, LONGEST_S)
            await asyncio.sleep(pause)

    def _told(self, words: Mapping[str, Any]) -> None:
        if words["op"] == "served" and self._served is not None and not self._served.done():
            self._served.set_result(int(words["port"]))
            text = f"The Foxglove protocol is spoken on ws://127.0.0.1:{words['port']} and at /foxglove."
            self._hub.event("", "device", "info", text)
        elif words["op"] == "failed":
            hint = f"Is port {self._wanted} in use? Give another: --foxglove PORT, or 0 for any free one."
            text = f"The Foxglove protocol cannot be spoken: {words['why']}."
            self._hub.event("", "device", "fault", text, data={"hint": hint})
            self._ended.set()

    def _crashed(self, words: str) -> None:
        text = "The Foxglove bridge ended by itself and is started again."
        self._hub.event("", "device", "caution", text, data={"said": words[-500:]})
        self._ended.set()
