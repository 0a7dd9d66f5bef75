"""Rerun behind our own port: the viewer's files, recordings streamed into it, what is live, and who is kept out."""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import httpx
import numpy as np
import pytest
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from server.views.proxy import ViewError
from server.views.rerun import AHEAD, MOST_LIVE, PAST_BYTES, Viewer
from tests.process import ROOT, ServerProcess
from tests.recordings.test_rrd import entities, numbers
from tests.server.test_opening import drive

PAGE = ROOT / "server" / "views" / "rerun_page"


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server with a twin and one recording of four seconds."""
    data = tmp_path_factory.mktemp("data")
    (data / "recordings").mkdir()
    drive(data / "recordings" / "drive.mcap")
    with ServerProcess("twin:xbus", data=data) as server:
        yield server


@pytest.fixture(scope="module")
def client(running: ServerProcess) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=running.url, timeout=120) as client:
        yield client


def test_the_viewer_is_that_of_the_installed_package_and_comes_compressed(client: httpx.Client) -> None:
    wasm = client.get("/rerun/re_viewer_bg.wasm", headers={"accept-encoding": "gzip"})
    assert wasm.headers["content-type"] == "application/wasm"
    assert int(wasm.headers["content-length"]) < 16e6
    assert wasm.content[:4] == b"\0asm"
    assert version("rerun-sdk") in wasm.headers["etag"]
    assert client.get("/rerun/re_viewer_bg.wasm", headers={"if-none-match": wasm.headers["etag"]}).status_code == 304
    script = client.get("/rerun/re_viewer.js", headers={"accept-encoding": "identity"})
    assert "content-encoding" not in script.headers
    assert "WebHandle" in script.text


def test_the_page_names_no_other_host_and_may_talk_to_none(client: httpx.Client) -> None:
    answer = client.get("/rerun/?recording=drive")
    policy = dict(part.split(" ", 1) for part in answer.headers["content-security-policy"].split("; "))
    assert policy["connect-src"] == "'self'"
    assert policy["script-src"] == "'self' 'wasm-unsafe-eval'"
    assert policy["default-src"] == "'none'"
    for path in PAGE.iterdir():
        assert not re.search(r"https?://|//[a-z]+\.", path.read_text().replace("* ", "")), path.name
    missing = client.get("/rerun/index.html")
    assert missing.status_code == 404
    assert missing.json().keys() == {"kind", "message", "hint"}


def test_a_recording_is_streamed_whole_or_in_part_or_thinned(client: httpx.Client, tmp_path: Path) -> None:
    address = "/api/recordings/drive/recording.rrd"
    whole = saved(client.get(address), tmp_path / "whole.rrd")
    rows = client.get("/api/recordings/drive/query?channel=Acceleration&format=json").json()["columns"]
    acceleration = next(name for name in whole if "Acceleration" in name)
    got = numbers(whole[acceleration], "Scalars:scalars")
    assert len(got) == len(rows["x"]) > 300
    np.testing.assert_allclose(got[:, 0], rows["x"], rtol=1e-6)
    t0 = rows["time"][100]
    part = saved(client.get(address, params={"t0": t0, "t1": t0 + 1}), tmp_path / "part.rrd")
    assert 90 < len(numbers(part[acceleration], "Scalars:scalars")) < 110
    thin = saved(client.get(address, params={"most": 50}), tmp_path / "thin.rrd")
    assert len(numbers(thin[acceleration], "Scalars:scalars")) <= 50


def saved(answer: httpx.Response, path: Path) -> dict[str, list[object]]:
    assert answer.status_code == 200, answer.text
    path.write_bytes(answer.content)
    return entities(path)  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("address", "status"),
    [("/api/recordings/none/recording.rrd", 404), ("/api/recordings/drive/recording.rrd?t0=5&t1=4", 422)],
)
def test_what_cannot_be_streamed_is_told_in_words(client: httpx.Client, address: str, status: int) -> None:
    answer = client.get(address)
    assert answer.status_code == status
    assert answer.json()["message"]


def test_what_is_live_comes_as_batches_that_each_can_be_read(running: ServerProcess, tmp_path: Path) -> None:
    told, batches = looked(running.url, 12)
    assert told["kind"] == "lag"
    assert told["lag_ms"] >= 0
    assert told["dropped"] == 0
    found: set[str] = set()
    for number, batch in enumerate(batches):
        path = tmp_path / f"{number}.rrd"
        path.write_bytes(batch)
        if RrdReader(path).recordings():
            found |= entities(path).keys()
    assert any(name.endswith("/body/shape") for name in found), found  # what is static comes to each
    assert any("Acceleration" in name for name in found)
    late, again = looked(running.url, 6)
    assert late["kind"] == "lag"
    assert again[0] == batches[0]  # what is static comes first, also to one who is late


def looked(url: str, wanted: int) -> tuple[dict[str, float], list[bytes]]:
    """So many batches as a browser takes them, and what was told about them."""
    batches: list[bytes] = []
    told: dict[str, float] = {}
    with connect(url.replace("http", "ws") + "/rerun/live", max_size=None) as socket:
        while len(batches) < wanted or not told:
            message = socket.recv(timeout=60)
            if isinstance(message, str):
                told = json.loads(message)
            else:
                batches.append(message)
                socket.send(str(len(batches)))
    return told, batches


def test_a_stream_of_a_device_that_is_not_there_is_refused_in_words(running: ServerProcess) -> None:
    address = running.url.replace("http", "ws") + "/rerun/live?device=none"
    with connect(address) as socket, pytest.raises(ConnectionClosed, match="There is no device none"):
        socket.recv(timeout=30)


def test_a_viewer_that_does_not_keep_up_loses_the_oldest_and_is_told_how_many() -> None:
    async def look() -> None:
        viewer = Viewer()
        viewer.still.append(b"still")
        for n in range(MOST_LIVE + 5):
            viewer.offer(float(n + 1), b"live %d" % n)
        viewer.remember(b"newest of before")
        viewer.remember(b"older")
        viewer.remember(bytes(PAST_BYTES))  # more than it may cost
        assert viewer.dropped == 5
        taken = []
        for n in range(MOST_LIVE + 3):
            taken.append((await viewer.take())[1])
            viewer.acknowledge(n + 1)
        assert taken[:2] == [b"still", b"live 5"]
        assert taken[-2:] == [b"newest of before", b"older"]

    asyncio.run(look())


def test_a_viewer_is_not_sent_ahead_of_what_it_has_taken() -> None:
    async def look() -> None:
        viewer = Viewer()
        for n in range(10):
            viewer.offer(1.0, b"%d" % n)
        for _ in range(AHEAD):
            await viewer.take()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.05):
                await viewer.take()
        viewer.acknowledge(1)
        assert (await viewer.take())[1] == b"%d" % AHEAD
        viewer.lost = "The stream has ended."
        viewer.wake.set()
        with pytest.raises(ViewError):
            await viewer.take()

    asyncio.run(look())


def test_a_server_starts_without_importing_rerun() -> None:
    code = "import sys, server.app, server.cli, server.views.rerun; print([n for n in sys.modules if 'rerun_b' in n])"
    said = subprocess.run(
        [sys.executable, "-c", f"{code}; print('rerun' in sys.modules)"],
        capture_output=True, text=True, check=True, timeout=120, cwd=ROOT,
    )  # fmt: skip
    assert said.stdout.split("\n")[:2] == ["[]", "False"]


def test_an_address_that_is_none_of_a_viewer_is_refused_before_anything_starts() -> None:
    said = subprocess.run(
        [sys.executable, "-m", "server.cli", "serve", "--rerun-connect", "http://elsewhere"],
        capture_output=True, text=True, timeout=120, cwd=ROOT,
    )  # fmt: skip
    assert said.returncode == 1
    assert "rerun_connect" in said.stderr


def test_it_streams_to_a_viewer_elsewhere(tmp_path: Path) -> None:
    """Rerun's own program in the viewer's place; what reached it is saved and read."""
    from server.views.rerun_files import program

    out, log = tmp_path / "got.rrd", tmp_path / "log"
    environment = {"HOME": str(tmp_path), "PATH": "/usr/bin:/bin", "NO_COLOR": "1"}
    port = free_port()
    options = ["--serve-grpc", "--bind", "127.0.0.1", "--port", str(port), "--server-memory-limit", "50MB"]
    with log.open("wb") as told:
        elsewhere = subprocess.Popen(
            [program(), *options], stdin=subprocess.DEVNULL, stdout=told, stderr=told, env=environment
        )
    try:
        address = f"rerun+http://127.0.0.1:{port}/proxy"
        with ServerProcess("twin:xbus", data=tmp_path / "data", arguments=("--rerun-connect", address)):
            taker = subprocess.Popen(
                [program(), "--save", str(out), address],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment,
            )  # fmt: skip
            try:
                for _ in range(300):
                    if out.is_file() and out.stat().st_size > 300_000:
                        break
                    with pytest.raises(subprocess.TimeoutExpired):
                        taker.wait(0.2)
            finally:
                taker.terminate()
                taker.wait(10)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RerunWarning)  # the taker was ended: its file has no footer
            assert any("Acceleration" in name for name in entities(out))
    finally:
        elsewhere.kill()
        elsewhere.wait()


def free_port() -> int:
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
