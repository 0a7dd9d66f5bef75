"""A limit of memory near what a server needs, as of a unit of systemd with MemoryMax (docs/guide/deployment.md).

    fault                                       outcome
    many times what the history may hold        the history stays within `memory_mb`, the recording is whole
    less memory than `memory_mb` asks for       the history is smaller, and the start says so

The limit is RLIMIT_DATA, which needs no rights, and set once the server runs: an allocation beyond it fails, which a
test can tell, while a control group would end the process.
"""

from __future__ import annotations

import re
import resource
import sys
import urllib.request
from pathlib import Path

import pytest

from imuscope.recordings.system import resource_limits
from imuscope.server.commands.serve import within_memory
from imuscope.server.settings.config import Config
from tests.bench.support.serial_devices import Speakers, received_in
from tests.support.each_row import each_row
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

MB = 1 << 20
HISTORY_MB, ROOM_MB = 2, 48  # room beside the history: workspaces of the decoders, what waits for the disk, answers
RATE, SPEED, SECONDS = 400.0, 40.0, 120.0  # of the devices' own time


def data_of(pid: int) -> int:
    """Memory of a process that counts against RLIMIT_DATA, bytes."""
    match = re.search(r"^VmData:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text(), re.MULTILINE)
    assert match is not None
    return int(match[1]) * 1024


def received_by(server: ServerProcess) -> float:
    """Bytes that all devices sent, of its figures."""
    with urllib.request.urlopen(f"{server.url}/metrics", timeout=PATIENCE_S) as answer:
        text = answer.read().decode()
    return sum(
        float(one) for one in re.findall(r"^imuscope_link_received_bytes_total\{.*\} (\S+)$", text, re.MULTILINE)
    )


@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_DATA counts private memory only on Linux")
def test_a_recording_is_whole_and_the_history_bounded_within_a_limit(tmp_path: Path) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text(f"memory_mb = {HISTORY_MB}\nrecord_head = false\n")
    arguments = ("--record", "--config", str(settings))
    with Speakers(3, RATE, SECONDS, SPEED) as speakers:
        sources = [f"serial://{path}?baud=2000000&protocol=xbus" for path in speakers.terminals]
        with ServerProcess(*sources, data=tmp_path / "data", arguments=arguments) as server:
            pid = server.process.pid
            limit = data_of(pid) + (HISTORY_MB + ROOM_MB) * MB
            resource.prlimit(pid, resource.RLIMIT_DATA, (limit, limit))
            server.wait_until_open(3)
            speakers.go()
            sent = speakers.sent()["devices"]
            total = sum(one["bytes"] for one in sent)
            block_until(lambda: received_by(server) >= total, "all of it has arrived")
            held = server.request("GET", "/api/recorder/memory")
            assert 0 < sum(one["size"] for one in held) <= HISTORY_MB * MB
    assert server.process.wait() == 0
    received = received_in(sorted((tmp_path / "data" / "recordings").glob("*.mcap")))
    assert [received[str(n)] for n in (1, 2, 3)] == [{name: one[name] for name in ("bytes", "crc32")} for one in sent]
    assert "Traceback" not in server.log


@each_row(("available", "expected"), [(256, 64), (100, 8), (1024, 256), (64_000, 256)])
def test_a_history_without_room_is_smaller_and_the_start_states_it(
    available: int, expected: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(resource_limits, "_memories", lambda: [available * MB])
    assert within_memory(Config()).memory_mb == expected
    assert resource_limits.history_room() >= (available - 1536) * MB, "a large machine keeps 1.5 GB for others"
    message = f"at most {expected} MB in place of 256 (memory_mb)"
    assert (message in capsys.readouterr().err) == (expected < 256)
