"""Configuration over HTTP and the WebSocket, as the page does it: real server, two simulators, several users."""

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import pytest
from httpx import Client

from imuscope.server.wire import SUBPROTOCOL
from tests.support.control_harness import at_rate, outputs
from tests.support.each_row import each_row
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, connect, http_client
from tests.support.waiting import block_until

VIEW, CONTROL = "only-looking", "may-command"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    data = tmp_path_factory.mktemp("data")
    config = data / "imuscope.toml"
    config.write_text(f'rollback_s = 1.0\nview_token = "{VIEW}"\ncontrol_token = "{CONTROL}"\n')
    sources = (*(f"sim:xbus?seed={seed}&rate=10" for seed in (1, 2)), "sim:isb?rate=10", "sim:idtp?rate=10")
    with ServerProcess(*sources, data=data, arguments=("--config", str(config))) as process:
        with http_client(base_url=process.url) as http:
            until(lambda: [one["status"] for one in http.get("/api/devices").json()] == ["live"] * 4, http)
        yield process


@pytest.fixture
def http(server: ServerProcess) -> Iterator[Client]:
    with http_client(base_url=server.url) as client:
        yield client


def until(condition: Callable[[], object], http: Client) -> Any:
    return block_until(condition, lambda: http.get("/api/devices/1/jobs").text)


def done(http: Client, answer: Any, device: int = 1) -> Any:
    """The job that a route answered with, when it is over."""
    assert answer.status_code == 202, answer.text
    number = answer.json()["id"]

    def result() -> Any:
        control = http.get(f"/api/devices/{device}/jobs").json()
        return next((job for job in control["done"] if job["id"] == number), None)

    return until(result, http)


def post(http: Client, path: str, body: Any, device: int = 1) -> Any:
    return http.post(f"/api/devices/{device}/{path}", json=body)


def read(http: Client, device: int = 1) -> Any:
    done(http, post(http, "read", {}, device), device)
    return http.get(f"/api/devices/{device}/values").json()["values"]


def sent(http: Client, since: int = 0) -> list[str]:
    """Requests to device 1, in order; of what is sent again and again one."""
    log = http.get("/api/devices/1/traffic?limit=2000").json()
    return [entry["name"] for entry in log if entry["direction"] == "tx" and entry["seq"] > since]


def newest(http: Client) -> int:
    return max((entry["seq"] for entry in http.get("/api/devices/1/traffic?limit=1").json()), default=0)


def command(http: Client, name: str, values: dict[str, Any], **more: Any) -> Any:
    job = done(http, post(http, "run", {"command": name, "values": values, **more}))
    assert job["state"] == "done", job
    return job


def test_an_orientation_reset_is_stored_with_nothing_between(http: Client) -> None:
    """Taking a snapshot before the second command made the device measure again, which discards the reset."""
    before = read(http)["AlignmentRotation.RotLocal"]
    since = newest(http)
    command(http, "ResetOrientation", {"code": 4}, confirmed=True)
    assert "not stored" in http.get("/api/devices/1/jobs").json()["unfinished"]
    command(http, "ResetOrientation", {"code": 0}, confirmed=True)
    frames = sent(http, since)
    assert frames[:4] == ["ResetOrientation", "GoToConfig", "ResetOrientation", "GoToMeasurement"]
    assert {"ReqAlignmentRotation"} == {name for name in frames[4:] if "Rotation" in name or "Orientation" in name}
    body = http.get("/api/devices/1/values").json()
    assert body["ports"] == ["PortConfig.words.0", "PortConfig.words.1"], "both have the rate of the link"
    stored = body["values"]["AlignmentRotation.RotLocal"]
    assert stored != before, "the form has the new one without being asked"
    assert http.get("/api/devices/1/jobs").json()["unfinished"] == ""
    assert read(http)["AlignmentRotation.RotLocal"] != before
    command(http, "ResetOrientation.Stored", {"code": 7}, confirmed=True)
    assert read(http)["AlignmentRotation.RotLocal"] == before


