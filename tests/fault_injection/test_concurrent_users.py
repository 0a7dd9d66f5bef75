"""Users who close their browser during a command, or send commands at the same time.

    fault                                   outcome
    browser gone once the command was sent  the command is carried out to its end, and the device measures again
    browser gone while it sends             nothing is sent to the device, nothing is recorded as a fault of ours
    two people command at once              one after the other, in the order in which they came; both are told
    browser gone in the middle of an upload nothing is left of it

(Turns in a queue: tests/server/configuration/test_device_controller.py, tests/server/api/test_configure.py. A trial
that nobody keeps because the browser is gone: tests/browser/test_configure.py.)
"""

from __future__ import annotations

import json
import socket
import struct
import threading
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.links.source_url import open_link
from imuscope.server.settings.config import Config
from tests.support.control_harness import outputs
from tests.support.in_process_server import InProcessServer
from tests.support.timeouts import http_client
from tests.support.waiting import block_until


def request(url: str, path: str, body: bytes, length: int | None = None, kind: str = "application/json") -> bytes:
    """A POST as a browser sends it."""
    host = urlsplit(url).netloc
    verb = "POST" if kind == "application/json" else "PUT"
    head = f"{verb} {path} HTTP/1.1\r\nHost: {host}\r\nContent-Type: {kind}\r\n"
    return f"{head}Content-Length: {len(body) if length is None else length}\r\n\r\n".encode() + body


def send_and_vanish(url: str, data: bytes) -> None:
    """Sent, and the connection is reset: what a browser does that is closed."""
    address = urlsplit(url)
    with socket.create_connection((address.hostname, address.port)) as line:
        line.sendall(data)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


def test_clients_that_disconnect_midway(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with InProcessServer(Config(sources=("sim:xbus",), data=tmp_path), open_link, all_protocols()) as running:
        http, url = running.client, running.url
        block_until(lambda: http.get("/api/devices").json()[0]["status"] == "live", "it streams")
        control = "/api/devices/1/jobs"

        body = json.dumps({"changes": {"OutputConfiguration": outputs(50)}, "confirmed": True}).encode()
        send_and_vanish(url, request(url, "/api/devices/1/apply", body[:40], len(body)))
        data = request(url, "/api/recordings/upload?name=a.mcap", b"\x89MCAP0", 10**6, "application/octet-stream")
        send_and_vanish(url, data)
        assert http.get(control).json()["done"] == [], "half a wish is none"

        send_and_vanish(url, request(url, "/api/devices/1/apply", body))
        (job,) = block_until(lambda: http.get(control).json()["done"], "it was carried out")
        assert (job["state"], job["message"]) == ("done", "1 of 1 settings written and read back.")
        block_until(lambda: http.get("/api/devices").json()[0]["status"] == "live", "it measures again")
        block_until(lambda: not list((tmp_path / "recordings").glob(".incoming/*")), "nothing of the upload is left")
        assert http.get("/api/recordings").json() == []
    assert not [record for record in caplog.records if record.exc_info], "nobody's leaving is a fault of ours"


def test_two_users_at_once(tmp_path: Path) -> None:
    with InProcessServer(Config(sources=("sim:xbus",), data=tmp_path), open_link, all_protocols()) as running:
        http = running.client
        block_until(lambda: http.get("/api/devices").json()[0]["status"] == "live", "it streams")
        answers: list[dict[str, Any]] = []
        both = threading.Barrier(2)

        def wish(rate: int) -> None:
            with http_client(base_url=running.url) as own:
                both.wait()
                body = {"changes": {"OutputConfiguration": outputs(rate)}, "confirmed": True}
                answers.append(own.post("/api/devices/1/apply", json=body).json())

        people = [threading.Thread(target=wish, args=(rate,)) for rate in (50, 200)]
        for person in people:
            person.start()
        for person in people:
            person.join()
        done = block_until(
            lambda: len(result := http.get("/api/devices/1/jobs").json()["done"]) == 2 and result, "both"
        )
        assert {one["id"] for one in done} == {one["id"] for one in answers} == {1, 2}
        assert [one["state"] for one in done] == ["done", "done"]
        last, first = done  # newest first
        assert first["ended"] <= last["started"], "one after the other"
        values = http.get("/api/devices/1/values").json()["values"]["OutputConfiguration"]
        rates = {one["output_frequency"] for one in values["outputs"]} - {0xFFFF}
        assert len(rates) == 1, "never a mixture of both"
        block_until(lambda: http.get("/api/devices").json()[0]["status"] == "live", "it measures again")
