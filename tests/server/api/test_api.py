"""The HTTP API: behaviour of the routes, and one error format for all."""

from __future__ import annotations

import json
import re
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from httpx import Client
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection
from websockets.typing import Origin, Subprotocol

from imuscope.server.access.auth import Access, Guard
from imuscope.server.app.build import create_app
from imuscope.server.http.page_files import Files
from imuscope.server.links.base import Link, LinkError, LinkSettings
from imuscope.server.settings.config import Config
from imuscope.server.streaming.send_queue import SendQueue
from imuscope.server.wire import SUBPROTOCOL
from tests.support.asgi_client import Answer, send_request
from tests.support.each_row import each_row
from tests.support.fakes import SPEECH, FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.problems import assert_problem
from tests.support.timeouts import PATIENCE_S, connect
from tests.support.waiting import block_until


def open_link(source: str, settings: LinkSettings) -> Link:
    if source.startswith("bad"):
        raise LinkError("bad-source", f"{source} is no source.", "Write /dev/tty…")
    return FakeLink(source, settings)


@pytest.fixture
def running() -> Iterator[InProcessServer]:
    with InProcessServer(Config(sources=("/dev/one",)), open_link) as running:
        yield running


@pytest.fixture
def client(running: InProcessServer) -> Client:
    return running.client


@pytest.fixture
def guarded() -> Config:
    return Config(host="0.0.0.0", sources=("/dev/one",), view_token="v" * 24, control_token="c" * 24)


def test_devices(client: Client) -> None:
    (device,) = client.get("/api/devices").json()
    assert (device["id"], device["source"], device["status"]) == ("1", "/dev/one", "connecting")
    added = client.post("/api/devices", json={"source": "/dev/two"})
    assert added.status_code == 201
    assert added.json()["id"] == "2"
    assert client.post("/api/devices/2/retry").json()["source"] == "/dev/two"
    assert client.delete("/api/devices/2").status_code == 204
    assert [one["id"] for one in client.get("/api/devices").json()] == ["1"]


def test_source_errors_are_reported(client: Client) -> None:
    body = assert_problem(client.post("/api/devices", json={"source": "bad:1"}), 400, "bad-source")
    assert body["message"].startswith("The source 'bad:1' cannot be used: 'bad' is not one of serial, tcp,")
    assert body["hint"].startswith("Sources look like /dev/ttyUSB0")
    assert_problem(client.post("/api/devices", json={"source": "/dev/one"}), 409, "busy")
    assert_problem(client.post("/api/devices", json={"source": "/dev/x", "protocol": "morse"}), 400, "bad-protocol")


@each_row("body", [{}, {"source": ""}, {"source": 1}, {"source": "x", "extra": 1}, [], "x", None])
def test_wrong_bodies(client: Client, body: Any) -> None:
    response = client.post("/api/devices", json=body)
    result = assert_problem(response, 422, "bad-request")
    assert result["hint"]


def test_a_body_that_is_not_json(client: Client) -> None:
    headers = {"content-type": "application/json"}
    assert_problem(client.post("/api/devices", content=b"{", headers=headers), 422)
    assert_problem(client.post("/api/devices", content=b"source=x"), 415, "not-json")


KEY = "00112233445566778899aabbccddeeff"


def test_decode_options_can_be_changed(client: Client) -> None:
    changed = client.post("/api/devices/1/decode-options", json={"key": KEY})
    assert changed.status_code == 200
    assert changed.json()["id"] == "1"
    assert KEY not in changed.text
    assert_problem(client.post("/api/devices/1/decode-options", json={"key": "xyz"}), 400, "bad-setting")
    assert_problem(client.post("/api/devices/1/decode-options", json={"protocol": "morse"}), 400, "bad-protocol")
    assert_problem(client.post("/api/devices/1/decode-options", json={"source": "/dev/two"}), 422)
    assert_problem(client.post("/api/devices/99/decode-options", json={}), 404, "not-found")


@each_row(
    "body",
    [
        {"source": "/dev/two", "key": KEY, "min_mode": "safety"},
        {"source": f"/dev/two?key={KEY}&protocol=idtp"},
        {"source": f"/dev/two?baud=9600&key={KEY}", "protocol": "idtp", "unverified": True},
    ],
)
def test_a_key_is_accepted_and_never_returned(client: Client, body: dict[str, Any]) -> None:
    added = client.post("/api/devices", json=body)
    assert added.status_code == 201
    assert added.json()["source"].startswith("/dev/two")
    assert KEY not in added.text + client.get("/api/devices").text
    assert_problem(client.post("/api/devices", json=body), 409, "busy")
    assert client.delete(f"/api/devices/{added.json()['id']}").status_code == 204


