"""Map tiles: from the configured server only, images only, bounded, without access to other hosts."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
from httpx import Client

from imuscope.server.integrations.map_tiles import MAX_BYTES
from imuscope.server.settings.config import Config, MapTiles, load
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer

PNG = bytes.fromhex("89504e470d0a1a0a")


class TileServer(ThreadingHTTPServer):
    """A tile server that misbehaves at some places."""

    requests: list[str]


class TileHandler(BaseHTTPRequestHandler):
    server: TileServer

    def do_GET(self) -> None:
        self.server.requests.append(self.path)
        status, kind, data, more = {
            "/2/0/0.png": (404, "image/png", b"", {}),
            "/2/1/0.png": (302, "image/png", b"", {"location": "/0/0/0.png"}),
            "/2/2/0.png": (200, "text/html", b"<script>", {}),
            "/2/3/0.png": (200, "image/png", bytes(MAX_BYTES + 1), {}),
            "/2/0/1.png": (500, "image/png", b"", {}),
        }.get(self.path, (200, "image/png", PNG + self.path.encode(), {}))
        self.send_response(status)
        for name, value in {"content-type": kind, "content-length": str(len(data)), **more}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *args: Any) -> None:
        return


@pytest.fixture(scope="module")
def maps() -> Iterator[TileServer]:
    with TileServer(("127.0.0.1", 0), TileHandler) as server:
        server.requests = []
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def client(maps: TileServer) -> Iterator[Client]:
    settings = MapTiles(f"http://127.0.0.1:{maps.server_port}/{{z}}/{{x}}/{{y}}.png", "© somebody")
    with InProcessServer(Config(sources=("/dev/one",), map=settings), FakeLink) as running:
        yield running.client


def test_a_tile_comes_through_our_own_port_and_is_requested_once(client: Client, maps: TileServer) -> None:
    assert client.get("/api/map").json() == {"tiles": True, "attribution": "© somebody"}
    for _ in range(3):
        answer = client.get("/api/tiles/3/4/5")
        assert answer.content == PNG + b"/3/4/5.png"
        assert answer.headers["content-type"] == "image/png"
        assert "max-age" in answer.headers["cache-control"]
    assert maps.requests.count("/3/4/5.png") == 1


@each_row(
    ("place", "status"),
    [("2/0/0", 404), ("2/1/0", 502), ("2/2/0", 502), ("2/3/0", 502), ("2/0/1", 502)],
    ids=["none there", "a redirection", "no picture", "too large", "a fault"],
)
def test_responses_that_are_not_tiles_are_not_passed_on(
    client: Client, maps: TileServer, place: str, status: int
) -> None:
    before = len(maps.requests)
    answer = client.get(f"/api/tiles/{place}")
    assert answer.status_code == status
    assert answer.json().keys() == {"kind", "message", "hint"}
    assert len(maps.requests) == before + 1


@each_row("place", ["0/1/0", "3/0/8", "-1/0/0", "23/0/0", "1/a/0", "1/0/0.png", "1/..%2f..%2fx/0"])
def test_only_valid_tiles_are_requested(client: Client, maps: TileServer, place: str) -> None:
    before = len(maps.requests)
    assert client.get(f"/api/tiles/{place}").status_code in (404, 422)
    assert len(maps.requests) == before


def test_without_a_tile_server_no_request_is_made() -> None:
    with InProcessServer(Config(sources=("/dev/one",)), FakeLink) as running:
        assert running.client.get("/api/map").json() == {"tiles": False, "attribution": ""}
        assert running.client.get("/api/tiles/0/0/0").status_code == 404


def test_a_missing_tile_server_is_reported() -> None:
    settings = MapTiles("http://127.0.0.1:1/{z}/{x}/{y}.png")
    with InProcessServer(Config(sources=("/dev/one",), map=settings), FakeLink) as running:
        answer = running.client.get("/api/tiles/0/0/0")
        assert answer.status_code == 502
        assert answer.json()["kind"] == "tile-server"


def test_settings_that_can(tmp_path: Any) -> None:
    file = tmp_path / "imuscope.toml"
    file.write_text('port = 9000\n[map]\ntiles = "https://a/{z}/{x}/{y}.png?k=1"\nattribution = "© a"\n')
    assert load(file).map == MapTiles("https://a/{z}/{x}/{y}.png?k=1", "© a")
