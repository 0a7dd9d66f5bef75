"""Recordings that alarms start: from before the limit was crossed to after the condition has ended, within bounds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from imuscope.recordings.mcap.reader import TIME, McapReader
from imuscope.server.extensions.alarms.definitions import RecordingAction
from imuscope.server.extensions.alarms.recording_trigger import RecordingTrigger
from imuscope.server.settings.config import Config
from tests.recordings.mcap_files import json_messages
from tests.support.each_row import each_row
from tests.support.fakes import FakeLinks, sample
from tests.support.in_process_server import InProcessServer
from tests.support.manual_clock import ManualClock
from tests.support.recorder_harness import chunks, recorded, send, settled
from tests.support.server_process import ServerProcess
from tests.support.timeouts import http_client
from tests.support.waiting import block_until

RECORDING = {"before_s": 60, "after_s": 0}
FORCE: dict[str, Any] = {
    "name": "Force",
    "condition": {"kind": "expression", "expression": "Force > 100 N"},
    "missing_s": 3600,
    "recording": RECORDING,
}
LOW, HIGH = sample(1, 10), sample(2, 150)


@pytest.fixture
def running(tmp_path: Path, links: FakeLinks) -> Iterator[InProcessServer]:
    config = Config(sources=("/dev/one", "/dev/two"), protocol="fake", data=tmp_path)
    with InProcessServer(config, links.open) as running:
        for source in config.sources:
            send(running, links, source, LOW)
        yield running


def added(running: InProcessServer, device: str = "/dev/one", **changes: Any) -> str:
    body = {**FORCE, "devices": {"device": device}, **changes}
    answer = running.client.post("/api/alarms", json=body)
    assert answer.status_code == 201, answer.text
    alarm = str(answer.json()["id"])
    block_until(lambda: running.client.get(f"/api/alarms/{alarm}").json()["states"], "it is evaluated")
    return alarm


def recorder(running: InProcessServer) -> dict[str, Any]:
    return dict(running.client.get("/api/recorder").json())


def until_recording(running: InProcessServer, *, is_running: bool = True) -> dict[str, Any]:
    block_until(lambda: recorder(running)["running"] is is_running, lambda: (recorder(running), notices_of(running)))
    return recorder(running)


def notices_of(running: InProcessServer) -> list[str]:
    """Texts of the events of actions."""
    results = running.call(lambda: list(running.services.telemetry.log))
    return [one.text for one in results if one.kind == "alarm" and one.data["change"] == "action"]


def until_reported(running: InProcessServer, *parts: str) -> None:
    """Wait until there is one event for each part, in their order."""

    def is_reported() -> bool:
        texts = notices_of(running)
        return len(texts) == len(parts) and all(part in text for part, text in zip(parts, texts, strict=True))

    block_until(is_reported, lambda: notices_of(running))


def topics(path: Path, topic: str) -> list[dict[str, Any]]:
    with McapReader(path) as recording:
        return [body for _, body in json_messages(recording, topic)]


def file_of(data: Path, state: dict[str, Any]) -> Path:
    return data / "recordings" / f"{state['id']}.mcap"


def test_it_begins_before_the_crossing_and_ends_after_it_has_cleared(
    running: InProcessServer, links: FakeLinks, tmp_path: Path
) -> None:
    added(running)
    send(running, links, "/dev/one", HIGH)
    state = until_recording(running)
    assert (state["title"], state["devices"]) == ("Alarm Force", ["1"])
    settled(running)
    send(running, links, "/dev/one", LOW)
    until_recording(running, is_running=False)
    until_reported(running, f"started the recording {state['id']}.", f"ended the recording {state['id']}.")
    path = file_of(tmp_path, state)
    assert chunks(path, "rx/1") == LOW + HIGH + LOW
    assert chunks(path, "rx/2") == b""
    [marker] = topics(path, "notes")
    assert (marker["text"], marker["device"]) == ("Alarm “Force”", "1")


def test_it_records_every_device_and_goes_on_while_it_holds_and_for_some_time_after(
    running: InProcessServer, links: FakeLinks, tmp_path: Path
) -> None:
    added(running, recording={**RECORDING, "after_s": 3600, "longest_s": 1, "every_device": True})
    send(running, links, "/dev/one", HIGH)
    state = until_recording(running)
    assert state["devices"] == ["1", "2"]
    send(running, links, "/dev/one", LOW)
    until_recording(running, is_running=False)
    until_reported(running, "started the recording", "it has lasted 1 s, the longest that is set.")
    assert chunks(file_of(tmp_path, state), "rx/2") == LOW


def test_a_recording_of_a_person_has_a_marker_and_goes_on(
    running: InProcessServer, links: FakeLinks, tmp_path: Path
) -> None:
    added(running)
    own = running.client.post("/api/recordings/start", json={"devices": ["2"]}).json()
    for _ in range(2):  # the second marker within ten seconds is left out
        send(running, links, "/dev/one", HIGH)
        block_until(lambda: notices_of(running), "told")
        send(running, links, "/dev/one", LOW)
    until_reported(running, "started no recording: one is running, which has a marker now, but not this device.")
    assert recorder(running)["id"] == own["id"]
    running.client.post("/api/recordings/stop", json={})
    assert [one["text"] for one in topics(recorded(tmp_path), "notes")] == ["Alarm “Force”"]


def test_one_alarm_prolongs_the_recording_of_another(running: InProcessServer, links: FakeLinks) -> None:
    added(running)
    added(running, device="/dev/two", name="Other")
    send(running, links, "/dev/one", HIGH)
    state = until_recording(running)
    send(running, links, "/dev/two", HIGH)
    until_reported(running, "“Force” started the recording", "“Other” started no recording: one is running")
    send(running, links, "/dev/one", LOW)
    assert recorder(running)["id"] == state["id"]
    send(running, links, "/dev/two", LOW)
    until_recording(running, is_running=False)
    until_reported(running, "“Force” started", "“Other” started no", "“Force” ended the recording")


def test_what_a_person_stops_is_over_and_recordings_of_an_hour_are_bounded(
    running: InProcessServer, links: FakeLinks
) -> None:
    alarm = added(running, recording={**RECORDING, "per_hour": 1})
    send(running, links, "/dev/one", HIGH)
    until_recording(running)
    running.client.post("/api/recordings/stop", json={})

    def count() -> int:
        return int(running.client.get(f"/api/alarms/{alarm}").json()["states"][0]["count"])

    for expected in (2, 3):
        send(running, links, "/dev/one", LOW + HIGH)
        block_until(lambda: count() == expected, count)  # noqa: B023
    until_reported(running, "started the recording", "it has started 1 within an hour, which is its limit.")
    assert recorder(running)["running"] is False


def test_an_alarm_that_was_raised_before_a_restart_starts_nothing(tmp_path: Path, links: FakeLinks) -> None:
    config = Config(sources=("/dev/one",), protocol="fake", data=tmp_path)
    with InProcessServer(config, links.open) as running:
        send(running, links, "/dev/one", LOW)
        alarm = added(running)
        send(running, links, "/dev/one", HIGH)
        until_recording(running)
    with InProcessServer(config, links.open) as running:
        send(running, links, "/dev/one", HIGH)

        def status() -> str:
            states = running.client.get(f"/api/alarms/{alarm}").json()["states"]
            return str(states[0]["status"]) if states else ""

        block_until(lambda: status() == "raised", status)
        send(running, links, "/dev/one", LOW)
        block_until(lambda: status() == "ok", status)
        assert notices_of(running) == []
        assert recorder(running)["running"] is False


@each_row(
    "wrong", [{"before_s": -1}, {"longest_s": 0}, {"per_hour": 0}, {"per_hour": 61}, {"after_s": 3601}, {"other": 1}]
)
def test_what_is_out_of_bounds_is_refused(running: InProcessServer, wrong: dict[str, Any]) -> None:
    answer = running.client.post("/api/alarms", json={**FORCE, "recording": wrong})
    assert (answer.status_code, answer.json()["kind"]) == (422, "bad-request")


def arrivals(path: Path) -> list[int]:
    """Time of each chunk of the first device, ns."""
    results: list[int] = []
    with McapReader(path) as recording:
        for block in recording.blocks():
            channel = recording.topic("rx/1")
            if channel is not None:
                results += block.of(channel.id)[TIME].tolist()
    return results


def test_the_recording_of_a_simulator_has_the_bytes_before_the_crossing(server: ServerProcess) -> None:
    before_s, raise_s = 2.0, 0.2
    body = {
        "name": "Moves",
        "condition": {"kind": "expression", "expression": "norm(Acceleration) > 0.1 g"},
        "raise_s": raise_s,
        "recording": {"before_s": before_s, "after_s": 3600, "longest_s": 1},
    }
    with http_client(base_url=server.url) as client:

        def held_s() -> float:
            return sum(float(one["t1"] - one["t0"]) for one in client.get("/api/recorder/memory").json())

        block_until(lambda: held_s() > before_s + 1, held_s)
        assert client.post("/api/alarms", json=body).status_code == 201
        ids: list[str] = []

        def is_over() -> bool:
            state = client.get("/api/recorder").json()
            ids[:] = [state["id"]]
            return bool(state["id"]) and not state["running"]

        block_until(is_over, lambda: server.log)
        triggered = server.data / "recordings" / f"{ids[0]}.mcap"
        saved = client.post("/api/recordings/save-memory", json={}).json()
        memory = server.data / "recordings" / f"{saved['id']}.mcap"
        with McapReader(triggered) as recording:
            [crossed] = [time for time, note in json_messages(recording, "notes") if note["text"] == "Alarm “Moves”"]
        assert chunks(triggered, "rx/1") in chunks(memory, "rx/1")
        times = arrivals(triggered)
        assert crossed - before_s * 1e9 - 1e6 <= times[0] < crossed
        led_to_it = [one for one in arrivals(memory) if crossed - 1.5e9 < one < crossed]
        assert led_to_it
        assert led_to_it == [one for one in times if crossed - 1.5e9 < one < crossed]


async def test_the_markers_of_an_alarm_are_not_remembered_for_ever() -> None:
    """One time for each device that had ever raised it."""
    clock = ManualClock(0.0)
    running = SimpleNamespace(every=True, devices=[], writer=SimpleNamespace(path=Path("a.mcap")))
    recorder: Any = SimpleNamespace(current=running, now=clock, mark=lambda mark: None)
    trigger = RecordingTrigger(recorder)
    for number in range(100):
        stored, definition = SimpleNamespace(id="alarm"), SimpleNamespace(name="Force")
        instance: Any = SimpleNamespace(
            stored=stored, device=str(number), definition=definition, note=lambda *_, **__: 0
        )
        await trigger._act(instance, RecordingAction(), 0.0)
        clock.now += 5.0
    assert len(trigger._histories["alarm"].marked) <= 3
