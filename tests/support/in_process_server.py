"""The real application on a real socket, in a thread of the test's process, so that a test may change its parts."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from imuscope.server import wire
from imuscope.server.access.auth import Access
from imuscope.server.app.build import create_app
from imuscope.server.devices.decode.protocol_detection import ProtocolSet
from imuscope.server.devices.link.sessions import OpenLink
from imuscope.server.http import server as http_server
from imuscope.server.http.connections import ConnectionLimits
from imuscope.server.http.page_files import Files
from imuscope.server.services.services import Services, ViewerTimings
from imuscope.server.settings.config import Config
from imuscope.server.streaming.channel_rows import ChannelRows
from tests.support.fakes import SPEECH, FakeLink
from tests.support.timeouts import PATIENCE_S, http_client
from tests.support.waiting import block_until


class InProcessServer:
    """`with InProcessServer(config, open_link) as running:` serves on a free port until the block ends.

    Args:
        brought, has_devices: as of `create_app`.
        loop: makes its event loop, for a test that turns its clock (tests/server/extensions/fleet/turned_loop.py).
    """

    def __init__(
        self,
        config: Config,
        open_link: OpenLink,
        protocol_set: ProtocolSet = SPEECH,
        *,
        page_files: Files | None = None,
        timings: ViewerTimings | None = None,
        limits: ConnectionLimits | None = None,
        brought: Sequence[object] = (),
        has_devices: bool = True,
        loop: Callable[[], asyncio.AbstractEventLoop] = asyncio.SelectorEventLoop,
    ) -> None:
        self._app = create_app(
            config,
            Access(config),
            open_link=open_link,
            protocol_set=protocol_set,
            page_files=page_files,
            timings=timings,
            brought=brought,
            has_devices=has_devices,
        )
        self.services: Services = self._app.app.services  # type: ignore[attr-defined]
        self._listener = http_server.listen("127.0.0.1", 0)
        port = self._listener.getsockname()[1]
        self.url = f"http://127.0.0.1:{port}"
        self.ws = f"ws://127.0.0.1:{port}/ws"
        ready = threading.Event()
        self._server = http_server.server(self._app, ready.set, limits=limits)
        self.loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=self._run, args=(loop,))
        self._thread.start()
        assert ready.wait(PATIENCE_S)
        self.client = http_client(base_url=self.url)

    def _run(self, loop: Callable[[], asyncio.AbstractEventLoop]) -> None:
        with asyncio.Runner(loop_factory=loop) as runner:
            runner.run(self._serve())

    async def _serve(self) -> None:
        self.loop = asyncio.get_running_loop()
        await self._server.serve(sockets=[self._listener])

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Run a function in the server's thread and wait for it."""
        done: Future[Any] = Future()
        assert self.loop is not None
        self.loop.call_soon_threadsafe(lambda: done.set_result(function(*arguments)))
        return done.result(PATIENCE_S)

    def signals_of(self, recording: str) -> list[str]:
        """Names of the signals of a recording, as its importer calls them, once it is open."""

        def channels() -> Any:
            answer = self.client.get(f"/api/recordings/{recording}")
            return answer.json()["channels"] if answer.status_code == 200 else None

        results = block_until(channels, "the opened recording")
        return [f"{one['name']}.{column['name']}" for one in results for column in one["columns"]]

    def publish(self, device: str, name: str, unit: str, columns: list[Any]) -> None:
        """Publish arrivals, times and values of a live device as a channel with the column y."""
        bus = self.services.telemetry.bus
        info = wire.ChannelInfo(0, device, "M", name, name, "scalar", unit, "", [wire.ColumnInfo("y", "f8", unit)])
        self.call(lambda: bus.publish([ChannelRows(bus.advertise(info), columns)]))

    def __enter__(self) -> InProcessServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.client.close()
        self._server.should_exit = True
        self._thread.join(PATIENCE_S)
        self._listener.close()
        assert not self._thread.is_alive()


@contextmanager
def table_server(data: Path, **tables: str) -> Iterator[InProcessServer]:
    """A server with one silent device and a library of tables, by name; its client waits for what is computed."""
    folder = data / "recordings"
    folder.mkdir()
    for name, text in tables.items():
        (folder / f"{name}.csv").write_text(text)
    with InProcessServer(Config(data=data, sources=("/dev/one",)), FakeLink) as running:
        running.client.timeout = 60
        yield running
