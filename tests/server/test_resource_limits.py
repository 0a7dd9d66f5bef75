"""Bounds on the resources that a client, a query, a pipe or a hostile file may use."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import resource
import socket
import stat
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import zstandard
from httpx import TransportError
from mcap.writer import CompressionType, IndexType, Writer
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from imuscope.recordings.library.probe import probe
from imuscope.recordings.mcap.reader import CHUNK, LARGEST_CHUNK, McapReader
from imuscope.recordings.mcap.records import MAGIC
from imuscope.recordings.system import resource_limits
from imuscope.server import wire
from imuscope.server.http import server as http_server
from imuscope.server.http.connections import ConnectionLimits
from imuscope.server.library import range_query
from imuscope.server.links.base import LinkSettings
from imuscope.server.links.replay import split_devices
from imuscope.server.links.source_url import open_link
from imuscope.server.settings.config import Config
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until


def connected(running: InProcessServer) -> socket.socket:
    host, port = running.url.removeprefix("http://").split(":")
    return socket.create_connection((host, int(port)), PATIENCE_S)


def open_connections(running: InProcessServer) -> list[int]:
    """The descriptors that the server's side holds at its port."""
    results = []
    for fd in map(int, os.listdir("/proc/self/fd")):
        with contextlib.suppress(OSError):
            if stat.S_ISSOCK(os.fstat(fd).st_mode):
                with socket.socket(fileno=os.dup(fd)) as one:
                    if one.family == socket.AF_INET and running.url.endswith(f":{one.getsockname()[1]}"):
                        results.append(fd)
    return results


def serving(folder: Path, **limits: float) -> InProcessServer:
    return InProcessServer(
        Config(sources=("/dev/one",), data=folder),
        FakeLink,
        limits=ConnectionLimits(**limits),  # type: ignore[arg-type]
    )


def answers(running: InProcessServer) -> bool:
    with contextlib.suppress(TransportError):
        return running.client.get("/healthz").status_code == 200
    return False


def test_a_request_whose_head_does_not_come_is_not_waited_for(tmp_path: Path) -> None:
    with (
        serving(tmp_path, head_s=0.1) as running,
        connected(running) as silent,
        connected(running) as slow,
    ):
        slow.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n")
        for one in (silent, slow):
            with contextlib.suppress(ConnectionResetError):
                assert one.recv(1) == b""
        assert running.client.get("/healthz").status_code == 200


def test_idle_connections_leave_descriptors_for_recordings(tmp_path: Path) -> None:
    """About 1,010 of them, without a token, stopped a recording and every link that had to be opened again."""
    # Their number is limited here.
    with serving(tmp_path, most=20, head_s=10 * PATIENCE_S) as running:
        block_until(lambda: answers(running), "it answers")
        idle = [connected(running) for _ in range(60)]
        block_until(lambda: len(open_connections(running)) <= 21, "the listener, and 20 connections")
        for one in idle:
            one.close()
        # Once is enough: a late one of the 60 may still take the place of a connection that has been answered.
        block_until(lambda: answers(running), "there is room again")


def test_an_idle_connection_makes_room_for_one_that_sends(tmp_path: Path) -> None:
    """Regression: a client with a thousand open connections and no token blocked all others, including /healthz."""
    with serving(tmp_path, most=20) as running:
        idle = [connected(running) for _ in range(40)]
        assert all(answers(running) for _ in range(3))
        for one in idle:
            one.close()


def test_a_request_before_a_burst_of_connections_is_answered(tmp_path: Path) -> None:
    """They were all accepted before the request was read, which was then taken for the one idle longest."""
    blocked, go_on = threading.Event(), threading.Event()
    with serving(tmp_path, most=100) as running, contextlib.ExitStack() as held:
        assert running.loop is not None
        running.loop.call_soon_threadsafe(lambda: (blocked.set(), go_on.wait(PATIENCE_S)))
        assert blocked.wait(PATIENCE_S)
        requests = held.enter_context(connected(running))
        requests.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        for _ in range(400):
            held.enter_context(connected(running))
        go_on.set()
        assert requests.recv(12) == b"HTTP/1.1 200"


