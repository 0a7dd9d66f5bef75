"""Exports of a recording that the server rewrites at the same time."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from imuscope.recordings.mcap_writer import RecordingError
from imuscope.server.config import Config
from imuscope.server.library.export_jobs import ExportJobs
from tests.recordings.recorded_drive import drive
from tests.server.fakes import FakeLink
from tests.server.in_process_server import InProcessServer
from tests.waiting import block_until


def test_a_recording_that_is_compacted_during_its_export_is_exported_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its columns have another place then, and the former ones are deleted."""
    path = tmp_path / "recordings" / "a.mcap"
    path.parent.mkdir()
    drive(path, seconds=1.0)
    write, attempts = ExportJobs._run, list[int]()

    async def rewritten(jobs: ExportJobs, job: Any, title: str) -> list[Path]:
        attempts.append(1)
        if len(attempts) == 1:
            os.utime(path, (1e9, 1e9))
            raise RecordingError("The recording changed while it was exported.", "Export it again.")
        return await write(jobs, job, title)

    monkeypatch.setattr(ExportJobs, "_run", rewritten)
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running:
        running.client.post("/api/recordings/a/exports", json={"format": "csv"})

        def done() -> dict[str, Any] | None:
            [one] = running.client.get("/api/recordings/exports").json()
            return one if one["state"] not in ("waiting", "running") else None

        state = block_until(done, "the export is finished")
    assert state["state"] == "done", state["message"]
    assert len(attempts) == 2
