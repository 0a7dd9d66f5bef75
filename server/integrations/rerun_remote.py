"""How is a Rerun viewer on another machine (`--rerun-connect`) kept up to date, for as long as the server runs?

    Hub ──viewer_process.py──> python -m server.integrations.rerun_worker ──gRPC, by Rerun's own SDK──> the viewer

The SDK neither bounds what waits for a viewer that takes nothing nor connects anew after a break. So the process sends
no more before the last was taken, ends itself when nothing is for `STUCK_S`, and is begun again here, later each time.
Whoever has just been reached gets the last half minute, newest first; what happened meanwhile is left out, because the
present matters more. Both are told as events, once each.

    says:  {"op": "reached"}     the viewer has taken what was sent for a while
           {"op": "stuck"}       it takes nothing; the process ends
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Mapping
from typing import Any

from server import wire
from server.integrations.viewer_process import ViewerProcess
from server.streaming.hub import Hub

MODULE = "server.integrations.rerun_worker"
AGAIN_S, LONGEST_S = 2.0, 60.0
STUCK_S = 5.0


class RemoteRerun:
    """A stream to one viewer elsewhere. To be used in the hub's event loop.

    Args:
        address: as Rerun writes it: rerun+http://HOST:PORT/proxy.
        again_s: the first pause before it is tried again.
        stuck_s: a viewer that has taken nothing for so long is gone.
    """

    def __init__(self, hub: Hub, address: str, again_s: float = AGAIN_S, stuck_s: float = STUCK_S) -> None:
        self._hub = hub
        self._wish = {"device": "", "connect": address, "stuck_s": stuck_s}
        self._address = address
        self._first_pause = self._pause = again_s
        self._ended = asyncio.Event()
        self._reached: bool | None = None  # as told last
        self._aside: ViewerProcess | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def pid(self) -> int | None:
        """Of its process; None while there is none."""
        return None if self._aside is None else self._aside.pid

    def start(self) -> None:
        """Begin, in the background."""
        self._task = asyncio.create_task(self._keep_running(), name="rerun elsewhere")

    async def stop(self) -> None:
        """End it, and wait until it is gone."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    async def _keep_running(self) -> None:
        while True:
            self._ended.clear()
            self._aside = ViewerProcess(self._hub, MODULE, self._told, self._crashed)
            try:
                with contextlib.suppress(OSError):
                    await self._aside.start()
                    self._aside.say(op="open", **self._wish)
                    await self._ended.wait()
            finally:
                aside, self._aside = self._aside, None
                await aside.stop()
            await asyncio.sleep(self._pause)
            self._pause = min(2 * self._pause, LONGEST_S)

    def _told(self, words: Mapping[str, Any]) -> None:
        if words["op"] == "reached":
            self._pause = self._first_pause
            self._say(True, "info", f"The Rerun viewer at {self._address} gets what devices send.")
        elif words["op"] == "stuck":
            text = f"The Rerun viewer at {self._address} does not take what devices send; it is tried again."
            self._say(False, "caution", text)

    def _crashed(self, words: str) -> None:
        text = f"The stream to the Rerun viewer at {self._address} ended by itself and is begun again."
        self._say(False, "caution", text, said=words[-500:])
        self._ended.set()

    def _say(self, reached: bool, level: wire.Level, text: str, **more: Any) -> None:
        if reached is not self._reached:
            self._reached = reached
            self._hub.event("", "link", level, text, data=more)
