"""The audit says what is known, and says so when nothing is: never that all is well because nobody answered."""

from __future__ import annotations

import dataclasses
import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from tests import advisories, audit, osv
from tests.advisories import Advisory, Range, Table, Version

NOWHERE = "http://127.0.0.1:9"


class Database(ThreadingHTTPServer):
    """As much of OSV as is asked. Source: https://google.github.io/osv.dev/api/ (POST v1/querybatch, GET v1/vulns)."""

    daemon_threads = True
    bad = ""  # the name of a package that something is known against
    garbage: bytes | None = None
    pages: dict[str, list[list[str]]]  # package → ids, by pages
    records: dict[str, dict[str, Any]]
    asked: list[dict[str, Any]]


class _Answers(BaseHTTPRequestHandler):
    server: Database

    def do_POST(self) -> None:
        queries = json.loads(self.rfile.read(int(self.headers["content-length"])))["queries"]
        self.server.asked = queries
        self._say({"results": [self._known(one) for one in queries]})

    def _known(self, query: dict[str, Any]) -> dict[str, Any]:
        name, page = query["package"]["name"], int(query.get("page_token", 0))
        pages = self.server.pages.get(name, [["OSV-0000-1"]] if name == self.server.bad else [])
        if not pages:
            return {}
        vulns = [{"id": id, "modified": "2026-01-01T00:00:00Z"} for id in pages[page]]
        return {"vulns": vulns, **({"next_page_token": str(page + 1)} if page + 1 < len(pages) else {})}

    def do_GET(self) -> None:
        id = self.path.rpartition("/")[2]
        self._say(self.server.records.get(id) or {"id": id, "summary": "All numbers are wrong."})

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
    running.bad, running.garbage, running.pages, running.records = "", None, {}, {}
    return running


def address(database: Database) -> str:
    return f"http://127.0.0.1:{database.server_address[1]}"


def known(version: Version, *affected: Range, id: str = "GHSA-0000", aliases: tuple[str, ...] = ("CVE-0000",)) -> Table:
    """The table, and one more row in it."""
    row = Advisory(id, aliases, version.ecosystem, version.name, affected, "2026-11-01", "All numbers are wrong")
    table = advisories.read()
    return dataclasses.replace(table, advisories=(*table.advisories, row))


def locked(name: str) -> Version:
    return next(one for one in audit.locked() if one.name == name)


# ── ranges ──


@pytest.mark.parametrize(
    ("ecosystem", "version", "affected", "holds"),
    [
        ("PyPI", "1.9.9", Range("1.2", "2.0"), True),
        ("PyPI", "2.0", Range("1.2", "2.0"), False),
        ("PyPI", "2.0.0", Range("1.2", "2.0"), False),
        ("PyPI", "2.0rc1", Range("1.2", "2.0"), True),
        ("PyPI", "1.2", Range("1.2", "2.0"), True),
        ("PyPI", "1.2rc1", Range("1.2", "2.0"), False),
        ("PyPI", "1.1", Range("1.2", "2.0"), False),
        ("PyPI", "0.0.dev1", Range("0", "2.0"), True),
        ("PyPI", "2024.7.4", Range("2021.05.30", "2024.07.04"), False),
        ("PyPI", "1.2", Range("1.0", last_affected="1.2"), True),
        ("PyPI", "1.2.1", Range("1.0", last_affected="1.2"), False),
        ("PyPI", "99", Range("1.0"), True),
        ("npm", "8.3.2", Range("8.3.0", "8.3.3"), True),
        ("npm", "8.3.3", Range("8.3.0", "8.3.3"), False),
        ("npm", "8.2.9", Range("8.3.0", "8.3.3"), False),
        ("npm", "8.3.10", Range("8.3.0", "8.3.9"), False),
        ("npm", "5.0.0-rc.2", Range("5.0.0-beta.1", "5.0.0-rc.2"), False),
        ("npm", "5.0.0-rc.1", Range("5.0.0-beta.1", "5.0.0-rc.2"), True),
        ("npm", "5.0.0-beta.10", Range("5.0.0-beta.2", "5.0.0"), True),
        ("npm", "5.0.0-beta.1", Range("5.0.0-beta.2", "5.0.0"), False),
        ("npm", "5.0.0", Range("5.0.0-beta.2", "5.0.0"), False),
        ("npm", "5.0.0+build.7", Range("5.0.0-beta.2", "5.0.0"), False),
        ("npm", "0.0.0-alpha", Range("0", "5"), True),
        ("npm", "4.4.2", Range("4.4.2", last_affected="4.4.2"), True),
        ("npm", "4.4.3", Range("4.4.2", last_affected="4.4.2"), False),
    ],
)
def test_a_range_holds_what_is_in_it(ecosystem: str, version: str, affected: Range, holds: bool) -> None:
    assert affected.holds(Version(ecosystem, "numpy", version)) is holds


