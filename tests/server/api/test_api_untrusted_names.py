"""Names that somebody types, uploads or puts into an address: none becomes a path, none is a fault, none is endless.

Each is sent wherever a name, a title, a text or an id is taken. What is answered is an answer, in the one shape of
errors where it is one; what lies on disk afterwards lies in the data folder and has a name that any system can hold.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import pytest

from imuscope.recordings.file_names import clean_name
from imuscope.recordings.readers.file_suffixes import suffixes
from imuscope.server.api.framework import is_whole
from imuscope.server.configuration.snapshots import Snapshot, Snapshots
from imuscope.server.settings.config import Config
from tests.recordings.recorded_drive import drive
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer

NASTY = {
    "parent": "../../escape.mcap",
    "parent, backwards": "..\\..\\escape.mcap",
    "absolute": "/etc/escape.mcap",
    "drive": "C:\\escape.mcap",
    "spelled": "%2e%2e%2fescape.mcap",
    "hidden": ".hidden.mcap",
    "an option": "-rf.mcap",
    "options": "--output=x",
    "nul": "a\0b.mcap",
    "lines": "a\r\nSet-Cookie: x=1\r\n\r\n.mcap",
    "dot": ".",
    "dots": "..",
    "space": "  ",
    "long": "x" * 300,
    "long in bytes": "🛰" * 90 + ".mcap",
    "emoji": "💥 🇦🇶.mcap",
    "device": "CON",
    "device with suffix": "nul.mcap",
    "backwards": "\u202epacm.exe",
    "combining": "e" + "\u0301" * 100 + ".mcap",
    "shell": "$(reboot);`id`|x.mcap",
    "markup": "<img src=x onerror=alert(1)>.mcap",
    "quotes": "\"';--.mcap",
    "half a character": "\ud800.mcap",
    "wildcards": "*?[a-z].mcap",
    "yaml": "!!python/object/apply:os.system ['x']",
    "format": "{0.__class__} %s %n",
}
FILE = {"content-type": "application/octet-stream"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Contains the data folder and, beside it, files that must not be touched."""
    folder = tmp_path_factory.mktemp("names")
    (folder / "data" / "recordings").mkdir(parents=True)
    (folder / "escape.mcap").write_text("not yours")
    return folder


@pytest.fixture(scope="module")
def running(folder: Path) -> Iterator[InProcessServer]:
    with InProcessServer(Config(data=folder / "data", sources=("/dev/one",), upload_gb=0.001), FakeLink) as running:
        running.client.timeout = 60
        yield running


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("file") / "a.mcap"
    drive(path, seconds=0.1)
    return path.read_bytes()


def quoted(name: str) -> str:
    return quote(name.encode("utf-8", "surrogatepass"), safe="").replace(".", "%2E")


def sent(running: InProcessServer, method: str, path: str, body: Any = None, content: bytes = b"") -> httpx.Response:
    """Send a request and check that its answer is well-formed."""
    headers, data = {}, content
    if body is not None:
        headers, data = {"content-type": "application/json"}, json.dumps(body).encode()
    elif content:
        headers = FILE
    answer = running.client.request(method, f"{running.url}{path}", content=data, headers=headers)
    assert answer.status_code < 500, (method, path, answer.text)
    assert "x=1" not in answer.headers.get("set-cookie", "")
    if answer.status_code >= 400:
        assert set(answer.json()) == {"kind", "message", "hint"}, (method, path)
        assert len(answer.json()["message"]) < 400
    return answer


def is_harmless(name: str) -> bool:
    """Could this be a file's name anywhere, and be given to a command?"""
    stem = name.partition(".")[0].upper()
    return (
        name.isprintable()
        and 0 < len(name.encode()) <= 255
        and name[0] not in "-. "
        and not set(name) & set('/\\<>:"|?*')
        and stem not in {"CON", "PRN", "AUX", "NUL", *(f"{port}{n}" for port in ("COM", "LPT") for n in range(1, 10))}
    )


def in_order(folder: Path) -> None:
    """No file is outside the data folder, and all names are harmless."""
    assert sorted(path.name for path in folder.iterdir()) == ["data", "escape.mcap"]
    assert (folder / "escape.mcap").read_text() == "not yours"
    for path in (folder / "data" / "recordings").iterdir():
        assert path.name.startswith(".") or is_harmless(path.name), path.name


@pytest.fixture(scope="module")
def recording(running: InProcessServer, file: bytes) -> str:
    """Address of an existing recording."""
    uploaded = sent(running, "PUT", "/api/recordings/upload?name=there.mcap", content=file)
    return f"/api/recordings/{uploaded.json()['id']}"


UPLOADED = ("parent", "spelled", "hidden", "an option", "nul", "long in bytes", "device", "half a character")


@each_row("what", UPLOADED)
def test_an_uploaded_file_gets_a_name_that_is_no_path(
    what: str, running: InProcessServer, folder: Path, file: bytes
) -> None:
    name = NASTY[what]
    uploaded = sent(running, "PUT", f"/api/recordings/upload?name={quoted(name)}", content=file)
    assert uploaded.is_success or (uploaded.status_code == 422 and len(name) > 400), uploaded.text
    in_order(folder)
    own = f"/api/recordings/{quoted(uploaded.json()['id'])}"
    disposition = sent(running, "GET", f"{own}/download").headers["content-disposition"]
    assert disposition.isascii()
    assert ".." not in disposition
    sent(running, "DELETE", own)