def test_websockets_leave_room_for_requests(tmp_path: Path) -> None:
    with (
        serving(tmp_path, most=6) as running,
        contextlib.ExitStack() as held,
    ):
        protocols = [Subprotocol(wire.SUBPROTOCOL)]
        for _ in range(3):
            held.enter_context(connect(running.ws, subprotocols=protocols, open_timeout=PATIENCE_S))
        with pytest.raises(InvalidStatus) as refused:
            connect(running.ws, subprotocols=protocols, open_timeout=PATIENCE_S)
        assert refused.value.response.status_code == 409
        assert b'"full"' in (refused.value.response.body or b"")
        assert answers(running)


def test_connections_that_cannot_be_accepted_wait_without_a_traceback(tmp_path: Path) -> None:
    with ServerProcess("/dev/nothing-there", data=tmp_path) as running:
        pid = running.process.pid
        before = resource.prlimit(pid, resource.RLIMIT_NOFILE)
        address = running.url.rpartition("/")[2].split(":")
        resource.prlimit(pid, resource.RLIMIT_NOFILE, (1, before[1]))
        with socket.create_connection((address[0], int(address[1])), PATIENCE_S) as waits:
            waits.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
            block_until(lambda: "New connections wait: Too many open files" in running.log, lambda: running.log)
            resource.prlimit(pid, resource.RLIMIT_NOFILE, before)
            assert waits.recv(12) == b"HTTP/1.1 200"
        assert "LimitNOFILE" in running.log
        assert "Traceback" not in running.log


def test_half_of_the_descriptors_are_not_for_browsers() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(256, hard), hard))
        assert ConnectionLimits().connections == 128
        http_server.raise_limit()
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] == min(hard, http_server.MAX_FILES)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_table_is_made_in_small_pieces() -> None:
    """One query of 4.9 million rows took a gigabyte, and a live one froze the server for seconds."""
    n = 300_000
    info = wire.ChannelInfo(1, "1", "M", "Force", "Force", "scalar", "N", "", [wire.ColumnInfo("value", "f8")])
    clock = np.arange(n, dtype=np.float64)
    answer = range_query.query_columns(info, [clock, clock, clock], 0, n, 0)
    assert max(map(len, range_query.json_of(answer))) < 100_000, "a column is not spelled at once"
    assert max(map(len, range_query.arrow_of(answer))) < 2_000_000


async def test_a_pipe_without_a_writer_blocks_no_one_else(tmp_path: Path) -> None:
    """It was opened in the event loop, which then waited for a writer."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert await split_devices(str(pipe)) == [str(pipe)]

    link = open_link(str(pipe), LinkSettings(lambda: 0))
    async with asyncio.timeout(PATIENCE_S):
        await link.open()
        reading = asyncio.create_task(link.read())
        for _ in range(20):  # the loop goes on
            await asyncio.sleep(0.001)
        assert not reading.done()
        reading.cancel()
        await link.close()


def test_files_are_sources_only_on_the_command_line(tmp_path: Path) -> None:
    """Regression: with a control token, any file readable by the server's user could be read by recording it."""
    secret, named = tmp_path / "secret.key", tmp_path / "captures" / "one.bin"
    named.parent.mkdir()
    for file in (secret, named):
        file.write_bytes(b"FFFF")
    (named.parent / "link.bin").symlink_to(secret)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    config = Config(sources=("/dev/one",), data=tmp_path / "data", source_folders=(str(named.parent),))
    with InProcessServer(config, FakeLink) as running:
        for refused in (
            secret,
            pipe,
            "/etc/passwd",
            "/proc/self/environ",
            named.parent / "link.bin",
            f"{secret}?speed=2",
        ):
            answer = running.client.post("/api/devices", json={"source": str(refused)})
            assert (answer.status_code, answer.json()["kind"]) == (403, "file-not-allowed")
        assert running.client.post("/api/devices", json={"source": str(named)}).status_code == 201


def test_a_worker_that_uses_too_much_memory_is_stopped() -> None:
    program = """
from imuscope.recordings.system.resource_limits import bounded
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


def test_packing_is_bounded(tmp_path: Path) -> None:
    """It had no bound of memory or time, as opening and exporting have."""
    program = """
import sys
from pathlib import Path
from imuscope.recordings.mcap import compaction
from imuscope.recordings.system import resource_limits

def hostile(path):
    if path.name == "large":
        bytearray(2 * compaction.MAX_MEMORY_BYTES)
    while True:
        pass

