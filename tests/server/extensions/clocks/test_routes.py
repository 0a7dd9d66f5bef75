"""The clocks of an opened recording over HTTP."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.recordings.recorded_drive import drive
from tests.support.in_process_server import InProcessServer, table_server
from tests.support.waiting import block_until

URL = "/api/recordings"
ROWS, CUT = 300, 200


@pytest.fixture
def running(tmp_path: Path) -> Iterator[InProcessServer]:
    times = 1.5e9 + np.arange(ROWS) / 100 - 2.0 * (np.arange(ROWS) >= CUT)
    rows = "\n".join(f"{t:.3f},{k}" for k, t in enumerate(times))
    with table_server(tmp_path, walk=f"time (s),gyr_x (rad/s)\n{rows}\n") as running:
        drive(tmp_path / "recordings" / "drive.mcap", seconds=1.0)
        statuses = lambda: [running.client.get(f"{URL}/{name}").status_code for name in ("walk", "drive")]  # noqa: E731
        block_until(lambda: statuses() == [200, 200], statuses, seconds=60)
        yield running


def test_clocks_have_figures_and_steps(running: InProcessServer) -> None:
    time = running.client.get(f"{URL}/walk/clocks").json()
    [message] = time["messages"]
    [clock] = message["clocks"]
    assert (clock["name"], clock["unit"], clock["epoch"], clock["is_axis"]) == ("time", "s", "1970", True)
    assert clock["rate_hz"] == pytest.approx(100)
    assert [(step["kind"], step["by_s"], step["row"]) for step in clock["steps"]] == [("back", -2.0, CUT + 1)]
    assert time["sure"] == "stated"
    assert any("time axis" in sentence for sentence in time["sentences"])
    assert time["start"] == 1.5e9


def test_clocks_of_a_device_are_compared_with_the_arrival(running: InProcessServer) -> None:
    time = running.client.get(f"{URL}/drive/clocks").json()
    assert (time["sentences"], time["sure"]) == ([], "")
    clocks = [clock for message in time["messages"] for clock in message["clocks"]]
    assert {clock["name"] for clock in clocks} >= {"time", "arrival"}
    assert all(clock["drift_ppm"] is None for clock in clocks if clock["is_axis"])


def test_an_unknown_recording_is_an_error(running: InProcessServer) -> None:
    assert running.client.get(f"{URL}/none/clocks").status_code == 404
