"""The audit says what is known, and says so when nothing is: never that all is well because nobody answered."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from tests import audit


class Database(ThreadingHTTPServer):
    """As much of OSV as is asked. Source: https://google.github.io/osv.dev/api/ (POST v1/querybatch, GET v1/vulns)."""

    daemon_threads = True
    bad = ""  # the name of a package that something is known against
    garbage: bytes | None = None
    asked: list[dict[str, Any]]


class _Answers(BaseHTTPRequestHandler):
    server: Database

    def do_POST(self) -> None:
        queries = json.loads(self.rfile.read(int(self.headers["content-length"])))["queries"]
        self.server.asked = queries
        known = {"vulns": [{"id": "OSV-0000-1", "modified": "2026-01-01T00:00:00Z"}]}
        self._say({"results": [known if one["package"]["name"] == self.server.bad else {} for one in queries]})

    def do_GET(self) -> None:
        self._say({"id": self.path.rpartition("/")[2], "summary": "All numbers are wrong."})

    def _say(self, told: Any) -> None:
        body = json.dumps(told).encode() if self.server.garbage is None else self.server.garbage
        self.send_response(200)
        self.send_header("content-length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture(scope="module")
def running() -> Iterator[Database]:
    with Database(("127.0.0.1", 0), _Answers) as server:
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        yield server
        server.shutdown()


@pytest.fixture
def database(running: Database) -> Database:
    running.bad, running.garbage = "", None
    return running


def address(database: Database) -> str:
    return f"http://127.0.0.1:{database.server_address[1]}"


def test_every_locked_version_is_asked_for(database: Database, capsys: pytest.CaptureFixture[str]) -> None:
    assert audit.audit(address(database), True) == 0
    asked = {(one["package"]["ecosystem"], one["package"]["name"]) for one in database.asked}
    assert {("PyPI", "numpy"), ("PyPI", "uvicorn"), ("PyPI", "pytest"), ("npm", "preact"), ("npm", "vitest")} <= asked
    assert all(one["version"] for one in database.asked)
    assert capsys.readouterr().out.splitlines()[-1].endswith("packages: none known")


@pytest.mark.parametrize("name", ["numpy", "preact"])
def test_a_known_vulnerability_fails(name: str, database: Database, capsys: pytest.CaptureFixture[str]) -> None:
    database.bad = name
    assert audit.audit(address(database), False) == 1
    out = capsys.readouterr().out
    assert f" {name} " in out
    assert "OSV-0000-1 All numbers are wrong." in out
    assert "KNOWN" in out.splitlines()[-1]


@pytest.mark.parametrize("garbage", [b"<html>", b"[]", b"{}", b'{"results": []}', b'{"results": 3}'])
def test_no_answer_is_no_all_clear(garbage: bytes, database: Database, capsys: pytest.CaptureFixture[str]) -> None:
    database.garbage = garbage
    assert audit.audit(address(database), False) == 0
    out = capsys.readouterr().out
    assert "NOT CHECKED" in out.splitlines()[-1]
    assert "none known" not in out
    assert audit.audit(address(database), True) == 1


def test_nobody_there_is_no_all_clear(capsys: pytest.CaptureFixture[str]) -> None:
    assert audit.audit("http://127.0.0.1:9", True) == 1
    assert "NOT CHECKED" in capsys.readouterr().out


def test_a_licence_that_is_not_permissive_fails(database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(audit, "licence", lambda name: ("GPL-3.0-only" if name == "numpy" else "MIT", []))
    assert [line.partition(":")[0] for line in audit.unfree_linked()] == ["numpy"]
    assert audit.audit(address(database), False) == 1


def test_what_is_accepted_has_a_reason() -> None:
    assert all(len(reason) > 20 for reason in audit.ACCEPTED.values())
