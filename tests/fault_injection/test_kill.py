"""kill -9 at any time: the state found by the next server, and its recovery.

    killed while it …                outcome when it starts again
    records                          every byte but the last 20 ms is in the file, which is packed
    writes settings                  the old ones are put back and read back, and the device measures
    exports                          no job is there, and nothing of its files
    takes an upload, writes a note   nothing of it but what was there before
    packs a recording                it is packed anew, and what the old packing still does harms nothing

(What is lost of a recording, 20 ms: tests/server/library/test_recorder.py. A temporary rate:
tests/server/configuration/test_rollback.py.)
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.mcap import compaction
from imuscope.recordings.mcap.own_recordings import is_uncompacted
from imuscope.server.library.cleanup import LOCK, DataFolderLock
from imuscope.server.library.compaction_worker import uncompacted
from imuscope.server.links.simulator import SimulatorThread
from tests.bench.support.tcp_device import TcpDevice
from tests.fault_injection.fault_harness import frames
from tests.fault_injection.recorded_files import hidden, recording
from tests.support.control_harness import bench, outputs
from tests.support.recorder_harness import chunks
from tests.support.server_process import ROOT, ServerProcess
from tests.support.timeouts import PATIENCE_S, http_client
from tests.support.waiting import block_until


async def test_killed_while_it_records_exports_and_writes_settings(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    recording(folder / "long.mcap", frames(0, 2000) * 40)

    async with bench() as there:
        there.hold_open()  # the port outlives the server
        await asyncio.to_thread(killed, there, tmp_path)


def killed(there: SimulatorThread, data: Path) -> None:
    folder = data / "recordings"
    device = f"serial://{there.slave}?baud=115200"
    (data / "exports" / "older-1").mkdir(parents=True)
    with TcpDevice(500) as line:
        with ServerProcess(line.source, device, data=data, arguments=("--record",)) as first:
            with http_client(base_url=first.url) as http:
                block_until(
                    lambda: [one["status"] for one in http.get("/api/devices").json()] == ["live"] * 2, "both stream"
                )
                block_until(lambda: http.get("/api/recorder").json()["bytes"] > 50_000, "it records")
                is_idle = lambda: not http.get("/api/devices/2/jobs").json()["running"]  # noqa: E731
                block_until(is_idle, "the recording has asked for what it wants")
                assert (data / LOCK).exists()
                request = http.post("/api/recordings/long/exports", json={"format": "csv"})
                assert request.status_code == 202, request.text
                block_until(lambda: http.get("/api/recordings/exports").json()[0]["state"] != "waiting", "it exports")
                # On trial: a write alone may be over, and its way back gone, before anybody has looked.
                body = {"changes": {"OutputConfiguration": outputs(50)}, "confirmed": True, "confirm_s": 600}
                assert http.post("/api/devices/2/apply", json=body).status_code == 202
                block_until(
                    lambda: list((data / "rollbacks").glob("*.json")), "the way back is on disk, the write begins"
                )
            first.process.kill()
            first.process.wait()
        sent = line.sent
    (made,) = (path for path in folder.glob("*.mcap") if path.stem != "long")
    assert len(chunks(made)) > 10_000  # of the bytes counted above, those of this device
    assert sent.startswith(chunks(made))
    before = chunks(made)
    (folder / ".note.json.0a1b2c3d").write_text("{", "utf-8")
    (folder / f".{made.name}.packing").write_bytes(b"left by a packing that was killed")
    (data / "cache" / "columns" / ".abc.4711.making").mkdir(parents=True, exist_ok=True)

    with ServerProcess(device, data=data) as second, http_client(base_url=second.url) as http:

        def idle() -> Any:
            jobs = http.get("/api/devices/2/jobs").json()
            return jobs["done"] if not jobs["running"] and not jobs["queue"] else None

        job = block_until(idle, "the settings went back")[
            0
        ]  # after one that put the device back into its state, if the kill had interrupted that
        assert (job["state"], job["message"]) == ("done", "The device has its old settings again.")
        block_until(lambda: http.get("/api/devices").json()[0]["status"] == "live", "the device measures")
        assert not list((data / "rollbacks").glob("*.json"))
        assert http.get("/api/recordings/exports").json() == []
        block_until(lambda: not is_uncompacted(made) and not is_uncompacted(folder / "long.mcap"), "both are packed")
        assert chunks(made) == before
        assert chunks(folder / "long.mcap") == frames(0, 2000) * 40
        block_until(lambda: not hidden(data), "nothing unfinished is left")
        assert not (folder / ".note.json.0a1b2c3d").exists()
    assert isinstance(there.device, XbusSimulator)


def test_a_server_deletes_no_file_of_another_server_in_its_folder(tmp_path: Path) -> None:
    """Two servers on one data folder: files being written by one are not leftovers of the other."""
    first, second = DataFolderLock(tmp_path), DataFolderLock(tmp_path)
    first.begin()
    half = tmp_path / "exports" / "abc-1"
    half.mkdir(parents=True)
    assert second.begin() == []
    assert half.exists()
    second.end()
    first.end()
    third = DataFolderLock(tmp_path)
    assert third.begin() == ["exports/abc-1"]
    third.end()


def test_a_compaction_that_outlives_its_server_is_harmless(tmp_path: Path) -> None:
    """Regression: both wrote the same temporary file, so one could publish half of the other's data."""
    path = tmp_path / "a.mcap"
    expected = frames(0, 2000) * 3
    recording(path, expected)
    begin = "import sys\nfrom pathlib import Path\nfrom imuscope.recordings.mcap.compaction import compact\n"
    code = f"{begin}compact(Path({str(path)!r}), progress=%s)"
    held = code % "lambda share: (print('half', flush=True), sys.stdin.readline())"
    with subprocess.Popen(
        [sys.executable, "-c", held], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as old:
        assert old.stdout
        assert old.stdin
        assert old.stdout.readline() == "half\n"
        assert uncompacted(tmp_path) == [path]  # the next server starts, and packs
        pipe = old.stdin

        def let_it_end(share: float) -> None:
            pipe.write("\n" * 1000)
            pipe.flush()
            old.wait(PATIENCE_S)

        with pytest.raises(RecordingError, match="replaced while it was packed"):
            compaction.compact(path, progress=let_it_end)
    assert chunks(path) == expected
    assert not is_uncompacted(path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mcap"]
