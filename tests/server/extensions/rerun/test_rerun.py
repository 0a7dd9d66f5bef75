"""Rerun behind the server's port: viewer files, streamed recordings, live data, and access control."""

import asyncio
import base64
import contextlib
import json
import re
import socket
import subprocess
import warnings
from collections import deque
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import numpy as np
import pytest
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning
from websockets.exceptions import ConnectionClosed

from imuscope.server import wire
from imuscope.server.extensions.rerun.rrd.chunks import name_of
from imuscope.server.extensions.rerun.service import (
    KEPT_BYTES,
    MAX_LIVE,
    MAX_UNACKNOWLEDGED,
    PAST_BYTES,
    RerunFeed,
    RerunViewer,
)
from imuscope.server.integrations.viewer_process import ViewError
from imuscope.server.streaming.channel_rows import ChannelRows
from imuscope.server.streaming.telemetry import Telemetry
from imuscope.server.wire.codec import SampleFrame
from tests.recordings.recorded_drive import drive
from tests.server.extensions.rerun.rrd_tables import entities, numbers
from tests.support.each_row import each_row
from tests.support.free_ports import free_port
from tests.support.processes import resident_mb
from tests.support.server_process import ROOT, ServerProcess, imuscope
from tests.support.timeouts import PATIENCE_S, connect, http_client
from tests.support.waiting import block_until

PAGE = ROOT / "server" / "extensions" / "rerun" / "page"


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server with a simulator and one recording of four seconds."""
    data = tmp_path_factory.mktemp("data")
    (data / "recordings").mkdir()
    drive(data / "recordings" / "drive.mcap")
    with ServerProcess("sim:xbus", data=data) as server:
        yield server


@pytest.fixture(scope="module")
def client(running: ServerProcess) -> Iterator[httpx.Client]:
    with http_client(base_url=running.url, timeout=PATIENCE_S) as client:
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


def test_the_amount_sent_to_a_browser_is_reported(client: httpx.Client) -> None:
    address = "/api/recordings/drive/amount"
    answer = client.get(address).json()
    assert answer["rows"] == answer["shown"] > 1000
    assert (answer["most"], answer["every"]) == (0, 1)
    assert answer["whole_s"] == pytest.approx(3.5, abs=0.6)
    begin = client.get("/api/recordings/drive").json()["t0"]
    part = client.get(address, params={"t0": begin, "t1": begin + 1}).json()
    assert 0 < part["rows"] < answer["rows"] / 2
    assert client.get(address, params={"t0": 5, "t1": 4}).status_code == 422
    assert client.get("/api/recordings/none/amount").status_code == 404


def saved(answer: httpx.Response, path: Path) -> dict[str, list[object]]:
    assert answer.status_code == 200, answer.text
    path.write_bytes(answer.content)
    return entities(path)  # type: ignore[return-value]


@each_row(
    ("address", "status"),
    [("/api/recordings/none/recording.rrd", 404), ("/api/recordings/drive/recording.rrd?t0=5&t1=4", 422)],
)
def test_unstreamable_requests_are_reported(client: httpx.Client, address: str, status: int) -> None:
    answer = client.get(address)
    assert answer.status_code == status
    assert answer.json()["message"]


def test_live_data_are_sent_as_self_contained_batches(running: ServerProcess, tmp_path: Path) -> None:
    report, batches = streamed(running.url, 12)
    assert report["kind"] == "lag"
    assert report["lag_ms"] >= 0
    assert report["sent_ms"] > 1e12  # unix ms
    assert report["dropped"] == 0
    results: set[str] = set()
    for number, batch in enumerate(batches):
        path = tmp_path / f"{number}.rrd"
        path.write_bytes(batch)
        if RrdReader(path).recordings():
            results |= entities(path).keys()
    assert any(name.endswith("/body/shape") for name in results), results  # static data are sent to each
    assert any("Acceleration" in name for name in results)
    late, again = streamed(running.url, 6)
    assert late["kind"] == "lag"
    assert again[0] == batches[0]  # static data are sent first, also to a late viewer


def streamed(url: str, expected: int) -> tuple[dict[str, float], list[bytes]]:
    """Receive this many batches as a browser does, and the reports about them."""
    batches: list[bytes] = []
    subjects: dict[str, float] = {}
    with connect(url.replace("http", "ws") + "/rerun/live", max_size=None) as socket:
        while len(batches) < expected or not subjects:
            message = socket.recv(timeout=PATIENCE_S)
            if isinstance(message, str):
                subjects = json.loads(message)
            else:
                batches.append(message)
                socket.send(str(len(batches)))
    return subjects, batches


def test_a_stream_of_a_missing_device_is_refused_with_a_reason(running: ServerProcess) -> None:
    address = running.url.replace("http", "ws") + "/rerun/live?device=none"
    with connect(address) as socket, pytest.raises(ConnectionClosed, match="Device none not found"):
        socket.recv(timeout=PATIENCE_S)


async def test_a_slow_viewer_loses_the_oldest_samples_and_their_number_is_reported() -> None:
    viewer = RerunViewer()
    viewer.is_idle.append(b"still")
    for n in range(MAX_LIVE + 5):
        viewer.offer(float(n + 1), b"live %d" % n)
    viewer.remember(b"newest of before")
    viewer.remember(b"older")
    viewer.remember(bytes(PAST_BYTES))  # more than it may cost
    assert viewer.dropped == 5
    batches = []
    for n in range(MAX_LIVE + 3):
        batches.append((await viewer.take())[1])
        viewer.acknowledge(n + 1)
    assert batches[:2] == [b"still", b"live 5"]
    assert batches[-2:] == [b"newest of before", b"older"]


async def test_a_viewer_is_not_sent_ahead_of_what_it_has_taken() -> None:
    viewer = RerunViewer()
    for n in range(10):
        viewer.offer(1.0, b"%d" % n)
    for _ in range(MAX_UNACKNOWLEDGED):
        await viewer.take()
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.05):
            await viewer.take()
    viewer.acknowledge(1)
    assert (await viewer.take())[1] == b"%d" % MAX_UNACKNOWLEDGED
    viewer.lost = "The stream has ended."
    viewer.wake_event.set()
    with pytest.raises(ViewError):
        await viewer.take()


def batch(newest: float, data: bytes, *, still: bool = False, past: bool = False) -> dict[str, Any]:
    """A batch in the format of a feed's process."""
    text = base64.b64encode(data).decode()
    return {"op": "batch", "still": still, "restart": False, "past": past, "newest": newest, "data": text}


