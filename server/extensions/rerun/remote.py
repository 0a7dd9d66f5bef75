"""Connection to a Rerun viewer on another machine (`--rerun-connect`), kept for as long as the server runs.

    Telemetry ──viewer_process.py──> rerun_worker.py ──gRPC, by Rerun's own SDK──> the viewer

The SDK neither bounds the data queued for a stalled viewer nor reconnects. So the process sends more only when the last
data was taken, ends itself if nothing was taken for `STUCK_S`, and is restarted here with growing delays. A viewer that
was just reached gets the last half minute, newest first; data of the interruption is left out, because live data
matters more. Both are reported as events, once each.

    output:  {"op": "reached"}   the viewer has taken the sent data for a while
             {"op": "stuck"}     the viewer accepts no data; the process ends
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Mapping
from typing import Any

from imuscope.server import wire
from imuscope.server.backoff import Backoff
from imuscope.server.integrations.viewer_process import ViewerProcess
from imuscope.server.streaming.telemetry import Telemetry

MODULE = "imuscope.server.extensions.rerun.worker"
AGAIN_S, LONGEST_S = 2.0, 60.0
STUCK_S = 5.0


class RemoteRerun:
    """A stream to one viewer on another machine. To be used in the server's event loop.

    Args:
        address: in the form of Rerun: rerun+http://HOST:PORT/proxy.
        again_s: first delay before a retry.
        stuck_s: time without accepted data after which the viewer counts as gone.
    """

    def __init__(self, telemetry: Telemetry, address: str, again_s: float = AGAIN_S, stuck_s: float = STUCK_S) -> None:
        self._bus, self._clients = telemetry.bus, telemetry.clients
        self._requested = {"device": "", "connect": address, "stuck_s": stuck_s}
        self._address = address
        self._backoff = Backoff(again_s, LONGEST_S)
        self._has_ended = asyncio.Event()
        self._reached: bool | None = None  # as last reported
        self._process: ViewerProcess | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def pid(self) -> int | None:
        """Process ID; None while it is not running."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Start in the background."""
        self._task = asyncio.create_task(self._keep_running(), name="rerun elsewhere")

    async def stop(self) -> None:
        """Stop the stream, and wait until its process has ended."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    async def _keep_running(self) -> None:
        while True:
            self._has_ended.clear()
            self._process = ViewerProcess(self._clients, MODULE, self._on_report, self._crashed)
            try:
                with contextlib.suppress(OSError):
                    await self._process.start()
                    self._process.send(op="open", **self._requested)
                    await self._has_ended.wait()
            finally:
                process, self._process = self._process, None
                await process.stop()
            await asyncio.sleep(self._backoff.next())

    def _on_report(self, words: Mapping[str, Any]) -> None:
        if words["op"] == "reached":
            self._backoff.reset()
            self._send(True, "info", f"The Rerun viewer at {self._address} receives live data.")
        elif words["op"] == "stuck":
            text = f"The Rerun viewer at {self._address} does not accept data; retrying."
            self._send(False, "warning", text)

    def _crashed(self, words: str) -> None:
        text = f"The stream to the Rerun viewer at {self._address} ended unexpectedly and is restarted."
        self._send(False, "warning", text, said=words[-500:])
        self._has_ended.set()

    def _send(self, reached: bool, level: wire.Level, text: str, **more: Any) -> None:
        if reached is not self._reached:
            self._reached = reached
            self._bus.event("", "link", level, text, data=more)
