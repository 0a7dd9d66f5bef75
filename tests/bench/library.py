"""Benchmark of `imuscope.open`: a recording of ROS 2 at 1 kHz, opened, and one signal of it as Arrow.

    python -m tests.bench.library --minutes 6

The yardstick, in the same run, is what people use today for it: mcap's Python reader with its ROS 2 decoder, and a list
of the values. The file is sensor_msgs/Imu, CDR, in chunks compressed with lz4, as rosbag2 writes it.
"""

from __future__ import annotations

import struct
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pyarrow as pa
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

import imuscope
from tests.bench.support.report import options_of, report
from tests.recordings.readers.formats.bags import imu

RATE_HZ = 1000
START_NS = 1_700_000_000_000_000_000
BUDGET_RATIO = 10
TYPE = "sensor_msgs/msg/Imu"


def write(path: Path, minutes: float) -> int:
    """Write the recording; returns the number of messages."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    definition, _ = store.generate_msgdef(TYPE, ros_version=2)
    template = bytearray(store.serialize_cdr(imu(store, 2, 0, 0.5), TYPE))
    count = int(minutes * 60 * RATE_HZ)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(profile="ros2", library="bench")
        schema = writer.register_schema(name=TYPE, encoding="ros2msg", data=definition.encode())
        channel = writer.register_channel(topic="/imu/data", message_encoding="cdr", schema_id=schema)
        for k in range(count):
            at = START_NS + k * 1_000_000_000 // RATE_HZ
            struct.pack_into("<iI", template, 4, *divmod(at, 1_000_000_000))
            struct.pack_into("<d", template, 4 + 24, 0.001 * k)  # behind the name of the frame
            writer.add_message(channel, at, bytes(template), at, k & 0xFFFF)
        writer.finish()  # type: ignore[no-untyped-call]
    return count


def with_mcap(path: Path) -> int:
    """The yardstick."""
    from mcap_ros2.reader import read_ros2_messages

    rows = []
    for message in read_ros2_messages(str(path)):
        value: Any = message.ros_msg
        stamp = value.header.stamp
        rate = value.angular_velocity
        rows.append((stamp.sec + stamp.nanosec * 1e-9, rate.x, rate.y, rate.z))
    times, *columns = zip(*rows, strict=True)
    return int(pa.table([times, *columns], names=["time", "x", "y", "z"]).num_rows)


def with_imuscope(path: Path) -> int:
    with imuscope.open(path) as recording:
        [signal] = [one for one in recording if "angular_velocity" in one.name and len(one.columns) == 3]
        return int(signal.to_arrow().num_rows)


def main() -> None:
    """The command line."""
    parser = options_of(__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=6.0, help="length of the recording")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "imu.mcap"
        count = write(path, options.minutes)
        figures: dict[str, Any] = {"messages": count, "mb": path.stat().st_size / 1e6}
        for name, read in (("imuscope_s", with_imuscope), ("yardstick_s", with_mcap)):
            began = time.perf_counter()
            rows = read(path)
            figures[name] = time.perf_counter() - began
            if rows != count:
                sys.exit(f"{name}: {rows} of {count} rows")
    figures["ratio"] = figures["yardstick_s"] / figures["imuscope_s"]
    figures["budget"] = {"ratio": BUDGET_RATIO}
    report("library", figures)


if __name__ == "__main__":
    main()