async def test_late_viewers_get_the_newest_data_first_and_memory_is_bounded() -> None:
    feed = RerunFeed(Telemetry.create(lambda: 100.0))
    feed._on_report(batch(0.0, b"still", still=True))
    for n in range(40):
        feed._on_report(batch(n + 1.0, b"%02d" % n + bytes(1 << 20)))
    assert sum(len(data) for _, data in feed._backlog) <= KEPT_BYTES
    viewer = feed.join()
    feed._on_report(batch(99.0, b"now"))  # live data are sent before older data
    batches = [await viewer.take() for _ in range(MAX_UNACKNOWLEDGED)]
    assert [data[:5].rstrip(b"\0") for _, data in batches] == [b"still", b"now", b"39", b"38"]
    assert feed.lag_ms(batches[1][0]) == 1000
    rest = 0
    while viewer.past:
        viewer.acknowledge(viewer.sent)
        rest += len((await viewer.take())[1])
    assert 0 < rest <= PAST_BYTES


class RerunMessage:
    """Input and output of a feed's process, without the process."""

    def __init__(self, devices: list[Any], channels: dict[int, Any]) -> None:
        self.devices, self.announced, self.channels, self.changed = devices, devices, channels, True
        self.batches: list[dict[str, Any]] = []

    def send(self, **words: Any) -> None:
        self.batches.append(words)

    def subscribe(self, channels: list[int], past: list[int], history: float) -> None:
        self.request = (channels, history)


