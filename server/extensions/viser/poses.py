"""Pose of each device: attitude, track, gravity and magnetic field. Pure; used by the 3D scene.

Everything is converted to one world frame, ENU (x east, y north, z up), whatever the frame of a device
(protocols/rotations.py).

Gravity is the opposite of the acceleration measured at rest; gravity and field are vectors in body axes.
recordings/exporters/entities.py chooses the channels of attitude and position, so that all views agree.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.rotations import Quaternion, Vector, quaternions
from imuscope.recordings.exporters import entities, enu
from imuscope.server.extensions.viser.playout_buffer import PlayoutBuffer
from imuscope.server.wire.codec import SampleFrame

Info = Mapping[str, Any]

G = 9.80665  # m/s², standard gravity (CGPM 1901)
PACE_S = 0.1  # shortest interval between points of a track
TRACK_S = 600.0


class DeviceView:
    """One device in a scene.

    Args:
        device: assignment of its channels.
        infos: all its channels.

    Attributes:
        name: unique name.
        q_frame_from_body: attitude in the frame of the device, newest or played out; None before the first one.
        gravity: in body axes, in units of g; field: in body axes, any unit.
        place: newest position: metres east, north and up of its first one.
    """

    def __init__(self, device: entities.DeviceEntity, infos: Sequence[Info]) -> None:
        self.id, self.title, self.name = device.id, device.title, device.name
        self.attitude, self.position = device.attitude, device.position
        self.frame = device.attitude.frame if device.attitude else "ENU"
        self._acceleration = _vector(infos, re.compile("^acceleration", re.I), "m/s²")
        self._field = _vector(infos, re.compile("^magnetic", re.I), None)
        self.q_frame_from_body: Quaternion | None = None
        self.gravity: Vector | None = None
        self.field: Vector | None = None
        self.place: Vector | None = None
        self._origin: enu.Origin | None = None
        self._track: Floats = np.zeros((0, 4))  # time (unix s), east, north, up; ascending
        self._playout = PlayoutBuffer()

    @property
    def waits(self) -> bool:
        """Whether attitudes are waiting to be played out."""
        return self._playout.waits

    @property
    def channels(self) -> list[int]:
        """Channels that it needs."""
        used = [self._acceleration, self._field]
        used += [self.attitude.channel] if self.attitude else []
        used += [self.position.channel] if self.position else []
        return [number for number in used if number]

    def update(self, samples: SampleFrame, received_at: float | None = None) -> None:
        """Add newer samples of a channel, or older ones of a position.

        Args:
            received_at: arrival, monotonic, s: attitudes are played out with `play`. None: use the newest.
        """
        if samples.n == 0 or samples.channel not in self.channels:
            return
        own = samples.columns[2:]
        if self.position and samples.channel == self.position.channel:
            self._add_positions(samples)
        if samples.history:
            return
        if self.attitude and samples.channel == self.attitude.channel:
            if received_at is None:
                self._rotation([float(column[-1]) for column in own])
            else:
                self._playout.add(samples, received_at)
        elif samples.channel == self._acceleration:
            self.gravity = _direction([-float(column[-1]) / G for column in own])
        elif samples.channel == self._field:
            self.field = _direction([float(column[-1]) for column in own])

    def play(self, now: float) -> None:
        """Set the attitude to be shown now (monotonic, s)."""
        values = self._playout.due(now)
        if values is not None:
            self._rotation(values)

    def _rotation(self, values: Sequence[float]) -> None:
        assert self.attitude is not None
        w, x, y, z = quaternions(self.attitude.kind, list(np.reshape(values, (-1, 1))))[0].tolist()
        if not math.isnan(w):
            self.q_frame_from_body = (w, x, y, z)

    def track(self, seconds: float) -> Floats:
        """Track of the last seconds.

        Returns:
            (n, 3) float64: metres east, north and up of its first position.
        """
        if len(self._track) == 0:
            return np.zeros((0, 3))
        return self._track[self._track[:, 0] >= self._track[-1, 0] - seconds, 1:]

    def forget_track(self) -> None:
        """Start a new track after a jump of the playhead."""
        self._track = np.zeros((0, 4))

    def _add_positions(self, samples: SampleFrame) -> None:
        rows = self._places(samples)
        if len(rows) == 0:
            return
        if not samples.history:
            self.place = (rows[-1, 1], rows[-1, 2], rows[-1, 3])
        last = self._track[-1, 0] if len(self._track) and not samples.history else -math.inf
        rows = rows[rows[:, 0] >= last + PACE_S]
        rows = rows[np.diff(np.floor(rows[:, 0] / PACE_S), prepend=-math.inf) > 0]
        if len(rows) == 0:
            return
        both = (rows, self._track) if samples.history else (self._track, rows)
        track = np.concatenate(both)
        self._track = track[track[:, 0] >= track[-1, 0] - TRACK_S]

    def _places(self, samples: SampleFrame) -> Floats:
        """Rows of time, east, north, up, without invalid positions."""
        assert self.position is not None
        own = samples.columns[2:]
        a, b, c = ((own[i] if i >= 0 else np.zeros(samples.n)).astype(np.float64) for i in self.position.columns)
        time = samples.columns[0]
        if self.position.kind == "local":
            there = np.isfinite(a) & np.isfinite(b) & np.isfinite(c)
            return np.column_stack((time, b, a, -c))[there]
        there = enu.is_place(a, b)
        if not there.any():
            return np.zeros((0, 4))
        lat, lon, height = a[there], b[there], np.nan_to_num(c[there])
        if self._origin is None:
            self._origin = enu.Origin(float(lat[-1]), float(lon[-1]), float(height[-1]))
        return np.column_stack((time[there], enu.enu_of(lat, lon, height, self._origin)))


def device_views(devices: Sequence[Mapping[str, Any]], channels: Sequence[Info]) -> list[DeviceView]:
    """All devices with an attitude, in order."""
    views = [
        DeviceView(device, [info for info in channels if info["device"] == device.id])
        for device in entities.devices_of(devices, channels)
    ]
    return [view for view in views if view.attitude]


def _vector(infos: Sequence[Info], title: re.Pattern[str], unit: str | None) -> int:
    for info in infos:
        right = info["kind"] == "vector" and len(info["columns"]) == 3 and title.match(str(info["title"]))
        if right and (unit is None or info["unit"] == unit):
            return int(info["id"])
    return 0


def _direction(v: Sequence[float]) -> Vector | None:
    return (v[0], v[1], v[2]) if 1e-9 < math.hypot(*v) < 1e9 else None
