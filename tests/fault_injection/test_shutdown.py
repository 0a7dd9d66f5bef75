"""SIGTERM: flush, close and exit, regardless of clients and running work.

    meanwhile                                       outcome
    four sources, a recording, three browsers, one  the recording is whole and on disk; every process that was begun is
    that takes nothing, a 3D scene, an export       gone; what was half made goes with the next start; status 0
    a signal while the server starts                it ends, too: none is overheard
    a thread that does not come to an end           the process ends over it, and says so

It takes 2 s at most: how long is measured on an otherwise idle machine by tests/bench/shutdown.py, not here.
"""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from fastapi import FastAPI

from server import http_server
from tests.fault_injection.ending import end
from tests.server_process import ROOT
from tests.timeouts import PATIENCE_S


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
    said = ended("lingering", "ready")
    assert "still at work" in said
    assert "returned" not in said
