"""Corrections over HTTP, on a running server with real simulators."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from httpx import Client

from imuscope.recordings.mcap.source import McapSource
from imuscope.server.api.devices import check_path
from imuscope.server.errors import DomainError
from imuscope.server.extensions.corrections.routes import CorrectionManager
from imuscope.server.extensions.corrections.stream import file_of
from imuscope.server.settings.config import Config
from tests.server.extensions.corrections.correction_messages import NUMBERS, STREAM
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, http_client
from tests.support.waiting import block_until


@pytest.fixture
def client(serve: Callable[..., ServerProcess]) -> Iterator[Client]:
    server = serve("sim:isb?rate=10", "sim:idtp?rate=10")
    with http_client(base_url=server.url, headers={"x-data": str(server.data)}) as client:
        yield client


def until(client: Client, path: str, true: Any, seconds: float = PATIENCE_S) -> dict[str, Any]:
    def result() -> dict[str, Any] | None:
        body: dict[str, Any] = client.get(path).json()
        return body if true(body) else None

    body: dict[str, Any] = block_until(result, lambda: client.get(path).text, seconds=seconds)
    return body


@pytest.fixture
def base() -> Iterator[int]:
    """A base station that serves every client; returns its port."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        connection, _ = server.accept()
        connection.sendall(STREAM)
        connection.recv(1)
        connection.close()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield int(server.getsockname()[1])
    server.close()
    thread.join(PATIENCE_S)


def test_a_stream_is_set_watched_and_ended(client: Client, base: int) -> None:
    path = "/api/devices/1/corrections"
    assert client.get(path).json() == {
        **{"source": "", "running": False, "message": "", "hint": "", "age_s": None, "bytes_per_s": 0.0},
        **{"messages": {}, "rejected": 0, "refused": 0, "forwarding": False},
    }
    until(client, "/api/devices", lambda devices: devices[0]["status"] == "live")
    assert client.put(path, json={"source": f"tcp://127.0.0.1:{base}"}).status_code == 200
    state = until(client, path, lambda body: body["messages"] == NUMBERS)
    assert (state["running"], state["forwarding"], state["rejected"], state["refused"]) == (True, True, 0, 0)
    assert state["age_s"] < 20
    assert client.delete(path).json()["running"] is False
    assert client.get(path).json()["source"] == ""


def test_a_refusing_source_is_not_reported_as_forwarding(client: Client) -> None:
    """It was shown as "Running", because it is tried again."""
    until(client, "/api/devices", lambda devices: devices[0]["status"] == "live")
    path = "/api/devices/1/corrections"
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    client.put(path, json={"source": f"ntrip://me:secret@127.0.0.1:{port}/NEAR"}).raise_for_status()
    state = until(client, path, lambda body: body["hint"] != "")
    assert (state["running"], state["forwarding"]) == (True, False)
    client.delete(path).raise_for_status()


def test_forwarded_corrections_are_logged_and_recorded(client: Client, base: int) -> None:
    """The bytes were there; that and how long corrections were forwarded was nowhere to be read."""
    until(client, "/api/devices", lambda devices: devices[0]["status"] == "live")
    client.post("/api/recordings/start", json={"devices": ["1"], "title": "corrected"}).raise_for_status()
    client.put("/api/devices/1/corrections", json={"source": f"tcp://127.0.0.1:{base}"}).raise_for_status()
    until(client, "/api/devices/1/corrections", lambda body: body["messages"] == NUMBERS)
    client.delete("/api/devices/1/corrections").raise_for_status()
    log = client.get("/api/devices/1/traffic").json()
    [first] = [entry for entry in log if "are forwarded" in entry["text"]]  # one entry, not one a message
    assert first["direction"] == "tx"
    assert STREAM.startswith(bytes.fromhex(first["hex"]))
    client.post("/api/recordings/stop", json={}).raise_for_status()
    results: Any = until(client, "/api/recordings", lambda results: bool(results) and not results[0]["recording"])
    detail = until(client, f"/api/recordings/{results[0]['id']}", lambda body: "events" in body)
    messages = [event["text"] for event in detail["events"] if event["text"].startswith("Corrections ")]
    assert [text.partition(" from ")[0] for text in messages] == ["Corrections", "Corrections"]
    assert messages[0].endswith("are forwarded.")
    assert "Forwarded: 4 messages" in messages[1]
    assert "1077 × 1" in messages[1]
    path = next(Path(str(client.headers["x-data"])).glob("recordings/*.mcap"))
    sent = b"".join(part.data for part in McapSource(path).parts() if part.direction == "tx")
    assert STREAM in sent


def test_invalid_requests_are_answered_with_a_reason(client: Client) -> None:
    until(client, "/api/devices", lambda devices: all(one["status"] == "live" for one in devices[:2]))
    wrong = client.put("/api/devices/1/corrections", json={"source": "ntrip://me:secret@host"})
    assert (wrong.status_code, wrong.json()["message"]) == (400, "The caster lacks a mount point.")
    assert "secret" not in wrong.text
    none = client.put("/api/devices/2/corrections", json={"source": "tcp://127.0.0.1:1"})
    assert (none.status_code, none.json()["kind"]) == (409, "no-receiver")
    assert client.get("/api/devices/99/corrections").status_code == 404


def test_corrections_are_read_from_explicit_files_only(tmp_path: Path) -> None:
    """They were a second door to any file of the server's user: one learned what is there, and a device was sent it."""
    secret, named = tmp_path / "base.rtcm3", tmp_path / "captures" / "base.rtcm3"
    named.parent.mkdir()
    for file in (secret, named):
        file.write_bytes(b"")
    (named.parent / "link").symlink_to(secret)
    folders = [named.parent]
    for refused in (secret, "/etc/passwd", f"file://{secret}", named.parent / "link", named.parent / ".." / "x"):
        file_there = file_of(str(refused))
        assert file_there is not None
        with pytest.raises(DomainError, match="configured folders"):
            check_path(file_there, folders)
    allowed = file_of(f"file://{named}")
    assert allowed is not None
    check_path(allowed, folders)
    assert file_of("tcp://127.0.0.1:2101") is None


def test_corrections_from_any_file_are_refused_over_http(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(CorrectionManager, "accepts", lambda *_: True)
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running:
        answer = running.client.put("/api/devices/1/corrections", json={"source": "/etc/passwd"})
        assert (answer.status_code, answer.json()["kind"]) == (403, "file-not-allowed")
