"""Every route and WebSocket with every role where a token is required: changes need the control role.

The expectation is derived from the method, so that a route that is added is judged by it: GET, HEAD and OPTIONS look,
all others change something. What differs from that stands in the two lists here, one by one and with its reason.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.routing import Route, WebSocketRoute

from imuscope.server import wire
from imuscope.server.access.auth import Access, Guard, path_on_robot
from imuscope.server.app.build import create_app
from imuscope.server.services.extension import extensions
from imuscope.server.settings.config import Config
from imuscope.server.wire.codec import WireError, decode_text
from tests.support.asgi_client import ACCEPTED, Answer, Reached, send_request
from tests.support.each_row import each_row

VIEW, CONTROL = "view-token-of-this-test", "control-token-of-this-test"
TOKENS = {"none": "", "view": VIEW, "control": CONTROL, "wrong": "w" * 30}
REFUSALS = {"none": "no-token", "wrong": "bad-token"}
SAFE = {"GET", "HEAD", "OPTIONS"}
METHODS = ("GET", "HEAD", "OPTIONS", "POST", "PUT", "PATCH", "DELETE", "TRACE", "PROPFIND", "get", "post", "X")

# POST, because they carry values: what would be sent, would it fit, in what do two sides differ, figures of a range.
# They change nothing.
REQUESTING = {
    *(
        "/api/analysis/{name}",
        "/api/analysis/pairs",
        "/api/alarms/check",
        "/api/alarms/preview",
        "/api/calibration/{kind}",
        "/api/comparison",
        "/api/comparison/settings",
        "/api/query",
    ),
    *(f"/api/devices/{{device}}/{what}" for what in ("preview", "fit-rates", "compare")),
}
# Without a token: they hold nothing of the devices. /robots/NAME only leads to the fleet server's own page.
OPEN = {"/healthz", "/{name:path}", "/docs", "/docs/{name}", "/robots/{robot}", "/robots/{robot}/{name:path}"}
# WebSockets, all of which only look; a scene's panel is dealt with in test_viewer_secrets.py.
SOCKETS = {
    *("/ws", "/ws/scene/{recording}", "/viser", "/viser/{key}", "/rerun/live", "/foxglove", "/foxglove/"),
    "/robots/{robot}/ws",
}


@functools.cache
def settings(folder: Path) -> Config:
    return Config(host="0.0.0.0", data=folder, view_token=VIEW, control_token=CONTROL)


def access_to(folder: Path) -> Access:
    """Access with the rules of all extensions."""
    access = Access(settings(folder))
    for one in extensions():
        access.routes.add(one.places, one.read_only_posts)
    return access


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Guard:
    config = settings(tmp_path_factory.mktemp("data"))
    app = create_app(config, Access(config))
    assert isinstance(app, Guard)  # around everything
    return app


@pytest.fixture(scope="module")
def routes(guarded: Guard) -> list[Any]:
    """Every route of the application, including undocumented ones."""
    application: Any = guarded.app
    results = list(_leaves(application.framework().routes))
    documented = {
        (path, method.upper()) for path, ways in application.framework().openapi()["paths"].items() for method in ways
    }
    assert documented <= {(route.path, method) for route in results for method in getattr(route, "methods", None) or ()}
    return results


def _leaves(routes: Any) -> Iterator[Any]:
    for route in routes:
        if isinstance(route, Route | WebSocketRoute):
            yield route
        else:  # an included router; any other kind would escape this check
            yield from _leaves(route.original_router.routes)


def attempt(folder: Path, method: str, path: str, token: str, body: str = "") -> tuple[Answer, str]:
    """The answer, and the role that reached the application."""
    reached = Reached()
    headers = {"authorization": f"Bearer {token}"} if token else {}
    if body:
        headers |= {"content-type": body, "content-length": "2"}
    answer = send_request(Guard(reached, access_to(folder)), method, path, headers)
    return answer, reached.role


def filled(path: str) -> str:
    return re.sub(r"\{.*?\}", "1", path)


def test_every_route_with_every_role(routes: list[Any], tmp_path: Path) -> None:
    plain = [route for route in routes if isinstance(route, Route)]
    assert len(plain) > 60
    for route, role in itertools.product(plain, TOKENS):
        for method in {*METHODS, *(route.methods or ())}:
            upload = (method, route.path) == ("PUT", "/api/recordings/upload")
            body = "" if method in SAFE else "application/octet-stream" if upload else "application/json"
            answer, reached = attempt(tmp_path, method, filled(route.path), TOKENS[role], body)
            what = (method, route.path, role)
            if route.path.startswith("/api/") and not upload:  # the same through the line of a robot
                through, reached_robot = attempt(tmp_path, method, "/robots/1" + filled(route.path), TOKENS[role], body)
                assert (through.status, reached_robot) == (answer.status, reached), what
            if route.path in OPEN:
                assert reached == "open", what
                continue
            views = method in SAFE or (method == "POST" and route.path in REQUESTING)
            if role in REFUSALS:
                assert (answer.status, reached) == (401, ""), what
                assert answer.json()["kind"] == REFUSALS[role], what
            elif role == "control" or views:
                assert (answer.status, reached) == (200, role), what
            else:
                assert (answer.status, reached, answer.json()["kind"]) == (403, "", "view-only"), what


def test_read_only_routes_are_those_listed(routes: list[Any], tmp_path: Path) -> None:
    """An outdated entry in the list would authorise a route that is added later."""
    paths = {route.path for route in routes}
    assert paths >= REQUESTING | OPEN | SOCKETS
    rules = access_to(tmp_path).routes
    assert {route.path for route in routes if not rules.is_protected(path_on_robot(filled(route.path)))} == OPEN
    assert not REQUESTING & {
        route.path for route in routes if {"PUT", "PATCH", "DELETE"} & set(getattr(route, "methods", ()) or ())
    }


def test_every_websocket_with_every_role(routes: list[Any], tmp_path: Path) -> None:
    sockets = [route.path for route in routes if isinstance(route, WebSocketRoute)]
    assert set(sockets) == SOCKETS  # an added one: state what it can change
    for path, role in itertools.product(sockets, TOKENS):
        answer, reached = attempt(tmp_path, "WS", filled(path), TOKENS[role])
        expected = (ACCEPTED, role) if role in ("view", "control") else (401, "")
        assert (answer.status, reached) == expected, (path, role)


def test_websocket_messages_change_nothing() -> None:
    """All three requests: what is sent, how often, and a question for the time. All else goes over HTTP."""
    request = {
        one
        for one in vars(wire).values()
        if isinstance(one, type) and one.__name__ in ("Subscribe", "Interval", "Ping")
    }
    understood = set()
    for name in {one.__dataclass_fields__["op"].default for one in vars(wire).values() if _has_op(one)}:
        try:
            understood.add(type(decode_text(f'{{"op": "{name}", "channels": null, "history": 0, "t": 1, "s": 1}}')))
        except WireError:
            continue
    assert understood == request


def _has_op(one: Any) -> bool:
    return isinstance(one, type) and "op" in getattr(one, "__dataclass_fields__", {})


@each_row(
    "path",
    [
        *("/api/devices/", "//api/devices", "/api//devices", "/./api/devices", "/x/../api/devices", "/API/devices"),
        *("/%61pi/devices", "/api%2Fdevices", "/api/devices%00", "/api;x/devices", "/\\api\\devices", "/api\n", "/ws/"),
        *("/robots//api/devices", "/robots/x//api/devices", "/robots/x/y/api/devices", "/robots/x/../api/devices"),
        *("/robots/x/api%2Fdevices", "/robots/x%2Fapi/devices", "/robots/x/%61pi/devices", "/ROBOTS/x/api/devices"),
        *("/robots/x\n/api/devices", "/robots/x/api\n", "/robots/x/API/devices", "/robots/x/ws/"),
    ],
)
def test_no_way_of_writing_a_path_leads_around_the_guard(path: str, guarded: Guard) -> None:
    """A path that resembles one of the page is answered by the page, and there is no such file."""
    assert send_request(guarded, "DELETE", path).status in (401, 404, 405)
    assert send_request(guarded, "GET", path).status in (401, 404)


def test_a_token_of_one_role_reveals_nothing_of_the_other(tmp_path: Path) -> None:
    """With two tokens in one request, the explicit one decides, not the cookie of an earlier visit."""
    headers = {"cookie": f"{Access(settings(tmp_path)).cookie_name}={CONTROL}"}
    reached = Reached()
    guard = Guard(reached, Access(settings(tmp_path)))
    assert send_request(guard, "DELETE", f"/api/devices/1?token={VIEW}", headers).status == 403
    assert send_request(guard, "DELETE", "/api/devices/1", {**headers, "authorization": f"Bearer {VIEW}"}).status == 403
    assert send_request(guard, "DELETE", "/api/devices/1", headers).status == 200