@each_row(
    ("path", "body"),
    [
        ("read", {}),
        ("apply", {"changes": {"LocationID": {"location_id": 0}}}),
        ("run", {"command": "SetLocationID", "values": {"location_id": 0}}),
        ("run", {"command": "ReqDID", "values": {}}),
    ],
)
def test_what_would_discard_an_orientation_reset_needs_confirmation_first(
    http: Client, path: str, body: dict[str, Any]
) -> None:
    read(http)
    command(http, "ResetOrientation", {"code": 3}, confirmed=True)
    answer = post(http, path, body)
    assert (answer.status_code, answer.json()["kind"]) == (409, "confirm")
    assert "discarded" in answer.json()["message"]
    assert done(http, post(http, path, {**body, "confirmed": True}))["state"] == "done"
    until(lambda: http.get("/api/devices/1/jobs").json()["unfinished"] == "", http)


def test_a_baud_rate_of_the_600_series_is_written_as_its_port_on_trial(http: Client) -> None:
    """It was confirmed, took effect by the next reset, and the device was lost."""
    read(http)
    body = {"command": "SetBaudrate", "values": {"baudrate_code": 0x80}}
    answer = post(http, "run", body)
    assert (answer.status_code, answer.json()["kind"]) == (409, "confirm")
    job = done(http, post(http, "run", {**body, "confirmed": True}))
    assert "not confirmed in time" in job["message"]
    assert http.get("/api/devices/1/jobs").json()["pending_rollback"]["state"] == "rolled-back"
    assert "SetBaudrate" not in sent(http)


def test_a_compass_calibration_is_not_interrupted_and_a_query_is_harmless(http: Client) -> None:
    """Reading everything before each command ended the motion between its start and its stop."""
    read(http)
    since = newest(http)
    command(http, "IccCommand", {"command": 0})
    assert command(http, "IccCommand", {"command": 3})["values"] == {"command": 3, "representative_motion_active": 1}
    result = command(http, "IccCommand", {"command": 1})["values"]
    assert result["status"] == 0
    assert post(http, "run", {"command": "IccCommand", "values": {"command": 2}}).status_code == 409
    command(http, "IccCommand", {"command": 2}, confirmed=True)
    assert sent(http, since) == ["IccCommand"] * 3 + ["GoToConfig", "IccCommand", "GoToMeasurement"]


def test_present_values_preview_without_a_problem(http: Client) -> None:
    values = read(http)
    forms = {row["name"]: row for row in http.get("/api/devices/1/forms").json()["settings"]}
    for name, fields in values.items():
        if forms[name]["writable"] and name != "CanOutputConfig":  # nothing to send on CAN cannot be written
            shown = post(http, "preview", {"setting": name, "values": fields}).json()
            assert shown["problems"] == [], (name, shown)
            frame = shown["frames"][0]
            covered = [(span["offset"], span["offset"] + span["size"]) for span in frame["spans"]]
            assert covered[0][0] == 0
            assert covered[-1][1] == len(frame["hex"]) // 2
            assert all(end == start for (_, end), (start, _) in pairwise(covered))


def test_the_load_is_shown_before_anything_is_sent(http: Client) -> None:
    shown = post(http, "preview", {"setting": "OutputConfiguration", "values": outputs(400)}).json()
    load = shown["load"]
    # 400 messages/s of header 4, counter 5, time 7, quaternion 19, acceleration 15, checksum 1
    assert load["total"] == 400 * (4 + 5 + 7 + 19 + 15 + 1)
    assert (load["baud"], load["capacity"]) == (115_200, 11_520)
    fitted = post(http, "fit-rates", {"setting": "OutputConfiguration", "values": outputs(400)}).json()
    assert fitted["load"]["total"] <= 11_520
    assert any(words.startswith("Quaternion 400 Hz → ") for words in fitted["words"])
    again = post(http, "preview", {"setting": "OutputConfiguration", "values": fitted["values"]}).json()
    assert again["load"]["total"] == fitted["load"]["total"]


def test_a_wrong_value_is_reported_at_its_field(http: Client) -> None:
    wrong = {"outputs": [{"data_identifier": 0x2010, "output_frequency": -1}]}
    shown = post(http, "preview", {"setting": "OutputConfiguration", "values": wrong}).json()
    assert [problem["path"] for problem in shown["problems"]] == ["outputs.0.output_frequency"]
    assert shown["frames"] == []
    answer = post(http, "apply", {"changes": {"OutputConfiguration": wrong}})
    assert (answer.status_code, answer.json()["kind"]) == (422, "bad-value")


