"""Recording as users do it: button, marker, `--record`; and the contents of the file, however the server ends."""

from __future__ import annotations

import asyncio
import itertools
import os
import signal
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from imuscope.protocols.xbus.output_changes import CONFIGURED
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.file_names import free_path, slug
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library import quota
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.live_writer import Limits
from imuscope.recordings.mcap.own_recordings import is_uncompacted
from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.mcap.source import McapSource
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.devices.decode import protocol_set
from imuscope.server.errors import DomainError
from imuscope.server.library.api_models import MarkerRequest
from imuscope.server.library.compaction_worker import CompactionWorker
from imuscope.server.library.decode import decode
from imuscope.server.library.recorder import RecordingOptions, plan_of
from imuscope.server.settings.config import Config, load
from tests.bench.support.tcp_device import TcpDevice
from tests.recordings.mcap_files import json_messages
from tests.support.fakes import FakeLinks, sample
from tests.support.in_process_server import InProcessServer
from tests.support.recorder_harness import (
    chunks,
    flowing,
    recorded,
    recorder,
    send,
    settled,
)
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until, until


def notes(path: Path) -> list[dict[str, Any]]:
    with McapReader(path) as recording:
        return [body for _, body in json_messages(recording, "notes")]


# ── over HTTP ────────────────────────────────────────────────────────────────────────────────────────────────────────


def test_data_between_start_and_stop_is_in_the_file(running: InProcessServer, links: FakeLinks, tmp_path: Path) -> None:
    send(running, links, "/dev/one", sample(1))
    assert running.client.get("/api/recorder").json()["running"] is False
    began = running.client.post("/api/recordings/start", json={"title": "Test drive"}).json()
    assert began["running"] is True
    assert began["op"] == "recorder"
    assert began["devices"] == ["1", "2"]
    assert began["title"] == "Test drive"
    expected = b""
    for n in range(2, 60):
        send(running, links, "/dev/one", sample(n))
        expected += sample(n)
    send(running, links, "/dev/two", b"other")
    settled(running)
    marked = running.client.post("/api/recordings/mark", json={"text": "bump", "device": "1"})
    assert marked.status_code == 200
    running.client.post("/api/recordings/mark", json={"text": "What a day", "kind": "note", "time": 17.5})
    ended = running.client.post("/api/recordings/stop", json={}).json()
    assert ended["running"] is False
    assert ended["message"] == ""
    path = tmp_path / "recordings" / f"{began['id']}.mcap"
    assert path.name.endswith("-Test-drive.mcap")
    assert chunks(path, "rx/1") == expected
    assert chunks(path, "rx/2") == b"other"
    assert notes(path) == [
        {"kind": "marker", "text": "bump", "device": "1"},
        {"kind": "note", "text": "What a day", "device": ""},
    ]
    source = McapSource(path)
    assert source.header["title"] == "Test drive"
    assert source.devices["1"].identity["source"] == "/dev/one"
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert sorted(channel.topic for channel in summary.channels.values())[-2:] == ["rx/1", "rx/2"]


def test_a_device_keeps_nothing_of_recordings_that_have_ended(running: InProcessServer) -> None:
    """Each was kept in memory as long as its devices."""
    listeners = running.services.sessions.get("1").listeners
    before = len(listeners._closing)
    for _ in range(3):
        running.client.post("/api/recordings/start", json={})
        running.client.post("/api/recordings/stop", json={})
    assert len(listeners._closing) == before


def test_chosen_devices_only_and_all_with_those_that_come_later(
    running: InProcessServer, links: FakeLinks, tmp_path: Path
) -> None:
    state = running.client.post("/api/recordings/start", json={"devices": ["2"]}).json()
    assert state["devices"] == ["2"]
    running.client.post("/api/devices", json={"source": "/dev/three"})
    assert running.client.get("/api/recorder").json()["devices"] == ["2"]
    send(running, links, "/dev/one", sample(1))
    send(running, links, "/dev/two", sample(2))
    settled(running)
    ended = running.client.post("/api/recordings/stop", json={}).json()
    assert chunks(tmp_path / "recordings" / f"{ended['id']}.mcap", "rx/1") == b""
    assert chunks(tmp_path / "recordings" / f"{ended['id']}.mcap", "rx/2") == sample(2)

    running.client.post("/api/recordings/start", json={})
    running.client.post("/api/devices", json={"source": "/dev/four"})
    send(running, links, "/dev/four", sample(9))
    settled(running)
    ended = running.client.post("/api/recordings/stop", json={}).json()
    assert ended["devices"] == ["1", "2", "3", "4"]
    assert chunks(tmp_path / "recordings" / f"{ended['id']}.mcap", "rx/4") == sample(9)


