"""Benchmark of bags: a bag of ROS, opened by `imuscope.open`, and one signal of it as Arrow.

    python -m tests.bench.bags --mb 1000

The yardstick, in the same run, is the library that reads bags without ROS: rosbags, each message deserialised, and a
list of the values. The bags hold sensor_msgs/Imu: ROS 1 in chunks without compression, ROS 2 in SQLite.
"""

from __future__ import annotations

import struct
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pyarrow as pa
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from tests.bench.library import RATE_HZ, START_NS, TYPE, with_imuscope
from tests.bench.support.report import options_of, report
from tests.recordings.readers.formats.bags import imu

STORES = {"ros1": Stores.ROS1_NOETIC, "ros2": Stores.ROS2_HUMBLE}


def template_of(kind: str) -> tuple[bytearray, int]:
    """A serialised message, and the place of its stamp."""
    store = get_typestore(STORES[kind])
    one = imu(store, 1 if kind == "ros1" else 2, 0x01020304 * 1_000_000_000, 0.5)
    data = bytearray(store.serialize_ros1(one, TYPE) if kind == "ros1" else store.serialize_cdr(one, TYPE))
    return data, data.index(b"\4\3\2\1")


def write(path: Path, kind: str, megabytes: float) -> int:
    """Write a bag; returns the number of messages."""
    data, at = template_of(kind)
    count = int(megabytes * 1e6 / (len(data) + 50))
    bag: Any = Writer1(path) if kind == "ros1" else Writer2(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
    with bag:
        connection = bag.add_connection("/imu/data", TYPE, typestore=get_typestore(STORES[kind]))
        for k in range(count):
            when = START_NS + k * 1_000_000_000 // RATE_HZ
            struct.pack_into("<iI", data, at, *divmod(when, 1_000_000_000))
            bag.write(connection, when, bytes(data))
    return count


def with_rosbags(path: Path) -> int:
    """The yardstick."""
    rows = []
    with AnyReader([path]) as bag:
        for connection, when, raw in bag.messages():
            rate: Any = bag.deserialize(raw, connection.msgtype).angular_velocity  # type: ignore[attr-defined]
            rows.append((when, rate.x, rate.y, rate.z))
    times, *columns = zip(*rows, strict=True)
    return int(pa.table([times, *columns], names=["time", "x", "y", "z"]).num_rows)


def main() -> None:
    """The command line."""
    parser = options_of(__doc__.partition("\n")[0])
    parser.add_argument("--mb", type=float, default=300.0, help="size of each bag")
    options = parser.parse_args()
    figures: dict[str, Any] = {"mb": options.mb, "budget": {"ratio": 3}}
    for kind in STORES:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / ("imu.bag" if kind == "ros1" else "imu")
            count = write(path, kind, options.mb)
            spent = {}
            for name, read in (("imuscope_s", with_imuscope), ("yardstick_s", with_rosbags)):
                began = time.perf_counter()
                if read(path) != count:
                    sys.exit(f"{name}: rows are missing")
                spent[name] = time.perf_counter() - began
            figures[kind] = {"messages": count, **spent, "ratio": spent["yardstick_s"] / spent["imuscope_s"]}
    report("bags", figures)


if __name__ == "__main__":
    main()