@each_row(
    "body",
    [
        {"key": "0g"},
        {"key": "123"},
        {"schema": "type ="},
        {"source": "/dev/two?key=0g"},
        {"source": "/dev/two?min_mode=strong"},
    ],
)
def test_settings_that_cannot_be_used(client: Client, body: dict[str, Any]) -> None:
    problem = assert_problem(client.post("/api/devices", json={"source": "/dev/two", **body}), 400, "bad-setting")
    assert "0g" not in json.dumps(problem)


def test_vendor_types_are_described_in_the_request(client: Client) -> None:
    schema = '[[message]]\ntype = 0x80\nname = "W"\n[[message.field]]\nname = "V"\ntype = "i16"\n'
    assert client.post("/api/devices", json={"source": "/dev/two", "schema": schema}).status_code == 201
    assert_problem(client.post("/api/devices", json={"source": "/dev/x?protocol=morse"}), 400, "bad-protocol")
    assert_problem(client.post("/api/devices", json={"source": "/dev/x", "min_mode": "strong"}), 422)


def test_unknown_devices(client: Client) -> None:
    assert_problem(client.delete("/api/devices/99"), 404, "not-found")
    assert_problem(client.post("/api/devices/99/retry"), 404, "not-found")


@pytest.fixture(scope="module")
def app() -> Guard:
    """The application without a server, for what is asked of every route: a request is ten times as quick."""
    config = Config(sources=("/dev/one",))
    app = create_app(config, Access(config), open_link=open_link, protocol_set=SPEECH)
    assert isinstance(app, Guard)
    return app


@pytest.fixture(scope="module")
def document(app: Guard) -> dict[str, Any]:
    """Its description of itself."""
    return json.loads(send_request(app, "GET", "/openapi.json", client="127.0.0.1").body)  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def routes(document: dict[str, Any]) -> list[tuple[str, str]]:
    paths = document["paths"]
    return [(path.replace("{device}", "99"), method.upper()) for path, methods in paths.items() for method in methods]


def is_shaped(template: str, path: str) -> bool:
    """Would the route answer at this path? /api/recordings/{recording} does at /api/recordings/start."""
    return re.fullmatch(re.sub(r"\\\{[^/]+\\\}", "[^/]+", re.escape(template)), path) is not None


def test_every_route_answers_errors_in_the_one_shape(app: Guard, routes: list[tuple[str, str]]) -> None:
    def request(method: str, path: str, headers: dict[str, str] | None = None, body: bytes = b"") -> Answer:
        length = {"content-length": str(len(body))} if body else {}
        headers = {"host": "127.0.0.1", **length, **(headers or {})}
        return send_request(app, method, path, headers, client="127.0.0.1", body=body)

    assert ("/api/devices", "POST") in routes
    for path, method in routes:
        for other in {"PUT", "PATCH", "POST", "DELETE"} - {verb for at, verb in routes if is_shaped(at, path)}:
            assert_problem(request(other, path), 405, "not-allowed")
        if path.startswith("/api"):
            assert_problem(request(method, path, {"host": "evil.example"}), 403, "bad-host")
        if method != "GET":
            assert_problem(request(method, path, {"origin": "http://evil.example"}), 403, "bad-origin")
            assert_problem(request(method, path, {"content-type": "text/plain"}, b"x=1"), 415)
    for path in ("/nothing", "/api/nothing", "/api", "/assets/none.js", "/..%2f..%2fetc/passwd", "/%00", "/a/b/c.d"):
        assert_problem(request("GET", path), 404, "not-found")


