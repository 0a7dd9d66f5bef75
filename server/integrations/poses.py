"""How does each device lie now, where has it been, which way do gravity and the field point? For a scene in 3D. Pure.

Everything is brought into one world, ENU (x east, y north, z up), whatever frame a device speaks
(recordings/rotations.py).

Gravity is the opposite of what an accelerometer at rest feels; both it and the field are vectors in body axes. Which
channel is the attitude and which the position is recordings/rrd/entities.py's decision, so that every view agrees.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recordings.rotations import ENU_FROM, READ, Quaternion, Vector, multiply
from recordings.rrd import entities, enu
from server.integrations.playout_buffer import PlayoutBuffer
from server.wire_codec import SampleFrame

Floats = NDArray[np.float64]
Info = Mapping[str, Any]

G = 9.80665  # m/s², standard gravity (CGPM 1901)
PACE_S = 0.1  # a track has no more points than that
TRACK_S = 600.0


class DeviceView:
    """One device, as a scene shows it.

    Args:
        device: which of its channels say what.
        infos: all its channels.
    Attributes:
        name: what it is called where names must differ.
        q_frame_from_body: attitude in the frame the device speaks, newest or played out; None before there is one.
        gravity: in body axes, in units of g; field: in body axes, any unit.
        place: newest position: metres east, north and up of its first one.
    """

    def __init__(self, device: entities.Device, infos: Sequence[Info]) -> None:
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
        """There are attitudes to play out."""
        return self._playout.waits

    @property
    def channels(self) -> list[int]:
        """What it must be told of."""
        used = [self._acceleration, self._field]
        used += [self.attitude.channel] if self.attitude else []
        used += [self.position.channel] if self.position else []
        return [number for number in used if number]

    @property
    def q_enu_from_body(self) -> Quaternion | None:
        q = self.q_frame_from_body
        return None if q is None else multiply(ENU_FROM[self.frame], q)

    def hear(self, samples: SampleFrame, heard: float | None = None) -> None:
        """Newer samples of a channel, or of a position older ones.

        Args:
            heard: when they came, monotonic, s: attitudes are to be played out with `play`. None: the newest is taken.
        """
        if samples.n == 0 or samples.channel not in self.channels:
            return
        own = samples.columns[2:]
        if self.position and samples.channel == self.position.channel:
            self._hear_place(samples)
        if samples.history:
            return
        if self.attitude and samples.channel == self.attitude.channel:
            if heard is None:
                self._turn([float(column[-1]) for column in own])
            else:
                self._playout.hear(samples, heard)
        elif samples.channel == self._acceleration:
            self.gravity = _direction([-float(column[-1]) / G for column in own])
        elif samples.channel == self._field:
            self.field = _direction([float(column[-1]) for column in own])

    def play(self, now: float) -> None:
        """Bring the attitude to what is to be shown now (monotonic, s)."""
        values = self._playout.at(now)
        if values is not None:
            self._turn(values)

    def _turn(self, values: Sequence[float]) -> None:
        assert self.attitude is not None
        self.q_frame_from_body = READ[self.attitude.kind](values) or self.q_frame_from_body

    def track(self, seconds: float) -> Floats:
        """Where it was in its last so many seconds.

        Returns:
            (n, 3) float64: metres east, north and up of its first place.
        """
        if len(self._track) == 0:
            return np.zeros((0, 3))
        return self._track[self._track[:, 0] >= self._track[-1, 0] - seconds, 1:]

    def forget_track(self) -> None:
        """Begin anew: what is played has jumped."""
        self._track = np.zeros((0, 4))

    def _hear_place(self, samples: SampleFrame) -> None:
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
        """Rows of time, east, north, up; those that are no places left out."""
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


def looks_of(devices: Sequence[Mapping[str, Any]], channels: Sequence[Info]) -> list[DeviceView]:
    """All devices that tell how they lie, in order."""
    found = [
        DeviceView(device, [info for info in channels if info["device"] == device.id])
        for device in entities.devices_of(devices, channels)
    ]
    return [look for look in found if look.attitude]


def _vector(infos: Sequence[Info], title: re.Pattern[str], unit: str | None) -> int:
    for info in infos:
        right = info["kind"] == "vector" and len(info["columns"]) == 3 and title.match(str(info["title"]))
        if right and (unit is None or info["unit"] == unit):
            return int(info["id"])
    return 0


def _direction(v: Sequence[float]) -> Vector | None:
    return (v[0], v[1], v[2]) if 1e-9 < math.hypot(*v) < 1e9 else None
