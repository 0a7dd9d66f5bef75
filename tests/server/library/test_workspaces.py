"""Stored workspaces: over HTTP with rights and revisions, and as files that survive anything."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from httpx import Client

from imuscope.recordings.system import atomic_write
from imuscope.server.errors import DomainError
from imuscope.server.library.workspaces import ANY, FOLDER, MAX_BYTES, MAX_NAME, WorkspaceStore, clean_name
from imuscope.server.settings.config import Config
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.problems import assert_problem

PATH = "/api/workspaces"


def workspace(**parts: Any) -> dict[str, Any]:
    return {"format": "imuscope-workspace", "version": 1, "parts": parts}


@pytest.fixture
def client(tmp_path: Path) -> Iterator[Client]:
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running:
        yield running.client


def put(client: Client, name: str, content: Any, if_match: str = "") -> Any:
    headers = {"if-match": if_match} if if_match else {}
    return client.put(f"{PATH}/{name}", json={"workspace": content}, headers=headers)


def test_a_workspace_is_stored_read_changed_and_deleted(client: Client) -> None:
    assert client.get(PATH).json() == {"workspaces": [], "defaults": {}}
    saved = put(client, "Räder / vibration 50 Hz".replace("/", "·"), workspace(frame="NED"))
    assert saved.status_code == 200
    info = saved.json()
    assert saved.headers["etag"] == f'"{info["revision"]}"'
    read = client.get(f"{PATH}/{info['name']}")
    assert read.json() == info
    assert read.json()["workspace"] == workspace(frame="NED")
    changed = put(client, info["name"], workspace(frame="ENU"), saved.headers["etag"])
    assert changed.status_code == 200
    assert changed.json()["revision"] != info["revision"]
    (listed,) = client.get(PATH).json()["workspaces"]
    assert listed == {key: changed.json()[key] for key in ("name", "modified", "revision")}
    assert client.delete(f"{PATH}/{info['name']}").status_code == 204
    assert_problem(client.get(f"{PATH}/{info['name']}"), 404, "not-found")
    assert_problem(client.delete(f"{PATH}/{info['name']}"), 404, "not-found")


def test_of_two_who_change_one_workspace_the_second_is_refused(client: Client) -> None:
    first = put(client, "shared", workspace()).headers["etag"]
    mine = put(client, "shared", workspace(mine=1), first)
    assert_problem(put(client, "shared", workspace(other=1), first), 412, "changed")
    assert_problem(client.delete(f"{PATH}/shared", headers={"if-match": first}), 412, "changed")
    assert client.get(f"{PATH}/shared").json()["workspace"] == workspace(mine=1)
    assert_problem(put(client, "shared", workspace()), 409, "name")  # a new one does not take its place
    assert put(client, "shared", workspace(other=1), "*").status_code == 200
    client.delete(f"{PATH}/shared")
    assert_problem(put(client, "shared", workspace(), mine.headers["etag"]), 412, "changed")


BAD: list[Any] = [
    None,
    [],
    {},
    {"format": "imuscope-workspace"},
    {"format": "imuscope-workspace", "version": "1", "parts": {}},
    {"format": "else", "version": 1, "parts": {}},
    {"format": "imuscope-workspace", "version": 1, "parts": []},
]


@each_row("content", BAD)
def test_what_is_no_workspace_is_not_stored(client: Client, content: Any) -> None:
    assert_problem(put(client, "bad", content), 422, "bad-request")
    assert client.get(PATH).json()["workspaces"] == []


@each_row("number", ["NaN", "Infinity", '"\\ud800"'])
def test_what_json_cannot_hold_is_not_stored(client: Client, number: str) -> None:
    body = json.dumps({"workspace": workspace(x="X")}).replace('"X"', number)
    answer = client.put(f"{PATH}/bad", content=body, headers={"content-type": "application/json"})
    assert_problem(answer, 422, "bad-request")
    assert client.get(PATH).json()["workspaces"] == []


def test_a_workspace_has_limits(client: Client) -> None:
    assert_problem(put(client, "large", workspace(notes="x" * MAX_BYTES)), 413, "too-large")
    assert put(client, "n" * MAX_NAME, workspace(notes="x" * (MAX_BYTES - 200))).status_code == 200
    assert_problem(put(client, "n" * (MAX_NAME + 1), workspace()), 422, "bad-request")


def test_a_family_opens_with_a_workspace_until_that_is_deleted(client: Client) -> None:
    put(client, "race", workspace())
    default = "/api/workspace-defaults"
    assert client.put(f"{default}/xbus", json={"name": "race"}).json() == {"xbus": "race"}
    assert client.get(PATH).json()["defaults"] == {"xbus": "race"}
    assert_problem(client.put(f"{default}/isb", json={"name": "none such"}), 404, "not-found")
    assert_problem(client.put(f"{default}/no family", json={"name": None}), 422, "bad-request")
    assert client.put(f"{default}/isb", json={"name": "race"}).json() == {"xbus": "race", "isb": "race"}
    assert client.put(f"{default}/xbus", json={"name": None}).json() == {"isb": "race"}
    client.delete(f"{PATH}/race")
    assert client.get(PATH).json()["defaults"] == {}


@each_row("name", ["", "  ", "a\x00b", "a\u200bb", "\ud800", "x" * 81])
def test_a_name_that_cannot_be_shown_is_refused(name: str) -> None:
    with pytest.raises(DomainError) as caught:
        clean_name(name)
    assert caught.value.kind == "bad-request"


@each_row("name", ["..", "../../etc/passwd", "defaults", ".hidden", "CON", "ä" * 80, "a/b", "%2e%2e"])
def test_any_name_stays_within_its_folder(tmp_path: Path, name: str) -> None:
    store = WorkspaceStore(tmp_path)
    store.put(name, workspace(), None)
    assert store.get(name).name == name
    (file,) = (tmp_path / FOLDER).iterdir()
    assert len(file.name) < 60
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [file]
    store.set_default("xbus", name)
    assert [one.name for one in store.all()] == [name]


def test_names_that_resemble_each_other_are_different_files(tmp_path: Path) -> None:
    store = WorkspaceStore(tmp_path)
    for name in ("Test 1", "test-1", "test 1"):
        store.put(name, workspace(name=name), None)
    assert [store.get(name).workspace["parts"]["name"] for name in ("Test 1", "test-1", "test 1")] == [
        "Test 1",
        "test-1",
        "test 1",
    ]


def test_a_write_that_fails_leaves_the_old_workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = WorkspaceStore(tmp_path)
    before = store.put("one", workspace(a=1), None)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr(atomic_write, "replace", full)
    with pytest.raises(DomainError) as caught:
        store.put("one", workspace(a=2), before.revision)
    assert caught.value.kind == "disk"
    assert store.get("one") == before
    assert len(list((tmp_path / FOLDER).iterdir())) == 1  # no temporary file


@each_row("damage", [b"", b"{", b"[]", b'{"name": "one"}', b"\xff", b"[" * 100_000])
def test_a_damaged_file_hides_no_other(tmp_path: Path, damage: bytes) -> None:
    store = WorkspaceStore(tmp_path)
    store.put("one", workspace(), None)
    (file,) = (tmp_path / FOLDER).iterdir()
    store.put("two", workspace(), None)
    store.set_default("xbus", "two")
    file.write_bytes(damage)
    assert [one.name for one in store.all()] == ["two"]
    assert store.defaults() == {"xbus": "two"}
    with pytest.raises(DomainError):
        store.get("one")
    store.put("one", workspace(), ANY)
    assert [one.name for one in store.all()] == ["one", "two"]


def test_there_is_an_end_to_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imuscope.server.library.workspaces.MAX_WORKSPACES", 2)
    store = WorkspaceStore(tmp_path)
    first = store.put("one", workspace(), None)
    store.put("two", workspace(), None)
    with pytest.raises(DomainError) as caught:
        store.put("three", workspace(), None)
    assert caught.value.kind == "full"
    store.put("one", workspace(a=1), first.revision)
