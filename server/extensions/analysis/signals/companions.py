"""Companions of a signal: the other sensors of its device, by which rest is judged.

    gyroscope, accelerometer    all three axes of each (server/extensions/analysis/signals/triads.py)
    attitude                    quaternion, Euler angles or matrix, as quaternions
    clipping                    flags of the device's own status: "ClipAccX", "SATURATION_GYR"

A gyroscope that turns steadily looks like one at rest with a bias; gravity and the attitude distinguish the two.
"""

import functools
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.rotations import quaternions
from imuscope.server.extensions.analysis.signals.stillness import (
    FORCE_CHANGE,
    FORCE_SPREAD,
    TURN_CHANGE,
    TURN_SPREAD,
    StepMeans,
    moving_intervals,
    step_means,
)
from imuscope.server.extensions.analysis.signals.triads import (
    NO_SAMPLES,
    Samples,
    Triad,
    gather,
    sensors_in,
    triads_in,
)
from imuscope.server.wire import BitsInfo, ChannelInfo

ReadColumn = Callable[[ChannelInfo, int], tuple[Floats, Floats]]
"""Times and values of a column, by its position in the channel."""

_CLIPPING = re.compile(r"clip|saturat", re.I)
_OTHER_SENSOR = re.compile(r"mag|baro", re.I)
_ATTITUDE = {"quaternion": 4, "euler": 3, "matrix": 9}


@dataclass(frozen=True)
class Companions:
    """Samples of the sensors of one device over a range.

    Attributes:
        gyroscope: °/s.
        accelerometer: m/s².
        attitude: unit quaternions, (n, 4) scalar first.
        clipped: number of samples in which each flag for clipping was set, by its name.
        has_status: the device sends such flags.
    """

    gyroscope: Samples = NO_SAMPLES
    accelerometer: Samples = NO_SAMPLES
    attitude: Samples = NO_SAMPLES
    clipped: Mapping[str, int] = field(default_factory=dict)
    has_status: bool = False

    @functools.cached_property
    def moving(self) -> list[tuple[float, float]]:
        """Intervals in which one of its sensors shows motion, unix s."""
        return [
            *moving_intervals(self.gyroscope, TURN_SPREAD, TURN_CHANGE, self.steps[0]),
            *moving_intervals(self.accelerometer, FORCE_SPREAD, FORCE_CHANGE, self.steps[1]),
        ]

    @functools.cached_property
    def steps(self) -> tuple[StepMeans, StepMeans]:
        """Means of short intervals of gyroscope and accelerometer."""
        return step_means(self.gyroscope), step_means(self.accelerometer)


@dataclass(frozen=True, slots=True)
class CompanionChannels:
    """Positions of the companions among the channels of a device. They are read once: of one request."""

    triads: Mapping[str, Triad]
    attitude: ChannelInfo | None = None
    flags: Sequence[tuple[ChannelInfo, int, BitsInfo]] = ()
    _cache: list[Companions] = field(default_factory=list, compare=False, repr=False)

    def columns_beside(self, own: ChannelInfo, column: int) -> list[tuple[ChannelInfo, int]]:
        """The columns that are read beside one, by channel and position."""
        pairs = [(own, at) for triad in triads_in(own) if column in triad.at for at in triad.at]
        pairs += [(triad.info, at) for triad in self.triads.values() for at in triad.at]
        if self.attitude is not None:
            pairs += [(self.attitude, at) for at in range(_ATTITUDE[self.attitude.kind])]
        return pairs + [(info, at) for info, at, _ in self.flags]

    def read(self, read: ReadColumn) -> Companions:
        """Their samples."""
        if not self._cache:
            self._cache.append(self._read(read))
        return self._cache[0]

    def siblings(self, info: ChannelInfo, at: int, read: ReadColumn) -> StepMeans:
        """Means of short intervals of the triad that a column is an axis of; none if it is of none."""
        own = next((one for one in triads_in(info) if at in one.at), None)
        if own is None:
            return step_means(NO_SAMPLES)
        for place, name in enumerate(("gyroscope", "accelerometer")):
            known = self.triads.get(name)
            if known is not None and (known.info.id, known.at) == (info.id, own.at):
                return self.read(read).steps[place]
        return step_means(gather(own, columns_by(read)))

    def _read(self, read: ReadColumn) -> Companions:
        columns = columns_by(read)
        clipped = {}
        for info, at, bits in self.flags:
            values = read(info, at)[1]
            words = values[np.isfinite(values)].astype(np.int64)
            clipped[bits.name] = int(np.count_nonzero(words >> bits.low & ((1 << bits.width) - 1)))
        triads = {name: gather(triad, columns) for name, triad in self.triads.items()}
        return Companions(
            triads.get("gyroscope", NO_SAMPLES),
            triads.get("accelerometer", NO_SAMPLES),
            NO_SAMPLES if self.attitude is None else _attitude(self.attitude, columns),
            {name: count for name, count in clipped.items() if count},
            bool(self.flags),
        )


def columns_by(read: ReadColumn) -> Callable[[ChannelInfo, Sequence[int]], tuple[Floats, list[Floats]]]:
    """Times, and the values of several columns of a channel."""

    def columns(info: ChannelInfo, places: Sequence[int]) -> tuple[Floats, list[Floats]]:
        pairs = [read(info, at) for at in places]
        return pairs[0][0], [values for _, values in pairs]

    return columns


def companions_in(infos: Iterable[ChannelInfo], device: str) -> CompanionChannels:
    """The companions of a device's signals."""
    own = [info for info in infos if info.device == device and info.verified]
    triads = {name: triad for name, triad in sensors_in(own).items() if name != "magnetometer"}
    attitudes = [info for info in own if len(info.columns) == _ATTITUDE.get(info.kind, -1) and info.source != "page"]
    flags = [
        (info, at, bits)
        for info in own
        for at, column in enumerate(info.columns)
        for bits in column.bits
        if _CLIPPING.search(bits.name) and not _OTHER_SENSOR.search(bits.name)
    ]
    attitude = min(attitudes, key=lambda info: (info.kind != "quaternion", -info.id), default=None)
    return CompanionChannels(triads, attitude, flags)


def _attitude(info: ChannelInfo, read: Callable[[ChannelInfo, Sequence[int]], tuple[Floats, list[Floats]]]) -> Samples:
    time, columns = read(info, range(_ATTITUDE[info.kind]))
    values = quaternions(info.kind, columns)
    is_finite = np.isfinite(values).all(axis=1) & np.isfinite(time)
    return Samples(np.maximum.accumulate(time[is_finite]), values[is_finite])