@each_row("name", NASTY.values(), ids=NASTY)
def test_hostile_names_open_nothing(name: str, running: InProcessServer, folder: Path, recording: str) -> None:
    device = running.client.get("/api/devices").json()[0]["id"]
    sent(running, "PATCH", recording, {"title": name, "tags": [name], "notes": name, "pinned": False})
    sent(running, "POST", f"{recording}/exports", {"format": "csv", "channels": [name], "device": name})
    assert sent(running, "GET", f"/api/recordings?q={quoted(name[:300])}").status_code in (200, 422)
    for path in (
        *(
            "/api/recordings/{}",
            "/api/recordings/{}/download",
            "/api/recordings/{}/original",
            "/api/devices/{}/jobs",
        ),
        *("/api/recordings/exports/{}/file", f"/api/devices/{device}/snapshots/{{}}", "/viser/{}/", "/rerun/{}", "/{}"),
        *("/api/views/scene?device={}", f"/api/devices/{device}/query?channel={{}}", "/api/tiles/{}/0/0"),
    ):
        assert sent_or_no_view(running, path.format(quoted(name))) not in (200, 201), path
    for method, path in (
        *(("DELETE", f"/api/devices/{device}/snapshots/{{}}"), ("DELETE", "/api/recordings/{}")),
        *(("POST", "/api/recordings/{}/undelete"), ("POST", "/api/recordings/{}/play")),
    ):
        sent(running, method, path.format(quoted(name)), {} if method == "POST" else None)
    sent(running, "POST", f"/api/devices/{device}/snapshots", {"title": name, "text": name})
    sent(running, "POST", f"/api/devices/{device}/decode-options", {"protocol": name, "key": name, "schema": name})
    in_order(folder)


def sent_or_no_view(running: InProcessServer, path: str) -> int:
    """As `sent`, where an unavailable view answers with 503."""
    answer = running.client.get(f"{running.url}{path}")
    if answer.status_code == 503:
        assert answer.json()["kind"] == "no-view"
        return 503
    return sent(running, "GET", path).status_code


@each_row("name", NASTY.values(), ids=NASTY)
def test_a_file_gets_a_name_that_any_system_can_hold(name: str) -> None:
    result = clean_name(name, suffixes())
    assert is_harmless(result), result
    assert clean_name(result, suffixes()) == result


@each_row("name", NASTY.values(), ids=NASTY)
def test_a_snapshot_is_stored_in_its_folder_only(name: str, tmp_path: Path) -> None:
    """The serial number is untrusted too: it comes from the line."""
    place = Snapshots(tmp_path / "data" / "snapshots")
    snapshot = Snapshot("xbus", name, name, name, title=name, taken=1.76e9, values={"a": {"b": 1}}, reason=name)
    info = place.save(snapshot, {})
    assert [path.name for path in tmp_path.iterdir()] == ["data"]
    for path in tmp_path.rglob("*"):
        assert is_harmless(path.name), path
    assert place.get("xbus", name, info.name).values == {"a": {"b": 1}}
    for other in (*NASTY.values(), "", "x/../y"):
        with pytest.raises(KeyError):
            place.get("xbus", name, other)
        with pytest.raises(KeyError):
            place.delete("xbus", name, other)


@each_row(
    ("method", "path", "body"),
    [
        ("PATCH", "/api/recordings/a", {"title": "x" * 201}),
        ("PATCH", "/api/recordings/a", {"notes": "x" * 20_001}),
        ("PATCH", "/api/recordings/a", {"tags": ["x"] * 51}),
        ("PATCH", "/api/recordings/a", {"tags": ["x" * 61]}),
        ("PATCH", "/api/recordings/a", {"file": "x" * 201}),
        ("POST", "/api/recordings/a/markers", {"text": "x" * 2001, "time": 1.0}),
        ("POST", "/api/recordings/mark", {"text": "x" * 2001}),
        ("POST", "/api/recordings/start", {"title": "x" * 10_000}),
        ("POST", "/api/devices", {"source": "x" * 1001}),
        ("GET", "/api/recordings?q=" + "x" * 401, None),
        ("PUT", "/api/recordings/upload?name=" + "x" * 401, None),
    ],
)
def test_every_text_has_a_limit(method: str, path: str, body: Any, running: InProcessServer) -> None:
    answer = sent(running, method, path, body, b"" if body is not None or method == "GET" else b"x")
    assert answer.status_code in (404, 409, 413, 422), answer.text


def test_a_body_beyond_a_megabyte_is_refused_before_it_is_read(running: InProcessServer) -> None:
    for path in ("/api/devices", "/api/recordings/start", "/api/recordings/mark", "/api/devices/1/decode-options"):
        answer = running.client.post(path, json={"x": "y" * 1024 * 1024})
        assert answer.status_code == 413


@each_row(
    ("body", "is_fine"),
    [
        (b'{"text": "\\ud83d\\ude80"}', True),
        (b'{"text": "\\uD83D"}', False),
        (b'{"\\ude80": 1}', False),
        (b'{"text": "\\\\ud83d"}', True),  # six letters
        (b'{"text": "\\ud83d"', True),  # not JSON: reported by the parser
        (b"[" * 100_000 + b'"\\ud83d"', True),
        (b"", True),
    ],
)
def test_an_unpaired_surrogate_is_detected(body: bytes, is_fine: bool) -> None:
    assert is_whole(body) == is_fine
