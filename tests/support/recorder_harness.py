"""A recorder with links fed by a test, and the contents of its files."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from imuscope.recordings.mcap.reader import McapReader
from imuscope.server.library.compaction_worker import CompactionWorker
from imuscope.server.library.recorder import Recorder, RecordingOptions
from imuscope.server.wire import RecorderState
from tests.bench.support.tcp_device import TcpDevice
from tests.support.control_harness import ControlHarness, house
from tests.support.fakes import FakeLinks
from tests.support.in_process_server import InProcessServer
from tests.support.server_process import ServerProcess
from tests.support.timeouts import http_client
from tests.support.waiting import block_until


def chunks(path: Path, topic: str = "rx/1") -> bytes:
    """All bytes of a channel, one after the other: from a device, or with `tx/1` to it."""
    with McapReader(path) as recording:
        results = []
        for block in recording.blocks():
            channel = recording.topic(topic)
            if channel is not None:
                results.append(block.joined(block.of(channel.id))[0])
        return b"".join(results)


def send(running: InProcessServer, links: FakeLinks, source: str, data: bytes) -> None:
    running.call(links[source].send, data)


def settled(running: InProcessServer) -> RecorderState:
    """The state when all that waited has been written."""

    def result() -> RecorderState | None:
        state: RecorderState = running.call(lambda: running.services.recorder.state)
        return state if state.behind_s == 0 or not state.running else None

    state: RecorderState = block_until(result, "the recorder has written everything")
    return state


@asynccontextmanager
async def recorder(
    data: Path, plan: RecordingOptions | None = None, compactor: CompactionWorker | None = None, **options: Any
) -> AsyncIterator[tuple[ControlHarness, Recorder]]:
    async with house(data, **options) as made:
        recorder = Recorder(
            made.telemetry.bus, made.sessions, made.desks, plan or RecordingOptions(data / "recordings"), compactor
        )
        try:
            yield made, recorder
        finally:
            await recorder.close()


def recorded(data: Path) -> Path:
    (path,) = (data / "recordings").glob("*.mcap")
    return path


def flowing(server: ServerProcess, line: TcpDevice) -> None:
    """Wait until a part of what the line sends has been recorded."""
    with http_client(base_url=server.url) as client:

        def is_flowing() -> bool:
            state = client.get("/api/recorder").json()
            return bool(state["running"] and state["bytes"] > 50_000)

        block_until(is_flowing, lambda: f"recording:\n{server.log}")