def test_the_same_profile_goes_to_two_devices(http: Client) -> None:
    """And is put back from the snapshot that was taken before: exactly what was there."""
    before = [read(http, 1), read(http, 2)]
    changes = {"OutputConfiguration": outputs(50), "LocationID": {"location_id": 42}}
    body = {"changes": changes, "devices": ["2"], "reason": "new mast"}
    question = post(http, "apply", body)
    assert (question.status_code, question.json()["kind"]) == (409, "confirm")
    assert "written to 2 devices: MTi-630 0080800002, MTi-630 0080800003." in question.json()["message"]
    job = done(http, post(http, "apply", {**body, "confirmed": True}))
    assert (job["state"], job["outcomes"]) == ("done", [])
    until(lambda: http.get("/api/devices/2/jobs").json()["running"] is None, http)
    for device, old in ((1, before[0]), (2, before[1])):
        now = read(http, device)
        assert {name: now[name] for name in changes} == changes
        answer = http.get(f"/api/devices/{device}/snapshots").json()
        name = next(one["name"] for one in answer if one["reason"] == "new mast")
        sides = {"left": {"side": "device"}, "right": {"side": "snapshot", "snapshot": name}}
        difference = post(http, "compare", sides, device).json()
        assert set(difference["changes"]) == set(changes)
        assert difference["changes"]["LocationID"] == old["LocationID"]
        assert done(http, post(http, "apply", {"changes": difference["changes"]}, device), device)["state"] == "done"
        assert read(http, device) == old


def test_every_way_of_writing_checks_budget_product_and_family(http: Client) -> None:
    """A profile was once written as it was, to any product, filling the line more than twice."""
    read(http, 1)
    over = {"OutputConfiguration": outputs(400, 0x2010, 0x4020, 0x8020, 0xC020)}
    answer = post(http, "apply", {"changes": over, "confirmed": True})
    assert (answer.status_code, answer.json()["kind"]) == (422, "too-much")
    command = {"command": "SetOutputConfiguration", "values": over["OutputConfiguration"], "confirmed": True}
    assert post(http, "run", command).json()["kind"] == "too-much"
    changes = {"LocationID": {"location_id": 42}}
    answer = post(http, "apply", {"changes": changes, "product": "MTi-300-2A8G4"})
    assert (answer.status_code, answer.json()["kind"]) == (409, "confirm")
    assert "MTi-300" in answer.json()["message"]
    text = "imuscope: 1\nprotocol: isb\nsettings: {}\n"
    answer = post(http, "compare", {"left": {"side": "device"}, "right": {"side": "text", "text": text}})
    assert (answer.status_code, answer.json()["kind"]) == (422, "bad-snapshot")


def test_a_snapshot_of_one_device_is_compared_with_another(http: Client) -> None:
    read(http, 1)
    read(http, 2)
    name = http.get("/api/devices/1/snapshots").json()[-1]["name"]
    right = {"side": "snapshot", "snapshot": name, "device": "1"}
    answer = post(http, "compare", {"left": {"side": "device"}, "right": right}, 2).json()
    assert answer["product"].startswith("MTi-630")
    assert set(answer["changes"]) <= set(answer["profile"])
    assert (answer["blocked"], answer["problems"]) == ("", [])


def test_a_snapshot_is_a_file_that_can_be_sent_and_compared(http: Client) -> None:
    read(http)
    stored = post(http, "snapshots", {"title": "New mast fitted"}).json()
    answer = http.get(f"/api/devices/1/snapshots/{stored['name']}")
    assert answer.headers["content-type"].startswith("application/yaml")
    text = answer.text
    sides = {"left": {"side": "device"}, "right": {"side": "text", "text": text}}
    difference = post(http, "compare", sides).json()
    assert (difference["rows"], difference["changes"]) == ([], {})
    assert difference["same"] > 20
    sent = post(http, "snapshots", {"title": "From rover-06", "text": text}, 2).json()
    assert (sent["title"], sent["pinned"]) == ("From rover-06", True)
    body = http.get(f"/api/devices/2/snapshots/{sent['name']}?format=json").json()
    assert body["values"]["LocationID"] == {"location_id": 0}
    assert http.delete(f"/api/devices/2/snapshots/{sent['name']}").status_code == 204
    assert http.get(f"/api/devices/2/snapshots/{sent['name']}").status_code == 404
    for name in ("..%2F..%2Fimuscope", "%2e%2e"):
        assert http.get(f"/api/devices/1/snapshots/{name}").status_code == 404
    answer = post(http, "snapshots", {"title": "x", "text": "imuscope: 1\nsettings: [1]"})
    assert (answer.status_code, answer.json()["kind"]) == (422, "bad-snapshot")


