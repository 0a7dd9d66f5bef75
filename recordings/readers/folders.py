"""Folders that are one recording: a ROS 2 bag, an EuRoC folder, packets of an OXTS receiver (KITTI); how they are
recognised.
"""

from pathlib import Path

METADATA = "metadata.yaml"  # of a bag
SENSOR_DATA, SENSOR = "data.csv", "sensor.yaml"  # of EuRoC
MOST_SENSORS = 32
TIMES, PACKETS = "timestamps.txt", "data"  # of OXTS


def is_bag_folder(path: Path) -> bool:
    """Whether a path is a folder with the description of a ROS 2 bag."""
    return (path / METADATA).is_file()


def sensor_folders(path: Path) -> list[Path]:
    """Folders with the tables of sensors, but cameras: those of `mav0` in a folder, or of the folder itself."""
    root = path / "mav0" if (path / "mav0").is_dir() else path
    folders = sorted(one.parent for one in root.glob(f"*/{SENSOR_DATA}") if not one.parent.name.startswith("cam"))
    return folders[:MOST_SENSORS] if any(one.name.startswith("imu") for one in folders) else []


def packet_folder(path: Path) -> Path | None:
    """The folder with the times and a file for each packet: oxts in a drive, or the folder itself; None without one."""
    for folder in (path / "oxts", path):
        if (folder / TIMES).is_file() and next((folder / PACKETS).glob("*.txt"), None) is not None:
            return folder
    return None
