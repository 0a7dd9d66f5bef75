"""MCAP files, read by imuscope's reader and the official one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from imuscope.recordings.mcap.reader import CHANNEL_ID, DATA, LENGTH, TIME, McapReader

OF_ROS = """================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
"""Definitions that the messages of tests contain, as the text of a schema has them after its own."""
ABOUT = {"title": "A drive", "created": "2026-11-21T04:00:00Z", "host": "rover", "version": "0.1.0"}


Message = tuple[str, int, bytes]


def read(path: Path) -> list[Message]:
    with McapReader(path) as recording:
        return messages(recording)


def messages(recording: McapReader) -> list[Message]:
    return [
        (recording.topics[channel].topic, time, bytes(block.data[at : at + size]))
        for block in recording.blocks()
        for channel, time, at, size in block.table[[CHANNEL_ID, TIME, DATA, LENGTH]].T.tolist()
    ]


def json_messages(recording: McapReader, topic: str) -> list[tuple[int, dict[str, Any]]]:
    """Time and body of every message of a channel ("events", "notes", "snapshot/…")."""
    return [(time, json.loads(body)) for name, time, body in messages(recording) if name == topic]


def theirs(path: Path) -> list[Message]:
    """Messages according to the standard reader."""
    with path.open("rb") as file:
        reader = make_reader(file)
        results = reader.iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in results]
