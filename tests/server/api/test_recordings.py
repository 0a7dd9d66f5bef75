"""The library over HTTP with the real application: lists, texts, uploads and limits, downloads, exports."""

import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.index import INDEX
from imuscope.recordings.library.library import Library
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.mcap.source import McapSource
from imuscope.recordings.tables.table_source import TableSource
from imuscope.server.library.catalogue import Catalogue
from imuscope.server.library.export_worker import one_file
from imuscope.server.settings.config import Config
from imuscope.server.streaming.clients import ClientFanout
from tests.recordings.recorded_drive import START, drive
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.problems import assert_problem
from tests.support.read_library import ReadLibrary
from tests.support.waiting import block_until

FILE = {"content-type": "application/octet-stream"}
URL = "/api/recordings"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "recordings").mkdir()
    return tmp_path / "recordings"


@pytest.fixture
def running(folder: Path) -> Iterator[InProcessServer]:
    with InProcessServer(Config(data=folder.parent, sources=("/dev/one",), upload_gb=0.001), FakeLink) as running:
        running.client.timeout = 60
        yield running


def listed(running: InProcessServer, search: str = "") -> list[dict[str, Any]]:
    answer: list[dict[str, Any]] = running.client.get(URL, params={"q": search}).json()
    return answer


def finished(running: InProcessServer, job: int) -> dict[str, Any]:
    def result() -> dict[str, Any] | None:
        jobs = (one for one in running.client.get(f"{URL}/exports").json() if one["id"] == job)
        return next((one for one in jobs if one["state"] not in ("waiting", "running")), None)

    return dict(block_until(result, f"export {job} is finished", seconds=120))


def opened(running: InProcessServer, recording: str) -> dict[str, Any]:
    """Details of a recording, when it is decoded."""
    path = f"{URL}/{recording}"
    block_until(lambda: running.client.get(path).status_code != 202, f"{recording} is open", seconds=60)
    return dict(running.client.get(path).json())


def test_a_file_dropped_into_the_folder_is_listed_and_changed(running: InProcessServer, folder: Path) -> None:
    assert listed(running) == []
    drive(folder / "a.mcap", seconds=1.0)
    (info,) = listed(running)
    assert (info["id"], info["title"], info["format"], info["markers"]) == ("a", "A drive", "mcap", 1)
    client = running.client
    changed = client.patch(f"{URL}/a", json={"title": " New  mast ", "tags": ["yard", " yard", ""], "pinned": True})
    assert changed.json()["title"] == "New mast"
    assert changed.json()["tags"] == ["yard"]
    assert client.patch(f"{URL}/a", json={"notes": "3 laps"}).json()["pinned"] is True
    assert [one["id"] for one in listed(running, "laps yard")] == ["a"]
    assert listed(running, "drone") == []
    refused = client.patch(f"{URL}/a", json={"notes": "mine", "notes_before": "2 laps"})
    assert (refused.status_code, refused.json()["kind"]) == (412, "changed")
    assert listed(running)[0]["notes"] == "3 laps"
    assert client.patch(f"{URL}/a", json={"notes": "3 laps, dry", "notes_before": "3 laps"}).json()["notes"] == (
        "3 laps, dry"
    )
    marker = client.post(f"{URL}/a/markers", json={"text": "later", "time": 1.76e9 + 0.5, "kind": "note"})
    assert marker.status_code == 201
    assert listed(running)[0]["markers"] == 2
    assert client.delete(f"{URL}/a").json()["deleted"] is not None
    assert [one["deleted"] is None for one in listed(running)] == [False]
    assert client.post(f"{URL}/a/undelete", json={}).json()["title"] == "New mast"


