"""A busy server to be shut down."""

from __future__ import annotations

import contextlib
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import msgspec
from httpx import Client
from websockets.sync.client import ClientConnection
from websockets.typing import Subprotocol

from imuscope.recordings.mcap.reader import McapReader
from imuscope.server import wire
from imuscope.server.library.cleanup import DataFolderLock
from imuscope.server.library.compaction_worker import uncompacted
from imuscope.server.wire import codec as wire_codec
from tests.bench.support.tcp_device import TcpDevice
from tests.fault_injection.fault_harness import frames
from tests.fault_injection.recorded_files import hidden, recording
from tests.server.extensions.viser.viser_client import CAMERA, subprotocol
from tests.support.processes import is_running
from tests.support.recorder_harness import chunks
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, connect, http_client
from tests.support.waiting import block_until

SOURCES = ("sim:xbus?rate=20", "sim:isb?rate=10", "sim:idtp?rate=10")


@contextlib.contextmanager
def busy(server: ServerProcess, http: Client) -> Iterator[None]:
    """Everything that a server may have to do with."""
    with contextlib.ExitStack() as stack:
        block_until(
            lambda: [one["status"] for one in http.get("/api/devices").json()] == ["live"] * 4, "four devices stream"
        )
        block_until(lambda: http.get("/api/recorder").json()["bytes"] > 20_000, "it records")
        for stuck in (False, False, True):
            stack.enter_context(browser(server, stuck=stuck))
        url = server.url.replace("http", "ws")
        looker = stack.enter_context(connect(f"{url}/viser", subprotocols=[Subprotocol(subprotocol())], max_size=None))
        looker.send(msgspec.msgpack.encode(CAMERA))
        request = http.post("/api/recordings/long/exports", json={"format": "csv"})
        assert request.status_code == 202, request.text
        block_until(lambda: http.get("/api/recordings/exports").json()[0]["state"] == "running", "it exports")
        yield


@contextlib.contextmanager
def browser(server: ServerProcess, *, stuck: bool) -> Iterator[ClientConnection]:
    """A client that reads while there is room, or one with almost no bandwidth."""
    address = urlsplit(server.url)
    line = socket.create_connection((address.hostname, address.port))
    if stuck:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    url = f"ws://{address.netloc}/ws"
    made = connect(url, sock=line, subprotocols=[Subprotocol(wire.SUBPROTOCOL)], max_size=None, max_queue=1)
    with made:
        made.send(wire_codec.encode_text(wire.Subscribe(600)))
        yield made


def children(pid: int) -> list[int]:
    results = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(one) for one in results]


def end(data: Path) -> float:
    """Start a server, give it everything to do, end it; seconds from the signal to its end."""
    folder = data / "recordings"
    folder.mkdir(parents=True)
    recording(folder / "long.mcap", frames(0, 2000) * 30)
    with TcpDevice(1000) as line:
        with ServerProcess(line.source, *SOURCES, data=data, arguments=("--record",), fresh=True) as server:
            with http_client(base_url=server.url) as http, busy(server, http):
                block_until(lambda: line.size > 20_000, "the line was busy, too")
                # Between the process that opens the recording and the one that exports it, none exists for a moment.
                block_until(lambda: len(children(server.process.pid)) >= 2, "a scene and an export run aside")
                begun = children(server.process.pid)
                started = time.monotonic()
                server.process.send_signal(signal.SIGTERM)
                status = server.process.wait(PATIENCE_S)
                took = time.monotonic() - started
            assert status == 0, server.log
            assert "Traceback" not in server.log, server.log
        sent = line.sent
    block_until(lambda: not any(is_running(pid) for pid in begun), "what it had begun is gone")
    (made,) = (path for path in folder.glob("*.mcap") if path.stem != "long")
    with McapReader(made) as reader:
        list(reader.blocks())
        assert reader.whole, "it was closed"
    assert sent.startswith(chunks(made))
    assert len(chunks(made)) > 10_000, f"of {len(sent)} bytes that were sent"
    tenancy = DataFolderLock(data)
    tenancy.begin()
    uncompacted(folder)
    tenancy.end()
    assert hidden(data) == [], "what was half made goes when the next server starts"
    return took
