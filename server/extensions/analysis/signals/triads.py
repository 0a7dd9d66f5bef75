"""The sensors of a device: which of its channels are gyroscope, accelerometer and magnetometer, and their samples.

    Acceleration  x y z  m/s²    ─> accelerometer        MagneticField  x y z  a.u., µT     ─> magnetometer
    RateOfTurn    x y z  °/s     ─> gyroscope            Temperature    °C

A channel is recognised by its title and unit, as for the data sheets (data_sheet.py); where none has such a title, a
rate of turn or an acceleration by its unit alone. Data sets with several sensors have columns imu.pqr.x ….
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import Unit
from imuscope.server.wire import ChannelInfo

_NAMES: dict[str, tuple[re.Pattern[str], str]] = {
    "gyroscope": (re.compile(r"rate.?of.?turn|angular.?(rate|velocity)|gyr|pqr", re.I), "rad/s"),
    "accelerometer": (re.compile(r"accel|specific.?force|(^|\.)acc", re.I), "m/s²"),
    "magnetometer": (re.compile(r"magn|(^|\.)mag", re.I), ""),
}
SHOWN_UNITS = {"gyroscope": "°/s", "accelerometer": "m/s²"}
_NOT = re.compile(
    r"free.?accel|linear.?accel|gravity|increment|uncal|raw|std|deviation|bias|high.?rate|reference", re.I
)


@dataclass(frozen=True, slots=True)
class Triad:
    """Three columns of a channel that are one sensor.

    Attributes:
        at: positions of x, y and z among the columns.
        name: of the channel, and of the group of columns within it if there are several.
        factor: to the unit of the calibration: °/s, m/s²; 1 for a magnetometer.
        unit: of the calibration.
        others: further sensors of its kind on the device: "RateOfTurn of Imu6".
    """

    info: ChannelInfo
    at: tuple[int, int, int]
    name: str
    factor: float
    unit: str
    others: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """Name and message, unique on its device."""
        return f"{self.name} of {self.info.message}" if self.info.message else self.name


@dataclass(frozen=True, slots=True)
class Samples:
    """Samples of a triad: times (n,) unix s, non-decreasing, and values (n, 3), all finite."""

    time: Floats
    values: Floats

    def __len__(self) -> int:
        return len(self.time)

    @property
    def rate(self) -> float:
        """Usual rate, Hz; 0 if unknown."""
        if len(self) < 3:
            return 0.0
        step = float(np.median(np.diff(self.time)))
        return 1 / step if step > 0 else 0.0

    def at(self, chosen: slice | NDArray[np.int64] | NDArray[np.bool_]) -> "Samples":
        """Some of them."""
        return Samples(self.time[chosen], self.values[chosen])


NO_SAMPLES = Samples(np.empty(0), np.empty((0, 3)))


def sensors_in(infos: Iterable[ChannelInfo]) -> dict[str, Triad]:
    """The sensors of one device, by the words of `_NAMES` and the unit; of several of a kind the plainest channel."""
    by_sensor: dict[str, list[Triad]] = {}
    for info in infos:
        for triad in triads_in(info):
            for sensor, (name, si) in _NAMES.items():
                unit, shown = Unit.parse(triad.unit), SHOWN_UNITS.get(sensor, triad.unit)
                fits = any(unit.fits(Unit.parse(one)) for one in ([si] if si else ("rad/s", "m/s²")))
                if _NOT.search(triad.name) or fits != bool(si) or not (si or name.search(triad.name)):
                    continue
                factor = unit.to(Unit.parse(shown)) if si else 1.0
                by_sensor.setdefault(sensor, []).append(replace(triad, factor=factor, unit=shown))
                break
    # one of that title; a channel of its own before a part of a data set; the newest of those with one name
    return {sensor: _plainest(sensor, those) for sensor, those in by_sensor.items()}


def _plainest(sensor: str, those: Sequence[Triad]) -> Triad:
    """The one of several that is taken, which names the others."""
    chosen = min(
        those,
        key=lambda one: (
            not _NAMES[sensor][0].search(one.name),
            one.info.kind != "vector",
            len(one.name),
            -one.info.id,
        ),
    )
    others = {one.title for one in those if _NAMES[sensor][0].search(one.name)} - {chosen.title}
    return replace(chosen, others=tuple(sorted(others)))


def temperature_in(infos: Iterable[ChannelInfo]) -> tuple[ChannelInfo, int] | None:
    """Channel and column of a temperature in °C, if there is one."""
    for info in infos:
        for at, column in enumerate(info.columns):
            if column.unit == "°C":
                return info, at
    return None


def triads_in(info: ChannelInfo) -> list[Triad]:
    """Columns x, y, z that follow one another, in their own unit, each named by the words that say what it is."""
    if info.kind not in ("vector", "record") or not info.verified:
        return []
    triads = []
    columns = info.columns
    for at in range(len(columns) - 2):
        heads = [_head(columns[at + k].name, "xyz"[k]) for k in range(3)]
        units = {columns[at + k].unit for k in range(3)}
        if None in heads or any(a != b for a, b in pairwise(heads)) or len(units) > 1:
            continue
        own = (heads[0] or "").rstrip("._[")
        words = f"{info.name}.{own}" if own else info.name if info.kind == "record" else f"{info.name}"
        triads.append(Triad(info, (at, at + 1, at + 2), words, 1.0, columns[at].unit))
    return triads


def _head(name: str, axis: str) -> str | None:
    """The part of a column's name before its axis; None if it ends otherwise."""
    lower = name.lower()
    return name[: -len(axis)] if lower.endswith(axis) and (len(name) == 1 or not name[-2].isalnum()) else None


def gather(triad: Triad, read: Callable[[ChannelInfo, Sequence[int]], tuple[Floats, list[Floats]]]) -> Samples:
    """Samples of a triad in the unit of the calibration, without those that are not finite."""
    time, columns = read(triad.info, triad.at)
    return finite(time, np.stack(columns, axis=1) * triad.factor if columns else np.empty((0, 3)))


def finite(time: Floats, values: Floats) -> Samples:
    """Samples without those that are not finite."""
    is_finite = np.isfinite(values).all(axis=1) & np.isfinite(time)
    return Samples(np.maximum.accumulate(time[is_finite]), values[is_finite])
