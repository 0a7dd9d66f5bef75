"""Objects of devices, links and recordings that are gone: a server that runs for weeks must not keep them."""

from __future__ import annotations

import gc
from pathlib import Path

from imuscope.server.config import Config
from imuscope.server.devices.session import Session
from tests.server.fakes import FakeLinks, sample
from tests.server.in_process_server import InProcessServer
from tests.server.recorder_harness import send


def kept(kind: type) -> int:
    """How many objects of a type there are."""
    gc.collect()
    return sum(type(one) is kind for one in gc.get_objects())


def test_a_recording_of_weeks_keeps_nothing_of_devices_that_were_removed(tmp_path: Path, links: FakeLinks) -> None:
    """Every session stayed in memory until the recording ended, and in the metadata of all of its later files."""
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), links.open) as running:
        recorder = running.services.recorder
        running.client.post("/api/recordings/start", json={})
        before = kept(Session)
        for number in range(5):
            source = f"/dev/more{number}"
            device = running.client.post("/api/devices", json={"source": source}).json()["id"]
            send(running, links, source, sample(1))
            assert running.client.delete(f"/api/devices/{device}").status_code == 204
            links.pop(source)
        assert kept(Session) == before
        assert len(running.call(lambda: recorder.current).recorded) == 6
        running.client.post("/api/recordings/stop", json={})
