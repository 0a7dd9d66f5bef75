"""Folders of OXTS packets, as in KITTI raw data: how they are recognised."""

from __future__ import annotations

from pathlib import Path

TIMES = "timestamps.txt"
PACKETS = "data"


def packet_folder(path: Path) -> Path | None:
    """The folder with the times and a file for each packet: oxts in a drive, or the folder itself; None without one."""
    for folder in (path / "oxts", path):
        if (folder / TIMES).is_file() and next((folder / PACKETS).glob("*.txt"), None) is not None:
            return folder
    return None