def test_the_token_of_the_printed_address_becomes_a_cookie(guarded: Config) -> None:
    with InProcessServer(guarded, open_link) as running:
        client = running.client
        answer = client.get(f"/?token={'v' * 24}&device=1", follow_redirects=False)
        assert answer.status_code == 303
        assert answer.headers["location"] == "./?device=1"  # wherever a proxy has put the server
        assert (answer.headers["cache-control"], answer.headers["referrer-policy"]) == ("no-store", "no-referrer")
        cookie = {part.strip() for part in answer.headers["set-cookie"].split(";")}
        assert {"HttpOnly", "SameSite=Strict"} <= cookie
        assert not any(part.startswith("Path") for part in cookie)  # it is that of the proxy
        assert client.get("/api/devices").status_code == 200  # the client kept the cookie
        assert_problem(client.post("/api/devices", json={"source": "/dev/two"}), 403, "view-only")
        elsewhere = client.get(f"{running.url}//evil.example/?token={'v' * 24}", follow_redirects=False)
        assert elsewhere.headers["location"] == "./"
        assert "Path=/;" in elsewhere.headers["set-cookie"]
        # A browser reads a backslash as a slash, and with a line break the answer could not be written.
        for path, place in (("%5cevil.example/", "./"), ("/x%5c%5cevil.example", "./x%5C%5Cevil.example")):
            answer = client.get(f"{running.url}/{path}?token={'v' * 24}", follow_redirects=False)
            assert answer.headers["location"] == place
        split = client.get(f"{running.url}/a%0d%0aset-cookie:x?token={'v' * 24}", follow_redirects=False)
        assert (split.status_code, split.headers["location"]) == (303, "./a%0D%0Aset-cookie%3Ax")


