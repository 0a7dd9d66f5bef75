"""A few random requests, texts and files with each run, and all earlier findings.

Nothing here looks at the time but to give up: the machine is busy with other tests.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import lz4.frame
import pytest
import zstandard

from tests.fuzz import cases, files, http, ws
from tests.fuzz.cases import FINDINGS, BrokenError, Case
from tests.support.each_row import each_row

FILES = 36  # one of each kind
REQUESTS = 1  # of every third operation
TALKS = 5
FOUND_REQUESTS = sorted((FINDINGS / "http").glob("*.json"))
TALKED = sorted((FINDINGS / "ws").glob("*.json"))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[http.FuzzedServer]:
    with http.FuzzedServer(tmp_path_factory.mktemp("data") / "data") as server:
        yield server


@pytest.fixture(scope="module")
def files_search(tmp_path_factory: pytest.TempPathFactory) -> Iterator[files.FileSearch]:
    search = files.FileSearch(tmp_path_factory.mktemp("files") / "files", seed=0)
    assert search.reading
    yield search
    search.close()


# -- http --------------------------------------------------------------------------------------------------------------


def test_a_few_requests(server: http.FuzzedServer) -> None:
    search = http.RequestSearch(server, first=0)
    broken = [f"{request}\n{error}" for request, error in search.step(REQUESTS, quick=True)]
    assert not broken, "\n\n".join(broken)
    assert len(search.operations) > 50
    assert search.cases > 8
    assert search.statuses.keys() >= {200}


@each_row("path", FOUND_REQUESTS, ids=lambda path: path.stem)
def test_a_request_that_once_broke_something_is_answered(server: http.FuzzedServer, path: Path) -> None:
    response = server.request(http.HttpRequest.read(path))
    http.check_error(response)
    server.check()
    assert response.status_code < 500


@each_row(
    ("status", "body"),
    [
        (500, '{"kind": "fault", "message": "x.", "hint": ""}'),
        (404, "not json"),
        (404, '{"detail": "x"}'),
        (404, '{"kind": "Not Found", "message": "x.", "hint": ""}'),
        (404, '{"kind": "not-found", "message": "x", "hint": ""}'),
    ],
)
def test_a_wrong_answer_is_caught(status: int, body: str) -> None:
    response = http.requests.Response()
    response.status_code = status
    response._content = body.encode()
    with pytest.raises(BrokenError):
        http.check_error(response)


# -- ws ----------------------------------------------------------------------------------------------------------------


def test_a_few_external_texts(server: http.FuzzedServer) -> None:
    floor = ws.Floor(server)
    broken = [f"{talk}\n{error}" for talk, error in ws.talks(floor, 0, TALKS)]
    floor.close()
    assert not broken, "\n\n".join(broken)
    assert floor.talks >= TALKS


@each_row("path", TALKED, ids=lambda path: path.stem)
def test_formerly_failing_texts_are_answered(server: http.FuzzedServer, path: Path) -> None:
    floor = ws.Floor(server)
    floor.hold(ws.Talk.read(path))
    floor.close()


# -- files -------------------------------------------------------------------------------------------------------------


@each_row("kind", files.KINDS)
def test_a_whole_file_of_each_kind_is_read(files_search: files.FileSearch, kind: str) -> None:
    files_search.check(Case(files_search.whole[kind], (), {"kind": kind, "cut": False}))


def test_a_few_damaged_files(files_search: files.FileSearch) -> None:
    for _ in range(FILES):
        case = files_search.case()
        with files.bounded():
            try:
                files_search.check(case)
            except BrokenError as broken:
                small, broken = files_search.smaller(case, broken)
                pytest.fail(f"{broken}\n{small.settings}\n{small.data.hex()}")


@each_row("path", list(cases.findings("files")), ids=lambda path: path.stem)
def test_a_file_that_once_broke_something_is_read_or_refused(files_search: files.FileSearch, path: Path) -> None:
    with files.bounded():
        files_search.check(cases.read(path))


@each_row("kind", files.KINDS)
@each_row("data", [b"", b"\0", b"\x89MCAP0\r\n", b"\xff" * 300, b"[" * 300], ids=len)
def test_empty_files(files_search: files.FileSearch, kind: str, data: bytes) -> None:
    with files.bounded():
        files_search.check(Case(data, (), {"kind": kind, "cut": False}))


def _squeezed(packing: str, data: bytes) -> bytes:
    """Compressed as an MCAP chunk is."""
    if packing == "zstd":
        return bytes(zstandard.ZstdCompressor().compress(data))
    return bytes(lz4.frame.compress(data))


@each_row("packing", ["zstd", "lz4"])
def test_a_chunk_that_unpacks_to_gigabytes_is_refused(tmp_path: Path, packing: str) -> None:
    """Regression: the chunk claimed 1 kB, but zstd used its own header, and lz4 had no limit."""
    from imuscope.recordings.mcap.reader import _unpack

    whole = bytes(files.MAX_BYTES // 4)
    body = _squeezed(packing, whole)
    assert len(body) < len(whole) // 100
    with files.bounded(files.MAX_BYTES // 8):
        if packing == "zstd":
            with pytest.raises(ValueError, match="another size"):
                _unpack(packing, body, 1024)
        else:
            assert len(_unpack(packing, body, 1024)) <= 1024


def test_a_faulty_reader_is_caught(files_search: files.FileSearch, monkeypatch: pytest.MonkeyPatch) -> None:
    """Self-test of the check: a reader that allocates the claimed size fails it."""

    def greedy(path: Path, cut: bool) -> None:
        bytearray(int.from_bytes(path.read_bytes()[:8], "little"))

    monkeypatch.setitem(files.KINDS, "bin", files.FileKind("a.bin", greedy))
    with files.bounded(), pytest.raises(BrokenError, match="memory"):
        files_search.check(Case((4 << 30).to_bytes(8, "little"), (), {"kind": "bin", "cut": False}))


def test_each_has_run_for_ten_minutes() -> None:
    runs = json.loads((Path(__file__).parent / "runs.json").read_text())
    for name in ("http", "ws", "files"):
        assert max(run["minutes"] for run in runs if run["protocol"] == name) >= 10, name