@each_row("rate", [100, 2000])
def test_a_live_stream_is_columns_of_at_most_sixty_batches_a_second(
    rate: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Three seconds of a device, published 60 times a second on a clock of the test."""
    from imuscope.server.extensions.rerun import worker as rerun_worker

    clock = SimpleNamespace(now=50.0)
    monkeypatch.setattr(rerun_worker, "time", SimpleNamespace(monotonic=lambda: clock.now, sleep=lambda _: None))
    columns = [{"name": name, "unit": "m/s²", "label": "", "axis": name, "bits": []} for name in "xyz"]
    info = {"id": 7, "device": "d", "message": "m", "name": "a", "title": "Acceleration", "group": "", "doc": ""}
    report = RerunMessage(
        [{"id": "d", "name": "D"}], {7: info | {"kind": "vector", "unit": "m/s²", "frame": "", "columns": columns}}
    )
    feed = rerun_worker.RerunBatcher(report, {"device": "", "connect": ""})  # type: ignore[arg-type]
    feed.lay_out()
    sent = 0
    for tick in range(180):
        clock.now = 50.0 + tick / 60
        n = rate * (tick + 1) // 60 - sent
        at = np.arange(sent, sent + n) / rate
        feed.add([SampleFrame(7, sent, n, 0, False, 0.0, [at, at, at, at, at])])
        sent += n
    live = [words for words in report.batches if words["op"] == "batch" and not words["still"]]
    assert 30 <= len(live) <= 3 * 60
    whole = tmp_path / "live.rrd"
    rows = 0
    for words in live:
        whole.write_bytes(base64.b64decode(words["data"]))
        [chunk] = entities(whole)[name_of(("D", "Acceleration [m/s²]"))]
        rows += chunk.num_rows
    assert sent - rate / 10 <= rows <= sent  # rows missing in the last batch are in the next


def test_a_stream_keeps_nothing_of_devices_that_are_gone() -> None:
    """The stream to a viewer elsewhere lasts as long as the server, and a track is an hour of positions."""
    from imuscope.server.extensions.rerun.worker import RerunBatcher

    column = {"name": "value", "unit": "", "label": "", "axis": "", "bits": []}
    info = {"id": 7, "device": "d", "message": "m", "name": "a", "title": "A", "group": "", "doc": "", "frame": ""}
    report = RerunMessage([{"id": "d", "name": "D"}], {7: info | {"kind": "scalar", "unit": "", "columns": [column]}})
    feed = RerunBatcher(report, {"device": "", "connect": ""})  # type: ignore[arg-type]
    track = deque([(np.zeros(3), np.zeros(2))])
    feed._paths, feed._words = {"d": track, "gone": track}, {(7, 0): 1, (8, 0): 1}
    feed.lay_out()
    assert (list(feed._paths), list(feed._words)) == (["d"], [(7, 0)])


def test_an_invalid_viewer_address_is_refused_before_anything_starts() -> None:
    message = imuscope("serve", "--rerun-connect", "http://elsewhere")
    assert message.returncode == 1
    assert "rerun_connect" in message.stderr


def listens(port: int) -> None:
    """Wait for a viewer: a consumer of its data ends at once if there is none."""

    def is_there() -> bool:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            return True
        return False

    block_until(is_there, "the viewer elsewhere listens")


def test_it_streams_to_a_viewer_elsewhere(tmp_path: Path) -> None:
    """Rerun's own program in the viewer's place; what reached it is saved and read."""
    from imuscope.server.extensions.rerun.assets import program

    out, log = tmp_path / "got.rrd", tmp_path / "log"
    environment = {"HOME": str(tmp_path), "PATH": "/usr/bin:/bin", "NO_COLOR": "1"}
    port = free_port()
    options = ["--serve-grpc", "--bind", "127.0.0.1", "--port", str(port), "--server-memory-limit", "50MB"]
    with log.open("wb") as report:
        elsewhere = subprocess.Popen(
            [program(), *options], stdin=subprocess.DEVNULL, stdout=report, stderr=report, env=environment
        )
    try:
        address = f"rerun+http://127.0.0.1:{port}/proxy"
        with ServerProcess("sim:xbus", data=tmp_path / "data", arguments=("--rerun-connect", address)):
            listens(port)
            taker = subprocess.Popen(
                [program(), "--save", str(out), address],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment,
            )  # fmt: skip
            try:

                def has_come() -> bool:
                    assert taker.poll() is None
                    return out.is_file() and out.stat().st_size > 300_000

                block_until(has_come, "what reached it is saved")
            finally:
                taker.terminate()
                taker.wait(PATIENCE_S)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RerunWarning)  # the taker was ended: its file has no footer
            assert any("Acceleration" in name for name in entities(out))
    finally:
        elsewhere.kill()
        elsewhere.wait()


def test_a_stalled_remote_viewer_uses_no_memory_and_is_reported() -> None:
    """A stalled viewer: it accepts the connection and reads nothing. Rerun's SDK stores all data sent to it."""
    from imuscope.server.extensions.rerun import service as rerun_remote

    async def check(address: str) -> None:
        now = asyncio.get_running_loop().time
        telemetry = Telemetry.create(now)
        telemetry.bus.set_device(wire.DeviceInfo("1", "D", "sim:xbus", "simulator", "live"))
        columns = [wire.ColumnInfo(name, "f8", axis=name) for name in "xyz"]
        channel = telemetry.bus.advertise(
            wire.ChannelInfo(0, "1", "M", "a", "Acceleration", "vector", "m/s²", "", columns)
        )
        elsewhere = rerun_remote.RemoteRerun(telemetry, address, again_s=0.1, stuck_s=1.0).process
        elsewhere.start()
        highest, pids = 0.0, set[int]()
        try:
            async with asyncio.timeout(120):
                while len(pids) < 2:  # until it is begun again
                    at = now() - np.arange(2000, 0, -1) / 2000 * 0.02
                    telemetry.bus.publish([ChannelRows(channel, [at, at, at, at, at])])
                    telemetry.clients.request_flush()
                    await asyncio.sleep(0.02)  # fifty times the rate of a device
                    if elsewhere.pid is not None:
                        pids.add(elsewhere.pid)
                        highest = max(highest, resident_mb(elsewhere.pid))
        finally:
            await elsewhere.close()
        assert 0 < highest < 400, f"{highest:.0f} MB"
        texts = [event.text for event in telemetry.log if address in event.text]
        assert len(texts) == 1
        assert "does not accept data" in texts[0]

    with socket.create_server(("127.0.0.1", 0)) as hole:
        asyncio.run(check(f"rerun+http://127.0.0.1:{hole.getsockname()[1]}/proxy"))
