"""Compaction in a subprocess: queued recordings are compacted, and a failing one does not stop the others."""

import asyncio
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from imuscope.recordings.mcap.own_recordings import is_uncompacted
from imuscope.server.library.compaction_worker import CompactionWorker
from imuscope.server.system.workers import Worker
from tests.fault_injection.fault_harness import frames
from tests.fault_injection.recorded_files import recording
from tests.support.waiting import until


def test_many_recordings_are_packed_by_one_process_and_a_bad_one_stops_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Regression: each had a separate process, which took 1.5 s of a core for a file of 40 kB."""
    begun: list[int] = []
    begin = Worker.create_process

    async def counted(*command: str, **options: Any) -> Any:
        process = await begin(*command, **options)
        begun.append(process.pid)
        return process

    monkeypatch.setattr(Worker, "create_process", staticmethod(counted))
    packed: list[Path] = []
    compactor = CompactionWorker(packed.append)
    for name in "abcde":
        recording(tmp_path / f"{name}.mcap", frames(0, 500))
    whole = (tmp_path / "c.mcap").read_bytes()
    (tmp_path / "c.mcap").write_bytes(whole[:4000] + bytes(3000) + whole[7000:])

    async def check() -> None:
        await compactor.resume(tmp_path)
        await until(lambda: not compactor.is_busy, "all are seen to")

    asyncio.run(check())
    assert [path.stem for path in packed] == ["a", "b", "d", "e"]
    assert "c.mcap could not be compacted" in caplog.text
    assert len(begun) == 1


def test_a_process_whose_server_was_killed_ends_quietly(tmp_path: Path) -> None:
    """Regression: it printed the traceback of a BrokenPipeError. The first file is whole, the second as it was."""
    first, second = tmp_path / "a.mcap", tmp_path / "b.mcap"
    for path in (first, second):
        recording(path, frames(0, 500))
    reader, writer = os.pipe()
    os.close(reader)  # as at the death of the server, a moment before the signal
    with os.fdopen(writer, "wb") as output:
        command = [sys.executable, "-m", "imuscope.recordings.mcap.compaction", str(first), str(second)]
        done = subprocess.run(command, stdout=output, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "")
    assert (is_uncompacted(first), is_uncompacted(second)) == (False, True)
