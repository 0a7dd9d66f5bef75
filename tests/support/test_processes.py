"""Tests and benchmarks leave no process behind, and a benchmark without its port says so."""

from __future__ import annotations

import asyncio
import fcntl
import os
import pty
import signal
import subprocess
import sys
import tty
from pathlib import Path

import pytest

from tests.bench import fanout
from tests.bench.support import serial_device
from tests.support.forking.fork_server import Child
from tests.support.processes import is_running
from tests.support.server_process import ROOT, ServerProcess
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

linux = pytest.mark.skipif(sys.platform != "linux", reason="ending with a parent is Linux's")

STARTER = """
import subprocess, sys
from tests.support.server_process import tied
child = subprocess.Popen(tied([sys.executable, "-c", "import time; time.sleep(600)"]), start_new_session=True)
print(child.pid, flush=True)
child.wait()
"""


def ends_with(starter: subprocess.Popen[str]) -> None:
    """Kill a process that started a server and printed its id: the server ends too."""
    assert starter.stdout
    child = int(starter.stdout.readline())
    assert is_running(child)
    starter.send_signal(signal.SIGKILL)
    block_until(lambda: not is_running(child), "the server has ended")


@linux
def test_a_server_ends_with_a_benchmark_that_was_killed() -> None:
    """It went on trying its port, and took the next run's terminal, which has the same name: no benchmark finished."""
    with subprocess.Popen([sys.executable, "-c", STARTER], cwd=ROOT, stdout=subprocess.PIPE, text=True) as starter:
        ends_with(starter)


@linux
def test_a_benchmark_reports_a_port_in_use(monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: a server without data was measured, which ended in "negative count" or never."""

    class TakenFeed(serial_device.Feed):
        def __enter__(self) -> serial_device.Feed:
            self.holder = os.open(self.terminal, os.O_RDWR | os.O_NOCTTY)
            fcntl.flock(self.holder, fcntl.LOCK_EX)
            return super().__enter__()

        def __exit__(self, *error: object) -> None:
            os.close(self.holder)
            super().__exit__(*error)

    monkeypatch.setattr(fanout, "Feed", TakenFeed)
    monkeypatch.setattr(fanout, "SETTLE_S", 0.5)
    with pytest.raises(RuntimeError, match="is in use by"):
        asyncio.run(fanout.product(1, 100, 0.1))


def test_an_unread_feed_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: it waited forever for a server that had ended."""
    monkeypatch.setattr(serial_device, "STUCK_S", 0.05)
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    with pytest.raises(SystemExit, match="nobody has read"):
        serial_device.put(master, bytes(1 << 20))
    os.close(master)
    os.close(slave)


FORKING = """
import sys, tempfile
from pathlib import Path
from tests.support.forking.fork_server import ForkServer
from tests.support import server_process
server_process.nursery = ForkServer()
server = server_process.ServerProcess("sim:xbus", data=Path(sys.argv[1]))
print(server.process.pid, flush=True)
sys.stdin.read()
"""


@linux
def test_a_forked_server_ends_with_the_tests_that_were_killed(tmp_path: Path) -> None:
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", FORKING, str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True) as starter:
        ends_with(starter)


@linux
def test_a_forked_server_ends_as_another_does(tmp_path: Path) -> None:
    with ServerProcess("sim:xbus", data=tmp_path) as server:
        assert isinstance(server.process, Child)
        assert server.process.poll() is None
        assert server.stop() == 0
    with ServerProcess("sim:xbus", data=tmp_path) as server:
        server.process.kill()
        assert server.process.wait(PATIENCE_S) == -signal.SIGKILL
    with pytest.raises(RuntimeError, match="file not found"):
        ServerProcess("nothing.bin", data=tmp_path)
