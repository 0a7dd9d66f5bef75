"""A power cut while a recording is packed: what was forced to the disk at any moment is the old file or the new one.

A disk is modelled as the worst that POSIX allows: a file has the bytes of its last fsync, and a rename counts only once
the folder is synced, but may come earlier.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from imuscope.recordings.mcap import compaction
from tests.recordings.mcap_files import Message, read
from tests.recordings.recorded_drive import drive


class WorstDisk:
    """Copies what a power cut would leave of a file, at each call that changes it.

    Attributes:
        left: files as they would be found.
    """

    def __init__(self, path: Path, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self._path, self._folder = path, folder
        self._synced: dict[int, bytes] = {}  # by inode
        self.left: list[Path] = []
        fsync, replace = os.fsync, os.replace

        def synced(fd: int) -> None:
            fsync(fd)
            if os.path.isfile(f"/proc/self/fd/{fd}"):
                self._synced[os.fstat(fd).st_ino] = Path(f"/proc/self/fd/{fd}").read_bytes()

        def replaced(old: Path, new: Path) -> None:
            self._keep(self._path.read_bytes())
            inode = old.stat().st_ino
            replace(old, new)
            self._keep(self._synced.get(inode, b""))

        patch.setattr(os, "fsync", synced)
        patch.setattr(os, "replace", replaced)

    def _keep(self, data: bytes) -> None:
        copy = self._folder / f"{len(self.left)}.mcap"
        copy.write_bytes(data)
        self.left.append(copy)


def messages(path: Path) -> list[Message]:
    return sorted(read(path))


def test_a_recording_survives_at_any_moment_of_packing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "drive.mcap"
    drive(path, seconds=3.0)
    expected = messages(path)
    (tmp_path / "left").mkdir()
    disk = WorstDisk(path, tmp_path / "left", monkeypatch)
    compaction.compact(path)
    assert len(disk.left) == 2, "it is replaced once"
    assert [messages(one) for one in disk.left] == [expected, expected]
    assert messages(path) == expected
