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

from collections.abc import Mapping
from typing import Any

from imuscope.server import wire
from imuscope.server.concurrency.backoff import Backoff
from imuscope.server.integrations.viewer_process import KeptProcess, ViewerProcess
from imuscope.server.streaming.telemetry import Telemetry

MODULE = "imuscope.server.extensions.rerun.worker"
AGAIN_S, LONGEST_S = 2.0, 60.0
STUCK_S = 5.0


class RemoteRerun:
    """A stream to one viewer on another machine. To be used in the server's event loop.

    Attributes:
        process: to be started and closed.

    Args:
        address: in the form of Rerun: rerun+http://HOST:PORT/proxy.
        again_s: first delay before a retry.
        stuck_s: time without accepted data after which the viewer counts as gone.
    """

    def __init__(self, telemetry: Telemetry, address: str, again_s: float = AGAIN_S, stuck_s: float = STUCK_S) -> None:
        self._bus = telemetry.bus
        self._address = address
        self._backoff = Backoff(again_s, LONGEST_S)
        self._reached: bool | None = None  # as last reported
        self.process = KeptProcess(
            lambda crashed: ViewerProcess(telemetry.clients, MODULE, self._on_report, crashed),
            lambda: self.process.send(op="open", device="", connect=address, stuck_s=stuck_s),
            self._crashed,
            self._backoff,
        )

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

    def _send(self, reached: bool, level: wire.Level, text: str, **more: Any) -> None:
        if reached is not self._reached:
            self._reached = reached
            self._bus.event("", "link", level, text, data=more)
