"""SIGTERM: flush, close and exit, regardless of clients and running work.

    meanwhile                                       outcome
    four sources, a recording, three browsers, one  the recording is whole and on disk; every process that was begun is
    that takes nothing, a 3D scene, an export       gone; what was half made goes with the next start; status 0
    a signal while the server starts                it ends, too: none is overheard
    a thread that does not come to an end           the process ends over it, and says so
    a start, a loop or a disk that hangs            the process ends at the deadline, and says what it waited for
    analyses, a question, evidence, an upload       all end with it

It takes 2 s at most: how long is measured on an otherwise idle machine by tests/bench/shutdown.py, not here.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from fastapi import FastAPI

from imuscope.server.http import server as http_server
from tests.fault_injection.ending import children, end
from tests.server.extensions.fleet.store_fixtures import ENDLESS
from tests.support.each_row import each_row
from tests.support.processes import is_running
from tests.support.server_process import ROOT, ServerProcess
from tests.support.timeouts import PATIENCE_S, http_client
from tests.support.waiting import block_until


def test_everything_at_once(tmp_path: Path) -> None:
    end(tmp_path)


def test_a_request_cancelled_at_shutdown_is_not_an_error(caplog: pytest.LogCaptureFixture) -> None:
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
import asyncio, socket, sys, threading, time
from imuscope.server.http import server as http_server, shutdown
from imuscope.server.http.server import listen

async def never():
    await asyncio.Event().wait()

async def stubborn():
    while True:
        try:
            await never()
        except asyncio.CancelledError:
            print("not cancelled", flush=True)

async def done():
    pass

async def app(scope, receive, send):
    while True:
        message = await receive()
        if message["type"] == "lifespan.startup":
            if sys.argv[1] == "hung start":
                print("starting", flush=True)
                await never()
            if sys.argv[1] == "early":
                print("starting", flush=True)
                await asyncio.sleep(0.5)
            elif sys.argv[1] == "lingering":
                asyncio.get_running_loop().run_in_executor(None, time.sleep, 600)
            await send({"type": "lifespan.startup.complete"})
        else:
            if sys.argv[1] == "hung loop":
                time.sleep(600)
            if sys.argv[1] == "hung disk":
                await shutdown.close_all(never(), {})
            if sys.argv[1] == "stubborn":
                await shutdown.close_all(done(), {"a viewer": stubborn()})
            await send({"type": "lifespan.shutdown.complete"})
            return

if sys.argv[1].startswith("hung"):
    shutdown.DEADLINE_S = 1.5
http_server.run(app, listen("127.0.0.1", 0), lambda: print("ready", flush=True))
print("returned", flush=True)
"""


def ended(how: str, word: str) -> str:
    """Output of the process up to its end."""
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
    message = ended("lingering", "ready")
    assert "still at work" in message
    assert "returned" not in message


@each_row(
    ("how", "word", "held"),
    [
        ("hung start", "starting", "It waited for: the start; its main thread: "),
        ("hung loop", "ready", "It waited for: the connections and services; its main thread: <string>, line "),
        ("hung disk", "ready", "It waited for: the recording, the connections and services; its main thread: "),
    ],
)
def test_what_hangs_is_named_at_the_deadline_and_the_process_ends(how: str, word: str, held: str) -> None:
    message = ended(how, word)
    assert "The process had not ended 1.5 s after the signal and was ended. " + held in message
    assert "returned" not in message


def test_a_part_that_will_not_be_cancelled_is_abandoned() -> None:
    message = ended("stubborn", "ready")
    assert "not cancelled" in message
    assert "a viewer did not close within 1 s and was abandoned." in message
    assert "Exited while a viewer did not end." in message


def _sent(
    server: ServerProcess, request: str, body: bytes, kind: str = "application/json", length: int = 0
) -> socket.socket:
    """A request whose answer nobody waits for."""
    host = server.url.removeprefix("http://")
    line = socket.create_connection(("127.0.0.1", int(host.rpartition(":")[2])))
    head = (
        f"{request} HTTP/1.1\r\nHost: {host}\r\nContent-Type: {kind}\r\nContent-Length: {length or len(body)}\r\n\r\n"
    )
    line.sendall(head.encode() + body)
    return line


def test_requests_under_way_end_with_the_server(tmp_path: Path) -> None:
    store = tmp_path / "store"
    store.mkdir()
    arguments = ("--record", "--store", str(store))
    with ServerProcess("sim:isb?rate=50", data=tmp_path / "data", arguments=arguments, fresh=True) as server:
        with http_client(base_url=server.url) as http, contextlib.ExitStack() as stack:
            pid = server.process.pid

            name = "DID_INS_1.theta.roll"

            def is_sent() -> bool:
                body = {"source": "1", "signals": [name]}
                return http.post("/api/analysis/statistics", json=body).status_code == 200

            block_until(is_sent, "a signal")
            heavy = f"{'lowpass(' * 50}resample({name}, 1000 kHz){', 10 Hz, 8)' * 50}"
            analysis = json.dumps({"source": "1", "signals": [heavy]}).encode()
            stack.enter_context(_sent(server, "POST /api/query", json.dumps({"sql": ENDLESS}).encode()))
            block_until(lambda: http.get("/api/query").json()["running"] == 1, "a question runs")
            stack.enter_context(_sent(server, "POST /api/analysis/statistics", analysis))
            grandchildren = block_until(lambda: [b for a in children(pid) for b in children(a)], "an analysis runs")
            upload = _sent(
                server, "PUT /api/recordings/upload?name=a.mcap", b"\x89MCAP0\r\n", "application/octet-stream", 10**6
            )
            stack.enter_context(upload)
            block_until(lambda: list((tmp_path / "data" / "recordings").glob(".*")), "an upload has begun")
            begun = [*children(pid), *grandchildren]
            server.process.send_signal(signal.SIGTERM)
            assert server.process.wait(PATIENCE_S) == 0, server.log
        assert "Traceback" not in server.log, server.log
    block_until(lambda: not any(is_running(one) for one in begun), "what it had begun is gone")