@pytest.mark.parametrize("version", ["", "one", "1.2.3.4", "1.x"])
def test_what_is_no_version_is_not_compared(version: str) -> None:
    with pytest.raises(ValueError, match="no version"):
        advisories.rank("npm", version)


def test_an_advisory_is_of_one_package_of_one_ecosystem() -> None:
    one = known(Version("npm", "debug", "1")).advisories[-1]
    one = dataclasses.replace(one, affected=(Range("0", "1"), Range("4.4.2", "4.4.3")))
    assert one.holds(Version("npm", "debug", "4.4.2")) == Range("4.4.2", "4.4.3")
    assert one.holds(Version("npm", "debug", "4.4.3")) is None
    assert one.holds(Version("npm", "ms", "4.4.2")) is None
    assert one.holds(Version("PyPI", "debug", "4.4.2")) is None


# ── the table that is kept ──


def test_the_table_is_well_formed() -> None:
    table = advisories.read()
    rows = [(one.ecosystem, one.package, name) for one in table.advisories for name in one.names]
    assert len(rows) == len(set(rows))
    for one in table.advisories:
        assert "2000" < one.date <= table.newest <= table.gathered
        assert len(one.summary) <= 100
        assert one.affected
        assert one.package in table.looked_at[one.ecosystem]
        for where in one.affected:
            ends = [end for end in (where.introduced, where.fixed or where.last_affected) if end not in ("", "0")]
            order = [advisories.rank(one.ecosystem, end) for end in ends]
            assert order == sorted(order)
    assert table.reach


def test_the_table_is_kept_as_it_is_written(tmp_path: Path) -> None:
    advisories.write(advisories.read(), tmp_path / "table.json")
    assert (tmp_path / "table.json").read_text() == advisories.TABLE.read_text()


@pytest.mark.parametrize(
    ("name", "version"),
    [("werkzeug", "3.1.8"), ("pillow", "12.3.0"), ("urllib3", "2.7.0"), ("vite", "8.3.2"), ("nanoid", "3.3.17")],
)
def test_a_version_of_yesterday_is_known_against(name: str, version: str) -> None:
    before = dataclasses.replace(locked(name), version=version)
    assert audit.tabled([locked(name)], advisories.read()) == []
    assert all(f" {name} {version}: " in line for line in audit.tabled([before], advisories.read()))
    assert audit.tabled([before], advisories.read())


# ── the audit ──


def test_every_locked_version_is_asked_for(database: Database, capsys: pytest.CaptureFixture[str]) -> None:
    assert audit.audit(address(database), True) == 0
    asked = {(one["package"]["ecosystem"], one["package"]["name"]) for one in database.asked}
    assert {("PyPI", "numpy"), ("PyPI", "uvicorn"), ("PyPI", "pytest"), ("npm", "preact"), ("npm", "vitest")} <= asked
    assert all(one["version"] for one in database.asked)
    table = advisories.read()
    assert capsys.readouterr().out.splitlines() == [
        f"licences permissive; {len(audit.locked())} packages: none of {len(table.advisories)} advisories known "
        f"{table.gathered} touches them; OSV: none known"
    ]


@pytest.mark.parametrize("name", ["numpy", "preact"])
def test_a_known_vulnerability_fails(name: str, database: Database, capsys: pytest.CaptureFixture[str]) -> None:
    database.bad = name
    assert audit.audit(address(database), False) == 1
    out = capsys.readouterr().out
    assert f" {name} " in out
    assert "OSV-0000-1 All numbers are wrong." in out
    assert out.splitlines()[-1].endswith("more KNOWN")


