"""Channels and samples for tests of ROS messages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.server.extensions.ros2.message_builder import FrameNames
from imuscope.server.extensions.ros2.messages import builders_of
from imuscope.server.extensions.ros2.quantities import quantities_of
from imuscope.server.wire.codec import SampleFrame

T0 = 1_795_000_000.0
deserialize = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr


def info(number: int, title: str, columns: dict[str, str], **more: Any) -> dict[str, Any]:
    """A channel with these columns and units."""
    units = set(columns.values())
    return {
        "id": number,
        "device": "1",
        "message": "M",
        "name": title,
        "title": title,
        "kind": "vector",
        "unit": units.pop() if len(units) == 1 else "",
        "frame": "",
        "group": "",
        "columns": [{"name": name, "unit": unit, "choices": {}} for name, unit in columns.items()],
        **more,
    }


def frame(channel: int, times: Sequence[float], *columns: Sequence[float], arrival: float = 0.0) -> SampleFrame:
    """Samples of a channel; times are seconds after T0."""
    time = T0 + np.asarray(times, np.float64)
    own = [np.asarray(column) for column in columns]
    return SampleFrame(channel, 0, len(time), 0, False, T0, [time + arrival, time, *own])


def xyz(unit: str) -> dict[str, str]:
    return dict.fromkeys("xyz", unit)


DEVICE = {"id": "1", "name": "IMU"}
FRAMES = FrameNames("imu0", "map")
TURN = info(1, "Rate of turn", xyz("°/s"))
ACCELERATION = info(2, "Acceleration", xyz("m/s²"))
QUATERNION = info(
    3, "Quaternion", dict.fromkeys(("w", "x", "y", "z"), ""), kind="quaternion", frame="ENU from body", message="Q"
)


def built(
    topic: str,
    channels: list[dict[str, Any]],
    *batches: Iterable[SampleFrame],
    noise: SensorProperties = SensorProperties(),  # noqa: B008 - it is frozen
    frames: FrameNames = FRAMES,
) -> list[Any]:
    """The messages of a topic, from samples that come in these batches."""
    builder = builders_of(quantities_of(DEVICE, channels), frames, noise)[topic]
    results = []
    for batch in batches:
        samples: dict[int, list[SampleFrame]] = {}
        for one in batch:
            samples.setdefault(one.channel, []).append(one)
        results += [deserialize(data, builder.type) for data in builder.build(samples)]
    return results


def vector(value: Any) -> list[float]:
    return [value.x, value.y, value.z]
