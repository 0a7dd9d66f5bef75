"""Questions over HTTP: a process for each, limited, in turns, and ended with its client."""

from __future__ import annotations

import io
import json
import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from deltalake import DeltaTable

from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.extensions.fleet.model.settings import FleetTables, StoreSettings
from imuscope.server.extensions.fleet.query.prepared_queries import QUESTIONS
from imuscope.server.extensions.fleet.store.store import location
from imuscope.server.extensions.fleet.store.tables import TABLES
from imuscope.server.extensions.fleet.upload.upload import upload
from imuscope.server.settings.config import Config
from imuscope.server.system.workers import Worker
from tests.recordings.recorded_drive import drive
from tests.server.extensions.fleet.store_fixtures import ENDLESS
from tests.support.each_row import each_row
from tests.support.fakes import FakeLinks
from tests.support.forking.forked_workers import started_afresh
from tests.support.in_process_server import InProcessServer
from tests.support.waiting import block_until


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with one recording."""
    folder = tmp_path_factory.mktemp("store")
    drive(folder / "drive.mcap")
    upload(folder / "drive.mcap", location(str(folder / "store")), "otter", DecodeOptions())
    return folder / "store"


class StartedWorkers(list[Worker]):
    """Processes that answer questions."""

    def running(self) -> list[int]:
        """Process ids."""
        return [one.pid for one in self if one.is_running]


@pytest.fixture(scope="module")
def workers() -> Iterator[StartedWorkers]:
    """Those of this module."""
    result, start = StartedWorkers(), Worker.start

    async def noted(module: str, *arguments: str, **more: Any) -> Worker:
        worker = await start(module, *arguments, **more)
        if not more:  # those of files are forked by one that stays
            result.append(worker)
        return worker

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Worker, "start", noted)
        yield result


@pytest.fixture(scope="module")
def server(
    workers: StartedWorkers, folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[InProcessServer]:
    with _server(str(folder), tmp_path_factory.mktemp("data")) as running:
        yield running


def _server(url: str, data: Path) -> InProcessServer:
    config = Config(port=0, data=data, sources=("/dev/ttyUSB9",)).having(FleetTables(StoreSettings(url, 600.0)))
    return InProcessServer(config, FakeLinks().open)


def _query(server: InProcessServer, **body: Any) -> Any:
    return server.client.post("/api/query", json=body)


def _state(server: InProcessServer) -> dict[str, Any]:
    state: dict[str, Any] = server.client.get("/api/query").json()
    return state


def test_an_answer_as_json(server: InProcessServer) -> None:
    sql = "SELECT robot, started, date, lost, 'nan'::DOUBLE AS x, lost AS x, 9007199254740993 AS big FROM recordings"
    answer = _query(server, sql=sql).json()
    assert answer["columns"] == [
        {"name": "robot", "kind": "text"},
        {"name": "started", "kind": "time"},
        {"name": "date", "kind": "date"},
        {"name": "lost", "kind": "integer"},
        {"name": "x", "kind": "number"},
        {"name": "x_2", "kind": "integer"},
        {"name": "big", "kind": "integer"},
    ]
    assert answer["rows"] == [["otter", "2025-10-09T08:53:20Z", "2025-10-09", 5, None, 5, "9007199254740993"]]
    assert answer["more"] is False
    assert answer["seconds"] >= 0


def test_an_answer_as_json_is_cut_and_states_it(server: InProcessServer) -> None:
    for rows, more in ((99_999, True), (100_000, False)):
        answer = _query(server, sql="SELECT range AS n FROM range(100000)", rows=rows).json()
        assert (len(answer["rows"]), answer["rows"][-1], answer["more"]) == (rows, [rows - 1], more)
    assert _query(server, sql="SELECT 1 AS a WHERE false").json()["rows"] == []


def test_an_answer_in_the_other_formats_has_all_rows(server: InProcessServer) -> None:
    sql, numbers = "SELECT range AS n FROM range(300000)", list(range(300_000))
    arrow = _query(server, sql=sql, format="arrow")
    assert arrow.headers["content-type"] == "application/vnd.apache.arrow.stream"
    assert pa.ipc.open_stream(arrow.content).read_all().column("n").to_pylist() == numbers
    assert (
        pq.read_table(io.BytesIO(_query(server, sql=sql, format="parquet").content)).column("n").to_pylist() == numbers
    )
    csv = _query(server, sql=sql, format="csv")
    assert csv.text.splitlines() == ["n", *map(str, numbers)]
    assert "answer.csv" in csv.headers["content-disposition"]


@each_row("name", QUESTIONS)
def test_prepared_questions_are_listed_and_answered(name: str, server: InProcessServer) -> None:
    listed = {one["name"]: one for one in server.client.get("/api/query/questions").json()}
    assert listed[name]["sql"] == QUESTIONS[name].sql
    by_name, by_sql = _query(server, question=name).json(), _query(server, sql=listed[name]["sql"]).json()
    assert (by_name["columns"], by_name["rows"]) == (by_sql["columns"], by_sql["rows"])


def test_what_an_editor_completes(server: InProcessServer, folder: Path) -> None:
    words = server.client.get("/api/query/tables").json()
    tables = {one["name"]: [column["name"] for column in one["columns"]] for one in words["tables"]}
    assert set(TABLES) <= set(tables)
    for name, table in TABLES.items():
        if name != "samples":
            assert tables[name] == [column.name for column in table.columns]
    wide = [field.name for field in DeltaTable(str(folder / "tables" / "samples")).schema().fields]
    assert sorted(tables["samples_wide"]) == sorted(wide)
    assert {"name": "Acceleration.x", "unit": "m/s²"} in words["signals"]
    assert {"median", "round", "left"} <= {one["name"] for one in words["functions"]}


@each_row(
    ("body", "status", "kind", "words"),
    [
        ({"sql": "SELEC 1"}, 422, "bad-query", "Line 1, column 1: syntax error"),
        ({"sql": "SELECT 'é',\n  nothing FROM recordings"}, 422, "bad-query", "Line 2, column 3: "),
        ({"sql": "SELECT 'é', nothing FROM recordings"}, 422, "bad-query", "Line 1, column 13: "),
        ({"sql": "EXPLAIN SELECT x FROM recordings"}, 422, "bad-query", "Line 1, column 16: "),
        ({"sql": "SELECT * FROM drives"}, 422, "bad-query", "Line 1, column 15: Table"),
        ({"sql": "DROP VIEW recordings"}, 422, "bad-query", "read-only"),
        ({"sql": "SELECT * FROM read_text('/etc/hostname')"}, 422, "bad-query", "disabled"),
        ({"sql": "SELECT list(range) FROM range(100000000)", "memory_mb": 64}, 422, "bad-query", "memory"),
        ({"sql": ENDLESS, "timeout_s": 0.5, "memory_mb": 64}, 422, "bad-query", "longer than 0.5 s"),
        ({"sql": "SELECT repeat('x', 1000000) FROM range(100)"}, 422, "bad-query", "64 MB"),
        ({"sql": " "}, 422, "bad-request", "one of the two"),
        ({"sql": "SELECT 1", "question": "shocks"}, 422, "bad-request", "one of the two"),
        ({"question": "nothing"}, 404, "not-found", "nothing"),
        ({"sql": "SELECT 1", "format": "xml"}, 422, "bad-request", "format"),
    ],
)
def test_what_cannot_be_answered(
    body: dict[str, Any], status: int, kind: str, words: str, server: InProcessServer
) -> None:
    answer = _query(server, **body)
    assert (answer.status_code, answer.json()["kind"]) == (status, kind)
    assert words in answer.json()["message"]
    assert "\n" not in answer.json()["message"]


def test_an_answer_that_fails_halfway_is_cut_off(server: InProcessServer) -> None:
    """It never looks complete. So many rows do not fit into what is computed ahead: the first are under way by then."""
    sql = "SELECT CASE WHEN range < 2000000 THEN range ELSE error('broken')::BIGINT END AS n FROM range(2000001)"
    with pytest.raises(httpx.RemoteProtocolError):
        _query(server, sql=sql, format="csv")


def test_a_store_that_is_not_there(tmp_path: Path) -> None:
    with _server("", tmp_path / "data") as server:
        assert _state(server)["store"] == ""
        assert (_query(server, sql="SELECT 1").status_code, _query(server, sql="SELECT 1").json()["kind"]) == (
            409,
            "no-store",
        )
        assert server.client.get("/api/query/tables").json()["kind"] == "no-store"
    (tmp_path / "file").write_bytes(b"")
    with _server(str(tmp_path / "file"), tmp_path / "other") as server, started_afresh():
        answer = _query(server, sql="SELECT 1")
        assert (answer.status_code, answer.json()["kind"]) == (502, "store")
        assert "is a file" in answer.json()["message"]


class _Gone:
    """A client that sends a question and leaves without reading the answer."""

    def __init__(self, server: InProcessServer, sql: str, query: str) -> None:
        body = json.dumps({"sql": sql, "id": query}).encode()
        host, port = server.url.removeprefix("http://").split(":")
        self._socket = socket.create_connection((host, int(port)))
        head = f"POST /api/query HTTP/1.1\r\nHost: {host}:{port}\r\nContent-Type: application/json\r\n"
        self._socket.sendall(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)

    def leave(self) -> None:
        self._socket.close()


def test_a_question_ends_with_its_client_and_another_waits_its_turn(
    server: InProcessServer, workers: StartedWorkers
) -> None:
    first = _Gone(server, ENDLESS, "first")
    block_until(lambda: _state(server)["running"] == 1 and bool(workers.running()), "the first question runs")
    second = _Gone(server, ENDLESS, "second")
    block_until(lambda: _state(server)["waiting"] == 1, "the second question waits")
    states = {one["id"]: (one["is_running"], one["before"]) for one in _state(server)["questions"]}
    assert states == {"first": (True, 0), "second": (False, 0)}
    (running,) = workers.running()
    second.leave()
    block_until(lambda: _state(server)["waiting"] == 0, "the second question left the queue")
    assert workers.running() == [running]
    first.leave()
    block_until(lambda: _state(server)["running"] == 0 and not workers.running(), "the first question ended")
    assert _query(server, sql="SELECT 1 AS a").json()["rows"] == [[1]]


def test_a_question_that_is_killed_does_not_harm_the_server(server: InProcessServer, workers: StartedWorkers) -> None:
    results: list[Any] = []
    block_until(lambda: not workers.running(), "former questions have ended")
    requesting = threading.Thread(target=lambda: results.append(_query(server, sql=ENDLESS)))
    requesting.start()
    block_until(lambda: bool(workers.running()), "the question runs")
    os.kill(workers.running()[0], 9)
    requesting.join()
    assert (results[0].status_code, results[0].json()["kind"]) == (422, "bad-query")
    assert _query(server, sql="SELECT 1 AS a").json()["rows"] == [[1]]


def test_too_many_questions_of_one_user_are_refused(server: InProcessServer) -> None:
    clients = [_Gone(server, ENDLESS, str(n)) for n in range(9)]
    try:
        block_until(lambda: (_state(server)["running"], _state(server)["waiting"]) == (1, 8), "nine questions")
        answer = _query(server, sql="SELECT 1")
        assert (answer.status_code, answer.json()["kind"]) == (409, "full")
    finally:
        for one in clients:
            one.leave()
    block_until(lambda: not _state(server)["running"] and not _state(server)["waiting"], "no questions")


def test_a_recording_is_fetched_from_the_store_once(server: InProcessServer, folder: Path) -> None:
    [[recording, key]] = _query(server, sql="SELECT recording, object FROM recordings").json()["rows"]
    route = f"/api/query/recordings/{recording}/fetch"
    first, second = (server.client.post(route, json={}).json() for _ in range(2))
    assert (first, second) == ({"id": recording, "is_new": True}, {"id": recording, "is_new": False})
    assert server.services.catalogue.library.path(recording).read_bytes() == (folder / key).read_bytes()


def test_a_recording_that_two_fetch_at_once_is_there_once(server: InProcessServer) -> None:
    [[recording]] = _query(server, sql="SELECT recording FROM recordings").json()["rows"]
    server.client.delete(f"/api/recordings/{recording}")  # of another test
    answers: list[Any] = []

    def fetch() -> None:
        answers.append(server.client.post(f"/api/query/recordings/{recording}/fetch", json={}).json())

    threads = [threading.Thread(target=fetch) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {one["id"] for one in answers} == {recording}
    assert sorted(one["is_new"] for one in answers) == [False, True]


@each_row(("recording", "status", "words"), [("0" * 24, 404, "no recording"), ("x", 422, "'x'")])
def test_what_is_not_in_the_store_is_not_fetched(
    recording: str, status: int, words: str, server: InProcessServer
) -> None:
    answer = server.client.post(f"/api/query/recordings/{recording}/fetch", json={})
    assert answer.status_code == status
    assert words in answer.json()["message"]


def test_an_object_that_was_changed_is_refused(tmp_path: Path) -> None:
    drive(tmp_path / "drive.mcap")
    made = upload(tmp_path / "drive.mcap", location(str(tmp_path / "store")), "otter", DecodeOptions())
    with (tmp_path / "store" / made.key).open("r+b") as file:
        file.seek(100)
        file.write(b"\0\1\2")
    with _server(str(tmp_path / "store"), tmp_path / "data") as server:
        answer = server.client.post(f"/api/query/recordings/{made.recording}/fetch", json={})
        assert (answer.status_code, answer.json()["kind"]) == (502, "store")
        assert "checksum" in answer.json()["message"]
        assert server.client.get("/api/recordings").json() == []
