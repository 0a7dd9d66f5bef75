"""/metrics, read by the official Prometheus parser, agrees with events."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from prometheus_client import Metric
from prometheus_client.parser import text_string_to_metric_families
from websockets.typing import Subprotocol

from imuscope.server.settings.config import Config
from imuscope.server.text.prometheus import Histogram, PrometheusText
from imuscope.server.version import VERSION
from imuscope.server.wire import SUBPROTOCOL
from tests.support.fakes import FakeLinks, sample
from tests.support.in_process_server import InProcessServer
from tests.support.timeouts import PATIENCE_S, connect
from tests.support.waiting import block_until

links = FakeLinks()


@pytest.fixture
def running(tmp_path: Path) -> Iterator[InProcessServer]:
    with InProcessServer(Config(sources=("/dev/one",), protocol="fake", data=tmp_path), links.open) as running:
        yield running


def read(running: InProcessServer) -> dict[str, Metric]:
    answer = running.client.get("/metrics")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    families = list(text_string_to_metric_families(answer.text))
    names = [family.name for family in families]
    assert len(set(names)) == len(names), "a family stands in one piece"
    return {family.name: family for family in families}


def value(families: dict[str, Metric], name: str, **labels: str) -> float | None:
    """Value of the sample with this name and these labels; None if there is none."""
    results = [
        one.value
        for family in families.values()
        for one in family.samples
        if one.name == name and labels.items() <= one.labels.items()
    ]
    assert len(results) <= 1, f"{name} {labels} is not one sample"
    return results[0] if results else None


def until(running: InProcessServer, name: str, expected: float, **labels: str) -> dict[str, Metric]:
    """The figures, as soon as one has reached a value."""
    return until_true(running, lambda families: value(families, name, **labels) == expected, f"{name} {labels}")


def until_true(running: InProcessServer, done: Callable[[dict[str, Metric]], bool], what: str) -> dict[str, Metric]:
    block_until(lambda: done(read(running)), lambda: f"{what}: {read(running)}")
    return read(running)


def test_link_metrics_follow_the_received_bytes(running: InProcessServer) -> None:
    data = sample(1) + sample(2) + b"???" + sample(3) + sample(7)
    running.call(links["/dev/one"].send, data)
    families = until(running, "imuscope_link_frames_total", 4, device="1", message="Sample")
    assert value(families, "imuscope_link_received_bytes_total", device="1") == len(data)
    assert value(families, "imuscope_link_rejects_total", device="1", reason="bad_checksum") == 3
    assert value(families, "imuscope_link_gaps_total", device="1") == 1
    assert value(families, "imuscope_link_lost_samples_total", device="1") == 3
    assert value(families, "imuscope_link_capacity_bytes_per_second", device="1") == 11_520
    count = value(families, "imuscope_link_latency_seconds_count", device="1")
    assert count is not None
    assert count >= 1
    assert value(families, "imuscope_link_latency_seconds_bucket", device="1", le="+Inf") == count
    assert value(families, "imuscope_device_state", device="1", state="live") == 1
    assert value(families, "imuscope_device_state", device="1", state="lost") == 0
    assert value(families, "imuscope_device_info", device="1", source="/dev/one", link="serial") == 1
    assert value(families, "imuscope_events_total", kind="gap", level="fault") == 1


def test_client_metrics_count_sent_bytes(running: InProcessServer) -> None:
    assert value(read(running), "imuscope_clients") == 0
    with connect(running.ws, subprotocols=[Subprotocol(SUBPROTOCOL)]) as socket:
        socket.send(json.dumps({"op": "subscribe", "history": 0}))
        running.call(links["/dev/one"].send, sample(1))
        got = 0
        while True:
            message = socket.recv(PATIENCE_S)
            got += len(message)
            if isinstance(message, bytes):
                break
        families = until_true(
            running,
            lambda families: (value(families, "imuscope_client_sent_bytes_total", client="1") or 0) >= got,
            "what was sent",
        )
        assert value(families, "imuscope_clients") == 1
        assert value(families, "imuscope_client_dropped_samples_total", client="1") == 0
        assert value(families, "imuscope_client_waiting_bytes", client="1") == 0
        lag = value(families, "imuscope_client_lag_seconds", client="1")
        assert lag is not None
        assert 0 <= lag < 30
    families = until(running, "imuscope_clients", 0)
    assert value(families, "imuscope_client_sent_bytes_total", client="1") is None
    assert (value(families, "imuscope_sent_bytes_total") or 0) >= got, "what was sent stays counted"
    assert value(families, "imuscope_clients_connected_total") == 1


def test_recording_and_process(running: InProcessServer) -> None:
    families = read(running)
    assert value(families, "imuscope_recording_running") == 0
    assert value(families, "imuscope_recording_bytes") is None
    assert (value(families, "imuscope_data_free_bytes") or 0) > 0
    assert value(families, "imuscope_build_info", version=VERSION) == 1
    assert (value(families, "imuscope_uptime_seconds") or 0) > 0
    assert (value(families, "process_cpu_seconds_total") or 0) > 0
    assert (value(families, "process_resident_memory_bytes") or 0) > 1e6
    assert abs((value(families, "process_start_time_seconds") or 0) - time.time()) < 86_400
    assert running.client.post("/api/recordings/start", json={}).status_code < 300
    families = until(running, "imuscope_recording_running", 1)
    assert (value(families, "imuscope_recording_bytes") or 0) > 0
    assert value(families, "imuscope_recording_lag_seconds") is not None
    assert running.client.post("/api/recordings/stop").status_code < 300
    families = until(running, "imuscope_recording_running", 0)
    assert value(families, "imuscope_recording_failed") == 0


def test_names_follow_the_conventions(running: InProcessServer) -> None:
    running.call(links["/dev/one"].send, sample(1))
    until(running, "imuscope_link_frames_total", 1, device="1")
    text = running.client.get("/metrics").text
    kinds = dict(re.findall(r"^# TYPE (\S+) (\S+)$", text, re.MULTILINE))
    helps = set(re.findall(r"^# HELP (\S+) \S", text, re.MULTILINE))
    assert helps == set(kinds)
    for name, kind in kinds.items():
        assert re.fullmatch(r"(imuscope|process)_[a-z_]+", name)
        assert name.endswith("_total") == (kind == "counter"), name
        assert not re.search(r"_(ms|us|ns|kb|mb|ppm|percent|s)(_|$)", name), f"{name} has no base unit"


def test_the_text_form() -> None:
    """Cases that are difficult to produce through the server: characters to escape, values that are not numbers."""
    page = PrometheusText()
    page.family("empty", "gauge", "never seen")
    page.family("odd", "gauge", "a \\ and\na second line").add(float("nan"), what='a "b" \\ c\nd')
    page.add(None, what="unknown")
    page.add(float("inf"), what="e")
    took = Histogram((0.1, 1.0))
    for seconds in (0.05, 0.1, 0.5, 7.0):
        took.add(seconds)
    page.family("took_seconds", "histogram", "how long").histogram(took, device="1")
    odd, seconds = text_string_to_metric_families(str(page))
    assert odd.documentation == "a \\ and\na second line"
    assert [one.labels["what"] for one in odd.samples] == ['a "b" \\ c\nd', "e"]
    assert odd.samples[0].value != odd.samples[0].value
    assert [one.value for one in seconds.samples] == [2, 3, 4, pytest.approx(7.65), 4]
