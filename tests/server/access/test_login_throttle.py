"""Limits on wrong tokens, by address, and exemptions from them."""

from typing import Any

import pytest

from imuscope.server.access.auth import Access, Guard, RefusedError
from imuscope.server.access.login_throttle import (
    MAX_ADDRESSES,
    MAX_FAILURES,
    MIN_UNGUESSABLE_CHARS,
    LoginThrottle,
    client_group,
    short_tokens,
)
from imuscope.server.errors import status_of
from imuscope.server.settings.config import Config
from tests.support.asgi_client import Answer, send_request
from tests.support.each_row import each_row
from tests.support.manual_clock import ManualClock

SHORT, LONG_TOKEN = "short-one", "a-token-that-cannot-be-guessed"
HOST = {"host": "192.0.2.1:8080"}
Clock = ManualClock[float]


def tried(rules: Access, token: str, client: str = "198.51.100.7") -> str | int:
    try:
        headers = {**HOST, "authorization": f"Bearer {token}"}
        return rules.check("/api/devices", "GET", headers, client=client)
    except RefusedError as refused:
        return status_of(refused.kind)


@pytest.fixture
def clock() -> Clock:
    return ManualClock(0.0)


def access(clock: Clock) -> Access:
    return Access(Config(host="0.0.0.0", view_token=SHORT, control_token=LONG_TOKEN), LoginThrottle(clock))


@pytest.fixture
def rules(clock: Clock) -> Access:
    return access(clock)


def test_ten_wrong_tokens_and_then_one_each_six_seconds(rules: Access, clock: Clock) -> None:
    assert [tried(rules, f"guess-{n}") for n in range(12)] == [401] * MAX_FAILURES + [429] * 2
    clock.now = 5.9
    assert tried(rules, "guess") == 429
    clock.now = 6.0
    assert [tried(rules, "guess") for _ in range(2)] == [401, 429]
    clock.now = 90.0
    assert [tried(rules, "guess") for _ in range(12)] == [401] * MAX_FAILURES + [429] * 2


def test_a_correct_token_fails_while_its_address_is_locked(rules: Access, clock: Clock) -> None:
    """Otherwise guessing would not be slowed down: only the answers to wrong guesses would change."""
    for n in range(MAX_FAILURES):
        tried(rules, f"guess-{n}")
    assert tried(rules, SHORT) == 429
    assert tried(rules, SHORT, "198.51.100.8") == "view"
    clock.now = 6.0
    assert tried(rules, SHORT) == "view"


def test_a_long_token_passes_despite_failures_at_its_address(rules: Access) -> None:
    for n in range(100):
        tried(rules, f"guess-{n}")
        assert tried(rules, LONG_TOKEN) == "control"
    made = Access(Config(host="0.0.0.0"))
    for n in range(100):
        tried(made, f"guess-{n}")
    assert len(made.view_token) >= MIN_UNGUESSABLE_CHARS
    assert tried(made, made.view_token) == "view"


def test_a_missing_token_is_not_a_guess(rules: Access) -> None:
    for _ in range(100):
        with pytest.raises(RefusedError) as refused:
            rules.check("/api/devices", "GET", HOST, client="198.51.100.7")
        assert status_of(refused.value.kind) == 401
    assert tried(rules, SHORT) == "view"


def test_where_no_token_is_needed_a_wrong_one_does_nothing() -> None:
    """An address kept from a run with tokens, opened again and again."""
    rules = Access(Config(control_token=SHORT))
    headers = {"host": "127.0.0.1", "authorization": "Bearer old"}
    for _ in range(100):
        assert rules.check("/api/devices", "GET", headers, client="127.0.0.1") == "control"
    proxied = {**headers, "x-forwarded-for": "203.0.113.5"}  # … but behind a proxy it does: loopback counts like others
    statuses = []
    for _ in range(MAX_FAILURES + 1):
        with pytest.raises(RefusedError) as refused:
            rules.check("/api/devices", "GET", proxied, client="127.0.0.1")
        statuses.append(status_of(refused.value.kind))
    assert statuses == [401] * MAX_FAILURES + [429]


@each_row(
    ("address", "group"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("127.0.0.1", "127.0.0.1"),
        ("", ""),
        ("x" * 1000, "x" * 64),
    ],
)
def test_addresses_are_grouped_by_client(address: str, group: str) -> None:
    assert client_group(address) == group


def test_memory_is_constant(clock: Clock) -> None:
    failures = LoginThrottle(clock)
    for n in range(3 * MAX_ADDRESSES):
        failures.count(f"10.{n >> 16}.{n >> 8 & 255}.{n & 255}")
        failures.count("192.0.2.7")  # clients that keep failing stay in the table
        failures.wait_s(f"2001:db8:{n:x}::1")  # clients that only ask are not stored
    assert len(failures) == MAX_ADDRESSES
    assert failures.wait_s("192.0.2.7") > 0


def test_short_tokens_are_reported() -> None:
    assert short_tokens(Config(view_token=SHORT, control_token=LONG_TOKEN)) == ["view_token"]
    assert short_tokens(Config()) == []


# ── as a browser or a script meets it ──


@each_row("way", ["bearer", "query", "cookie", "page", "websocket"])
def test_every_login_route_counts_failures_and_gives_retry_after(way: str) -> None:
    clock = Clock(0.0)
    rules = access(clock)

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    guard = Guard(app, rules)

    def attempt(token: str) -> Answer:
        match way:
            case "bearer":
                return send_request(guard, "GET", "/api/devices", {"authorization": f"Bearer {token}"})
            case "cookie":
                return send_request(guard, "GET", "/api/devices", {"cookie": f"{rules.cookie_name}={token}"})
            case "query":
                return send_request(guard, "GET", f"/api/devices?token={token}")
            case "page":
                return send_request(guard, "GET", f"/?token={token}")
            case _:
                return send_request(guard, "WS", f"/ws?token={token}")

    wrong = 200 if way == "page" else 401  # the page itself is open
    assert [attempt("wrong").status for _ in range(MAX_FAILURES)] == [wrong] * MAX_FAILURES
    locked = attempt("wrong")
    assert (locked.status, locked.headers["retry-after"]) == (429, "6")
    message = "Too many wrong tokens came from this address."
    assert locked.json() == {"kind": "too-many-tokens", "message": message, "hint": "Try again in 6 s."}
    assert send_request(guard, "GET", "/").status == 200
    assert send_request(guard, "GET", "/api/devices", {"authorization": f"Bearer {LONG_TOKEN}"}).status == 200
    clock.now = 6.0
    assert send_request(guard, "GET", f"/?token={SHORT}").status == 303