def test_the_factory_and_another_device_are_sides_too(http: Client) -> None:
    read(http, 1), read(http, 2)
    reply = post(http, "compare", {"left": {"side": "device"}, "right": {"side": "factory"}}).json()
    assert ("Acceleration", "10 Hz", "off") in [(one["title"], one["left"], one["right"]) for one in reply["rows"]]
    reply = post(http, "compare", {"left": {"side": "device"}, "right": {"side": "other", "device": "2"}}).json()
    assert "DeviceID" in [one["setting"] for one in reply["rows"]]
    answer = post(http, "compare", {"left": {"side": "device"}, "right": {"side": "other", "device": "3"}})
    assert (answer.status_code, answer.json()["kind"]) == (409, "not-alike")


def test_harmful_changes_need_confirmation_in_words(http: Client) -> None:
    answer = post(http, "run", {"command": "RestoreFactoryDef"})
    assert (answer.status_code, answer.json()["kind"]) == (409, "confirm")
    assert "All settings" in answer.json()["message"]
    answer = post(http, "raw", {"hex": "fa ff 30 00 d1"})
    assert (answer.status_code, answer.json()["kind"]) == (409, "confirm")
    ports = at_rate(read(http)["PortConfig"], 0x80)
    answer = post(http, "apply", {"changes": {"PortConfig": ports}})
    assert answer.status_code == 409
    assert "921 600 Bd" in answer.json()["message"]


def test_raw_bytes_are_named_before_they_are_sent(http: Client) -> None:
    """Whatever was typed, the question was the same; two messages in one could hide the second."""
    request, restore = "faff000001", "faff0e00f3"
    assert post(http, "raw", {"hex": request}).status_code == 202
    answer = post(http, "raw", {"hex": restore}).json()
    assert answer["kind"] == "confirm"
    assert answer["message"].startswith("RestoreFactoryDef: ")
    both = post(http, "raw", {"hex": request + restore}).json()["message"]
    assert "ReqDID: " in both
    assert "RestoreFactoryDef: " in both
    for odd in (request + "00", request[:-2] + "02", "00"):
        assert "not a known message" in post(http, "raw", {"hex": odd}).json()["message"]


def test_a_command_is_answered_and_raw_bytes_are_seen(http: Client) -> None:
    job = done(http, post(http, "run", {"command": "ReqFWRev"}))
    assert (job["state"], job["values"]["major"]) == ("done", 1)
    done(http, post(http, "raw", {"hex": "faff1000f1", "confirmed": True}))
    log = http.get("/api/devices/1/traffic?limit=20").json()
    assert ("tx", "GoToMeasurement") in [(one["direction"], one["name"]) for one in log]
    newest = log[-1]["seq"]
    older = http.get(f"/api/devices/1/traffic?before={newest}&limit=5").json()
    assert [one["seq"] < newest for one in older] == [True] * 5
    assert post(http, "raw", {"hex": "xy", "confirmed": True}).status_code == 422


