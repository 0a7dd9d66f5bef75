"""The cache of decoded columns: the oldest go first, and what another recording's decoding is making stays."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from server.library import column_cache


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


def test_what_is_being_made_is_neither_deleted_nor_missed_when_it_vanishes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    making = store(tmp_path, ".a.17.making", 500, 99)
    gone, kept = store(tmp_path, "b", 500, 20), store(tmp_path, "c", 100, 10)
    listed = [making, gone, kept]
    monkeypatch.setattr(Path, "iterdir", lambda self: iter(listed) if self == tmp_path else iter(_files(self)))
    (gone / "columns.bin").unlink()
    gone.rmdir()  # by another decoding, after it was listed
    column_cache._sweep(tmp_path, 200)
    assert making.exists()
    assert kept.exists()


def _files(folder: Path) -> list[Path]:
    return [folder / name for name in os.listdir(folder)]