@pytest.mark.parametrize("name", ["requests", "preact"])
def test_what_the_table_knows_fails_without_a_network(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    version = locked(name)
    assert audit.audit(NOWHERE, False, known(version, Range("0", "999"))) == 1
    first, *_, last = capsys.readouterr().out.splitlines()
    told = "GHSA-0000 CVE-0000 (fixed in 999) All numbers are wrong"
    assert first == f"VULNERABLE  {version.ecosystem} {name} {version.version}: {told}"
    assert ": 1 KNOWN or not looked at, " in last
    assert audit.audit(NOWHERE, False, known(version, Range("0", version.version))) == 0
    assert ": none of " in capsys.readouterr().out.splitlines()[-1]


@pytest.mark.parametrize(
    ("affected", "told"),
    [(Range("0"), "(no fix is known)"), (Range("0", last_affected="999"), "(fixed in the one after 999)")],
)
def test_the_end_of_a_range_is_told(affected: Range, told: str) -> None:
    (line,) = audit.tabled([locked("numpy")], known(locked("numpy"), affected))
    assert told in line


@pytest.mark.parametrize("fixed", ["", "0.1"])  # with the second OSV alone knows of it
@pytest.mark.parametrize("accepted", ["GHSA-0000", "CVE-0000", "OSV-0000-1"])
def test_what_is_accepted_is_by_all_its_names(
    accepted: str, fixed: str, database: Database, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    database.bad = "preact"
    table = known(locked("preact"), Range("0", fixed), aliases=("CVE-0000", "OSV-0000-1"))
    monkeypatch.setitem(audit.ACCEPTED, accepted, "numbers are not used by us at all")
    assert audit.audit(address(database), True, table) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1


def test_what_the_table_told_is_not_told_again(database: Database, capsys: pytest.CaptureFixture[str]) -> None:
    database.bad = "preact"
    table = known(locked("preact"), Range("0"), aliases=("OSV-0000-1",))
    assert audit.audit(address(database), True, table) == 1
    told, last = capsys.readouterr().out.splitlines()
    assert "GHSA-0000 OSV-0000-1 (no fix is known)" in told
    assert last.endswith("OSV: none known")


def test_a_package_that_nobody_looked_at_fails(capsys: pytest.CaptureFixture[str]) -> None:
    table = advisories.read()
    names = [name for name in table.looked_at["npm"] if name != "preact"]
    table = dataclasses.replace(table, looked_at={**table.looked_at, "npm": names})
    assert audit.audit(NOWHERE, False, table) == 1
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("NOT LOOKED AT  npm preact ")
    assert "--gather" in first


@pytest.mark.parametrize("garbage", [b"<html>", b"[]", b"{}", b'{"results": []}', b'{"results": 3}'])
def test_no_answer_is_no_all_clear(garbage: bytes, database: Database, capsys: pytest.CaptureFixture[str]) -> None:
    database.garbage = garbage
    assert audit.audit(address(database), False) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[-1].endswith("; OSV not reached, newer ones NOT CHECKED")
    assert advisories.read().newest in out
    assert "none known" not in out


def test_nobody_there_is_no_all_clear(capsys: pytest.CaptureFixture[str]) -> None:
    assert audit.audit(NOWHERE, True) == 1
    assert "NOT CHECKED" in capsys.readouterr().out


def test_a_licence_that_is_not_permissive_fails(database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(audit, "licence", lambda name: ("GPL-3.0-only" if name == "numpy" else "MIT", []))
    assert [line.partition(":")[0] for line in audit.unfree_linked()] == ["numpy"]
    assert audit.audit(address(database), False) == 1


def test_what_is_accepted_has_a_reason() -> None:
    assert all(len(reason) > 20 for reason in audit.ACCEPTED.values())


# ── the table, gathered anew ──


def record(id: str, name: str, ecosystem: str, *ranges: dict[str, Any], **more: Any) -> dict[str, Any]:
    affected = {"package": {"name": name, "ecosystem": ecosystem}, "ranges": list(ranges)}
    return {"id": id, "published": "2026-11-11T10:00:00Z", "affected": [affected], **more}


def test_the_table_is_gathered_from_every_page(database: Database, tmp_path: Path) -> None:
    events = [
        {"introduced": "0"},
        {"fixed": "1.2"},
        {"introduced": "2.0"},
        {"last_affected": "2.3"},
        {"introduced": "3"},
    ]
    git = {"type": "GIT", "events": [{"introduced": "0"}]}
    pillow = record("GHSA-1", "Pillow", "PyPI", git, {"type": "ECOSYSTEM", "events": events}, aliases=["CVE-1"])
    malware = record("MAL-1", "debug", "npm")
    malware["affected"][0]["versions"] = ["4.4.2", "4.4.x"]
    database.pages = {"pillow": [["GHSA-1"], ["GHSA-2"]], "debug": [["MAL-1"]], "numpy": [["GHSA-1"]]}
    withdrawn = record("GHSA-2", "pillow", "PyPI", {"type": "ECOSYSTEM", "events": events}, withdrawn="2026-11-12")
    database.records = {"GHSA-1": pillow, "GHSA-2": withdrawn, "MAL-1": malware}
    path = tmp_path / "table.json"
    advisories.write(known(locked("pillow"), Range("0"), id="CVE-1"), path)
    assert audit.gather(address(database), path) == 0
    table = advisories.read(path)
    assert [(one.id, one.package, one.summary) for one in table.advisories] == [
        ("GHSA-1", "pillow", "All numbers are wrong"),
        ("MAL-1", "debug", ""),
    ]
    assert table.advisories[0].affected == (Range("0", "1.2"), Range("2.0", last_affected="2.3"), Range("3"))
    assert table.advisories[1].affected == (Range("4.4.2", last_affected="4.4.2"),)
    assert table.newest == "2026-11-11"
    assert all(table.is_looked_at(version) for version in audit.locked())


def test_the_table_stays_when_nobody_answers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "table.json"
    path.write_text(advisories.TABLE.read_text())
    assert audit.gather(NOWHERE, path) == 1
    assert path.read_text() == advisories.TABLE.read_text()
    assert "stays as it is" in capsys.readouterr().out


def test_pages_without_an_end_are_no_answer(database: Database) -> None:
    database.pages = {"numpy": [["GHSA-1"]] * (osv.MOST_PAGES + 1)}
    with pytest.raises(osv.UnreachableError):
        osv.gathered({"PyPI": ["numpy"]}, {}, address(database))
