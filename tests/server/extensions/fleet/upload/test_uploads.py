"""Finished recordings go to the store by themselves, exactly once, whatever fails."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from imuscope.recordings import sidecar
from imuscope.recordings.mcap.compaction import compact
from imuscope.server.extensions.fleet.model.fleet_settings import FleetSettings
from imuscope.server.extensions.fleet.model.settings import FleetTables, StoreSettings
from imuscope.server.extensions.fleet.upload import uploads
from imuscope.server.library.compaction_worker import CompactionWorker
from imuscope.server.library.foreign_files import MODULE as FILES
from imuscope.server.settings.config import Config
from imuscope.server.system.workers import Worker
from tests.recordings.recorded_drive import drive
from tests.server.extensions.fleet.store_fixtures import delta
from tests.support.each_row import each_row
from tests.support.fakes import FakeLinks
from tests.support.in_process_server import InProcessServer
from tests.support.server_process import ServerProcess
from tests.support.timeouts import http_client
from tests.support.waiting import block_until


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uploads, "SETTLED_S", 0.0)
    monkeypatch.setattr(uploads, "CHECK_S", 0.1)
    monkeypatch.setattr(uploads, "FIRST_PAUSE_S", 0.1)
    monkeypatch.setattr(uploads, "LONGEST_PAUSE_S", 0.5)


def folder_of(data: Path) -> Path:
    """The folder of the library."""
    (data / "recordings").mkdir(parents=True, exist_ok=True)
    return data / "recordings"


def serving(data: Path, store: Path, **rules: Any) -> InProcessServer:
    settings = StoreSettings(str(store), upload=True, **rules)
    config = Config(port=0, data=data, sources=("/dev/ttyUSB9",)).having(
        FleetTables(settings, FleetSettings(name="otter"))
    )
    return InProcessServer(config, FakeLinks().open)


def states(server: InProcessServer) -> dict[str, dict[str, Any]]:
    answer = server.client.get("/api/uploads").json()
    return {one["id"]: one for one in answer["recordings"]}


def until(server: InProcessServer, recording: str, state: str) -> dict[str, Any]:
    """Wait for the state of a recording."""

    def is_it() -> dict[str, Any] | None:
        one = states(server).get(recording, {})
        return one if one.get("state") == state else None

    result: dict[str, Any] = block_until(is_it, lambda: states(server))
    return result


def stored(store: Path) -> list[str]:
    """Recordings as another program reads them."""
    return sorted(delta(store, "recordings")["name"].to_pylist())


def events(server: InProcessServer) -> list[str]:
    return [event.text for event in server.call(lambda: server.services.telemetry.bus.events_since(0.0))]


def test_without_the_setting_nothing_is_uploaded(tmp_path: Path) -> None:
    config = Config(port=0, data=tmp_path / "data", sources=("/dev/ttyUSB9",)).having(
        FleetTables(StoreSettings(str(tmp_path / "s")))
    )
    drive(folder_of(tmp_path / "data") / "a.mcap")
    with InProcessServer(config, FakeLinks().open) as server:
        answer = server.client.get("/api/uploads").json()
        assert answer == {"enabled": False, "store": "", "robot": "", "problem": "", "recordings": []}
        assert "imuscope_uploads" not in server.client.get("/metrics").text


@pytest.mark.slow
def test_finished_recordings_are_stored_and_a_restart_knows_it(tmp_path: Path) -> None:
    data, store = tmp_path / "data", tmp_path / "store"
    drive(folder_of(data) / "a.mcap")
    drive(folder_of(data) / "b.mcap", seconds=2.0)
    (folder_of(data) / "noise.bin").write_bytes(b"\x55" * 5000)
    sidecar.write(folder_of(data) / "b.mcap", sidecar.Edits(tags=("private",)))
    with serving(data, store, skip_tags=("private",)) as server:
        one = until(server, "a", "stored")
        (path,) = (store / "robots").rglob("*.mcap")
        assert one["checksum"] == hashlib.sha256(path.read_bytes()).hexdigest()
        assert (one["object"], path.stem) == (str(path.relative_to(store)), one["recording"])
        assert one["stored_at"] > 0
        assert "not a format" in until(server, "noise", "refused")["reason"]
        assert states(server)["b"]["reason"] == "It has the tag private."
        answer = server.client.get("/api/uploads").json()
        assert (answer["enabled"], answer["store"], answer["robot"]) == (True, str(store), "otter")
        block_until(lambda: 'imuscope_uploads{state="stored"} 1' in server.client.get("/metrics").text, "the metric")
        assert any("noise.bin is not uploaded" in text for text in events(server))
    with serving(data, store, skip_tags=("secret",)) as server:
        assert states(server)["a"] == one
        until(server, "b", "stored")
    assert stored(store) == ["a.mcap", "b.mcap"]


def test_what_waits_gave_no_reason_and_what_was_stored_no_progress(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive(folder_of(tmp_path / "data") / "a.mcap")
    drive(folder_of(tmp_path / "data") / "b.mcap", seconds=2.0)
    monkeypatch.setattr(CompactionWorker, "is_busy", True)
    monkeypatch.setattr(Worker, "start", _never)
    with serving(tmp_path / "data", tmp_path / "store") as server:
        compacting = "Uploads begin when finished recordings are compacted."
        assert {one["reason"] for one in states(server).values()} == {compacting}
        monkeypatch.setattr(uploads, "SETTLED_S", 1e9)
        monkeypatch.setattr(CompactionWorker, "is_busy", False)
        settling = "Its upload begins when the file has not changed for 1e+09 s."
        assert {one["reason"] for one in states(server).values()} == {settling}
        monkeypatch.setattr(uploads, "SETTLED_S", 0.0)
        block_until(lambda: any(one["state"] == "uploading" for one in states(server).values()), lambda: states(server))
        results = sorted((one["state"], one["reason"]) for one in states(server).values())
        assert results == [("uploading", ""), ("waiting", "Another recording is being uploaded.")]


_start = Worker.start


async def _never(module: str, *arguments: str, **more: Any) -> Worker:
    """A process that does not start, but for those that read files."""
    if module == FILES:
        return await _start(module, *arguments, **more)
    await asyncio.Event().wait()
    raise AssertionError


def test_a_store_that_fails_is_reported_and_tried_again(tmp_path: Path) -> None:
    """A full disk likewise: the words are those of the store."""
    data, store = tmp_path / "data", tmp_path / "store"
    store.write_text("in the way")
    drive(folder_of(data) / "a.mcap")
    with serving(data, store) as server:
        block_until(lambda: "is a file" in states(server)["a"]["reason"], "the reason of the store")
        assert states(server)["a"]["state"] in ("waiting", "uploading")
        assert "is a file" in server.client.get("/api/uploads").json()["problem"]
        store.unlink()
        until(server, "a", "stored")
        assert server.client.get("/api/uploads").json()["problem"] == ""
        assert states(server)["a"]["progress"] == 1.0
        message = events(server)
        assert sum("cannot be uploaded at present" in text for text in message) == 1
        assert "Recordings are uploaded again." in message
    assert stored(store) == ["a.mcap"]


def test_a_backlog_that_fills_the_quota_is_reported_once(tmp_path: Path) -> None:
    data, store = tmp_path / "data", tmp_path / "store"
    store.write_text("in the way")
    size = 0
    for name in "ab":
        drive(folder_of(data) / f"{name}.mcap")
        compact(folder_of(data) / f"{name}.mcap")  # or it would shrink below the share that is told
        size += (folder_of(data) / f"{name}.mcap").stat().st_size
    settings = StoreSettings(str(store), upload=True)
    config = Config(
        port=0,
        data=data,
        sources=("/dev/ttyUSB9",),
        recordings_quota_gb=1.1 * size / 1e9,
        extensions=(FleetTables(settings, FleetSettings(name="otter")),),
    )
    with InProcessServer(config, FakeLinks().open) as server:
        block_until(lambda: sum("cannot be uploaded at present" in text for text in events(server)), "it was tried")
        service = server.services.parts.get(uploads.UploadService)
        assert service.waiting_paths() == {folder_of(data) / f"{name}.mcap" for name in "ab"}
        store.unlink()
        until(server, "a", "stored")
        until(server, "b", "stored")
        assert service.waiting_paths() == set()
        waits = [text for text in events(server) if "wait for their upload" in text]
        assert len(waits) == 1
        assert "kept beyond it until the disk is short" in waits[0]


@pytest.mark.slow
def test_a_recording_that_was_renamed_is_not_stored_twice(tmp_path: Path) -> None:
    data, store = tmp_path / "data", tmp_path / "store"
    drive(folder_of(data) / "a.mcap")
    with serving(data, store) as server:
        one = until(server, "a", "stored")
        assert server.client.patch("/api/recordings/a", json={"file": "other", "title": "Other"}).status_code == 200
        again = until(server, "other", "stored")
        assert (again["recording"], again["object"]) == (one["recording"], one["object"])
    assert stored(store) == ["a.mcap"]


@pytest.mark.slow
def test_what_the_store_confirms_moves_to_the_bin(tmp_path: Path) -> None:
    data, store = tmp_path / "data", tmp_path / "store"
    for name, seconds in (("a", 2.0), ("b", 3.0), ("c", 4.0)):
        drive(folder_of(data) / f"{name}.mcap", seconds=seconds)
    sidecar.write(folder_of(data) / "a.mcap", sidecar.Edits(title="Yard"))
    sidecar.write(folder_of(data) / "b.mcap", sidecar.Edits(tags=("Keep",)))
    with serving(data, store) as server:
        for name in "abc":
            until(server, name, "stored")
        objects = {name: store / states(server)[name]["object"] for name in "abc"}
    before = objects["c"].read_bytes()
    objects["c"].write_bytes(b"x" * len(before))
    with serving(data, store, keep_gb=1e-9, keep_tags=("keep",)) as server:
        block_until(lambda: any("a.mcap is in the store and was moved" in text for text in events(server)), "the bin")
        block_until(lambda: any("does not confirm c.mcap, which stays" in text for text in events(server)), "the doubt")
        block_until(lambda: objects["c"].read_bytes() == before, "the object is uploaded again")
        until(server, "c", "stored")
        listed = server.client.get("/api/recordings").json()
        assert sorted(one["id"] for one in listed if one["deleted"] is None) == ["b", "c"]
        assert [one["id"] for one in listed if one["deleted"] is not None] == ["a"]
    assert stored(store) == ["a.mcap", "b.mcap", "c.mcap"]


@pytest.mark.slow
@each_row("progress", [0.01, 0.7])
def test_a_server_that_is_killed_in_an_upload_stores_it_once(progress: float, tmp_path: Path) -> None:
    data, store = tmp_path / "data", tmp_path / "store"
    drive(folder_of(data) / "a.mcap", seconds=40.0)
    os.utime(folder_of(data) / "a.mcap", (1_760_000_000, 1_760_000_000))
    settings = tmp_path / "imuscope.toml"
    settings.write_text(f"[store]\nurl = {json.dumps(str(store))}\nupload = true\n[fleet]\nname = 'otter'\n")

    def state(server: ServerProcess) -> dict[str, Any]:
        with http_client(base_url=server.url) as client:
            (one,) = client.get("/api/uploads").json()["recordings"]
        result: dict[str, Any] = one
        return result

    with ServerProcess("sim:xbus?rate=10", data=data, arguments=("--config", str(settings))) as server:
        block_until(lambda: state(server)["progress"] >= progress or state(server)["state"] == "stored", server.log)
        os.kill(server.process.pid, signal.SIGKILL)
        server.process.wait()
    with ServerProcess("sim:xbus?rate=10", data=data, arguments=("--config", str(settings))) as server:
        block_until(lambda: state(server)["state"] == "stored", lambda: (state(server), server.log))
    assert stored(store) == ["a.mcap"]
    (path,) = (store / "robots").rglob("*.mcap")
    assert path.read_bytes() == (data / "recordings" / "a.mcap").read_bytes()
    rows = delta(store, "samples")
    assert rows.num_rows > 4000
    assert not list((data / "uploading").glob("*"))


# ── full disks ───────────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.fixture
def small(tmp_path: Path) -> Iterator[Path]:
    """A file system of 64 kB."""
    place = tmp_path / "small"
    place.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(place)]
    try:
        mounted = subprocess.run(words, capture_output=True, text=True)
    except FileNotFoundError:
        pytest.skip("there is no mount command")
    if mounted.returncode:
        pytest.skip(f"a small file system needs the right to mount: {mounted.stderr.strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", "--lazy", str(place)], check=True)


def problem(server: InProcessServer) -> str:
    return str(server.client.get("/api/uploads").json()["problem"])


def overcome(server: InProcessServer, small: Path, words: str) -> None:
    """Check that a full disk is told once, and that the upload goes on when there is room."""
    block_until(lambda: words in problem(server), lambda: problem(server))
    assert "tried again" in problem(server)
    assert states(server)["a"]["state"] in ("waiting", "uploading")
    block_until(lambda: "imuscope_upload_failures_total 3" in server.client.get("/metrics").text, "more attempts")
    subprocess.run(["mount", "-o", "remount,size=64m", str(small)], check=True)
    until(server, "a", "stored")
    assert problem(server) == ""
    message = events(server)
    assert sum("cannot be uploaded at present" in text for text in message) == 1
    assert "Recordings are uploaded again." in message


@pytest.mark.slow
def test_a_store_without_room(tmp_path: Path, small: Path) -> None:
    data, store = tmp_path / "data", small / "store"
    drive(folder_of(data) / "a.mcap")
    with serving(data, store) as server:
        overcome(server, small, f"{store}: the disk is full. Free some space.")
    assert stored(store) == ["a.mcap"]
    assert (folder_of(data) / "a.mcap").exists()
    assert len(list((store / "robots").rglob("*.mcap"))) == 1


@pytest.mark.slow
def test_a_robot_without_room_for_temporary_files(tmp_path: Path, small: Path) -> None:
    data, store = tmp_path / "data", tmp_path / "store"
    (small / "uploading").mkdir()
    drive(folder_of(data) / "a.mcap")
    (data / uploads.FOLDER).symlink_to(small / "uploading")
    with serving(data, store) as server:
        overcome(server, small, "The disk of this robot is full: the upload of a.mcap needs room for temporary files.")
    assert stored(store) == ["a.mcap"]
