"""Devices that appear while a recording begins, goes on, or ends; and one that is stopped while it ends."""

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.mcap.live_writer import RecordingWriter
from imuscope.server.settings.config import Config
from tests.support.fakes import FakeLinks, sample
from tests.support.in_process_server import InProcessServer
from tests.support.recorder_harness import chunks, recorded, send, settled
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until


@pytest.fixture
def running(tmp_path: Path, links: FakeLinks) -> Iterator[InProcessServer]:
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), links.open) as running:
        yield running


def test_a_device_that_appears_in_a_recording_with_a_past_is_recorded(
    running: InProcessServer, links: FakeLinks, tmp_path: Path
) -> None:
    """Its bytes waited in memory for a past that was written already, and were not in the file."""
    send(running, links, "/dev/one", sample(1))
    running.client.post("/api/recordings/start", json={"before_s": 60})
    running.client.post("/api/devices", json={"source": "/dev/two"})
    send(running, links, "/dev/two", sample(2))
    settled(running)
    ended = running.client.post("/api/recordings/stop", json={}).json()
    assert ended["devices"] == ["1", "2"]
    assert chunks(recorded(tmp_path), "rx/1") == sample(1)
    assert chunks(recorded(tmp_path), "rx/2") == sample(2)


def slow_end(monkeypatch: pytest.MonkeyPatch) -> tuple[threading.Event, threading.Event]:
    """Let the end of a recording begin, which is the first event, and wait for the second, as on a slow disk."""
    ends, may_end, stop = threading.Event(), threading.Event(), RecordingWriter.stop

    def slow(writer: RecordingWriter) -> None:
        ends.set()
        may_end.wait(PATIENCE_S)
        stop(writer)

    monkeypatch.setattr(RecordingWriter, "stop", slow)
    return ends, may_end


def test_a_device_that_appears_while_a_recording_is_written_to_its_end_does_not_join_it(
    running: InProcessServer, links: FakeLinks, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was queued for a file that nobody wrote any more, until the memory was full."""
    recorder = running.services.recorder
    running.client.post("/api/recordings/start", json={})
    session = running.call(lambda: recorder.current)
    ends, may_end = slow_end(monkeypatch)
    stopping = threading.Thread(target=running.client.post, args=("/api/recordings/stop",), kwargs={"json": {}})
    stopping.start()
    assert ends.wait(PATIENCE_S)
    running.client.post("/api/devices", json={"source": "/dev/two"})
    may_end.set()
    stopping.join()
    send(running, links, "/dev/two", sample(2))
    assert session.recorded == ["1"]
    assert not list(session.writer._queue)


def test_a_recording_that_is_stopped_while_it_ends_by_itself_has_ended(
    running: InProcessServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To stop it was answered as an internal error."""
    recorder = running.services.recorder
    running.client.post("/api/recordings/start", json={})
    writer = running.call(lambda: recorder.current).writer
    ends, may_end = slow_end(monkeypatch)
    writer._fail(RecordingError("The disk is full.", "Free some space."))
    assert ends.wait(PATIENCE_S)
    answers: list[Any] = []
    stopping = threading.Thread(target=lambda: answers.append(running.client.post("/api/recordings/stop", json={})))
    stopping.start()
    block_until(lambda: answers or recorder._starting.locked(), "it is being stopped")
    may_end.set()
    stopping.join()
    assert answers[0].status_code == 200
    assert answers[0].json()["message"] == "The disk is full."
