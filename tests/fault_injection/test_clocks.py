"""Clock jumps of the device and of the host.

    fault                         outcome
    the device's clock jumps      one event with its size; no sample is lost, none is shown before the one before it
    this host's clock is set back one event with its size; recorded and shown times go on as if nothing had been

(Where times are mapped to: tests/protocols/clocks/test_counters.py. Resets, turns of a loop:
tests/server/devices/link/test_session.py.)
"""

from __future__ import annotations

import asyncio
import itertools
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.recordings.mcap.reader import TIME, McapReader
from imuscope.server.settings.config import Config
from tests.bench.support.serial_device import frame
from tests.fault_injection.fault_harness import stage
from tests.server.links.link_fixtures import pty
from tests.support.each_row import each_row
from tests.support.fakes import FakeLinks, sample
from tests.support.in_process_server import InProcessServer
from tests.support.recorder_harness import send, settled
from tests.support.waiting import block_until, until


async def test_the_devices_clock_jumps() -> None:
    with pty() as port:
        async with stage(f"serial://{port.path}?baud=115200&protocol=xbus") as here:
            await until(lambda: "is open" in here.info.message, "it is open")
            for n in range(60):
                later = 300 if n >= 30 else 0  # s
                port.write(retimed(n, 100, later))
                await asyncio.sleep(0.01)
            await until(lambda: here.samples == 60, "every sample is there")
            assert (here.health.lost, here.health.rejects) == (0, 0)
            await until(lambda: here.events("clock"), "it is told")
            (event,) = here.events("clock")
            assert "jumped" in event.text
            for channel in here.telemetry.store.all:
                frames_ = list(channel.ring.frames(1, 0, channel.ring.total, here.telemetry.bus.now()))
                assert sum(n for n, _ in frames_) in (0, 60)


def retimed(n: int, rate: float, later_s: int) -> bytes:
    """A frame with a clock that is ahead; its counter continues."""
    whole = bytearray(frame(n, rate))
    at = whole.index(b"\x10\x60\x04") + 3
    ticks = int.from_bytes(whole[at : at + 4], "big") + later_s * 10_000
    whole[at : at + 4] = ticks.to_bytes(4, "big")
    whole[-1] = -sum(whole[1:-1]) & 0xFF
    return bytes(whole)


@each_row(("by_s", "words"), [(-3600, "back by 3 600 s"), (63_072_000, "ahead by 63 072 000 s")])
def test_this_hosts_clock_is_set(by_s: int, words: str, tmp_path: Path) -> None:
    """By an hour, and by two years: a computer without a battery for its clock learns the date from the network."""
    links = FakeLinks()
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), links.open) as running:
        sessions = running.services.sessions
        running.client.post("/api/recordings/start", json={})
        wall = sessions._wall_ns
        for n in range(100):
            send(running, links, "/dev/one", sample(n))
            if n == 50:
                running.call(setattr, sessions, "_wall_ns", lambda: wall() + by_s * 10**9)
        report = block_until(lambda: running.call(events, running.services.telemetry, "clock"), "it is told")
        assert [event.text for event in report] == [
            f"This host's clock was set {words}; times on this page stay as they were."
        ]
        settled(running)
        state: dict[str, Any] = running.client.post("/api/recordings/stop", json={}).json()
    times: list[int] = []
    with McapReader(tmp_path / "recordings" / f"{state['id']}.mcap") as recording:
        for block in recording.blocks():
            channel = recording.topic("rx/1")
            if channel is not None:
                times += block.of(channel.id)[TIME].astype(np.int64).tolist() if len(block.of(channel.id)) else []
    assert len(times) == 100
    assert all(a <= b for a, b in itertools.pairwise(times)), "no time runs back"


def events(telemetry: Any, kind: str) -> list[Any]:
    return [event for event in telemetry.log if event.kind == kind]