def test_a_recording_is_named_after_devices_that_sent_data(running: InProcessServer, links: FakeLinks) -> None:
    """Regression: a port that never received anything came first in the name."""
    counts = itertools.count(1)

    def has_arrived() -> bool:
        send(running, links, "/dev/two", sample(next(counts) % 256))
        return running.call(lambda: running.services.sessions.get("2").info.last_arrival) is not None

    block_until(has_arrived, "the second port has received something")
    name = running.call(lambda: running.services.sessions.get("2").info.name)
    began = running.client.post("/api/recordings/start", json={}).json()
    assert began["id"].endswith(slug(name))
    assert "more" not in began["id"]


def test_sent_bytes_are_recorded_too(running: InProcessServer, links: FakeLinks, tmp_path: Path) -> None:
    links["/dev/one"].listens = True
    running.client.post("/api/recordings/start", json={})
    assert running.loop is not None
    session = running.services.sessions.get("1")
    asyncio.run_coroutine_threadsafe(session.access.send(b"hello"), running.loop).result(PATIENCE_S)
    ended = running.client.post("/api/recordings/stop", json={}).json()
    assert chunks(tmp_path / "recordings" / f"{ended['id']}.mcap", "tx/1") == b"hello"


def test_impossible_requests_are_refused_with_a_reason(running: InProcessServer) -> None:
    client = running.client

    def refused(response: Any, status: int, kind: str) -> None:
        assert response.status_code == status
        body = response.json()
        assert set(body) == {"kind", "message", "hint"}
        assert body["kind"] == kind
        assert body["message"]

    refused(client.post("/api/recordings/stop", json={}), 409, "not-now")
    refused(client.post("/api/recordings/mark", json={}), 409, "not-now")
    refused(client.post("/api/recordings/start", json={"devices": ["77"]}), 404, "not-found")
    refused(client.post("/api/recordings/start", json={"devices": []}), 404, "not-found")
    refused(client.post("/api/recordings/start", json={"title": "x" * 5000}), 422, "bad-request")
    assert client.post("/api/recordings/start", json={}).status_code == 200
    refused(client.post("/api/recordings/start", json={}), 409, "busy")
    refused(client.post("/api/recordings/mark", json={"kind": "shout"}), 422, "bad-request")


def test_an_uncreatable_folder_is_reported(tmp_path: Path, links: FakeLinks) -> None:
    (tmp_path / "recordings").write_text("a file where the folder should be")
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), links.open) as running:
        response = running.client.post("/api/recordings/start", json={})
        assert response.status_code == 507
        assert response.json()["kind"] == "disk"
        assert running.client.get("/api/recorder").json()["running"] is False


def test_with_record_a_disk_that_fails_does_not_keep_the_server_from_starting(tmp_path: Path, links: FakeLinks) -> None:
    (tmp_path / "recordings").write_text("a file where the folder should be")
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path, record=True), links.open) as running:
        state = running.client.get("/api/recorder").json()
        assert not state["running"]
        assert state["message"]


# ── quota, parts, names ──────────────────────────────────────────────────────────────────────────────────────────────


def old_recordings(data: Path, count: int, pinned: int | None = None) -> Path:
    """Closed recordings old-0 … in the folder that is returned, the oldest first."""
    folder = data / "recordings"
    folder.mkdir()
    for n in range(count):
        path = folder / f"old-{n}.mcap"
        writer = McapWriter(path, {})
        writer.chunk("1", "rx", os.urandom(400_000), 1)
        writer.close()
        compact(path, edit={"pinned": "true" if n == pinned else "false"})
        os.utime(path, (1000 + n, 1000 + n))
    return folder


def test_over_the_quota_the_oldest_unpinned_recordings_are_deleted(tmp_path: Path, links: FakeLinks) -> None:
    folder = old_recordings(tmp_path, 5, pinned=0)
    config = Config(sources=("/dev/one",), data=tmp_path, recordings_quota_gb=0.001)
    with InProcessServer(config, links.open) as running:
        state = running.client.post("/api/recordings/start", json={}).json()
        left = sorted(path.stem for path in folder.iterdir())
        assert left == sorted(["old-0", "old-4", state["id"]])
        events = running.call(lambda: [event.text for event in running.services.telemetry.log])
        assert any("old-1, old-2, old-3" in text for text in events)


