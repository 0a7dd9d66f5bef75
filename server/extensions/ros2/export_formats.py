"""Entry point of the exports for programs of ROS: bags in both storages, and EuRoC folders. None needs ROS or Zenoh."""

from functools import partial
from pathlib import Path

from imuscope.recordings.exporters.registry import ExportFormat, lazy, register_exporter
from imuscope.recordings.exporters.request import ExportRequest, ExportStep


def _write_bag(storage: str, request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    from imuscope.server.extensions.ros2.bag_writer import write_bag  # which takes longer to import

    return write_bag(storage, request, out, step)


for storage, suffix, title, order, per_byte in (
    ("MCAP", ".rosbag2", "MCAP", 32, 1.7),
    ("SQLITE3", ".db3.rosbag2", "SQLite", 34, 9.0),
):
    register_exporter(
        ExportFormat(
            f"rosbag2-{storage.lower()}",
            f"ROS 2 bag, {title}",
            suffix,
            partial(_write_bag, storage),
            order=order,
            words="sensor_msgs: SI units, axes of REP 103",
            per_byte=per_byte,
        )
    )
register_exporter(
    ExportFormat(
        "euroc",
        "EuRoC folder",
        ".euroc",
        lazy("imuscope.server.extensions.ros2.euroc_writer"),
        order=36,
        words="rate of turn and acceleration, for Kalibr",
        per_byte=1.3,
    )
)
