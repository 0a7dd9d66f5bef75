"""EuRoC folders: how they are recognised."""

from __future__ import annotations

from pathlib import Path

DATA, SENSOR = "data.csv", "sensor.yaml"
MOST_SENSORS = 32


def sensor_folders(path: Path) -> list[Path]:
    """Folders with the tables of sensors, but cameras: those of `mav0` in a folder, or of the folder itself."""
    root = path / "mav0" if (path / "mav0").is_dir() else path
    folders = sorted(one.parent for one in root.glob(f"*/{DATA}") if not one.parent.name.startswith("cam"))
    return folders[:MOST_SENSORS] if any(one.name.startswith("imu") for one in folders) else []
