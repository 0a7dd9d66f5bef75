"""Attitudes, positions and events as the messages that other people's viewers have panels for.

    /MTi-630/attitude     foxglove.FrameTransform, from ENU to the device
    /MTi-630/position     foxglove.LocationFix
    /events               foxglove.Log

The live Foxglove server and the plottable export both speak so. Which channel is the attitude and which the position is
recordings/rrd/entities.py's decision, so that every view agrees. Foxglove's SDK writes the messages; it is imported
with this file, which whoever needs none of them leaves alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from foxglove.messages import FrameTransform, LocationFix, Log, LogLevel, Quaternion, Timestamp, Vector3
from numpy.typing import NDArray

from recordings.rotations import ENU_FROM, READ, multiply
from recordings.rrd.entities import Attitude, Position
from recordings.rrd.enu import is_place

__all__ = ["ATTITUDE", "POSITION", "FrameTransform", "LocationFix", "Log", "fixes", "heights", "logged", "transforms"]

Array = NDArray[Any]
Times = NDArray[np.int64]
Message = tuple[int, bytes]  # of which row it is, protocol buffer

ATTITUDE, POSITION = "attitude", "position"  # last words of their topics
WORLD = "ENU"
LEVELS = {"caution": LogLevel.Warning, "fault": LogLevel.Error}
_NOWHERE = Vector3(x=0.0, y=0.0, z=0.0)


def transforms(name: str, attitude: Attitude, columns: Sequence[Array], times: Times) -> Iterator[Message]:
    """How a device lies; what is no rotation is left out.

    Args:
        name: what the device is called where names must differ.
        columns: of the attitude's channel, (n,) each.
        times: (n,) ns since 1970.
    """
    read, turn = READ[attitude.kind], ENU_FROM[attitude.frame]
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for number, (time, row) in enumerate(zip(times.tolist(), rows, strict=True)):
        q = read(row)
        if q is None:
            continue
        w, x, y, z = multiply(turn, q)
        message = FrameTransform(
            timestamp=stamp(time),
            parent_frame_id=WORLD,
            child_frame_id=name,
            translation=_NOWHERE,
            rotation=Quaternion(x=x, y=y, z=z, w=w),
        )
        yield number, message.encode()


def fixes(name: str, position: Position, columns: Sequence[Array], height: Array, times: Times) -> Iterator[Message]:
    """Where a device is, in latitude and longitude; what can be no place is left out.

    Args:
        name: what the device is called where names must differ.
        columns: of the position's channel, (n,) each.
        height: (n,) m; of use where the channel tells none.
        times: (n,) ns since 1970.
    """
    lat, lon = columns[position.columns[0]], columns[position.columns[1]]
    high = columns[position.columns[2]] if position.columns[2] >= 0 else height
    there = np.flatnonzero(is_place(lat, lon))
    rows = (part[there].tolist() for part in (times, lat, lon, high))
    for number, time, a, b, c in zip(there.tolist(), *rows, strict=True):
        yield number, LocationFix(timestamp=stamp(time), frame_id=name, latitude=a, longitude=b, altitude=c).encode()


def heights(told: Times, values: Array, times: Times) -> Array:
    """Heights that come in a channel of their own: of the same moment, else the last before; 0 where there are none.

    Args:
        told, values: (m,) when they came, ns, and what they say, m.
        times: (n,) when a place is asked for, ns.
    """
    if not len(told):
        return np.zeros(len(times))
    return values[np.maximum(np.searchsorted(told, times, "right") - 1, 0)]


def logged(event: Mapping[str, Any], name: str) -> tuple[int, bytes]:
    """What happened: when, ns since 1970, and the message.

    Args:
        event: server/wire.py Event.
        name: of its device; "" of none.
    """
    time = round(event["time"] * 1e9)
    level = LEVELS.get(event["level"], LogLevel.Info)
    words = Log(timestamp=stamp(time), level=level, message=str(event["text"]), name=name or "imuscope")
    return time, words.encode()


def stamp(time: int) -> Timestamp:
    """A moment, ns since 1970."""
    return Timestamp(time // 1_000_000_000, time % 1_000_000_000)
