"""Choices on how a recording is read, over HTTP: first rows under given options, and the memory of headings."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from imuscope.server.settings.config import Config
from tests.recordings.recorded_drive import drive
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer, table_server
from tests.support.problems import assert_problem
from tests.support.waiting import block_until

URL = "/api/recordings"
FILE = {"content-type": "application/octet-stream"}
ROWS = 100
OPEN = "time,gyr_x (rad/s),gyr_y,gyr_z,note\n" + "".join(f"{n},{n}.5,0,1,{n}\n" for n in range(ROWS))
TWO = "time (s),TimeUS,gx\n" + "".join(f"{1.5e9 + n / 100:.2f},{n * 20_000},1\n" for n in range(ROWS))


@pytest.fixture
def running(tmp_path: Path) -> Iterator[InProcessServer]:
    with table_server(tmp_path) as running:
        yield running


def upload(running: InProcessServer, name: str, text: str) -> str:
    answer = running.client.put(f"{URL}/upload?name={name}", content=text.encode(), headers=FILE)
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


def lasts(running: InProcessServer, recording: str) -> float:
    """Length of a recording once it is decoded, s."""

    def state() -> Any:
        return running.client.get(f"{URL}/{recording}")

    block_until(lambda: state().status_code != 202, lambda: state().text, seconds=60)
    detail = state()
    assert detail.status_code == 200, detail.text
    return float(detail.json()["t1"] - detail.json()["t0"])


def test_an_open_table_is_queried_once_for_its_heading(running: InProcessServer) -> None:
    client = running.client
    first = upload(running, "first.csv", OPEN)
    waiting = upload(running, "waiting.csv", OPEN)
    state = client.get(f"{URL}/{first}/reading").json()
    assert (state["about"], state["is_table"], state["is_chosen"]) == ("unit", True, False)
    assert "can be s (1 Hz) or ms (1000 Hz)" in state["problem"]
    preview = client.post(f"{URL}/{first}/reading/preview", json={}).json()
    assert (preview["about"], preview["clock"], preview["times"][0]) == ("unit", "time", None)
    rates = {one["unit"]: one["rate"] for one in preview["units"] if one["is_plausible"]}
    assert rates == {"s": pytest.approx(1), "ms": pytest.approx(1000)}
    answer = client.post(f"{URL}/{first}/reading/preview", json={"unit": "ms"}).json()
    assert (answer["about"], answer["rate"], answer["unit"], answer["separator"]) == (
        "",
        pytest.approx(1000),
        "ms",
        ",",
    )
    assert answer["times"][2] - answer["times"][1] == pytest.approx(0.001, abs=1e-6)
    assert answer["rows"][1] == ["1", 1.5, 0.0, 1.0, 1.0]
    assert [(one["group"], one["axis"], one["unit"], one["role"]) for one in answer["columns"]] == [
        ("", "", "", "time"),
        ("gyr", "x", "rad/s", "value"),
        ("gyr", "y", "", "value"),
        ("gyr", "z", "", "value"),
        ("", "", "", "value"),
    ]
    state = client.put(f"{URL}/{first}/reading", json={"unit": "ms", "columns": {"5": ""}}).json()
    assert (state["about"], state["is_chosen"], state["reading"]["unit"]) == ("", True, "ms")
    assert lasts(running, first) == pytest.approx((ROWS - 1) / 1000)
    later = upload(running, "later.csv", OPEN)
    for name in (waiting, later):
        assert client.get(f"{URL}/{name}/reading").json()["is_chosen"]
        assert lasts(running, name) == pytest.approx((ROWS - 1) / 1000)
        channels = client.get(f"{URL}/{name}").json()["channels"]
        assert [channel["name"] for channel in channels] == ["gyr"]


def test_choices_are_changed_and_undone(running: InProcessServer) -> None:
    client = running.client
    name = upload(running, "log.csv", TWO)
    assert lasts(running, name) == pytest.approx((ROWS - 1) / 100)
    clocks = {one["name"]: one for one in client.get(f"{URL}/{name}/clocks").json()["messages"][0]["clocks"]}
    assert clocks["TimeUS"]["use"] == "TimeUS"
    assert client.put(f"{URL}/{name}/reading", json={"time_column": "TimeUS"}).status_code == 200
    assert lasts(running, name) == pytest.approx((ROWS - 1) / 50)
    time = client.get(f"{URL}/{name}/clocks").json()
    clocks = {one["name"]: one for one in time["messages"][0]["clocks"]}
    assert (clocks["TimeUS"]["is_axis"], clocks["time"]["use"]) == (True, "time (s)")
    assert (time["is_table"], time["is_chosen"], time["reading"]["time_column"]) == (True, True, "TimeUS")
    listed = lambda: next(one for one in client.get(URL).json() if one["id"] == name)  # noqa: E731
    block_until(lambda: listed()["duration"] == pytest.approx((ROWS - 1) / 50), listed)
    state = client.delete(f"{URL}/{name}/reading").json()
    assert (state["is_chosen"], state["reading"]["time_column"]) == (False, "")
    assert lasts(running, name) == pytest.approx((ROWS - 1) / 100)
    assert lasts(running, upload(running, "next.csv", TWO)) == pytest.approx((ROWS - 1) / 100)


def test_a_table_without_times_is_taken_and_queried(running: InProcessServer) -> None:
    rows = "".join(f"{(n * 7) % 11} {(n * 5) % 13}\n" for n in range(ROWS))
    name = upload(running, "plain.txt", rows)
    assert running.client.get(f"{URL}/{name}/reading").json()["about"] == "time"
    preview = running.client.post(f"{URL}/{name}/reading/preview", json={}).json()
    assert (preview["separator"], preview["rows"][1], preview["clock"]) == (" ", [7.0, 5.0], "")
    body = {"time_column": "none", "rate": 50}
    assert running.client.put(f"{URL}/{name}/reading", json=body).status_code == 200
    assert lasts(running, name) == pytest.approx((ROWS - 1) / 50)


def test_the_arrival_of_a_device_is_chosen(running: InProcessServer, tmp_path: Path) -> None:
    client = running.client
    drive(tmp_path / "recordings" / "drive.mcap", seconds=1.0)
    lasts(running, "drive")

    def axis() -> str:
        clocks = client.get(f"{URL}/drive/clocks").json()["messages"][0]["clocks"]
        return str(next(one["name"] for one in clocks if one["is_axis"]))

    assert axis() == "time"
    assert client.put(f"{URL}/drive/reading", json={"clock": "arrival"}).status_code == 200
    assert axis() == "arrival"
    assert client.delete(f"{URL}/drive/reading").status_code == 200
    assert axis() == "time"
    assert_problem(client.put(f"{URL}/drive/reading", json={"unit": "ms"}), 422, "bad-request")
    assert_problem(client.post(f"{URL}/drive/reading/preview", json={}), 422, "bad-request")


@each_row(
    ("method", "place", "body", "status", "kind"),
    [
        ("GET", "none/reading", None, 404, "not-found"),
        ("PUT", "none/reading", {}, 404, "not-found"),
        ("PUT", "log/reading", {"unit": "years"}, 422, "bad-request"),
        ("PUT", "log/reading", {"time_column": "sun"}, 422, "cannot-open"),
        ("PUT", "log/reading", {"rate": 1}, 422, "cannot-open"),
        ("POST", "log/reading/preview", {"time_column": "sun"}, 422, "cannot-open"),
    ],
)
def test_impossible_choices_are_refused(
    method: str, place: str, body: dict[str, Any] | None, status: int, kind: str, tmp_path: Path
) -> None:
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "log.csv").write_text(TWO)
    with InProcessServer(Config(data=tmp_path, sources=("/dev/one",)), FakeLink) as running:
        assert_problem(running.client.request(method, f"{URL}/{place}", json=body), status, kind)
