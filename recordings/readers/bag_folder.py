"""ROS 2 bags as folders: how they are recognised."""

from __future__ import annotations

from pathlib import Path

METADATA = "metadata.yaml"


def is_bag_folder(path: Path) -> bool:
    """Whether a path is a folder with the description of a ROS 2 bag."""
    return (path / METADATA).is_file()
