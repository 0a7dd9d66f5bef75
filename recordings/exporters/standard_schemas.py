"""Attitudes, positions and events as the standard messages that other viewers have panels for.

    /MTi-630/attitude     foxglove.FrameTransform, from ENU to the device
    /MTi-630/position     foxglove.LocationFix
    /events               foxglove.Log

Both the live Foxglove server and the decoded MCAP export use these. recordings/exporters/entities.py chooses the
attitude and position channels, so that all views agree. Foxglove's SDK encodes the messages; it is imported with this
module, which is imported only where they are needed.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from foxglove.messages import FrameTransform, LocationFix, Log, LogLevel, Quaternion, Timestamp, Vector3
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array
from imuscope.protocols.rotations import ENU_FROM, multiply, quaternions
from imuscope.recordings.exporters.entities import Attitude, PositionEntity
from imuscope.recordings.exporters.enu import is_place

__all__ = ["ATTITUDE", "POSITION", "FrameTransform", "LocationFix", "Log", "fixes", "heights", "logged", "transforms"]

Times = NDArray[np.int64]
Message = tuple[int, bytes]  # row index, protocol buffer

ATTITUDE, POSITION = "attitude", "position"  # last words of their topics
WORLD = "ENU"
LEVELS = {"warning": LogLevel.Warning, "error": LogLevel.Error}
_NOWHERE = Vector3(x=0.0, y=0.0, z=0.0)


def transforms(name: str, attitude: Attitude, columns: Sequence[Array], times: Times) -> Iterator[Message]:
    """Transforms of a device; invalid rotations are left out.

    Args:
        name: of the device, made unique where needed.
        columns: of the attitude's channel, (n,) each.
        times: (n,) ns since 1970.
    """
    turn = ENU_FROM[attitude.frame]
    rows = quaternions(attitude.kind, columns).tolist()
    for number, (time, row) in enumerate(zip(times.tolist(), rows, strict=True)):
        if row[0] != row[0]:  # NaN
            continue
        w, x, y, z = multiply(turn, row)
        message = FrameTransform(
            timestamp=stamp(time),
            parent_frame_id=WORLD,
            child_frame_id=name,
            translation=_NOWHERE,
            rotation=Quaternion(x=x, y=y, z=z, w=w),
        )
        yield number, message.encode()


def fixes(
    name: str, position: PositionEntity, columns: Sequence[Array], height: Array, times: Times
) -> Iterator[Message]:
    """Position fixes of a device; implausible positions are left out.

    Args:
        name: of the device, made unique where needed.
        columns: of the position's channel, (n,) each.
        height: (n,) m; used if the channel has no heights.
        times: (n,) ns since 1970.
    """
    lat, lon = columns[position.columns[0]], columns[position.columns[1]]
    high = columns[position.columns[2]] if position.columns[2] >= 0 else height
    there = np.flatnonzero(is_place(lat, lon))
    rows = (part[there].tolist() for part in (times, lat, lon, high))
    for number, time, a, b, c in zip(there.tolist(), *rows, strict=True):
        yield number, LocationFix(timestamp=stamp(time), frame_id=name, latitude=a, longitude=b, altitude=c).encode()


def heights(height_times: Times, values: Array, times: Times) -> Array:
    """Heights from a separate channel: at the same time, else the last one before; 0 if there are none.

    Args:
        height_times, values: (m,) their times, ns, and heights, m.
        times: (n,) of the positions, ns.
    """
    if not len(height_times):
        return np.zeros(len(times))
    return values[np.maximum(np.searchsorted(height_times, times, "right") - 1, 0)]


def logged(event: Mapping[str, Any], name: str) -> tuple[int, bytes]:
    """Log message of an event: time, ns since 1970, and the encoded message.

    Args:
        event: server/wire/ Event.
        name: of its device; "" if it has none.
    """
    time = round(event["time"] * 1e9)
    level = LEVELS.get(event["level"], LogLevel.Info)
    message = Log(timestamp=stamp(time), level=level, message=str(event["text"]), name=name or "imuscope")
    return time, message.encode()


def stamp(time: int) -> Timestamp:
    """Timestamp of a time in ns since 1970."""
    return Timestamp(time // 1_000_000_000, time % 1_000_000_000)