def test_what_waits_for_its_upload_is_kept_beyond_the_quota_until_the_disk_is_short(
    tmp_path: Path, links: FakeLinks, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = old_recordings(tmp_path, 4)
    config = Config(sources=("/dev/one",), data=tmp_path, recordings_quota_gb=0.001)
    with InProcessServer(config, links.open) as running:
        recorder = running.services.recorder
        recorder.waiting = lambda: {folder / f"old-{n}.mcap" for n in (0, 1, 2)}
        running.client.post("/api/recordings/start", json={}).raise_for_status()
        running.client.post("/api/recordings/stop", json={}).raise_for_status()
        assert {path.stem for path in folder.glob("old-*")} == {"old-0", "old-1", "old-2"}
        monkeypatch.setattr(quota, "is_short", lambda place: True)
        running.client.post("/api/recordings/start", json={}).raise_for_status()
        assert {path.stem for path in folder.glob("old-*")} == {"old-1", "old-2"}
        events = running.call(lambda: [(event.level, event.text) for event in running.services.telemetry.log])
        assert ("error", "The disk is short: recordings were deleted before they were uploaded: old-0.") in events


def test_a_name_from_outside_never_becomes_a_path(tmp_path: Path) -> None:
    assert slug("../../etc/passwd") == "etc-passwd"
    assert slug("MTi-630 AHRS") == "MTi-630-AHRS"
    assert slug("кириллица") == ""
    path = free_path(tmp_path, 0.0, "../x/\0y" + "z" * 500)
    assert path.parent == tmp_path
    assert len(path.name) < 80
    path.touch()
    assert free_path(tmp_path, 0.0, "../x/\0y" + "z" * 500) == path.with_name(f"{path.stem}-2.mcap")


# ── with real simulators ──────────────────────────────────────────────────────────────────────────────────────────────


async def test_a_recording_stops_no_sensor(tmp_path: Path) -> None:
    """It sent GoToConfig for the head of the log: 100 ms of nothing, and "No loss since this session began"."""
    async with recorder(tmp_path) as (made, one):
        desk = await made.add("sim:xbus")
        desk.header = {}  # as if it had been plugged in long ago
        state = await one.start()
        assert state.headless == ["MTi-630"]
        samples = desk.member.link_session._pipeline.samples
        await until(lambda: desk.member.link_session._pipeline.samples > samples + 50, "it is recorded")
        assert "GoToConfig" not in [entry.name for entry in desk.log.tail(limit=500)]
        assert one.current is not None
        one.current.request_headers()
        await until(lambda: not one.state.headless, "the head has been read")
        await until(lambda: any(event.kind == "gap" for event in made.telemetry.log), "it measures again")
        pause = next(event for event in made.telemetry.log if event.kind == "gap")
        assert "imuscope had stopped the device (“Read its configuration for the recording”)." in pause.text
        assert pause.data["by"] == "request"
        await one.stop()
        path = tmp_path / "recordings" / f"{state.id}.mcap"
        store = decode(open_file(path), tmp_path / "opened", protocol_set.all_protocols())
        gaps = [event for event in store.manifest["events"] if event["kind"] == "gap"]
        assert [event["text"].partition(":")[2] for event in gaps] == [f" {CONFIGURED}"]
        assert (pause.t0, pause.t1) == pytest.approx((gaps[0]["t0"], gaps[0]["t1"]), abs=0.01)


async def test_a_recording_has_the_configuration_that_was_received_before(tmp_path: Path) -> None:
    async with recorder(tmp_path) as (made, one):
        desk = await made.add("sim:xbus")
        await made.read(desk)
        state = await one.start()
        assert state.headless == []
        await one.stop()
        with McapReader(tmp_path / "recordings" / f"{state.id}.mcap") as recording:
            assert bytes.fromhex(recording.meta("device/1")["configuration"])[:3] == b"\xfa\xff\x0d"


async def test_an_xsens_recording_holds_its_configuration_and_goes_on_measuring(tmp_path: Path) -> None:
    async with recorder(tmp_path, RecordingOptions(tmp_path / "recordings", request_header=True)) as (made, one):
        desk = await made.add("sim:xbus")
        state = await one.start()
        await until(lambda: desk.job_report.done, "the head has been read")
        assert desk.job_report.done[0].state == "done"
        samples = desk.member.link_session._pipeline.samples
        await until(lambda: desk.member.link_session._pipeline.samples > samples + 10, "it measures again")
        await one.stop()
        path = tmp_path / "recordings" / f"{state.id}.mcap"
        with McapReader(path) as recording:
            about = recording.meta("device/1")
        head = bytes.fromhex(about["configuration"])
        assert head[:3] == b"\xfa\xff\x0d"
        assert head in chunks(path, "rx/1")
        assert bytes.fromhex(about["emts"])[2] == 0x91
        assert b"\xfa\xff\x0c\x00" in chunks(path, "tx/1")
        with McapReader(path) as recording:
            commands = [body["text"] for _, body in json_messages(recording, "events") if body["kind"] == "command"]
        # On a busy machine an answer may arrive after its time-out; the request is repeated, which a note reports.
        requests = [text for text in commands if not text.startswith("Sent ")]
        assert requests == ["ReqDID", "GoToConfig", "ReqConfiguration", "ReqEmts", "GoToMeasurement"]


async def test_parts_of_a_live_recording_follow_without_a_byte_between(tmp_path: Path) -> None:
    plan = RecordingOptions(tmp_path / "recordings", Limits(split_bytes=30_000), request_header=True)
    async with recorder(tmp_path, plan) as (made, one):
        desk = await made.add("sim:xbus?rate=400")
        received: list[bytes] = []
        desk.member.listeners.chunks(lambda came, way: received.extend(one.data for one in came if way == "rx"))
        await one.start()

        def parts() -> list[Path]:
            begun = [path for path in plan.folder.iterdir() if path.stat().st_size > 2_000]  # its heading is written
            return sorted(begun, key=lambda path: int(McapSource(path).header["part"]))

        def with_head() -> list[Path]:
            return [path for path in parts() if "configuration" in McapSource(path).devices["1"].identity]

        await until(lambda: len(parts()) >= 4 and len(with_head()) >= 3, "it was split, and the device has answered")
        await one.stop()
        paths = parts()
        result = b"".join(chunks(path, "rx/1") for path in paths)
        assert result in b"".join(received), "it begins between two chunks, in the thread that reads"
        assert len(result) > 60_000
        for first, second in pairwise(paths):
            assert McapSource(second).header["previous"] == first.stem
        assert with_head() == paths[-len(with_head()) :], "every part since the answer can be exported"


async def test_the_time_until_a_recording_is_on_disk_is_a_setting(tmp_path: Path) -> None:
    for sync_s in (0.0, 7.0):
        plan = plan_of(load(data=tmp_path / f"{sync_s:g}", sync_s=sync_s))
        async with recorder(tmp_path, plan) as (_, one):
            await one.start()
            assert one.current is not None
            assert one.current.writer.sync_s == sync_s
    assert plan_of(load()).sync_s == 1.0


async def test_a_finished_recording_is_compacted_in_a_subprocess(tmp_path: Path) -> None:
    packed: list[Path] = []
    async with recorder(tmp_path, compactor=CompactionWorker(packed.append)) as (made, one):
        await made.add("sim:xbus")
        state = await one.start()
        await until(lambda: one.state.bytes > 1000, "something is recorded")
        await one.stop()
        path = tmp_path / "recordings" / f"{state.id}.mcap"
        await until(lambda: packed == [path], "it is packed")
        assert not is_uncompacted(path)
        with McapReader(path) as recording:
            assert recording.chunks
            assert not recording.damage


async def test_a_title_marks_and_refusals_without_http(tmp_path: Path) -> None:
    async with recorder(tmp_path) as (_, one):
        with pytest.raises(DomainError):
            one.mark(MarkerRequest())
        state = await one.start(title="Nothing connected yet")
        assert state.id.endswith("-Nothing-connected-yet")
        with pytest.raises(DomainError):
            await one.start()
        await one.stop()
        with pytest.raises(RecordingError):
            await one.start(path=tmp_path / "recordings" / f"{state.id}.mcap")  # never over another file


# ── whatever ends the server ─────────────────────────────────────────────────────────────────────────────────────────


def test_a_killed_server_keeps_what_it_has_received(tmp_path: Path) -> None:
    """Nothing has to follow for a byte to get into the file, and no end of the server.

    How long it takes is for the benchmark (tests/bench/recording.py: 20 ms).
    """
    with TcpDevice(500) as line, ServerProcess(line.source, data=tmp_path, arguments=("--record",)) as server:
        flowing(server, line)
        line.pause()
        block_until(lambda: chunks(recorded(tmp_path), "rx/1") == line.sent, "all that was sent is in the file")
        os.kill(server.process.pid, signal.SIGKILL)
        server.process.wait()
        assert chunks(recorded(tmp_path), "rx/1") == line.sent
