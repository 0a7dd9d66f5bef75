"""Full, slow, limited and damaged disks, and the outcome for their files.

    fault                                       outcome
    disk full while it is recorded (tmpfs)      the recording ends with a sentence and a hint; what was written is whole
    file as large as the system allows          the same; the next recording begins
    full while it is exported                   the export fails with a sentence and a hint, nothing is left of it
    slow disk                                   nothing waits for it, what waits is told as lag, and all of it arrives
    a recording damaged at random bytes         it opens up to the damage or around it, and says so
    … asked for over HTTP                       a detail with `damaged`, or one sentence and a hint; never 500

(A folder that is removed while it is recorded: tests/recordings/mcap/test_live_writer.py.
Trials and snapshots on a full disk: tests/server/configuration/test_rollback.py, test_snapshots.py.)
"""

from __future__ import annotations

import contextlib
import errno
import os
import random
import resource
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.exporters import ExportRequest, export
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.mcap.compaction import compact
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.library import standing_recording
from imuscope.server.library.decode import decode
from imuscope.server.library.standing_recording import StandingRecording
from imuscope.server.settings.config import Config
from tests.recordings.recorded_drive import drive
from tests.support.each_row import each_row
from tests.support.fakes import FakeLinks, sample
from tests.support.in_process_server import InProcessServer
from tests.support.recorder_harness import chunks, send, settled
from tests.support.server_process import ROOT, tied
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until


@contextlib.contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Limit the file size (EFBIG), as a quota or a small file system does.

    Modules imported inside the block write no bytecode: Python 3.11 would truncate it and fail on it afterwards.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[0][1]))
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before[0])
        sys.dont_write_bytecode = before[1]


def ended(running: InProcessServer) -> dict[str, Any]:
    """The recorder's state when it does not run any more."""
    block_until(lambda: not running.client.get("/api/recorder").json()["running"], "the recorder has stopped")
    return dict(running.client.get("/api/recorder").json())


FULL = """
import sys, time
from pathlib import Path
from imuscope.recordings.mcap.live_writer import RecordingWriter
from imuscope.recordings.mcap.reader import McapReader

folder = Path(sys.argv[1])
tape = RecordingWriter(lambda part: folder / "a.mcap", {}, time.time_ns)
n = 0
while tape.running:
    tape.chunk("1", "rx", n.to_bytes(4, "big") * 2048, n)
    n += 1
    time.sleep(0.001)
tape.stop()
found = []
with McapReader(folder / "a.mcap") as recording:
    for block in recording.blocks():
        channel = recording.topic("rx/1")
        if channel is not None:
            found.append(block.joined(block.of(channel.id))[0])
data = b"".join(found)
assert data == b"".join(k.to_bytes(4, "big") * 2048 for k in range(len(data) // 8192)), "torn"
print(tape.error.message, "|", tape.error.hint, "|", len(data))
"""


