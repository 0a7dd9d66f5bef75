"""The clocks of live devices over HTTP, over what is in memory."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.recordings.sources import SourceDevice
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.devices.link.byte_memory import ByteRun
from imuscope.server.extensions.clocks.live_time import MemorySource, write_memory
from imuscope.server.links.source_url import open_link
from imuscope.server.settings.config import Config
from tests.support.in_process_server import InProcessServer
from tests.support.waiting import block_until

BURSTY = "sim:xbus?rate=400&burst_ms=16&packet=0&drift_ppm=80"  # six samples each 16 ms


@pytest.fixture
def running(tmp_path: Path) -> Iterator[InProcessServer]:
    sources = (BURSTY, "sim:idtp")
    with InProcessServer(Config(data=tmp_path, sources=sources), open_link, all_protocols()) as running:
        running.client.timeout = 60
        yield running


def _samples(running: InProcessServer) -> dict[str, int]:
    """Newest number of a sample of each device."""
    totals = {"1": 0, "2": 0}
    for channel in running.services.telemetry.store.all:
        totals[channel.info.device] = max(totals[channel.info.device], channel.ring.total)
    return totals


def _by_name(message: Any) -> dict[str, Any]:
    return {clock["name"]: clock for clock in message["clocks"]}


def test_bursts_of_an_adapter_are_measured(running: InProcessServer) -> None:
    block_until(lambda: min(_samples(running).values()) > 300, lambda: _samples(running))
    time = running.client.get("/api/devices/1/clocks").json()
    assert time["end"] > time["start"]
    [message] = time["messages"]
    clocks = _by_name(message)
    assert clocks["time"]["is_axis"]
    arrival, device = clocks["arrival"], clocks["SampleTimeFine"]
    assert arrival["bursts"] == pytest.approx(1 - 1 / 6.4, abs=0.15)
    assert arrival["burst_samples"] > 3
    assert any("at once" in sentence for sentence in time["sentences"])
    assert "pieces" in time["sentences"][0]
    assert device["unit"] == "100 µs"
    assert device["drift_ppm"] is not None
    assert device["jitter_s"] < arrival["jitter_s"]
    assert arrival["difference"]["times"]
    [other, *_] = running.client.get("/api/devices/2/clocks").json()["messages"]
    assert {"time", "arrival", "timestamp"} <= _by_name(other).keys()


def test_a_device_that_is_not_there_is_an_error(running: InProcessServer) -> None:
    assert running.client.get("/api/devices/9/clocks").status_code == 404


def test_without_bytes_in_memory_there_are_no_clocks(tmp_path: Path) -> None:
    with InProcessServer(Config(data=tmp_path, sources=("/dev/none",)), open_link, all_protocols()) as running:
        answer = running.client.get("/api/devices/1/clocks")
        assert (answer.status_code, answer.json()["kind"]) == (404, "not-found")


def test_the_bytes_in_memory_are_read_as_they_arrived(tmp_path: Path) -> None:
    runs = [
        ByteRun("rx", b"abcd", np.array([1, 4], np.int32), np.array([10, 20])),
        ByteRun("tx", b"zz", np.array([2], np.int32), np.array([15])),
        ByteRun("rx", b"efg", np.array([3], np.int32), np.array([30])),
    ]
    assert write_memory(tmp_path / "a.npz", runs, b"head")
    source = MemorySource(tmp_path / "a.npz", SourceDevice("1"))
    [part] = source.parts()
    assert (part.data, part.ends.tolist(), part.times.tolist()) == (b"headabcdefg", [5, 8, 11], [10, 20, 30])
    assert part.done == 1.0
    assert not write_memory(tmp_path / "b.npz", runs[1:2], b"head")
