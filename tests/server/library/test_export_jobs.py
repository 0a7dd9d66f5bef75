"""Exports of a recording that the server rewrites at the same time."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.server.library import export_jobs
from imuscope.server.library.export_jobs import ExportJobs
from imuscope.server.settings.config import Config
from tests.recordings.recorded_drive import START, drive
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.problems import assert_problem
from tests.support.waiting import block_until


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
            raise RecordingError("The export failed.", "The log has details.")
        return await write(jobs, job, title)

    monkeypatch.setattr(ExportJobs, "_run", rewritten)
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running:
        running.client.post("/api/recordings/a/exports", json={"format": "csv"})

        def done() -> dict[str, Any] | None:
            [one] = running.client.get("/api/recordings/exports").json()
            return one if one["state"] not in ("waiting", "running") else None

        state = block_until(done, "the export is finished")
    assert state["state"] == "done", state["message"]
    assert 2 <= len(attempts) <= 3  # three if the server compacts it meanwhile, too


def test_a_range_is_kept_as_a_recording_of_the_library(tmp_path: Path) -> None:
    path = tmp_path / "recordings" / "20251009T085320Z-MTi-630.mcap"
    path.parent.mkdir()
    drive(path, seconds=4.0)
    url = f"/api/recordings/{path.stem}"
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running:
        running.client.patch(url, json={"tags": ["yard"], "notes": "Three laps."})
        t0 = START / 1e9 + 1.0
        answer = running.client.post(f"{url}/keep", json={"t0": t0, "t1": t0 + 1.5, "title": "Kerb"})
        assert answer.status_code == 201, answer.text
        made = answer.json()
        assert (made["title"], made["tags"], made["markers"]) == ("Kerb", ["yard"], 1)
        assert made["notes"].startswith("00:00.")
        assert "of A drive.\n20251009T085320Z-MTi-630.mcap, " in made["notes"]
        assert made["notes"].endswith("\n\nThree laps.")
        assert made["file"] == "20251009T085321Z-MTi-630.mcap"
        assert made["duration"] == pytest.approx(1.5, abs=0.05)
        assert {one["id"] for one in running.client.get("/api/recordings").json()} == {path.stem, made["id"]}
        assert_problem(running.client.post(f"{url}/keep", json={"t0": t0 + 90, "t1": t0 + 91}), 422, "cannot-open")
        assert_problem(running.client.post(f"{url}/keep", json={"t0": t0, "t1": t0 - 1}), 422, "bad-span")
        assert_problem(running.client.post("/api/recordings/none/keep", json={"t0": t0, "t1": t0 + 1}), 404)
        assert not list((tmp_path / "recordings" / ".incoming").iterdir())


def test_results_leave_space_for_recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "recordings" / "a.mcap"
    path.parent.mkdir()
    drive(path, seconds=1.0)
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running:

        def exported() -> list[int]:
            """Ids of the results after one more export, newest first."""
            number = running.client.post("/api/recordings/a/exports", json={"format": "csv"}).json()["id"]

            def done() -> list[dict[str, Any]] | None:
                rows: list[dict[str, Any]] = running.client.get("/api/recordings/exports").json()
                assert rows[0]["state"] != "failed", rows[0]
                return rows if rows[0]["id"] == number and rows[0]["state"] == "done" else None

            rows = block_until(done, "the export is finished")
            sizes.append(rows[0]["size"])
            return [one["id"] for one in rows]

        sizes: list[int] = []
        assert exported() == [1]
        assert exported() == [2, 1]
        usage = shutil.disk_usage(tmp_path)
        full = usage._replace(free=sizes[0] * (export_jobs.FREE_SPACE_DIVISOR - 2))
        monkeypatch.setattr(export_jobs.shutil, "disk_usage", lambda folder: full)  # type: ignore[attr-defined]
        assert exported() == [3], "two of them would take more than their share"
        folders = {one.name.rpartition("-")[2] for one in (tmp_path / "exports").iterdir()}
        assert folders == {"3"}


def test_an_export_that_fails_names_the_file_and_guesses_no_cause(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "imuscope.server.library.export_worker"],
        input=json.dumps(
            {
                **{"format": "csv", "store": str(tmp_path / "gone"), "source": str(tmp_path / "a.mcap"), "title": "a"},
                **{"t0": None, "t1": None, "channels": None, "device": "", "base": 0.0, "out": str(tmp_path / "a.csv")},
            }
        ),
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    *_, line = done.stdout.splitlines()
    assert (done.returncode, json.loads(line)["message"].partition(".")[0]) == (1, "The export failed")
    assert "changed" not in line
