"""Errors over HTTP."""

import re
from typing import Any


def assert_problem(response: Any, status: int, kind: str | None = None) -> dict[str, str]:
    assert response.status_code == status, response.text
    assert response.headers["content-type"].startswith("application/json")
    body = response.json()
    assert set(body) == {"kind", "message", "hint"}
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", body["kind"])
    assert body["message"]
    assert kind is None or body["kind"] == kind
    return dict(body)
