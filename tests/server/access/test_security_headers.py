"""Security headers of every response by path: policies, types, and permitted embedding."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from imuscope.server.settings.config import Config
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer

# Permissions of a page beyond the strict policy "only this server". All other responses contain no page.
WASM = "'wasm-unsafe-eval'"
PAGES = {"/": set(), "/docs": set(), "/docs/websocket": set(), "/rerun/": {WASM}, "/rerun/start.js": {WASM}}
DATA = (
    *("/api/devices", "/api/build", "/api/recordings", "/healthz", "/metrics", "/openapi.json", "/api/nothing"),
    *("/api/recordings/none", "/assets/none.js", "/api/ports/scan", "/viser", "/api/map", "/nothing.html"),
)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[InProcessServer]:
    with InProcessServer(Config(data=tmp_path_factory.mktemp("data"), sources=("/dev/one",)), FakeLink) as running:
        running.client.timeout = 60
        yield running


def policy_of(running: InProcessServer, path: str) -> dict[str, str]:
    answer = running.client.get(path)
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert answer.headers["cross-origin-resource-policy"] == "same-origin"
    assert len(answer.headers.get_list("content-security-policy")) == 1
    parts = (part.strip().partition(" ") for part in answer.headers["content-security-policy"].split(";"))
    return {name: value for name, _, value in parts}


@each_row("path", DATA)
def test_responses_other_than_pages_can_do_nothing_in_a_browser(path: str, running: InProcessServer) -> None:
    nothing = "'none'"
    expected = {"default-src": nothing, "frame-ancestors": nothing, "base-uri": nothing, "form-action": nothing}
    assert policy_of(running, path) == expected


@each_row("path", PAGES)
def test_a_page_may_do_what_it_needs_here_and_nothing_elsewhere(path: str, running: InProcessServer) -> None:
    policy = policy_of(running, path)
    assert policy["default-src"] == policy["base-uri"] == "'none'"
    assert policy["frame-ancestors"] == "'self'"
    allowed = {word for value in policy.values() for word in value.split()}
    assert allowed - {"'none'", "'self'", "data:", "blob:"} == PAGES[path]
    assert policy["script-src"].split()[0] == "'self'"
    assert policy["connect-src"] == "'self'"


def test_refusals_have_security_headers_too(running: InProcessServer) -> None:
    for headers in ({"host": "rebound.example"}, {"x-forwarded-for": "203.0.113.5"}):
        answer = running.client.get("/api/devices", headers=headers)
        assert answer.status_code in (401, 403)
        assert answer.headers["content-security-policy"].startswith("default-src 'none'")
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["cache-control"] == "no-store"


def test_pages_of_other_origins_cannot_read(running: InProcessServer) -> None:
    for method in ("GET", "OPTIONS"):
        answer = running.client.request(method, "/api/devices", headers={"origin": "https://elsewhere.example"})
        assert not [name for name in answer.headers if name.startswith("access-control-")]