def test_all_clients_are_notified_of_changes(http: Client, server: ServerProcess) -> None:
    """Two browsers see the job of one and its frames in order; a later browser gets the finished job."""

    def ops(socket: Any, enough: Callable[[list[Any]], bool]) -> list[Any]:
        results: list[Any] = []
        while not enough(results):
            message = json.loads(socket.recv(timeout=PATIENCE_S))
            if message["op"] in ("jobs", "traffic"):
                results.append(message)
        return results

    def first(message: Any) -> Any:
        return next(one for one in message["devices"] if one["device"] == "1")

    def requests(results: list[Any]) -> list[str]:
        entries = [entry for message in results for entry in message.get("entries", ())]
        return [entry["name"] for entry in entries if entry["direction"] == "tx"]

    def is_over(results: list[Any]) -> bool:
        """A short job may end before its first message is sent, so that no message reports it as running."""
        states = [first(one) for one in results if one["op"] == "jobs"]
        is_done = any(job["id"] > earlier for one in states for job in one["done"])
        return is_done and states[-1]["running"] is None and not states[-1]["queue"] and len(requests(results)) >= 3

    earlier = max((job["id"] for job in http.get("/api/devices/1/jobs").json()["done"]), default=0)
    ws = server.url.replace("http", "ws", 1) + "/ws"
    with (
        connect(ws, subprotocols=[SUBPROTOCOL]) as one,
        connect(ws, subprotocols=[SUBPROTOCOL]) as other,
        ThreadPoolExecutor(2) as pool,
    ):
        observed = [pool.submit(ops, socket, is_over) for socket in (one, other)]
        done(http, post(http, "run", {"command": "ReqFWRev"}))
        for future in observed:
            assert requests(future.result(PATIENCE_S))[:4] == ["ReqDID", "GoToConfig", "ReqFWRev", "GoToMeasurement"]
    with connect(ws, subprotocols=[SUBPROTOCOL]) as late:
        report = ops(late, lambda results: len(results) == 1)[0]
        assert first(report)["done"][0]["title"]


def test_two_users_at_once_and_an_unconfirmed_change(http: Client, server: ServerProcess) -> None:
    """The browser that changed the rate has disconnected; the request of another user waits for the rollback."""
    ports = at_rate(read(http)["PortConfig"], 0x80)
    with http_client(base_url=server.url) as gone:
        assert post(gone, "apply", {"changes": {"PortConfig": ports}, "confirmed": True}).status_code == 202
    waits = post(http, "run", {"command": "ReqFWRev"})
    until(lambda: (http.get("/api/devices/1/jobs").json()["pending_rollback"] or {}).get("state") == "pending", http)
    control = http.get("/api/devices/1/jobs").json()
    assert [job["id"] for job in control["queue"]] == [waits.json()["id"]]
    assert http.delete(f"/api/devices/1/jobs/{control['running']['id']}").status_code == 409
    job = done(http, waits)
    assert job["values"]["major"] == 1
    control = http.get("/api/devices/1/jobs").json()
    assert control["pending_rollback"]["state"] == "rolled-back"
    assert http.get("/api/devices").json()[0]["baud"] == 115_200


def test_what_viewers_may_request_sends_nothing(server: ServerProcess) -> None:
    with http_client(base_url=server.url, headers={"authorization": f"Bearer {VIEW}"}) as viewer:
        before = viewer.get("/api/devices/1/traffic").json()
        assert post(viewer, "preview", {"command": "Reset", "values": {}}).json()["frames"][0]["hex"] == "faff4000c1"
        assert post(viewer, "fit-rates", {"setting": "OutputConfiguration", "values": outputs(400)}).status_code == 200
        assert post(viewer, "compare", {"left": {"side": "factory"}, "right": {"side": "factory"}}).json()["rows"] == []
        assert viewer.get("/api/devices/1/traffic").json() == before, "looking sends nothing"
        assert viewer.get("/api/build").json()["role"] == "view"


@each_row("path", ["forms", "jobs", "traffic", "snapshots", "values"])
def test_a_missing_device_is_reported(http: Client, path: str) -> None:
    answer = http.get(f"/api/devices/99/{path}")
    assert (answer.status_code, answer.json()["kind"]) == (404, "not-found")


def test_missing_names_are_reported(http: Client) -> None:
    assert post(http, "run", {"command": "Nonsense"}).status_code == 404
    assert post(http, "apply", {"changes": {"Nonsense": {}}}).status_code == 404
    assert post(http, "apply", {"changes": {"ProductCode": {"product_code": "x"}}}).status_code == 404
    assert post(http, "apply", {"changes": {}}).status_code == 422
    for seconds in (0, 601):
        refused = post(http, "apply", {"changes": {"LocationID": {"location_id": 7}}, "confirm_s": seconds})
        assert refused.json()["message"] == f"confirm_s: {seconds} s cannot be the time to confirm."
    assert post(http, "confirm", {}).json()["kind"] == "not-now"
    assert post(http, "read", {}, 4).json()["kind"] == "no-settings"