def test_a_recording_that_is_deleted_while_the_library_is_listed_is_not_an_error(
    running: InProcessServer, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regression: the list was answered with 500 when a recording went between being listed and being indexed."""
    drive(folder / "a.mcap", seconds=0.2)
    opened(running, "a")
    index = Library.index

    def overtaken(library: Library, recording: str, columns: ColumnStore) -> None:
        library.delete(recording)
        index(library, recording, columns)

    monkeypatch.setattr(Library, "index", overtaken)
    answer = running.client.get(URL)
    assert answer.status_code == 200
    assert [one["deleted"] is None for one in answer.json()] == [False]


def test_a_marker_set_later_is_among_those_of_the_recording(running: InProcessServer, folder: Path) -> None:
    client = running.client
    drive(folder / "a.mcap", seconds=0.2)
    marker = client.post(f"{URL}/a/markers", json={"text": "later", "time": 1.76e9 + 0.1, "kind": "marker"}).json()
    assert marker in opened(running, "a")["markers"]


def test_a_file_gets_another_name_with_all_that_belongs_to_it(running: InProcessServer, folder: Path) -> None:
    client = running.client
    drive(folder / "a.mcap", seconds=0.5)
    drive(folder / "b.mcap", seconds=0.2)
    client.patch(f"{URL}/a", json={"notes": "3 laps"})
    opened(running, "a")
    result = next(one["devices"] for one in listed(running) if one["id"] == "a")  # as it was opened
    answer = client.patch(f"{URL}/a", json={"file": " ../yard loop.mcap "}).json()
    assert (answer["id"], answer["file"], answer["notes"]) == ("yard loop", "yard loop.mcap", "3 laps")
    assert answer["opened"]  # and it need not be decoded again
    assert answer["devices"] == result
    assert client.get(f"{URL}/yard loop").status_code == 200
    assert sorted(path.name for path in folder.iterdir() if path.suffix == ".json") == ["yard loop.mcap.json"]
    assert_problem(client.get(f"{URL}/a"), 404)
    refused = client.patch(f"{URL}/yard loop", json={"file": "b"})
    assert_problem(refused, 409)
    assert "b.mcap" in refused.json()["message"]
    assert_problem(client.patch(f"{URL}/b", json={"file": " ./. "}), 409)
    assert_problem(client.patch(f"{URL}/b", json={"file": "x" * 201}), 422)
    assert sorted(path.name for path in folder.glob("*.mcap")) == ["b.mcap", "yard loop.mcap"]


@each_row(
    ("method", "path", "body", "status"),
    [
        ("PATCH", "none", {}, 404),
        ("DELETE", "none", None, 404),
        ("POST", "none/undelete", {}, 404),
        ("POST", "none/markers", {"time": 1.0}, 404),
        ("POST", "none/exports", {"format": "csv"}, 404),
        ("GET", "none/download", None, 404),
        ("GET", "none/original", None, 404),
        ("GET", "..%2f..%2fetc%2fpasswd/original", None, 404),
        ("PATCH", "a", {"title": "x" * 201}, 422),
        ("PATCH", "a", {"tags": ["x"] * 51}, 422),
        ("POST", "a/markers", {"text": "when?"}, 422),
        ("POST", "a/exports", {"format": "xlsx"}, 422),
        ("POST", "a/exports", {"format": "csv", "t0": 2.0, "t1": 1.0}, 422),
        ("GET", "a/original?device=9", None, 404),
        ("GET", "exports/9/file", None, 404),
        ("DELETE", "exports/9", None, 404),
    ],
)
def test_invalid_requests_are_reported(
    running: InProcessServer, folder: Path, method: str, path: str, body: Any, status: int
) -> None:
    if not (folder / "a.mcap").exists():
        drive(folder / "a.mcap", seconds=0.2)
    assert_problem(running.client.request(method, f"{URL}/{path}", json=body), status)


def test_an_upload_is_a_recording_of_a_clean_name(running: InProcessServer, folder: Path, tmp_path: Path) -> None:
    drive(tmp_path / "x.mcap", seconds=1.0)
    content = (tmp_path / "x.mcap").read_bytes()
    sent = running.client.put(f"{URL}/upload", params={"name": "../../x.mcap"}, content=content, headers=FILE)
    assert sent.status_code == 201
    assert sent.json()["title"] == "A drive"
    assert (folder / "x.mcap").stat().st_size > 0
    bad = running.client.put(f"{URL}/upload?name=y.mcap", content=b"no recording" * 100, headers=FILE)
    assert_problem(bad, 422, "cannot-open")
    assert_problem(running.client.put(f"{URL}/upload?name=y.mcap", content=b"", headers=FILE), 422, "cannot-open")
    assert [one["id"] for one in listed(running)] == ["x"]
    assert not list(folder.glob(".incoming/*"))


def test_only_an_upload_may_be_large_and_no_json_and_it_is_bounded(running: InProcessServer) -> None:
    client = running.client
    large = bytes(1_000_001)
    assert_problem(client.put(f"{URL}/upload?name=x.bin", content=large, headers=FILE), 413, "too-large")
    assert_problem(client.put(f"{URL}/upload?name=x.bin", content=b"x", headers={"content-type": "text/plain"}), 415)
    assert_problem(client.post(f"{URL}/upload?name=x.bin", content=b"x", headers=FILE), 415, "not-json")
    assert_problem(client.put(f"{URL}/upload/?name=x.bin", content=b"x", headers=FILE), 415, "not-json")
    foreign = {**FILE, "origin": "http://evil.example"}
    assert_problem(client.put(f"{URL}/upload?name=x.bin", content=b"x", headers=foreign), 403, "bad-origin")
    pieces = client.put(f"{URL}/upload?name=x.bin", content=iter([b"x", b"y"]), headers=FILE)
    assert_problem(pieces, 411, "no-length")


def test_a_download_is_one_file_with_everything_in_it(running: InProcessServer, folder: Path, tmp_path: Path) -> None:
    path = drive(folder / "a.mcap", seconds=1.0)
    running.client.patch(f"{URL}/a", json={"title": "Höhe", "tags": ["x"]})
    running.client.post(f"{URL}/a/markers", json={"text": "later", "time": 1.76e9})
    got = running.client.get(f"{URL}/a/download")
    assert got.headers["content-disposition"].startswith('attachment; filename="a.mcap"')
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "b.mcap").write_bytes(got.content)
    entry = ReadLibrary(tmp_path / "b").get("b")
    assert (entry.title, entry.edits.tags, entry.markers) == ("Höhe", ("x",), 2)
    source = McapSource(tmp_path / "b" / "b.mcap")
    assert b"".join(part.data for part in source.parts() if part.direction == "rx") == path
    assert make_reader(io.BytesIO(got.content)).get_summary() is not None
    assert running.client.get(f"{URL}/a/original").content == path


def test_a_capture_is_downloaded_as_a_recording(running: InProcessServer, folder: Path, tmp_path: Path) -> None:
    path = drive(tmp_path / "x.mcap", seconds=2.0)
    (folder / "c.mtb").write_bytes(path)
    (tmp_path / "c.mcap").write_bytes(running.client.get(f"{URL}/c/download").content)
    with McapReader(tmp_path / "c.mcap") as recording:
        assert recording.is_ours
    source = McapSource(tmp_path / "c.mcap")
    assert b"".join(part.data for part in source.parts()) == path
    assert source.devices["1"].protocol == "xbus"
    assert not source.damage


def test_files_of_others_are_downloaded_with_the_users_changes(running: InProcessServer, folder: Path) -> None:
    """A table has no place for a title, tags, markers; they went lost with the download."""
    table = "time (s),acc.x (m/s²)\n" + "".join(f"{1.76e9 + n / 100:.2f},{n}\n" for n in range(50))
    (folder / "table.csv").write_text(table, encoding="utf-8-sig")
    with (folder / "theirs.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start("theirs")
        channel = writer.register_channel("/pose", "json", 0)
        for n in range(50):
            writer.add_message(channel, round(1.76e18) + n * 10**7, b'{"x": 1}', 0)
        writer.add_attachment(1, 1, "note.txt", "text/plain", b"theirs")
        writer.finish()
    client = running.client
    assert client.get(f"{URL}/table/download").content == (folder / "table.csv").read_bytes()
    assert client.get(f"{URL}/theirs/download").content == (folder / "theirs.mcap").read_bytes()
    for name, suffix in (("table", "csv"), ("theirs", "mcap")):
        client.patch(f"{URL}/{name}", json={"title": "Größer", "tags": ["yard"], "notes": "two\nlines"})
        client.post(f"{URL}/{name}/markers", json={"text": "x" * 2000, "time": 1.76e9})
        for n in range(40):  # a line longer than the examined start
            client.post(f"{URL}/{name}/markers", json={"text": f"{n} " + "y" * 1990, "time": 1.76e9})
        got = client.get(f"{URL}/{name}/download")
        assert f'filename="{name}.{suffix}"' in got.headers["content-disposition"]
        report = client.put(f"{URL}/upload", params={"name": f"{name}-2.{suffix}"}, content=got.content, headers=FILE)
        again = report.json()
        assert (again["title"], again["tags"], again["notes"]) == ("Größer", ["yard"], "two\nlines")
        assert again["markers"] == 41
        client.patch(f"{URL}/{name}-2", json={"title": "Anew"})
        twice = client.get(f"{URL}/{name}-2/download").content
        back = client.put(f"{URL}/upload", params={"name": f"{name}-3.{suffix}"}, content=twice, headers=FILE).json()
        assert (back["title"], back["markers"]) == ("Anew", 41)
    reader = make_reader(io.BytesIO(twice))
    assert len(list(reader.iter_messages())) == 50
    assert [one.name for one in reader.iter_attachments()] == ["note.txt"]
    summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.metadata_count == 2
    assert len(list(reader.iter_metadata())) == 2
    source = open_file(folder / "table-3.csv")
    assert isinstance(source, TableSource)
    (rows,) = source.rows()
    assert rows.columns["acc.x"][0].tolist() == list(range(50))


def test_an_export_is_a_job_whose_file_is_fetched(running: InProcessServer, folder: Path) -> None:
    drive(folder / "a.mcap", seconds=1.0)
    begun = running.client.post(f"{URL}/a/exports", json={"format": "csv"})
    assert begun.status_code == 202
    done = finished(running, begun.json()["id"])
    assert (done["state"], done["progress"], done["file"]) == ("done", 1.0, "A-drive_MTData2.csv")
    got = running.client.get(f"{URL}/exports/{done['id']}/file")
    assert got.content.startswith(b"time (s),arrival (s),PacketCounter")
    assert len(got.content) == done["size"]
    assert running.client.delete(f"{URL}/exports/{done['id']}").status_code == 204
    assert running.client.get(f"{URL}/exports").json() == []
    assert not [path for path in (folder.parent / "exports").rglob("*") if path.is_file()]


def test_sizes_of_exports_are_measured_before_anything_is_exported(running: InProcessServer, folder: Path) -> None:
    drive(folder / "a.mcap", seconds=1.0)
    answer = running.client.post(f"{URL}/a/export-sizes", json={}).json()
    done = finished(running, running.client.post(f"{URL}/a/exports", json={"format": "csv"}).json()["id"])
    assert answer["sizes"]["csv"] == pytest.approx(done["size"], rel=0.02)
    assert list(answer["devices"]) == ["1"]
    whole = running.client.get(f"{URL}/a").json()
    half = {"t0": whole["t0"], "t1": (whole["t0"] + whole["t1"]) / 2}
    part = running.client.post(f"{URL}/a/export-sizes", json=half).json()
    assert 0.3 < part["sizes"]["csv"] / done["size"] < 0.7
    assert not list((folder.parent / "exports").rglob("*sample*"))
    assert_problem(running.client.post(f"{URL}/none/export-sizes", json={}), 404)
    assert_problem(running.client.post(f"{URL}/a/export-sizes", json={"t0": 2.0, "t1": 1.0}), 422)


def test_several_files_are_one_zip_and_failures_are_reported(running: InProcessServer, folder: Path) -> None:
    (folder / "t.csv").write_text("time,x\n1760000000,1\n1760000001,2\n")
    drive(folder / "a.mcap", seconds=1.0)
    failed = finished(running, running.client.post(f"{URL}/t/exports", json={"format": "mtb"}).json()["id"])
    assert failed["state"] == "failed"
    assert failed["message"].endswith(".")
    assert_problem(running.client.get(f"{URL}/exports/{failed['id']}/file"), 409, "not-now")
    done = finished(running, running.client.post(f"{URL}/t/exports", json={"format": "csv"}).json()["id"])
    assert done["file"] == "t_t.csv"


def test_a_cancelled_export_leaves_nothing(running: InProcessServer, folder: Path) -> None:
    drive(folder / "a.mcap", seconds=2.0)
    jobs = [running.client.post(f"{URL}/a/exports", json={"format": "mcap"}).json()["id"] for _ in range(2)]
    for job in jobs:
        assert running.client.delete(f"{URL}/exports/{job}").status_code == 204
    assert running.client.get(f"{URL}/exports").json() == []
    assert not [path for path in (folder.parent / "exports").rglob("*") if path.is_file()]


def test_a_zip_holds_the_files_of_an_export(tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("run_A.csv", "run_B.csv")]
    for file in files:
        file.write_text(file.name)
    made = one_file(files, tmp_path, "run")
    with zipfile.ZipFile(made) as archive:
        assert {name: archive.read(name).decode() for name in archive.namelist()} == {
            "run_A.csv": "run_A.csv",
            "run_B.csv": "run_B.csv",
        }
    assert [path.name for path in tmp_path.iterdir()] == ["run.zip"]


def test_what_was_recorded_here_shows_its_motion_without_being_opened(folder: Path) -> None:
    """A file that a killed server left unpacked is packed at the next start, and looked at."""
    drive(folder / "a.mcap", seconds=2.0)
    with InProcessServer(Config(data=folder.parent, sources=("/dev/one",)), FakeLink) as running:
        running.client.timeout = 60
        block_until(lambda: listed(running)[0]["thumbnail"], "it is packed and read", seconds=120)
        info = listed(running)[0]
    assert info["opened"]
    assert len(info["thumbnail"]) == 64
    assert info["devices"][0]["product"].startswith("MTi")


def test_recordings_from_elsewhere_are_read_by_themselves_and_never_in_the_server(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One after the other while the list is viewed; the summary is kept with the columns that it was made of."""
    for name in "abc":
        drive(folder / f"{name}.mcap", seconds=1.0, started_ns=START + ord(name) * 10**12)
        compact(folder / f"{name}.mcap")
    calls = list[Path]()
    monkeypatch.setattr("imuscope.recordings.library.index.summarize", lambda columns: calls.append(columns.folder))
    most, running_now = 0, 0
    read = Catalogue._read_contents

    async def counted(catalogue: Catalogue, recording: str) -> bool:
        nonlocal most, running_now
        running_now += 1
        most = max(most, running_now)
        try:
            return await read(catalogue, recording)
        finally:
            running_now -= 1

    monkeypatch.setattr(Catalogue, "_read_contents", counted)
    monkeypatch.setattr(ClientFanout, "browsers", 1)  # one looks at it
    with InProcessServer(Config(data=folder.parent, sources=("/dev/one",)), FakeLink) as running:
        running.client.timeout = 60
        assert [one["read"] for one in listed(running)] == [False] * 3
        block_until(lambda: all(one["read"] for one in listed(running)), "all are read", seconds=120)
        (first, *_) = listed(running)
    assert (most, calls) == (1, [])
    assert (first["motion"], len(first["thumbnail"]), len(first["marks"])) == ("|a|", 64, 1)
    assert len(list((folder.parent / "cache" / "columns").glob("*/summary.json"))) == 3


def test_nothing_is_read_for_the_list_while_something_is_recorded(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive(folder / "a.mcap", seconds=1.0)
    compact(folder / "a.mcap")
    with InProcessServer(Config(data=folder.parent, sources=("/dev/one",)), FakeLink) as running:
        running.client.timeout = 60
        monkeypatch.setattr(ClientFanout, "browsers", 1)
        running.client.post(f"{URL}/start", json={})
        assert [one["read"] for one in listed(running) if one["id"] == "a"] == [False]
        catalogue = running.services.catalogue
        assert not running.call(lambda: catalogue._may_read)
        running.client.post(f"{URL}/stop")
        block_until(lambda: all(one["read"] for one in listed(running)), "both are read", seconds=120)


def test_the_disk_of_the_library_is_reported(folder: Path) -> None:
    drive(folder / "a.mcap", seconds=1.0)
    compact(folder / "a.mcap")
    config = Config(data=folder.parent, sources=("/dev/one",), recordings_quota_gb=3.0)
    with InProcessServer(config, FakeLink) as running:
        storage = running.client.get("/api/recorder/storage").json()
        assert storage["used"] == sum(one["size"] for one in listed(running))
    assert storage["quota"] == 3_000_000_000
    assert storage["free"] > 0


def test_findings_of_an_earlier_decoder_are_replaced(running: InProcessServer, folder: Path) -> None:
    drive(folder / "a.mcap", seconds=1.0)
    opened(running, "a")
    (right,) = listed(running)
    index = folder / INDEX / "a.mcap.json"
    index.write_text(json.dumps({**json.loads(index.read_text()), "decoder": "earlier", "duration": 4_000.0}))
    assert listed(running) == [right]


def test_a_query_takes_the_units_of_its_answer(running: InProcessServer, folder: Path) -> None:
    drive(folder / "a.mcap", seconds=1.0)
    opened(running, "a")
    question = {"channel": "RateOfTurn", "format": "json", "columns": "x"}
    answers = {}
    for units in ("shown", "SI", "device"):
        answers[units] = running.client.get(f"{URL}/a/query", params=question | {"units": units}).json()
    assert answers["device"]["columns"]["x"] == answers["SI"]["columns"]["x"]
    assert answers["shown"]["columns"]["x"] == pytest.approx(np.degrees(answers["SI"]["columns"]["x"]), rel=1e-6)
    wrong = running.client.get(f"{URL}/a/query", params=question | {"units": "deg"})
    assert_problem(wrong, 422)