compaction.compact = hostile
resource_limits.MIN_CPU_S = 1 if sys.argv[1].endswith("slow") else 60
sys.argv[1:] = [sys.argv[1]]
raise SystemExit(compaction.main())
"""
    for name, what in (("large", "memory"), ("slow", "time")):
        (tmp_path / name).write_bytes(b"")
        command = [sys.executable, "-c", program, str(tmp_path / name)]
        run = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert run.returncode == 1
        document = json.loads(run.stdout)
        assert document["packed"] is False
        assert f"takes more {what} than it may have" in document["message"]


def test_limits_follow_the_file_and_the_machine() -> None:
    assert resource_limits.seconds_for(0) == resource_limits.MIN_CPU_S
    assert resource_limits.seconds_for(6 << 20) < 120
    assert resource_limits.seconds_for(1 << 40) == resource_limits.CPU_S
    assert resource_limits.MIN_MEMORY <= resource_limits.memory_of_one() <= resource_limits.MAX_MEMORY


def test_a_hostile_recording_is_listed_at_once(tmp_path: Path) -> None:
    """Time went with the square of the metadata: 150,000 of them held up an upload for minutes, six such the server."""
    path = tmp_path / "many.mcap"
    count = 20_000
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, index_types=IndexType.ALL)
        writer.start()
        for number in range(count):
            writer.add_metadata(f"device/{number}", {"product": "MTi-630"})
        writer.add_metadata("device/0", {"product": "MTi-630"})
        writer.finish()
    began = time.process_time()
    result = probe(path)
    assert time.process_time() - began < 5
    assert result is not None
    assert (len(result.devices), result.devices[-1].id) == (count, "0")  # the repeated event is the last


def test_a_small_chunk_that_unpacks_to_much_is_damage(tmp_path: Path) -> None:
    """A file of 393 kB took 4 GB."""
    data = bytes(LARGEST_CHUNK + 1)
    body = zstandard.compress(data)
    head = struct.pack("<QQQI", 0, 0, len(data), 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(body))
    path = tmp_path / "bomb.mcap"
    path.write_bytes(MAGIC + struct.pack("<BQ", CHUNK, len(head) + len(body)) + head + body)
    with McapReader(path) as recording:
        assert list(recording.blocks()) == []
        assert "it claims" in recording.damage[0].words
    assert LARGEST_CHUNK <= 64 << 20


@each_row("piece", ["", " "])
def test_a_message_of_endless_pieces_is_cut_off(piece: str, tmp_path: Path) -> None:
    """Regression: empty fragments have no size and were stored, 40 MB a minute, from a view-only client."""
    pieces = ["{", *[piece] * (2 * http_server.MAX_FRAGMENTS), '"op": "ping", "t": 1}']
    with (
        InProcessServer(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running,
        connect(running.ws, subprotocols=[Subprotocol(wire.SUBPROTOCOL)], max_size=None) as browser,
    ):
        with contextlib.suppress(ConnectionClosed):
            browser.send(pieces)
        with pytest.raises(ConnectionClosed):
            until_pong(browser)


def until_pong(browser: ClientConnection) -> None:
    while '"pong"' not in str(browser.recv(PATIENCE_S)):
        pass


def test_requests_that_are_not_http_are_logged_with_their_sender_once(
    caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    with (
        InProcessServer(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running,
        connected(running) as stranger,
    ):
        stranger.sendall(b"\x16\x03\x01 no http\r\n\r\n")
        assert b"400" in stranger.recv(1000)
    [line] = [record for record in caplog.records if "Invalid HTTP" in record.getMessage()]
    assert "127.0.0.1" in line.getMessage()
    assert line.__dict__["often"] == ("no-http", "127.0.0.1")


@each_row(
    ("line", "folder", "file"),
    [
        ("0::/system.slice/imuscope.service", "system.slice", "memory.max"),
        ("7:cpu,memory:/system.slice/imuscope.service", "memory/system.slice", "memory.limit_in_bytes"),
        ("7:memory:/../..", "memory", "memory.limit_in_bytes"),
    ],
)
def test_limits_of_control_groups_of_both_versions_count(line: str, folder: str, file: str, tmp_path: Path) -> None:
    groups = tmp_path / "cgroup"
    groups.write_text(f"9:pids:/x\n{line}\n")
    (tmp_path / folder).mkdir(parents=True)
    (tmp_path / folder / file).write_text("67108864\n")
    assert min(resource_limits._memories(groups, tmp_path)) == 67_108_864
    (tmp_path / folder / file).write_text("max\n")
    assert min(resource_limits._memories(groups, tmp_path)) > 67_108_864
