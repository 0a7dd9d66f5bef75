"""SIGTERM: flush, close, exit, whoever is connected and whatever runs.

    meanwhile                                       outcome
    four sources, a recording, three browsers, one  the recording is whole and on disk; every process that was begun is
    that takes nothing, a 3D scene, an export       gone; what was half made goes with the next start; status 0
    a signal while the server starts                it ends, too: none is overheard
    a thread that does not come to an end           the process ends over it, and says so

It takes 2 s at most: how long is measured on an otherwise idle machine by tests/bench/shutdown.py, not here.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import msgspec
import pytest
from fastapi import FastAPI
from httpx import Client
from websockets.sync.client import ClientConnection
from websockets.typing import Subprotocol

from recordings.mcap_reader import McapReader
from server import http_server, wire, wire_codec
from server.library.cleanup import DataFolderLock
from server.library.compaction_worker import left_behind
from tests.fault_injection.fault_harness import frames
from tests.fault_injection.test_kill import hidden, received, recording, until
from tests.server.tcp_device import TcpDevice
from tests.server_process import ROOT, ServerProcess
from tests.timeouts import PATIENCE_S, connect
from tests.viser_client import CAMERA, subprotocol

SOURCES = ("twin:xbus?rate=400", "twin:isb", "twin:idtp")


@contextlib.contextmanager
def busy(server: ServerProcess, http: Client) -> Iterator[None]:
    """Everything that a server may have to do with."""
    with contextlib.ExitStack() as stack:
        until(lambda: [one["status"] for one in http.get("/api/devices").json()] == ["live"] * 4, "four devices stream")
        until(lambda: http.get("/api/recorder").json()["bytes"] > 100_000, "it records")
        for stuck in (False, False, True):
            stack.enter_context(browser(server, stuck=stuck))
        url = server.url.replace("http", "ws")
        looker = stack.enter_context(connect(f"{url}/viser", subprotocols=[Subprotocol(subprotocol())], max_size=None))
        looker.send(msgspec.msgpack.encode(CAMERA))
        asked = http.post("/api/recordings/long/exports", json={"format": "csv"})
        assert asked.status_code == 202, asked.text
        until(lambda: http.get("/api/recordings/exports").json()[0]["state"] == "running", "it exports")
        yield


@contextlib.contextmanager
def browser(server: ServerProcess, *, stuck: bool) -> Iterator[ClientConnection]:
    """One that reads, as long as there is room; or one whose network takes next to nothing."""
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
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(one) for one in found]


def is_there(pid: int) -> bool:
    """Does it run? One that has ended and was not asked about does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def end(data: Path) -> float:
    """Start a server, give it everything to do, end it; seconds from the signal to its end."""
    folder = data / "recordings"
    folder.mkdir(parents=True)
    recording(folder / "long.mcap", frames(0, 2000) * 30)
    with TcpDevice(1000) as line:
        with ServerProcess(line.source, *SOURCES, data=data, arguments=("--record",)) as server:
            with Client(base_url=server.url, timeout=PATIENCE_S) as http, busy(server, http):
                until(lambda: line.size > 100_000, "the line was busy, too")
                # Between the process that opens the recording and the one that exports it there is none for a moment.
                until(lambda: len(children(server.process.pid)) >= 2, "a scene and an export run aside")
                begun = children(server.process.pid)
                started = time.monotonic()
                server.process.send_signal(signal.SIGTERM)
                status = server.process.wait(PATIENCE_S)
                took = time.monotonic() - started
            assert status == 0, server.log
            assert "Traceback" not in server.log, server.log
        sent = line.sent
    until(lambda: not any(is_there(pid) for pid in begun), "what it had begun is gone")
    (made,) = (path for path in folder.glob("*.mcap") if path.stem != "long")
    with McapReader(made) as found:
        list(found.blocks())
        assert found.whole, "it was closed"
    assert sent.startswith(received(made))
    assert len(received(made)) > 50_000, f"of {len(sent)} bytes that were sent"
    tenancy = DataFolderLock(data)
    tenancy.begin()
    left_behind(folder)
    tenancy.end()
    assert hidden(data) == [], "what was half made goes when the next server starts"
    return took


def test_everything_at_once(tmp_path: Path) -> None:
    end(tmp_path)


def test_a_request_that_is_cancelled_at_the_end_is_no_fault(caplog: pytest.LogCaptureFixture) -> None:
    """The relay of a 3D scene that was closing its end left a traceback in the log of a server that ended well."""
    http_server.server(FastAPI(), lambda: None)
    log = logging.getLogger("uvicorn.error")
    for kind in (asyncio.CancelledError, ValueError):
        try:
            raise kind
        except BaseException:
            log.exception("Exception in ASGI application\n")
    assert [record.exc_info[0] for record in caplog.records if record.exc_info] == [ValueError]


LINGERING = """
import socket, sys, threading, time
from server import http_server
from server.http_server import listen

async def app(scope, receive, send):
    while True:
        message = await receive()
        if message["type"] == "lifespan.startup":
            import asyncio
            if sys.argv[1] == "early":
                print("starting", flush=True)
                await asyncio.sleep(0.5)
            else:
                asyncio.get_running_loop().run_in_executor(None, time.sleep, 600)
            await send({"type": "lifespan.startup.complete"})
        else:
            await send({"type": "lifespan.shutdown.complete"})
            return

http_server.run(app, listen("127.0.0.1", 0), lambda: print("ready", flush=True))
print("returned", flush=True)
"""


def ended(how: str, word: str) -> str:
    """What it printed until it had ended."""
    process = subprocess.Popen(
        [sys.executable, "-c", LINGERING, how],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    with process:
        assert process.stdout
        try:
            assert process.stdout.readline() == f"{word}\n"
            process.send_signal(signal.SIGTERM)
            assert process.wait(PATIENCE_S) in (0, 1)
            return process.stdout.read()
        finally:
            process.kill()


def test_a_signal_while_it_starts() -> None:
    ended("early", "starting")


def test_a_thread_that_does_not_end() -> None:
    """A zip of gigabytes was waited for; now the process ends over it."""
    said = ended("lingering", "ready")
    assert "still at work" in said
    assert "returned" not in said
