"""Alarms of a server over HTTP: stored, evaluated on what a device sends, acknowledged, and reported everywhere."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from imuscope.server.extensions.alarms.alarm_file import UNREADABLE
from imuscope.server.extensions.alarms.service import MAX_ALARMS
from imuscope.server.extensions.alarms.settings import FILE
from imuscope.server.settings.config import Config
from tests.support.each_row import each_row
from tests.support.fakes import FakeLinks, sample
from tests.support.in_process_server import InProcessServer
from tests.support.recorder_harness import recorded
from tests.support.server_process import ServerProcess
from tests.support.timeouts import http_client
from tests.support.waiting import block_until

FORCE: dict[str, Any] = {"name": "Force", "condition": {"kind": "expression", "expression": "Force > 100 N"}}
links = FakeLinks()


def serving(data: Path) -> InProcessServer:
    return InProcessServer(Config(sources=("/dev/one",), protocol="fake", data=data), links.open)


@pytest.fixture
def running(tmp_path: Path) -> Iterator[InProcessServer]:
    with serving(tmp_path) as running:
        yield running


def send(running: InProcessServer, *forces: int) -> None:
    for count, force in enumerate(forces):
        running.call(links["/dev/one"].send, sample(count, force))


def added(running: InProcessServer, **changes: Any) -> str:
    answer = running.client.post("/api/alarms", json={**FORCE, **changes})
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


def state(running: InProcessServer, alarm: str) -> dict[str, Any]:
    states = running.client.get(f"/api/alarms/{alarm}").json()["states"]
    return states[0] if states else {}


def until_status(running: InProcessServer, alarm: str, status: str) -> dict[str, Any]:
    block_until(lambda: state(running, alarm).get("status") == status, lambda: state(running, alarm))
    return state(running, alarm)


def events(running: InProcessServer) -> list[Any]:
    return [one for one in running.call(lambda: list(running.services.telemetry.log)) if one.kind == "alarm"]


def changes(running: InProcessServer) -> list[str]:
    return [one.data["change"] for one in events(running)]


def test_an_alarm_is_raised_acknowledged_and_cleared_and_each_is_an_event(running: InProcessServer) -> None:
    alarm = added(running, condition={**FORCE["condition"], "clear": "50 N"})
    send(running, 10)
    assert until_status(running, alarm, "ok")["unit"] == "N"
    send(running, 150)
    results = until_status(running, alarm, "raised")
    assert (results["raised_value"], results["limit"], results["signals"]) == (150, 100, ["Force.x"])
    answer = running.client.post(f"/api/alarms/{alarm}/acknowledge", json={"by": " Ada  Lovelace "})
    assert answer.json()["states"][0]["acknowledged_by"] == "Ada Lovelace"
    send(running, 80)
    assert until_status(running, alarm, "acknowledged")["raised"]
    send(running, 20)
    results = until_status(running, alarm, "ok")
    assert [one["worst"] for one in results["intervals"]] == [150]
    assert changes(running) == ["added", "data", "raised", "acknowledged", "cleared"]
    raised = events(running)[2]
    assert raised.text == "Alarm “Force”: Force is 150 N, above 100 N."
    assert (raised.level, raised.device) == ("warning", "1")
    assert events(running)[-1].data["t0"] == pytest.approx(raised.time)
    again = running.client.post(f"/api/alarms/{alarm}/acknowledge", json={"by": "Ada"})
    assert (again.status_code, again.json()["kind"]) == (409, "not-now")


def test_missing_data_is_a_state_of_its_own(running: InProcessServer) -> None:
    alarm = added(running, missing_s=0.2)
    assert until_status(running, alarm, "missing")["raised"] is False
    send(running, 10)
    until_status(running, alarm, "missing")
    block_until(lambda: changes(running)[-2:] == ["data", "missing"], lambda: changes(running))


def test_an_alarm_survives_a_restart_with_its_state(tmp_path: Path) -> None:
    with serving(tmp_path) as running:
        alarm = added(running, level="error")
        send(running, 150)
        until_status(running, alarm, "raised")
        running.client.post(f"/api/alarms/{alarm}/acknowledge", json={"by": "Ada"})
    with serving(tmp_path) as running:
        result = until_status(running, alarm, "missing")
        assert result["raised"]
        assert result["acknowledged_by"] == "Ada"
        assert running.client.get(f"/api/alarms/{alarm}").json()["definition"]["level"] == "error"
        send(running, 120)
        assert until_status(running, alarm, "acknowledged")["raised_value"] == 150
        assert "raised" not in changes(running)


def test_a_file_that_cannot_be_read_is_set_aside(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text('{"imuscope": 1, "alarms": [{"id"')
    with serving(tmp_path) as running:
        assert running.client.get("/api/alarms").json() == []
        assert "cannot be read" in events(running)[0].text
        added(running)
    assert (tmp_path / (FILE + UNREADABLE)).read_text().startswith('{"imuscope": 1')
    assert len(json.loads((tmp_path / FILE).read_text())["alarms"]) == 1


def test_a_change_begins_again_and_a_deletion_ends_it(running: InProcessServer) -> None:
    alarm = added(running)
    send(running, 150)
    until_status(running, alarm, "raised")
    changed = {**FORCE, "condition": {"kind": "expression", "expression": "Force > 200 N"}}
    assert running.client.put(f"/api/alarms/{alarm}", json=changed).status_code == 200
    assert state(running, alarm)["raised"] is False
    send(running, 150)
    until_status(running, alarm, "ok")
    disabled = running.client.put(f"/api/alarms/{alarm}", json={**changed, "enabled": False}).json()
    assert disabled["states"] == []
    assert running.client.delete(f"/api/alarms/{alarm}").status_code == 204
    assert running.client.get(f"/api/alarms/{alarm}").status_code == 404
    results = [one for one in changes(running) if one not in ("data", "missing")]
    assert results == ["added", "raised", "cleared", "changed", "changed", "deleted"]


def test_an_alarm_is_for_the_devices_that_its_filter_fits(running: InProcessServer) -> None:
    send(running, 1)
    other = added(running, devices={"family": "xbus"})
    own = added(running, devices={"device": "/dev/one"})
    until_status(running, own, "missing")
    assert state(running, other) == {}


def test_a_flapping_alarm_does_not_flood_the_log(running: InProcessServer) -> None:
    alarm = added(running)
    send(running, *(150 if k % 2 else 10 for k in range(200)))
    block_until(lambda: state(running, alarm)["count"] == 100, lambda: state(running, alarm))
    assert len(changes(running)) <= 12
    send(running, 10)
    running.client.delete(f"/api/alarms/{alarm}")
    [summary] = [one for one in events(running) if one.data["change"] == "repeated"]
    assert summary.data["times"] == 100 - changes(running).count("raised")


def test_a_check_marks_the_mistake(running: InProcessServer) -> None:
    send(running, 1)
    block_until(lambda: running.services.telemetry.store.all, "no channel")

    def checked(text: str, **more: Any) -> dict[str, Any]:
        body = {**FORCE, "condition": {"kind": "expression", "expression": text, **more}}
        return dict(running.client.post("/api/alarms/check", json=body).json())

    assert checked("Force > 1 N") == {
        "valid": True,
        "message": "",
        "hint": "",
        "begin": None,
        "end": None,
        "notes": [],
        "devices": [running.services.telemetry.bus.devices.latest["1"].name],
    }
    result = checked("Force > 1 g")
    assert (result["valid"], result["begin"], result["end"]) == (False, 0, 11)
    result = checked("Fore > 1 N")
    assert (result["begin"], result["end"]) == (0, 4)
    refused = running.client.post("/api/alarms", json={**FORCE, "condition": {"kind": "expression", "expression": ")"}})
    assert (refused.status_code, refused.json()["kind"]) == (422, "bad-expression")
    assert running.client.get("/api/alarms").json() == []


@each_row(
    "wrong",
    [
        {"name": ""},
        {"raise_s": -1},
        {"level": "info"},
        {"condition": {"kind": "health", "figure": "speed", "limit": 1}},
        {"condition": {"kind": "health", "figure": "rate", "limit": -1}},
        {"unknown": 1},
    ],
)
def test_an_invalid_definition_is_refused(running: InProcessServer, wrong: dict[str, Any]) -> None:
    answer = running.client.post("/api/alarms", json={**FORCE, **wrong})
    assert (answer.status_code, answer.json()["kind"]) == (422, "bad-request")


def test_the_number_of_alarms_is_bounded(running: InProcessServer) -> None:
    for number in range(MAX_ALARMS):
        added(running, name=f"{number}")
    answer = running.client.post("/api/alarms", json=FORCE)
    assert (answer.status_code, answer.json()["kind"]) == (409, "full")


def test_silence_and_a_low_rate_are_conditions(running: InProcessServer) -> None:
    send(running, 1)
    silence = added(running, condition={"kind": "health", "figure": "silence", "limit": 0.3})
    rate = added(running, condition={"kind": "health", "figure": "rate", "limit": 50})
    link = added(running, condition={"kind": "health", "figure": "link"})
    assert until_status(running, silence, "raised")["unit"] == "s"
    assert until_status(running, rate, "raised")["limit"] == 50

    def is_ok_while_it_sends() -> bool:
        send(running, 1)
        return state(running, link).get("status") == "ok"

    block_until(is_ok_while_it_sends, lambda: state(running, link))


def test_metrics_state_what_is_raised(running: InProcessServer) -> None:
    alarm = added(running)
    send(running, 150)
    until_status(running, alarm, "raised")
    lines = running.client.get("/metrics").text.splitlines()
    assert f'imuscope_alarm_raised{{device="1",alarm="{alarm}",name="Force",level="warning"}} 1' in lines
    assert f'imuscope_alarm_raised_total{{device="1",alarm="{alarm}"}} 1' in lines
    assert f'imuscope_alarm_missing{{device="1",alarm="{alarm}"}} 0' in lines


def test_a_simulator_crosses_a_limit_while_no_page_is_open_and_a_recording_shows_it(server: ServerProcess) -> None:
    with http_client(base_url=server.url) as client:
        body = {
            "name": "Moves",
            "condition": {"kind": "expression", "expression": "norm(Acceleration) > 0.1 g"},
            "raise_s": 0.2,
            "devices": {"family": "xbus"},
            "latched": True,
        }
        assert client.post("/api/recordings/start", json={}).status_code == 200
        made = client.post("/api/alarms", json=body)
        assert made.status_code == 201, made.text

        def raised() -> Any:
            states = client.get(f"/api/alarms/{made.json()['id']}").json()["states"]
            return [one for one in states if one["status"] == "raised"]

        [result] = block_until(raised, "raised")
        assert result["raised_value"] > 0.1 * 9.80665
        assert result["unit"] == "m/s²"
        assert result["limit"] == pytest.approx(0.980665)
        assert client.post("/api/recordings/stop", json={}).status_code == 200
        address = f"/api/recordings/{recorded(server.data).stem}"
        detail = block_until(lambda: (body := client.get(address).json()).get("events") and body, "decoded")
        events = [one for one in detail["events"] if one["kind"] == "alarm" and one["data"]["change"] == "raised"]
        assert [one["data"]["value"] for one in events] == [result["raised_value"]]
        assert events[0]["text"].startswith("Alarm “Moves”: norm(Acceleration) is ")
