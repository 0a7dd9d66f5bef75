"""Files made to harm, uploaded, found in the folder and read by every route, while a device records at 400 Hz."""

from __future__ import annotations

import re
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import numpy as np

import imuscope
from tests.fault_injection import watched_server
from tests.fault_injection.hostile_files import HOSTILE
from tests.support.processes import resident_mb
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases" / "hostile"
LONGEST_S = 0.05  # for which the event loop may be held
MOST_MB = 20.0  # by which the memory of the server may grow
AT_ONCE = 4
PASSING_S = 0.5  # what must be opened first takes longer: its client goes
ROUTES = ("/reading", "/frames?time=1", "/download", "/original")
OPENING = ("", "/settings", "/clock", "/window?channel=1&t0=0&t1=1&width=10", "/frames?time=1&channel=1")
OPENED = (
    "view_messages.db3",
    "laughs.zip",
    "bomb.bag",
    "claims.mcap",
    "years.csv",
    "zero.npy",
    "bomb.mat",
    "deep.json",
)
"""Those that are copied and opened, too: each takes a process that starts anew."""
SENTENCE = re.compile(r"\S.{0,1000}[.?]", re.DOTALL)


def _upload(client: httpx.Client, name: str, data: bytes) -> httpx.Response:
    head = {"content-type": "application/octet-stream"}
    return client.put("/api/recordings/upload", params={"name": name}, content=data, headers=head)


def _read(client: httpx.Client, recording: str) -> list[str]:
    """Ask every route of a recording; returns what is wrong with the answers."""
    wrong = []
    is_opened = any(name.rpartition(".")[0] in recording for name in OPENED)
    for route in (*ROUTES, *(OPENING if is_opened else ())):
        try:
            with client.stream(
                "GET", f"/api/recordings/{quote(recording, safe='')}{route}", timeout=PASSING_S
            ) as answer:
                if answer.status_code == 500:
                    wrong.append(f"{recording}{route}: {answer.status_code}")
        except httpx.TimeoutException:
            continue  # it is still being opened
        except httpx.TransportError:
            continue  # a download whose file cannot be read to its end
    return wrong


def test_hostile_files_harm_neither_the_server_nor_a_recording(tmp_path: Path) -> None:
    """An upload of 891 bytes ended the server, another froze it, and twelve reads of a view kept its threads."""
    hostile = {name: make(tmp_path) for name, make in HOSTILE.items()}
    if CASES.is_dir():
        hostile |= {f"given-{path.name}": path.read_bytes() for path in CASES.iterdir() if path.suffix != ".md"}
    source = "sim:xbus?rate=400&seed=1"
    server = ServerProcess(source, data=tmp_path / "data", arguments=("--record",), module=watched_server.__name__)
    with server, httpx.Client(base_url=server.url, timeout=3 * PATIENCE_S) as client:  # four wait for two processors
        assert (
            _upload(client, "warm.csv", b"time (s),x\n" + b"".join(b"%d,1\n" % n for n in range(100))).status_code
            == 201
        )
        assert not _read(client, "warm")
        assert client.get("/api/recordings/warm/window?channel=1&t0=0&t1=1&width=10").status_code in (200, 404)
        assert _upload(client, "warm.db3", b"SQLite format 3\0").status_code == 422
        pid = server.process.pid
        server.process.send_signal(signal.SIGUSR1)
        before_mb = resident_mb(pid)
        with ThreadPoolExecutor(AT_ONCE) as pool:
            answers = dict(zip(hostile, pool.map(lambda one: _upload(client, *one), hostile.items()), strict=True))
            for name, answer in answers.items():
                assert answer.status_code in (201, 422), (name, answer.text)
                if answer.status_code == 422:
                    assert SENTENCE.fullmatch(answer.json()["message"]), (name, answer.text)
            for name in (*OPENED, *(one for one in hostile if one.startswith("given-"))):  # and as somebody copies them
                (server.data / "recordings" / f"copied-{name}").write_bytes(hostile[name])
            listed: list[dict[str, Any]] = client.get("/api/recordings").json()
            assert {"copied-zero", "copied-view_messages"} <= {one["id"] for one in listed}
            wrong = [one for many in pool.map(lambda one: _read(client, one["id"]), listed) for one in many]
            assert not wrong, "\n".join(wrong)
        assert client.get("/healthz").status_code == 200
        grown_mb = resident_mb(pid) - before_mb
        server.process.terminate()
        assert server.process.wait(PATIENCE_S) in (0, 143, -signal.SIGTERM)
        block_until(lambda: "held at most" in server.log, "the server says what held it")
    held_s = float(re.search(r"held at most ([\d.]+) ms", server.log)[1]) / 1e3  # type: ignore[index]
    print(f"held {held_s * 1e3:.0f} ms, grew by {grown_mb:.0f} MB")
    [path] = (server.data / "recordings").glob("*Z-*.mcap")
    counter = np.asarray(imuscope.open(path)["PacketCounter"].values).astype(int)
    assert len(counter) > 1000
    assert set(np.diff(counter) % 65536) == {1}, "the recording has a hole"
    assert grown_mb < MOST_MB
    assert held_s < LONGEST_S
    assert "Traceback" not in server.log, server.log
