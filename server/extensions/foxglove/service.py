"""Live data for Foxglove, Lichtblick and PlotJuggler (`--foxglove`, off by default).

    ws://127.0.0.1:8765             on this machine; it can only be read
    ws://HOST:8080/foxglove         through our own port, with its TLS

The first listens on loopback only, whatever --host is; other machines can use only the second. The same rules apply to
both (server/access/auth.py): if the server needs a token, each needs it (?token=…), and the web application of Foxglove
is a foreign page whose origin must be in `allowed_origins`.

The protocol runs in a subprocess (server/extensions/foxglove/worker.py), which is started after the server and
restarted after a crash with growing delays.
"""

import asyncio
from collections.abc import Iterator, Mapping
from typing import Any

from imuscope.server.access.auth import Access
from imuscope.server.concurrency.backoff import Backoff
from imuscope.server.extensions.foxglove.settings import FoxgloveSettings
from imuscope.server.integrations.shared_secret import SecretEndpoint, new_secret
from imuscope.server.integrations.viewer_process import KeptProcess, ViewerProcess, ViewError
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services
from imuscope.server.streaming.telemetry import Telemetry

MODULE = "imuscope.server.extensions.foxglove.worker"
NO_PORT = -1
START_S = 60.0
AGAIN_S, LONGEST_S = 1.0, 60.0
STEADY_S = 120.0  # after running this long, the next crash counts as the first


class Foxglove:
    """The bridge of a server. To be used in its event loop.

    Args:
        port: port on loopback; 0 for any free one; OFF for none.
        access: the rules for clients of that port.
    """

    def __init__(self, telemetry: Telemetry, port: int, access: Access) -> None:
        self._bus = telemetry.bus
        self._wanted_port = port
        self._access = access
        self._secret = new_secret()
        self.process = KeptProcess(
            lambda crashed: ViewerProcess(telemetry.clients, MODULE, self._on_report, crashed),
            self._serve,
            self._crashed,
            Backoff(AGAIN_S, LONGEST_S),
            end=self._ended,
            steady_s=STEADY_S,
        )
        self._served: asyncio.Future[int] | None = None

    def start(self) -> None:
        """Start in the background, if configured."""
        if self._wanted_port != NO_PORT:
            self._served = asyncio.get_running_loop().create_future()
            self.process.start()

    async def endpoint(self) -> SecretEndpoint:
        """Loopback address of the worker, and its secret.

        Raises:
            ViewError: not configured, or not running.
        """
        if self._served is None:
            raise ViewError("The Foxglove protocol is not enabled on this server.", "Start it with --foxglove.")
        try:
            async with asyncio.timeout(START_S):
                return SecretEndpoint(await asyncio.shield(self._served), self._secret)
        except TimeoutError:
            raise ViewError(
                "The Foxglove bridge is not running.", "See the events on the page for the reason."
            ) from None

    async def close(self) -> None:
        """Stop the bridge."""
        await self.process.close()
        if self._served is not None:
            self._served.cancel()

    def _serve(self) -> None:
        self.process.send(op="serve", port=self._wanted_port, secret=self._secret, rules=self._access.rules())

    def _ended(self) -> None:
        if self._served is None or self._served.done():
            self._served = asyncio.get_running_loop().create_future()

    def _on_report(self, words: Mapping[str, Any]) -> None:
        if words["op"] == "served" and self._served is not None and not self._served.done():
            self._served.set_result(int(words["port"]))
            text = f"The Foxglove protocol is available on ws://127.0.0.1:{words['port']} and at /foxglove."
            self._bus.event("", "device", "info", text)
        elif words["op"] == "failed":
            hint = f"If port {self._wanted_port} is in use, give another: --foxglove PORT, or 0 for any free one."
            text = f"The Foxglove protocol cannot be served: {words['why']}."
            self._bus.event("", "device", "error", text, data={"hint": hint})
            self.process.restart()

    def _crashed(self, words: str) -> None:
        text = "The Foxglove bridge crashed and is restarted."
        self._bus.event("", "device", "warning", text, data={"said": words[-500:]})


def parts(services: Services) -> Iterator[ServicePart]:
    service = Foxglove(services.telemetry, services.config.of(FoxgloveSettings).foxglove, services.access)
    yield ServicePart("Foxglove", service, service.close, service.start)
