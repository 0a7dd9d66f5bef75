"""What a stranger, a query, a pipe or a hostile file may take of the machine, and no more."""

from __future__ import annotations

import asyncio
import contextlib
import os
import resource
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from httpx import TransportError

from server import serving, wire
from server.config import Config
from server.library import windows
from server.links import open_link
from server.links.base import LinkError, LinkSettings
from server.links.replay import expanded
from tests.links.bench import fails
from tests.patience import PATIENCE_S
from tests.server.fakes import FakeLink
from tests.server.running import Running


def connected(running: Running) -> socket.socket:
    host, port = running.url.removeprefix("http://").split(":")
    return socket.create_connection((host, int(port)), PATIENCE_S)


def answers(running: Running) -> bool:
    with contextlib.suppress(TransportError):
        return running.client.get("/healthz").status_code == 200
    return False


def test_a_request_whose_head_does_not_come_is_not_waited_for(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(serving, "HEAD_S", 0.1)
    with (
        Running(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running,
        connected(running) as silent,
        connected(running) as slow,
    ):
        slow.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n")
        for one in (silent, slow):
            with contextlib.suppress(ConnectionResetError):
                assert one.recv(1) == b""
        assert running.client.get("/healthz").status_code == 200


def test_idle_connections_leave_descriptors_for_recordings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """About 1,010 of them, without a token, stopped a recording and every link that had to be opened again."""
    monkeypatch.setattr(serving, "MOST_CONNECTIONS", 20)
    with Running(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running:
        before = len(os.listdir("/proc/self/fd"))
        idle = [connected(running) for _ in range(60)]
        ends = time.monotonic() + PATIENCE_S
        while len(os.listdir("/proc/self/fd")) > before + 60 + 21 and time.monotonic() < ends:
            time.sleep(0.01)
        assert len(os.listdir("/proc/self/fd")) <= before + 60 + 21  # 60 ends of ours
        for one in idle:
            one.close()
        while not answers(running) and time.monotonic() < ends:
            time.sleep(0.01)
        assert answers(running), "there is room again"


def test_half_of_the_descriptors_are_not_for_browsers() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(256, hard), hard))
        assert serving.most_connections() == 128
        serving.raise_limit()
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == min(hard, serving.MOST_FILES)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_table_is_made_in_small_pieces() -> None:
    """One query of 4.9 million rows took a gigabyte, and a live one froze the server for seconds."""
    n = 300_000
    info = wire.ChannelInfo(1, "1", "M", "Force", "Force", "scalar", "N", "", [wire.ColumnInfo("value", "f8")])
    clock = np.arange(n, dtype=np.float64)
    answer = windows.held(info, [clock, clock, clock], 0, n, 0)
    for pieces in (windows.json_of(answer), windows.arrow_of(answer)):
        assert max(map(len, pieces)) < 4_000_000


def test_a_pipe_as_a_source_is_refused_and_waits_for_nobody(tmp_path: Path) -> None:
    """It was opened in the event loop, which then waited for a writer."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert expanded(str(pipe)) == [str(pipe)]

    async def check() -> None:
        error = await fails(open_link(str(pipe), LinkSettings(lambda: 0)).open())
        assert isinstance(error, LinkError)
        assert error.kind == "bad-source"

    asyncio.run(check())


def test_files_are_sources_only_where_that_is_meant(tmp_path: Path) -> None:
    """Who had a control token could read, by recording it, any file of the server's user."""
    secret, named = tmp_path / "secret.key", tmp_path / "captures" / "one.bin"
    named.parent.mkdir()
    for file in (secret, named):
        file.write_bytes(b"FFFF")
    (named.parent / "link.bin").symlink_to(secret)
    config = Config(sources=("/dev/one",), data=tmp_path / "data", source_folders=(str(named.parent),))
    with Running(config, FakeLink) as running:
        for refused in (secret, "/etc/passwd", "/proc/self/environ", named.parent / "link.bin", f"{secret}?speed=2"):
            answer = running.client.post("/api/devices", json={"source": str(refused)})
            assert (answer.status_code, answer.json()["kind"]) == (403, "not-allowed")
        assert running.client.post("/api/devices", json={"source": str(named)}).status_code == 201


def test_a_worker_that_takes_too_much_memory_is_stopped() -> None:
    program = """
from recordings.bounds import bounded
bounded(memory=400 << 20)
try:
    bytearray(600 << 20)
except MemoryError:
    print("bounded")
"""
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=PATIENCE_S, check=True
    )
    assert run.stdout.strip() == "bounded"
