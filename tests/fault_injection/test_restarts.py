"""Restarts, kills and concurrent servers in a library of sixty recordings, some of them damaged.

what happens                                           outcome
`serve --record` starts, ends in order, starts again   every recording goes on until its server ends, and is whole
it is killed                                           the same, but for the last 20 ms
a second server starts on the folder                   it takes nothing of the first one's
`imuscope record` writes into the folder               no server packs it while it does
recordings that are damaged                            stay as they are, byte for byte
the host's clock is set after the server began         recordings that begin afterwards have the new time
"""

import os
import random
import time
from functools import partial
from pathlib import Path

import pytest

from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.own_recordings import is_uncompacted
from imuscope.recordings.mcap.reader import TIME, McapReader
from imuscope.server.settings.config import Config
from tests.bench.support.tcp_device import TcpDevice
from tests.fault_injection.fault_harness import frames
from tests.fault_injection.recorded_files import recording
from tests.support.fakes import FakeLinks, sample
from tests.support.in_process_server import InProcessServer
from tests.support.recorder_harness import chunks, send, settled
from tests.support.server_process import ServerProcess, begun
from tests.support.timeouts import PATIENCE_S, http_client
from tests.support.waiting import block_until

MIN_SAMPLES = 60_000  # bytes, more than were lost: the recording used to end after 0.8 s


def library(folder: Path) -> tuple[dict[str, bytes], bytes]:
    """Sixty recordings: most compacted, some damaged, and one left by a killed server; with the contents of the damaged
    ones.
    """
    folder.mkdir(parents=True)
    model = folder.parent / "model.mcap"
    recording(model, frames(0, 1500))
    loose = model.read_bytes()
    compact(model)
    packed = model.read_bytes()
    model.unlink()
    chance = random.Random(7)
    damaged = {
        "garbage.mcap": loose[:1000] + chance.randbytes(20_000) + loose[21_000:],
        "hole.mcap": loose[:4000] + bytes(9000) + loose[13_000:],
        "chunk.mcap": packed[: len(packed) // 2] + b"\xff" + packed[len(packed) // 2 + 1 :],
        "no-head.mcap": bytes(40) + loose[40:],
        "empty.mcap": b"",
    }
    for name, data in damaged.items():
        (folder / name).write_bytes(data)
    for number in range(60 - len(damaged)):
        (folder / f"kept-{number}.mcap").write_bytes(packed)
    return damaged, loose


def enough(url: str) -> int:
    """The bytes of the recording that runs, or a failure when it has ended."""
    with http_client(base_url=url) as http:
        state = http.get("/api/recorder").json()
    assert state["running"], state
    return int(state["bytes"]) if state["bytes"] > MIN_SAMPLES else 0


def reaches(url: str, goal: int) -> bool:
    """Whether the recording that runs has so many bytes."""
    return enough(url) > goal


def packs(left: list[Path]) -> bool:
    """Whether the server has compacted one of the remaining recordings."""
    return not all(map(is_uncompacted, left))


def own(folder: Path) -> set[str]:
    """The names of recordings that a server made."""
    return {path.name for path in folder.glob("2*.mcap")}


@pytest.mark.slow  # kills, orderly ends, company and damage, each in a small library: see the files beside this one
def test_recordings_survive_restarts_kills_and_other_servers_in_a_full_library(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    damaged, unpacked = library(folder)
    left = [folder / f"kept-{number}.mcap" for number in range(0, 55, 10)]
    whole = chunks(folder / "kept-1.mcap")
    sent: dict[str, bytes] = {}
    for end in ("terminate", "kill", "company"):
        before = own(folder)
        for path in left:
            path.write_bytes(unpacked)
        with (
            TcpDevice(300) as line,
            ServerProcess(line.source, data=tmp_path, arguments=("--record",)) as server,
            TcpDevice(300) as beside,
        ):
            block_until(lambda: enough(server.url), "a second is recorded")
            if end == "company":
                with company(tmp_path, folder / "drive.mcap", beside):
                    goal = enough(server.url) + MIN_SAMPLES
                    block_until(partial(reaches, server.url, goal), "the first server goes on recording")
            block_until(partial(packs, left), "one is packed; those that servers made came before it")
            enough(server.url)
            (name,) = own(folder) - before
            getattr(server.process, "kill" if end == "kill" else "terminate")()
            server.process.wait()
            sent[name] = line.sent
            if end == "company":
                sent["drive.mcap"] = beside.sent
    for name, data in sent.items():
        result = chunks(folder / name)
        assert data.startswith(result), name
        assert len(result) > MIN_SAMPLES // 2, name
    for name, held in damaged.items():
        assert (folder / name).read_bytes() == held, name
    assert all(chunks(path) == whole for path in folder.glob("kept-*"))
    assert len(list(folder.glob("*.mcap"))) == 60 + 4


class company:  # noqa: N801 - reads as what it is
    """A second server on the folder, and `imuscope record` into it, until the block ends."""

    def __init__(self, data: Path, path: Path, line: TcpDevice) -> None:
        self._record = begun("record", line.source, "-o", str(path), "--data", str(data), "--duration", "3")
        block_until(path.exists, "it records into the folder")
        self._server = ServerProcess("sim:isb?rate=10", data=data)

    def __enter__(self) -> None:
        self._server.__enter__()

    def __exit__(self, *error: object) -> None:
        self._server.__exit__(None, None, None)
        assert self._record.stdout is not None
        message = self._record.stdout.read()
        assert self._record.wait(PATIENCE_S) == 0, message
        self._record.stdout.close()


def test_a_recording_that_begins_after_the_clock_was_set_has_the_new_time(tmp_path: Path) -> None:
    """A host without a real-time clock battery: the network sets the time long after the server started."""
    links = FakeLinks()
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), links.open) as running:
        ahead = 2 * 365 * 86_400 * 1_000_000_000
        recorder = running.services.recorder
        recorder._wall_ns = lambda: round(running.services.telemetry.bus.now() * 1e9) + ahead
        assert running.client.post("/api/recordings/start", json={}).status_code < 300
        send(running, links, "/dev/one", b"".join(sample(n) for n in range(50)))
        settled(running)
        name = running.client.get("/api/recorder").json()["id"]
        recorder._wall_ns = lambda: round(running.services.telemetry.bus.now() * 1e9) + ahead + 3_600_000_000_000
        block_until(lambda: running.client.get("/api/recorder").json()["id"] != name, "it goes on in a new file")
        send(running, links, "/dev/one", b"".join(sample(n) for n in range(50, 100)))
        listed = running.client.get("/api/recordings").json()
        running.client.post("/api/recordings/stop")
    now = time.time_ns()
    starts = []
    for path in sorted((tmp_path / "recordings").glob("*.mcap"), key=os.path.getmtime):
        with McapReader(path) as made:
            starts.append(min(int(block.table[TIME].min()) for block in made.blocks()))
    assert len(starts) == 2
    assert abs(starts[0] - now - ahead) < 600e9
    assert abs(starts[1] - now - ahead - 3_600e9) < 600e9
    assert all(abs(one["duration"] or 0) < 600 for one in listed)
