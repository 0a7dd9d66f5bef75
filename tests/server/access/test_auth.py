"""Access control: the complete matrix of origins, routes and credentials."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.access.auth import Access, RefusedError
from imuscope.server.errors import status_of
from imuscope.server.settings.config import Config
from tests.support.each_row import each_row

VIEW, CONTROL = "view-token-1", "control-token-1"
JSON = {"content-type": "application/json", "content-length": "2"}


def access(host: str = "127.0.0.1", **settings: object) -> Access:
    return Access(Config(host=host, view_token=VIEW, control_token=CONTROL, **settings))  # type: ignore[arg-type]


def outcome(rules: Access, method: str = "GET", client: str = "127.0.0.1", **source: object) -> str | int:
    """Role, or status of the refusal."""
    headers = {"host": "127.0.0.1:8080", **source.pop("headers", {})}  # type: ignore[dict-item]
    try:
        return rules.check("/api/devices", method, headers, client=client, **source)  # type: ignore[arg-type]
    except RefusedError as refused:
        return status_of(refused.kind)


WHERE = {
    "loopback": ("127.0.0.1", "127.0.0.1", {}),
    "loopback v6": ("::1", "::1", {}),
    "localhost": ("localhost", "127.0.0.1", {}),
    "behind a proxy": ("127.0.0.1", "127.0.0.1", {"x-forwarded-for": "203.0.113.5"}),
    "behind another proxy": ("127.0.0.1", "127.0.0.1", {"forwarded": "for=203.0.113.5"}),
    "network": ("0.0.0.0", "192.0.2.7", {}),
    "network, from here": ("0.0.0.0", "127.0.0.1", {}),
    "loopback, foreign peer": ("127.0.0.1", "192.0.2.7", {}),
}
TOKENS = {"none": "", "view": VIEW, "control": CONTROL, "wrong": "wrong-token-1"}
WAYS = ("bearer", "query", "cookie")


@each_row(
    ("where", "token", "way", "method"),
    list(itertools.product(WHERE, TOKENS, WAYS, ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE"])),
)
def test_matrix(where: str, token: str, way: str, method: str) -> None:
    host, client, headers = WHERE[where]
    rules = access(host)
    value = TOKENS[token]
    headers = {**headers, **(JSON if method in ("POST", "PUT", "PATCH") else {})}
    query = ""
    if value and way == "bearer":
        headers["authorization"] = f"Bearer {value}"
    elif value and way == "cookie":
        headers["cookie"] = f"other=1; {rules.cookie_name}={value}"
    elif value:
        query = value
    got = outcome(rules, method, client, headers=headers, query_token=query)
    is_local = where in ("loopback", "loopback v6", "localhost")
    role = {"none": "control" if is_local else None, "wrong": "control" if is_local else None}.get(token, token)
    if role is None:
        assert got == 401
    elif role == "view" and method not in ("GET", "HEAD"):
        assert got == 403
    else:
        assert got == role


@each_row("site", ["cross-site", "same-site"])
def test_a_page_of_another_site_changes_nothing_though_it_sends_no_origin(site: str) -> None:
    """Only reads were guarded by what browsers say of the site that asks."""
    assert outcome(access(), "POST", headers={**JSON, "sec-fetch-site": site}) == 403
    assert outcome(access(), "POST", headers={**JSON, "sec-fetch-site": "same-origin"}) == "control"


def test_a_page_of_another_origin_may_link_here_and_embed_nothing() -> None:
    """Regression: an image with the address /viser/ started viser from any page."""
    batch = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors", "sec-fetch-dest": "image"}
    assert outcome(access(), headers=batch) == 403
    assert outcome(access(), headers={**batch, "sec-fetch-site": "same-site"}) == 403  # another port of this machine
    assert outcome(access(), headers={**batch, "referer": "https://elsewhere.example/page"}) == 403
    assert outcome(access(), headers={**batch, "sec-fetch-dest": "iframe", "sec-fetch-mode": "navigate"}) == 403
    led = {**batch, "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
    assert outcome(access(), headers=led) == "control"
    for own in ("same-origin", "none"):
        assert outcome(access(), headers={**batch, "sec-fetch-site": own}) == "control"
    listed = access(allowed_origins=("https://elsewhere.example",))
    assert outcome(listed, headers={**batch, "referer": "https://elsewhere.example/page"}) == "control"
    assert outcome(listed, headers={**batch, "origin": "https://elsewhere.example"}) == "control"
    assert outcome(listed, headers={**batch, "referer": "https://others.example/"}) == 403


def test_tokens_are_made_up_beyond_loopback_only() -> None:
    assert Access(Config()).control_token == ""
    first, second = Access(Config(host="0.0.0.0")), Access(Config(host="0.0.0.0"))
    tokens = {first.control_token, first.view_token, second.control_token, second.view_token}
    assert len(tokens) == 4
    assert min(map(len, tokens)) >= 20


def test_a_proxy_before_a_server_without_tokens_is_refused() -> None:
    rules = Access(Config())
    assert outcome(rules, headers={"x-forwarded-for": "203.0.113.5"}) == 401
    assert outcome(rules, headers={"x-forwarded-for": "x"}, query_token="") == 401


@each_row(
    ("origin", "host", "is_allowed"),
    [
        (None, "127.0.0.1:8080", True),  # no browser
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("https://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("http://LOCALHOST:8080", "localhost:8080", True),
        ("http://[::1]:8080", "[::1]:8080", True),
        ("http://127.0.0.1:9090", "127.0.0.1:8080", False),  # another server on the same machine
        ("http://localhost:8080", "127.0.0.1:8080", False),
        ("https://evil.example", "127.0.0.1:8080", False),
        ("http://127.0.0.1:8080.evil.example", "127.0.0.1:8080", False),
        ("null", "127.0.0.1:8080", False),
        ("", "127.0.0.1:8080", False),
        ("file://127.0.0.1:8080", "127.0.0.1:8080", False),
        ("https://fleet.example", "127.0.0.1:8080", True),  # listed
    ],
)
def test_origin(origin: str | None, host: str, is_allowed: bool) -> None:
    rules = access(allowed_origins=("https://fleet.example/",))
    headers = {"host": host, **({} if origin is None else {"origin": origin})}
    assert outcome(rules, "POST", headers={**headers, **JSON}) == ("control" if is_allowed else 403)
    assert outcome(rules, "DELETE", headers=headers) == ("control" if is_allowed else 403)
    assert outcome(rules, "GET", headers=headers, websocket=True) == ("control" if is_allowed else 403)
    assert outcome(rules, "GET", headers=headers) == "control"  # the browser itself prevents reading


@each_row(
    ("host", "is_allowed"),
    [
        ("127.0.0.1", True),
        ("127.0.0.1:8080", True),
        ("192.0.2.7:8080", True),  # a literal address cannot be rebound
        ("[2001:db8::1]:8080", True),
        ("localhost", True),
        ("LocalHost:1", True),
        ("localhost.", True),
        ("robot.example:8080", True),  # listed
        ("evil.example", False),
        ("localhost.evil.example", False),
        ("", False),
        ("[", False),
        ("[::1].evil.example", False),
        ("[::1]:8080.evil.example", False),
        ("127.0.0.1.evil.example", False),
    ],
)
def test_host(host: str, is_allowed: bool) -> None:
    rules = access(allowed_hosts=("Robot.example",))
    for method in ("GET", "DELETE"):
        assert outcome(rules, method, headers={"host": host}) == ("control" if is_allowed else 403)


@each_row(
    ("headers", "status"),
    [
        ({"content-length": "2", "content-type": "application/json; charset=utf-8"}, "control"),
        ({"content-length": "0"}, "control"),
        ({}, "control"),
        ({"content-length": "2"}, 415),
        ({"content-length": "2", "content-type": "text/plain"}, 415),
        ({"content-length": "2", "content-type": "application/x-www-form-urlencoded"}, 415),
        ({"content-length": "2", "content-type": "multipart/form-data"}, 415),
        ({"content-length": "99999999", "content-type": "application/json"}, 413),
        ({"content-length": "-1", "content-type": "application/json"}, 413),
        ({"transfer-encoding": "chunked", "content-type": "application/json"}, 411),
        ({"transfer-encoding": "chunked"}, 415),
    ],
)
def test_bodies_are_json_and_bounded(headers: dict[str, str], status: str | int) -> None:
    assert outcome(access(), "POST", headers=headers) == status


@given(st.text(max_size=40), st.text(max_size=40), st.text(max_size=40), st.text(max_size=40))
def test_every_origin_header_is_checked(host: str, origin: str, cookie: str, authorization: str) -> None:
    headers = {"host": host, "origin": origin, "cookie": cookie, "authorization": authorization}
    assert outcome(access(host="0.0.0.0"), "POST", headers=headers) in (401, 403)


def test_routes_without_a_token() -> None:
    is_protected = access().routes.is_protected
    for path in ("/", "/healthz", "/assets/index.js", "/apish", "/live", "/wsx"):
        assert not is_protected(path)
    for path in ("/api", "/api/devices", "/ws", "/openapi.json"):
        assert is_protected(path)


@each_row("path", ["1/preview/x", "1/apply", "preview", "1/preview\n", "a/b/fit-rates", "1/comparex"])
def test_writing_methods_need_the_control_role(path: str) -> None:
    headers = {"host": "127.0.0.1", "authorization": f"Bearer {VIEW}"}
    for method in ("POST", "PUT", "DELETE"):
        with pytest.raises(RefusedError):
            access().check(f"/api/devices/{path}", method, headers, client="127.0.0.1")
