"""ROS 2 bags: a folder with metadata.yaml and one file, which `ros2 bag`, PlotJuggler, Foxglove and rosbags open.

    /imu/imu/data …         the topics of the bridge (messages.py), with its axes, units, frames and covariances; in a
                            recording without them, below the name of the device: /mti_630/imu/data
    /imu/clock/DID_IMU      sensor_msgs/msg/TimeReference: the device's own clock at the time of the stamp
    header.stamp            the time axis of the recording
    time of the bag         arrival at the host

Messages of ROS, of a bag or of topics, are copied as they came (bag_copy.py).

What no message holds is named in metadata.yaml, as custom data `imuscope.left_out`; `imuscope.rows_left_out` counts the
samples without a message, because a number of theirs is missing, by topic; `imuscope.segments` has the times at which a
segment of a clock begins, unix s by device.

Source: rosbag2 (docs.ros.org), "metadata.yaml", version 8, which Humble reads as well.
"""

import json
from collections.abc import Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.exporters.message_table import windows
from imuscope.recordings.exporters.request import ExportError, ExportRequest, ExportStep
from imuscope.recordings.tables.time_units import UNITS
from imuscope.server.devices.decode.protocol_set import sensors_of
from imuscope.server.extensions.ros2 import type_support
from imuscope.server.extensions.ros2.bag_copy import copy_messages
from imuscope.server.extensions.ros2.key_expressions import name_of, node_names
from imuscope.server.extensions.ros2.message_builder import FrameNames, MessageBuilder
from imuscope.server.extensions.ros2.messages import builders_of, clock_builder
from imuscope.server.extensions.ros2.quantities import HINT, Place, recorded_quantities
from imuscope.server.wire.codec import SampleFrame

CHUNK_ROWS = 512  # of the busiest channel at once: fewer than a join keeps
ATTITUDE, TRANSFORM = "imu/data", "/tf"


def write_bag(storage: str, request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """Write the bag; returns its folder.

    Raises:
        ExportError: no message holds any of the channels.
    """
    writer = Writer(out, version=8, storage_plugin=StoragePlugin[storage])
    if storage == "MCAP":
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)  # of the chunks in the file
    writer.set_custom_data("imuscope.recording", request.title)
    segments = {device: begins for device, begins in request.columns.manifest.get("segments", {}).items() if begins}
    writer.set_custom_data("imuscope.segments", json.dumps(segments))
    done = 0
    with writer:
        copied = copy_messages(request, writer, step)
        infos = [
            info
            for info in (*request.infos, *request.clocks, *request.payloads)
            if (info["device"], info["message"]) not in copied
        ]
        as_sent = request.columns.in_units("device")  # bit by bit, where that is what ROS has
        sent = {
            info["id"]: info
            for info in as_sent.manifest["channels"]
            if {one["unit"] for one in info["columns"]} <= {"rad/s", "T"}
        }
        topics = [one for device in as_sent.manifest["devices"] for one in _topics(request, device, infos, sent)]
        held = {channel for _, builder in topics for channel in builder.channels}
        left_out = ", ".join(f"{info['message']}/{info['name']}" for info in infos if info["id"] not in held)
        writer.set_custom_data("imuscope.left_out", left_out)
        ranges = {info["id"]: request.rows(info["id"]) for info in infos if info["id"] in held}
        total = sum(past - first for first, past in ranges.values())
        if not total and not copied:
            raise ExportError("No message of ROS holds these channels.", HINT)
        connections = {
            topic: writer.add_connection(
                topic, kind, msgdef=type_support.definition(kind), rihs01=type_support.type_hash(kind)
            )
            for topic, kind in {topic: builder.type for topic, builder in topics}.items()
        }
        for window in windows(request.columns, ranges, CHUNK_ROWS):
            samples = {
                channel: [_frame(as_sent if channel in sent else request.columns, channel, *rows)]
                for channel, rows in window.items()
                if rows[1] > rows[0]
            }
            messages = [
                (arrival, topic, data)
                for topic, builder in topics
                for arrival, data in zip(*builder.build_with_arrivals(samples, waits=False), strict=True)
            ]
            for arrival, topic, data in sorted(messages, key=itemgetter(0)):
                writer.write(connections[topic], arrival, data)
            done += sum(past - first for first, past in window.values())
            step(done / total)
        rows_left_out = {topic: one.left_out for topic, one in topics if one.left_out}
        writer.set_custom_data("imuscope.rows_left_out", json.dumps(rows_left_out))
    return [out]


def _topics(
    request: ExportRequest,
    device: Mapping[str, Any],
    infos: Sequence[Mapping[str, Any]],
    sent: Mapping[int, Mapping[str, Any]],
) -> list[tuple[str, MessageBuilder]]:
    name = device.get("topic") or node_names(request.columns.manifest["devices"])[device["id"]]
    frames = FrameNames(name)
    builders = builders_of(
        recorded_quantities(device, [sent.get(info["id"], info) for info in request.infos if info in infos]),
        frames,
        sensors_of(device["protocol"], device.get("product", "")),
    )
    if ATTITUDE in builders:  # a transform would give the frame of the device a second parent on a robot
        builders.pop(TRANSFORM, None)
    for info in request.clocks:
        of_this = info["device"] == device["id"] and info in infos
        for at, column in enumerate(info["columns"] if of_this else ()):
            if scale := UNITS.get(column["unit"], 0.0):
                place = Place(info["id"], (at,), info["message"], 1e9 * scale)
                source = f"{info['message']}.{column['name']}"
                builders.setdefault(f"clock/{name_of(info['message'])}", clock_builder(place, frames, source))
    return [(topic if topic.startswith("/") else f"/{name}/{topic}", one) for topic, one in builders.items()]


def _frame(columns: ColumnStore, channel: int, first: int, past: int) -> SampleFrame:
    rows = columns.exact(channel, first, past)
    return SampleFrame(channel, 0, len(rows), 0, False, 0.0, [rows.arrival_ns, rows.time_ns, *rows.columns])
