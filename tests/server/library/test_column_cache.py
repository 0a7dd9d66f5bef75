"""The cache of decoded columns: the oldest go first, and what another recording's decoding is making stays."""

from __future__ import annotations

import asyncio
import os
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.server.library import column_cache
from imuscope.server.library.cache_provenance import write_source
from imuscope.server.library.column_cache import ColumnCache, DecodeJob
from imuscope.server.system.workers import Worker
from tests.fault_injection.fault_harness import frames
from tests.fault_injection.recorded_files import recording
from tests.support.timeouts import PATIENCE_S


def store(cache: Path, name: str, size: int, age: int) -> Path:
    folder = cache / name
    folder.mkdir()
    (folder / "columns.bin").write_bytes(bytes(size))
    os.utime(folder, (1_700_000_000 - age, 1_700_000_000 - age))
    return folder


def test_the_least_recently_used_are_deleted_first(tmp_path: Path) -> None:
    old, middle, new = (store(tmp_path, name, 100, age) for name, age in (("a", 30), ("b", 20), ("c", 10)))
    column_cache._sweep(tmp_path, 200)
    assert (old.exists(), middle.exists(), new.exists()) == (False, True, True)


def test_columns_of_a_recording_that_is_gone_or_has_changed_are_deleted(tmp_path: Path) -> None:
    cache = tmp_path / "columns"
    cache.mkdir()
    stored, gone, changed, foreign = (store(cache, name, 100, age) for age, name in enumerate(("a", "b", "c", "d")))
    for folder in (stored, gone, changed):
        recording = tmp_path / f"{folder.name}.mcap"
        recording.write_bytes(b"1")
        write_source(folder, recording, recording.stat())
    (tmp_path / "b.mcap").unlink()
    (tmp_path / "c.mcap").write_bytes(b"12")
    assert sorted(column_cache._sweep(cache, 1 << 30)) == [gone, changed]
    assert (stored.exists(), gone.exists(), changed.exists(), foreign.exists()) == (True, False, False, True)


async def test_columns_go_with_their_recording(tmp_path: Path) -> None:
    paths = {name: tmp_path / f"{name}.mcap" for name in "ab"}
    for path in paths.values():
        recording(path, frames(0, 200))

    columns = ColumnCache(tmp_path, paths.__getitem__)
    try:
        await columns.opened("a")
        first = columns.store_of("a")
        paths["a"].unlink()
        await columns.opened("b")
        assert not first.exists()
        assert columns.store_of("b").is_dir()
    finally:
        await columns.close()


async def test_a_recording_that_was_deleted_while_it_waited_and_is_restored_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was unknown until the server was started again, though it was in the list."""
    monkeypatch.setattr(column_cache, "FAILED_FOR_S", 0.0)
    path = tmp_path / "a.mcap"
    recording(path, frames(0, 200))
    known = {"a": path}
    columns = ColumnCache(tmp_path, known.__getitem__)
    try:
        opening = columns.open("a")
        assert isinstance(opening, DecodeJob)
        assert opening.task is not None
        del known["a"]  # before its turn
        await asyncio.wait((opening.task,))
        known["a"] = path
        assert await columns.opened("a")
    finally:
        await columns.close()


async def test_columns_that_were_deleted_before_anybody_read_them_are_made_again(tmp_path: Path) -> None:
    """A page that was closed while it opened a recording left a job that never ended, once the cache was swept."""
    path = tmp_path / "a.mcap"
    recording(path, frames(0, 200))
    columns = ColumnCache(tmp_path, {"a": path}.__getitem__)
    try:
        opening = columns.open("a")
        assert isinstance(opening, DecodeJob)
        assert opening.task is not None
        await asyncio.wait((opening.task,))
        shutil.rmtree(columns.store_of("a"))
        assert await columns.opened("a")
    finally:
        await columns.close()


async def test_attempts_that_failed_are_forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each state of a file that could not be opened was kept for ever, with the part that had been decoded."""
    monkeypatch.setattr(column_cache, "FAILED_FOR_S", -1.0)
    path = tmp_path / "a.mcap"
    known: dict[str, Path] = {}
    columns = ColumnCache(tmp_path, known.__getitem__)
    for number in range(20):
        path.write_bytes(bytes(number))
        known["a"] = path
        opening = columns.open("a")
        assert isinstance(opening, DecodeJob)
        assert opening.task is not None
        del known["a"]  # it fails without a process
        await asyncio.wait((opening.task,))
    assert len(columns._opening) == 1


def test_the_cache_takes_no_more_than_its_share_of_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stores = [store(tmp_path, name, 100, age) for age, name in enumerate("dcba")]
    free = 600
    monkeypatch.setattr(column_cache.shutil, "disk_usage", lambda path: SimpleNamespace(free=free))
    column_cache._sweep(tmp_path, 1 << 30)  # (600 + 400) / 4
    assert [folder.exists() for folder in stores] == [True, True, False, False]


def test_what_is_being_made_is_neither_deleted_nor_missed_when_it_vanishes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    making = store(tmp_path, ".a.17.making", 500, 99)
    gone, stored = store(tmp_path, "b", 500, 20), store(tmp_path, "c", 100, 10)
    listed = [making, gone, stored]
    monkeypatch.setattr(Path, "iterdir", lambda self: iter(listed) if self == tmp_path else iter(_files(self)))
    (gone / "columns.bin").unlink()
    gone.rmdir()  # by another decoding, after it was listed
    column_cache._sweep(tmp_path, 200)
    assert making.exists()
    assert stored.exists()


def _files(folder: Path) -> list[Path]:
    return [folder / name for name in os.listdir(folder)]


async def test_opening_ends_with_its_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two processes were alive 500 s after their recordings were deleted, and nothing else could be opened."""
    path = tmp_path / "a.csv"
    path.write_text("time (s),x\n0,1\n1,2\n")
    cache = ColumnCache(tmp_path / "data", {"a": path}.__getitem__)
    begun: list[Worker] = []

    async def never(worker: Worker) -> dict[str, Any]:
        begun.append(worker)
        await asyncio.Event().wait()
        raise AssertionError

    monkeypatch.setattr(Worker, "__anext__", never)
    waiting = asyncio.ensure_future(cache.opened("a"))
    async with asyncio.timeout(PATIENCE_S):
        while not begun:
            await asyncio.sleep(0.01)
        cache.end_orphans()
        await asyncio.sleep(0)
        assert begun[0].is_running
        path.unlink()
        cache.end_orphans()
        with pytest.raises((RecordingError, FileNotFoundError)):
            await waiting
        assert not begun[0].is_running


async def test_opening_that_takes_too_long_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time (s),x\n0,1\n1,2\n")
    cache = ColumnCache(tmp_path / "data", {"a": path}.__getitem__)
    monkeypatch.setattr(column_cache, "WAIT_SHARE", 0)
    with pytest.raises(RecordingError, match="takes too long"):
        await cache.opened("a")