def test_an_internal_error_has_the_error_format(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imuscope.server.devices.link.sessions.Sessions.infos", property(lambda self: 1 / 0))
    assert_problem(client.get("/api/devices"), 500, "fault")


def test_openapi_documents_every_route(document: dict[str, Any]) -> None:
    for path, methods in document["paths"].items():
        for method, route in methods.items():
            where = f"{method} {path}"
            assert route.get("summary"), where
            assert route.get("description"), where
            for status in ("401", "403", "500"):
                schema = route["responses"][status]["content"]["application/json"]["schema"]
                assert schema == {"$ref": "#/components/schemas/ProblemBody"}, where
            if "{" in path:
                assert "404" in route["responses"], where
            shapes = [str(answer) for status, answer in route["responses"].items() if status >= "400"]
            assert all("ProblemBody" in shape for shape in shapes), f"{where}: errors have one shape"


def test_openapi_names_the_token_that_is_requested(document: dict[str, Any]) -> None:
    assert document["components"]["securitySchemes"]["token"]["scheme"] == "bearer"
    assert document["paths"]["/api/devices"]["get"]["security"] == [{"token": []}, {}]
    assert document["paths"]["/healthz"]["get"]["security"] == []


@each_row("path", ["/healthz", "/metrics", "/api/devices", "/api/build", "/api/nothing", "/openapi.json"])
def test_head_answers_with_the_headers_of_get(path: str, client: Client) -> None:
    """Regression: HEAD requests of monitoring probes were answered with 404."""
    head, got = client.head(path), client.get(path)
    assert (head.status_code, head.content) == (got.status_code, b"")
    assert head.headers["content-type"] == got.headers["content-type"]


def test_a_third_party_viewer_is_not_counted_as_a_browser(running: InProcessServer) -> None:
    """With --foxglove one browser was counted, before anybody had come."""
    outbox = SendQueue()
    outbox.is_browser = False
    running.call(running.services.telemetry.clients.attach, outbox)
    try:
        assert running.client.get("/healthz").json()["browsers"] == 0
        assert "\nimuscope_clients 0\n" in running.client.get("/metrics").text
    finally:
        running.call(running.services.telemetry.clients.detach, outbox)


def test_build_and_health(client: Client) -> None:
    build = client.get("/api/build").json()
    assert build["name"] == "imuscope"
    assert build["wire"] == SUBPROTOCOL
    assert "xbus" in build["protocols"]
    assert build["role"] == "control"
    tables = client.get("/api/commands").json()
    assert [one["protocol"] for one in tables] == ["xbus", "isb", "idtp"]
    assert all(one["commands"] for one in tables)
    assert client.get("/healthz").json() == {"status": "ok", "devices": 1, "browsers": 0}


def test_ports(client: Client) -> None:
    ports = client.get("/api/ports").json()
    assert isinstance(ports, list)
    assert client.post("/api/ports/scan", json={"ports": []}).json() == []
    assert client.post("/api/ports/scan", json={"ports": ["/etc/passwd"]}).json() == []  # only ports are opened


# ── the page's files ──


def test_the_page_and_its_headers(tmp_path: Path) -> None:
    (tmp_path / "assets").mkdir()
    (tmp_path / "index.html").write_text("<p>page</p>")
    (tmp_path / "icon.svg").write_text("<svg/>")
    (tmp_path / "assets" / "a-123.js").write_text("1")
    (tmp_path / "assets" / "a-123.js.br").write_bytes(b"brotli")
    (tmp_path / "assets" / "a-123.js.gz").write_bytes(b"gzip")
    with InProcessServer(Config(sources=("/dev/one",)), open_link, page_files=Files(tmp_path)) as running:
        client = running.client
        index = client.get("/", headers={"accept-encoding": "identity"})
        assert (index.text, index.headers["cache-control"]) == ("<p>page</p>", "no-cache")
        policy = index.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert index.headers["x-content-type-options"] == "nosniff"
        again = client.get("/", headers={"if-none-match": index.headers["etag"]})
        assert (again.status_code, again.text) == (304, "")
        for accepted, data in (("br, gzip", "br"), ("gzip", "gzip"), ("br;q=0, gzip", "gzip"), ("identity", "")):
            with client.stream("GET", "/assets/a-123.js", headers={"accept-encoding": accepted}) as answer:
                assert answer.headers.get("content-encoding", "") == data
                assert answer.headers["content-type"] == "text/javascript; charset=utf-8"
                assert "immutable" in answer.headers["cache-control"]
        assert client.get("/recordings", headers={"accept": "text/html"}).text == "<p>page</p>"
        assert client.head("/").status_code == 200
        assert_problem(client.get("/../config.py"), 404)
        icon = client.get("/favicon.ico")  # requests that a browser makes by itself
        assert (icon.text, icon.headers["content-type"]) == ("<svg/>", "image/svg+xml")
        assert_problem(client.get("/assets"), 404)


def test_a_missing_page_build_is_reported_with_the_command(tmp_path: Path) -> None:
    with InProcessServer(Config(sources=("/dev/one",)), open_link, page_files=Files(tmp_path)) as running:
        client = running.client
        answer = client.get("/")
        assert answer.status_code == 503
        assert "python web/build.py" in answer.text


# ── the WebSocket ──


def test_a_refused_websocket_is_not_logged_as_an_error(caplog: pytest.LogCaptureFixture, guarded: Config) -> None:
    """A page without a token filled the log with "ASGI callable returned without completing handshake"."""
    with InProcessServer(guarded, open_link) as running, pytest.raises(InvalidStatus) as refused, connect(running.ws):
        pass
    assert refused.value.response.status_code == 401
    assert json.loads(refused.value.response.body)["kind"] == "no-token"
    assert [record.getMessage() for record in caplog.records] == [
        "Refused WebSocket /ws from 127.0.0.1: This server asks for a token."
    ]


def test_the_websocket_reports_everything_and_answers(running: InProcessServer) -> None:
    with connect(running.ws, subprotocols=[Subprotocol(SUBPROTOCOL)]) as socket:
        assert socket.subprotocol == SUBPROTOCOL
        assert [json.loads(socket.recv())["op"] for _ in range(5)] == [
            "hello",
            "devices",
            "channels",
            "events",
            "health",
        ]

        def request(message: str | bytes, op: str) -> dict[str, Any]:
            socket.send(message)
            while (answer := json.loads(socket.recv(timeout=PATIENCE_S)))["op"] != op:
                assert answer["op"] in ("devices", "events", "health", "channels", "jobs")
            return dict(answer)

        assert request('{"op":"ping","t":7}', "pong")["t"] == 7
        assert set(request("nonsense", "error")) == {"op", "kind", "message", "hint"}
        assert request(b"binary", "error")["kind"] == "bad-request"
        assert request('{"op":"subscribe","history":5,"channels":null}', "history_end") == {"op": "history_end"}
        assert running.client.get("/healthz").json()["browsers"] == 1
    block_until(lambda: not running.client.get("/healthz").json()["browsers"], "a browser that left is not counted")


def test_a_wrong_subprotocol_is_reported(running: InProcessServer) -> None:
    with connect(running.ws, subprotocols=None) as socket:
        assert json.loads(socket.recv())["kind"] == "bad-subprotocol"


@each_row(("origin", "host"), [("http://evil.example", None), (None, "evil.example")])
def test_a_foreign_page_gets_no_websocket(running: InProcessServer, origin: str | None, host: str | None) -> None:
    url = running.ws if host is None else running.ws.replace("127.0.0.1", host)
    address = running.ws.removeprefix("ws://").removesuffix("/ws").split(":")
    with pytest.raises(InvalidStatus) as caught, socket_to(address, url, origin):
        pass
    assert caught.value.response.status_code == 403
    assert set(json.loads(caught.value.response.body)) == {"kind", "message", "hint"}


def socket_to(address: list[str], url: str, origin: str | None) -> ClientConnection:
    """A WebSocket to this address, whatever host the URL names: what a rebound name would do."""
    plain = socket.create_connection((address[0], int(address[1])))
    return connect(url, sock=plain, origin=Origin(origin) if origin else None)
