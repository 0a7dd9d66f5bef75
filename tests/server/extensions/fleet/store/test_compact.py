"""`imuscope compact`: fewer files, the same rows, and uploads that are still known."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from imuscope.server.extensions.fleet.store.tables import TABLES
from tests.recordings.recorded_drive import START, drive
from tests.server.extensions.fleet.store_fixtures import Commands
from tests.support.server_process import ROOT, tied

DAYS = 8 * 86_400


@pytest.fixture
def drives(commands: Commands, store: Path, tmp_path: Path) -> list[Path]:
    """Four recordings of a day, uploaded."""
    files = [tmp_path / f"drive-{n}.mcap" for n in range(4)]
    for n, file in enumerate(files):
        drive(file, started_ns=START + n * 60_000_000_000)
        commands.upload(file, store)
    return files


def _files(store: Path, table: str) -> set[Path]:
    return {path for path in (store / "tables" / table).rglob("*.parquet") if "_delta_log" not in path.parts}


def _rows(commands: Commands, store: Path) -> dict[str, object]:
    names = [name for name in TABLES if name != "samples"]
    return {name: commands.query(store, f"SELECT * FROM {name} ORDER BY ALL") for name in (*names, "samples_wide")}


def test_files_are_joined_and_rows_stay(commands: Commands, store: Path, drives: list[Path]) -> None:
    before = _rows(commands, store)
    status, out, err = commands.run("compact", "--store", store)
    assert (status, err) == (0, "")
    assert "recordings: 4 files joined into 1\n" in out
    assert _rows(commands, store) == before
    assert commands.run("compact", "--store", store)[1].splitlines()[0] == "recordings: nothing to join"
    assert "was uploaded before" in commands.upload(drives[0], store)
    assert _rows(commands, store) == before
    commands.upload(drives[0], store, "badger")
    assert commands.query(store, "SELECT count(*) AS n FROM recordings") == [{"n": 5}]


def test_files_are_removed_a_week_after_they_were_needed(commands: Commands, store: Path, drives: list[Path]) -> None:
    stray, old = (store / "tables" / "minutes" / f"{name}.parquet" for name in ("new", "old"))
    for path in (stray, old):
        path.write_bytes(b"an upload that was cut off")
    os.utime(old, (time.time() - DAYS, time.time() - DAYS))
    before, count = _rows(commands, store), len(_files(store, "minutes"))
    commands.run("compact", "--store", store)
    assert len(_files(store, "minutes")) == count + 1
    out = commands.run("compact", "--store", store, "--remove-unused")[1]
    assert "minutes: nothing to join, 1 file removed\n" in out
    assert stray.exists()
    assert not old.exists()
    assert _rows(commands, store) == before


def test_a_store_that_cannot_be_compacted_gives_the_reason(commands: Commands, store: Path, tmp_path: Path) -> None:
    assert commands.run("compact", "--store", store) == (0, "", "")
    assert not store.exists()
    (tmp_path / "file").write_bytes(b"")
    assert "is a file" in commands.refused("compact", "--store", tmp_path / "file")


COMPACT_FOR_EVER = """
import sys
from imuscope.server.extensions.fleet.store.compact import compact
from imuscope.server.extensions.fleet.store.store import StoreError, location
while True:
    try:
        for table in compact(location(sys.argv[1]), remove=True):
            print(table.joined, flush=True)
    except StoreError as error:  # an upload committed first
        print(0, error.message, flush=True)
"""


@pytest.mark.slow
def test_uploads_of_several_processes_go_on_while_files_are_joined(
    commands: Commands, store: Path, drives: list[Path], tmp_path: Path
) -> None:
    later = [tmp_path / f"later-{n}.mcap" for n in range(6)]
    for n, file in enumerate(later):
        drive(file, seconds=1.0, started_ns=START + (10 + n) * 60_000_000_000)
    command = tied([sys.executable, "-c", COMPACT_FOR_EVER, str(store)])
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as joining:
        assert joining.stdout is not None
        joining.stdout.readline()
        uploads = [
            subprocess.Popen(
                tied(
                    [
                        sys.executable,
                        "-m",
                        "imuscope.server.cli",
                        "upload",
                        str(file),
                        "--store",
                        str(store),
                        "--robot",
                        robot,
                    ]
                ),
                cwd=ROOT,
                stdout=subprocess.DEVNULL,
            )
            for file, robot in [*((file, "otter") for file in later[:3]), (later[0], "otter"), (drives[0], "otter")]
        ]
        assert [one.wait() for one in uploads] == [0] * len(uploads)
        for file in later[3:]:
            commands.upload(file, store)
        assert joining.poll() is None, "files are still joined"
        joining.kill()
        message = joining.stdout.read()
    assert any(line.split()[0] not in ("0", "1") for line in message.splitlines()), (
        "files of uploads were joined meanwhile"
    )
    count = "SELECT count(*) AS n, count(DISTINCT recording) AS different FROM recordings"
    assert commands.query(store, count) == [{"n": 10, "different": 10}]
    alone = tmp_path / "alone"
    for file in (*drives, *later):
        commands.upload(file, alone)
    for name in ("devices", "events", "losses", "settings", "minutes", "samples_wide"):
        assert commands.query(store, f"SELECT * FROM {name} ORDER BY ALL") == commands.query(
            alone, f"SELECT * FROM {name} ORDER BY ALL"
        )