def test_a_full_disk(tmp_path: Path) -> None:
    """A real one, of a megabyte."""
    mount = 'mount -t tmpfs -o size=1m tmpfs "$1" && shift && exec "$@"'
    here = ["/usr/bin/env", "unshare", "-rm", "sh", "-c", mount, "sh", str(tmp_path)]
    if subprocess.run([*here, "true"], capture_output=True).returncode:
        pytest.skip("a file system of its own needs a name space of its own, which is not permitted here")
    done = subprocess.run(
        tied([*here, sys.executable, "-c", FULL, str(tmp_path)]),
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0, done.stderr
    message, hint, size = done.stdout.split(" | ")
    assert message == "The disk is full: a.mcap."
    assert "Free some space" in hint
    assert 900_000 < int(size) < 1_048_576


def test_a_file_size_limit(running: InProcessServer, links: FakeLinks, tmp_path: Path) -> None:
    running.client.post("/api/recordings/start", json={})
    expected = b""
    with files_of_at_most(20_000):
        for n in range(4000):
            send(running, links, "/dev/one", sample(n % 250))
            expected += sample(n % 250)
            if n % 200 == 0 and not running.client.get("/api/recorder").json()["running"]:
                break
        state = ended(running)
    assert "largest size" in state["message"]
    assert state["hint"]
    path = chunks(tmp_path / "recordings" / f"{state['id']}.mcap")
    assert expected.startswith(path)
    assert len(path) > 500
    assert running.client.post("/api/recordings/start", json={}).json()["running"] is True


def test_an_export_onto_a_full_disk(tmp_path: Path) -> None:
    drive(tmp_path / "a.mcap", seconds=2.0)
    columns = decode(open_file(tmp_path / "a.mcap"), tmp_path / "store", all_protocols())
    (tmp_path / "out").mkdir()
    wish = ExportRequest(columns, tmp_path / "a.mcap", "A drive", device="1")
    for suffix in ("csv", "parquet", "mcap"):
        with files_of_at_most(4096), pytest.raises(RecordingError) as caught:
            export(suffix, wish, tmp_path / "out" / f"a.{suffix}")
        assert caught.value.message.endswith(".")
        assert caught.value.hint
        assert list((tmp_path / "out").iterdir()) == []


def test_a_slow_disk(
    running: InProcessServer, links: FakeLinks, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that blocks on writing and on fsync for as long as the test requests."""
    running.client.post("/api/recordings/start", json={})
    settled(running)
    takes = threading.Event()

    def slowly(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(fd: int, *arguments: Any) -> Any:
            if os.readlink(f"/proc/self/fd/{fd}").endswith(".mcap"):
                takes.wait(PATIENCE_S)
            return function(fd, *arguments)

        return call

    monkeypatch.setattr(os, "write", slowly(os.write))
    monkeypatch.setattr(os, "fdatasync", slowly(os.fdatasync))
    expected = b"".join(sample(n % 250) for n in range(600))
    for n in range(600):
        send(running, links, "/dev/one", expected[4 * n : 4 * n + 4])

    def decoded() -> int:
        health = running.services.sessions.get("1").health(running.services.telemetry.bus.now())
        return sum(one.count for one in health.messages if one.name == "Sample")

    block_until(lambda: running.call(decoded) == 600, "samples wait for no disk")
    block_until(lambda: running.client.get("/api/recorder").json()["behind_s"] > 0.1, "what waits is told")
    assert running.client.get("/api/recorder").json()["running"] is True
    takes.set()
    settled(running)
    state = running.client.post("/api/recordings/stop", json={}).json()
    assert state["message"] == ""
    assert chunks(tmp_path / "recordings" / f"{state['id']}.mcap") == expected


class Usage(NamedTuple):
    """As shutil.disk_usage."""

    total: int
    used: int
    free: int


class FullDisk:
    """A disk whose free space a test sets; writing a recording fails while it is 0."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.free = 10**9
        write = os.write

        def limited(fd: int, *arguments: Any) -> Any:
            if not self.free and os.readlink(f"/proc/self/fd/{fd}").endswith(".mcap"):
                raise OSError(errno.ENOSPC, "No space left on device")
            return write(fd, *arguments)

        monkeypatch.setattr(os, "write", limited)
        monkeypatch.setattr(shutil, "disk_usage", lambda folder: Usage(10**9, 0, self.free))
        monkeypatch.setattr(standing_recording, "FIRST_S", 0.001)
        monkeypatch.setattr(standing_recording, "LONGEST_S", 0.002)
        monkeypatch.setattr(standing_recording, "CHECK_S", 0.002)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> FullDisk:
    return FullDisk(monkeypatch)


def attempts(running: InProcessServer, monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Waits until room has been looked for so often again."""
    count = 0
    own = StandingRecording._has_room

    def counted(self: StandingRecording) -> bool:
        nonlocal count
        count += 1
        return own(self)

    monkeypatch.setattr(StandingRecording, "_has_room", counted)

    def wait(more: int) -> None:
        expected = count + more
        block_until(lambda: count >= expected, "further attempts")

    return wait


def test_a_standing_recording_is_resumed_when_a_full_disk_has_room(
    tmp_path: Path, links: FakeLinks, disk: FullDisk, monkeypatch: pytest.MonkeyPatch
) -> None:
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path, record=True), links.open) as running:
        wait = attempts(running, monkeypatch)
        first = running.client.get("/api/recorder").json()
        disk.free = 0
        send(running, links, "/dev/one", sample(1))
        state = ended(running)
        assert state["message"].startswith("The disk is full")
        assert state["hint"] == "Recording is resumed by itself when 50 MB are free."
        disk.free = 49 * 10**6  # not enough: a little is free again and again on such a disk
        wait(3)
        send(running, links, "/dev/one", sample(3))
        assert not running.client.get("/api/recorder").json()["running"]
        disk.free = 51 * 10**6
        block_until(lambda: running.client.get("/api/recorder").json()["running"], "recording again")
        second = running.client.get("/api/recorder").json()
        assert second["id"] != first["id"]
        assert "The disk has room again: recording has been resumed." in [
            one.text for one in running.call(lambda: list(running.services.telemetry.log))
        ]
        send(running, links, "/dev/one", sample(2))
        settled(running)
    # with what memory still has of the time without room: it began with what came after there was room again
    assert chunks(tmp_path / "recordings" / f"{second['id']}.mcap").endswith(sample(3) + sample(2))


def test_a_standing_recording_begins_when_a_disk_that_was_full_at_the_start_has_room(
    tmp_path: Path, links: FakeLinks, disk: FullDisk
) -> None:
    disk.free = 0
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path, record=True), links.open) as running:
        assert not running.client.get("/api/recorder").json()["running"]
        disk.free = 10**9
        block_until(lambda: running.client.get("/api/recorder").json()["running"], "recording")


def test_a_recording_that_a_person_stopped_or_started_is_not_resumed(
    tmp_path: Path, links: FakeLinks, disk: FullDisk, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = Config(sources=("/dev/one",), data=tmp_path, record=True)
    with InProcessServer(config, links.open) as running:
        disk.free = 0
        send(running, links, "/dev/one", sample(1))
        ended(running)
        assert running.client.post("/api/recordings/stop", json={}).json()["message"] == ""
        disk.free = 10**9
        assert running.client.post("/api/recordings/stop", json={}).status_code == 409
        assert not running.client.get("/api/recorder").json()["running"]
        assert not running.services.recorder._standing.is_waiting
        running.client.post("/api/recordings/start", json={})
        disk.free = 0
        send(running, links, "/dev/one", sample(2))
        assert ended(running)["hint"].startswith("Free some space")
        assert not running.services.recorder._standing.is_waiting


# ── damage ───────────────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, bytes, int]:
    """A recording as it was written, the same packed, and its rows."""
    folder = tmp_path_factory.mktemp("whole")
    drive(folder / "a.mcap")
    loose = (folder / "a.mcap").read_bytes()
    rows = rows_of(decode(open_file(folder / "a.mcap"), folder / "store", all_protocols()))
    compact(folder / "a.mcap")
    return loose, (folder / "a.mcap").read_bytes(), rows


def rows_of(columns: ColumnStore) -> int:
    return sum(columns.rows(channel["id"]) for channel in columns.manifest["channels"])


def damaged(raw: bytes, seed: int) -> bytes:
    """A run of bytes turned, cut out or zeroed, somewhere."""
    draw = random.Random(seed)
    at, size = draw.randrange(8, len(raw)), draw.choice((1, 1, 7, 512, 4096))
    match seed % 4:
        case 0:
            return raw[:at]
        case 1:
            return raw[:at] + draw.randbytes(size) + raw[at + size :]
        case 2:
            return raw[:at] + bytes(size) + raw[at + size :]
        case _:
            return raw[:at] + raw[at + size :]


@each_row("packed", [False, True])
def test_a_recording_damaged_at_random_bytes(tmp_path: Path, whole: tuple[bytes, bytes, int], packed: bool) -> None:
    opened = 0
    for seed in range(12):
        path = tmp_path / f"{seed}.mcap"
        path.write_bytes(damaged(whole[1] if packed else whole[0], seed))
        with contextlib.suppress(RecordingError):  # any other exception is a fault
            columns = decode(open_file(path), tmp_path / f"store{seed}", all_protocols())
            assert 0 <= rows_of(columns) <= whole[2]
            opened += 1
    assert opened >= 6, "most of what is left can be read"


def test_damaged_recordings_over_http(tmp_path: Path, links: FakeLinks, whole: tuple[bytes, bytes, int]) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    for seed in (20, 21):
        (folder / f"hurt-{seed}.mcap").write_bytes(damaged(whole[1], seed))
    (folder / "nothing.mcap").write_bytes(b"")
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), links.open) as running:
        client = running.client
        listed = client.get("/api/recordings").json()
        assert len(listed) == 3
        assert any(one["damaged"] for one in listed), "a damage is told in the list"
        for one in listed:
            for path in ("", "/download", "/original?device=1"):
                answer = client.get(f"/api/recordings/{one['id']}{path}", timeout=PATIENCE_S)
                assert answer.status_code != 500, (one["id"], path, answer.text)
                if answer.status_code >= 400:
                    assert set(answer.json()) == {"kind", "message", "hint"}
