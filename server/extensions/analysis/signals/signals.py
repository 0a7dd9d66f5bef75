"""Signals: one column of a channel over a time range, from a recording or from the memory of a live device.

    Acceleration.x      one column            Acceleration      all columns of the channel, one after the other
    2/Acceleration.x    of device 2, if several devices have a channel of that name
    Imu6/Acceleration.x     of message Imu6, if several messages of a device have it; 2/Imu6/Acceleration.x of both

Names of channels may contain a point, so the longest name of a channel that fits is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.rows import ExactRows
from imuscope.recordings.columns.store import Base, ColumnStore
from imuscope.recordings.errors import near_miss
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.signals.companions import CompanionChannels, Companions
from imuscope.server.extensions.analysis.signals.stillness import StepMeans
from imuscope.server.library.range_query import query_columns, stored_values
from imuscope.server.streaming.channel_store import ChannelStore
from imuscope.server.wire import ChannelInfo

EULER_ANGLES = "EulerAngles"  # what the page derives from a quaternion is called so
ANGLES = ("roll", "pitch", "yaw")
MAX_VALUES = 50_000_000  # of one signal: 800 MB; an hour at 2 kHz has 7.2 million


@dataclass(frozen=True, slots=True)
class DataSheetNoise:
    """Noise of a sensor from its data sheet, in the unit of its signal; 0 for values that it does not contain.

    Attributes:
        product: name of the product.
        random_walk: unit/√Hz.
        bias_instability: unit; in-run bias stability.
    """

    product: str
    random_walk: float
    bias_instability: float


@dataclass(frozen=True, slots=True)
class Signal:
    """Samples of one column, without those that are not finite.

    Attributes:
        name: "Acceleration.x".
        unit: as on the page (server/streaming/channels.py, SHOWN).
        period: an angle wraps at this value; 0: it never wraps.
        time: (n,) unix s, non-decreasing: the device's clock mapped to host time, or arrival.
        values: (n,).
        notes: sentences on how it was computed, and how many samples were left out.
        left_out: the number of samples that were left out, because they are not finite.
        data_sheet: of the sensor it comes from; None if unknown.
        temperature: reads the times and values of its device's temperature, °C; None if that has none.
        companions: reads the other sensors of its device; None if they were not requested or it has no device.
        siblings: reads the means of short intervals of all axes of its triad; None as above.
        breaks: times at which the clock of its device steps, unix s: nothing is computed across them.
    """

    name: str
    unit: str
    period: float
    time: Floats
    values: Floats
    notes: tuple[str, ...] = ()
    left_out: int = 0
    data_sheet: DataSheetNoise | None = None
    temperature: Callable[[], tuple[Floats, Floats]] | None = field(default=None, compare=False)
    companions: Callable[[], Companions] | None = field(default=None, compare=False)
    siblings: Callable[[], StepMeans] | None = field(default=None, compare=False)
    breaks: tuple[float, ...] = ()

    @property
    def begins(self) -> NDArray[np.int64]:
        """First samples of the segments of its clock, without the first segment."""
        at = np.unique(np.searchsorted(self.time, np.array(self.breaks)))
        return at[(at > 0) & (at < len(self.time))]


@dataclass(frozen=True, slots=True)
class SignalColumn:
    """A column of a channel, as named in a request, with the data sheet of its sensor, the temperature and the other
    sensors of its device, the axes of its body ("FLU", "FRD") and the times at which its clock steps, if those are
    known. `message` is that of its channel if another message of the device has a channel of that name.
    """

    info: ChannelInfo
    at: int
    data_sheet: DataSheetNoise | None = None
    temperature: SignalColumn | None = None
    companions: CompanionChannels | None = None
    axes: str = ""
    breaks: tuple[float, ...] = ()
    message: str = ""

    @property
    def name(self) -> str:
        return f"{self.message and f'{self.message}/'}{self.info.name}.{self.info.columns[self.at].name}"

    @property
    def device(self) -> str:
        return self.info.device

    @property
    def columns(self) -> list[SignalColumn]:
        others = [] if self.companions is None else self.companions.columns_beside(self.info, self.at)
        return [self, *(SignalColumn(info, at) for info, at in others)]

    def signals(self, read: ReadSamples) -> list[Signal]:
        column = self.info.columns[self.at]
        signal = finite_signal(self.name, column.unit, column.period, *read(self))
        warmth, others = self.temperature, self.companions

        def column_of(info: ChannelInfo, at: int) -> tuple[Floats, Floats]:
            return read(SignalColumn(info, at))

        return [
            replace(
                signal,
                data_sheet=self.data_sheet,
                temperature=None if warmth is None else lambda: read(warmth),
                breaks=self.breaks,
                companions=None if others is None else lambda: others.read(column_of),
                siblings=None if others is None else lambda: others.siblings(self.info, self.at, column_of),
            )
        ]


ReadSamples = Callable[[SignalColumn], tuple[Floats, Floats]]
"""Times and values of a column, both (n,); values may be NaN. Columns of one channel have the same times."""


def grouped(count: int) -> str:
    """A count in words: 50 000 000."""
    return f"{count:,}".replace(",", " ")


def finite_signal(name: str, unit: str, period: float, time: Floats, values: Floats) -> Signal:
    """A signal of the finite ones among the samples; a note says how many are not."""
    finite = np.isfinite(values)
    left_out = len(values) - int(np.count_nonzero(finite))
    if not left_out:
        return Signal(name, unit, period, time, values)
    note = f"{grouped(left_out)} of {grouped(len(values))} samples of {name} are not finite numbers; they are left out."
    return Signal(name, unit, period, time[finite], values[finite], (note,), left_out)


def require_samples(signal: Signal) -> None:
    """Raise DomainError "not-found" for a signal without samples."""
    if len(signal.time):
        return
    if not signal.left_out:
        raise DomainError("not-found", f"{signal.name} has no samples in that range.", "Request another range.")
    message = (
        f"{signal.name} has {grouped(signal.left_out)} samples in that range, and each is infinite or not a number."
    )
    hint = "A division by 0 or the root of a negative number has no value: change the expression or the range."
    raise DomainError("not-found", message, hint)


def temperature_of(infos: Iterable[ChannelInfo], column: SignalColumn) -> SignalColumn | None:
    """The temperature of a column's device, in °C, the one of its own channel first; None for a temperature."""
    if column.info.columns[column.at].unit == "°C":
        return None
    columns = [
        SignalColumn(info, at)
        for info in infos
        if info.device == column.device and info.verified
        for at, one in enumerate(info.columns)
        if one.unit == "°C"
    ]
    return min(columns, key=lambda one: (one.info.id != column.info.id, one.info.id), default=None)


def columns_named(infos: Iterable[ChannelInfo], names: Sequence[str], device: str = "") -> list[SignalColumn]:
    """The columns with these names, in this order.

    Args:
        device: whose columns are meant by names without a device; "": the one device that has a channel of that name.

    Raises:
        DomainError: "not-found": that device has no such channel or column, never mind the others; "which-device":
            several devices have it; "which-message": several messages of one have it.
    """
    known = list(infos)
    return [column for name in names for column in _columns(known, name, device)]


def addressed_device(infos: Iterable[ChannelInfo], word: str) -> str:
    """The device that a word names, as in `2/Acceleration.x`; "" if it names none of these channels' devices."""
    device, slash, _ = word.partition("/")
    return device if slash and any(info.device == device for info in infos) else ""


def meant(infos: Sequence[ChannelInfo], others: Sequence[ChannelInfo], word: str) -> Sequence[ChannelInfo]:
    """The channels among which a name is looked up."""
    device, slash, _ = word.partition("/")
    return [info for info in others if slash and info.device == device] or infos


def angles_named(infos: Iterable[ChannelInfo], word: str, device: str = "") -> tuple[list[SignalColumn], str] | None:
    """The quaternion behind Euler angles that a device does not send, which the page shows as `EulerAngles.yaw`.

    Args:
        device: as for `columns_named`.

    Returns:
        Its columns, and the angle, "" for all; None for any other name.

    Raises:
        DomainError: "which-device": several devices have a quaternion.
    """
    known = list(infos)
    addressed = addressed_device(known, word)
    channel, _, angle = word.removeprefix(f"{addressed}/").partition(".")
    if channel != EULER_ANGLES or angle not in ("", *ANGLES):
        return None
    own = [info for info in known if info.device == (addressed or device or info.device)]
    rotations = [info for info in own if info.kind == "quaternion"]
    if not rotations or any(info.name == EULER_ANGLES for info in own):
        return None
    devices = sorted({info.device for info in rotations})
    if len(devices) > 1:
        hint = f"Name one: {', '.join(f'{one}/{word:.60}' for one in devices):.400}."
        raise DomainError("which-device", f"Several devices have {word:.60}.", hint)
    name = next((info.name for info in rotations if info.verified), rotations[0].name)
    if len(messages := {info.message for info in rotations if info.name == name}) > 1:
        hint = f"Name one with euler(…): {', '.join(f'{one}/{name:.60}' for one in sorted(messages)):.400}."
        raise DomainError("which-message", f"Several messages have {name:.60}.", hint)
    info = max((one for one in rotations if one.name == name), key=lambda one: one.id)
    return [SignalColumn(info, at) for at in range(len(info.columns))], angle


def _fitting(infos: Iterable[ChannelInfo], name: str) -> list[ChannelInfo]:
    """The channels that a name may begin with: those with the longest name that fits."""
    channels = [info for info in infos if name == info.name or name.startswith(f"{info.name}.")]
    length = max((len(info.name) for info in channels), default=0)
    return [info for info in channels if len(info.name) == length]


def signals_in(infos: Sequence[ChannelInfo]) -> list[str]:
    """Names of all channels that hold numbers, each as it has to be named."""
    devices = len({info.device for info in infos})
    names = (
        f"{f'{info.device}/' if devices > 1 else ''}{f'{info.message}/' if is_shared(info, infos) else ''}{info.name}"
        for info in infos
        if any(not column.bits and not column.choices for column in info.columns)
    )
    return list(dict.fromkeys(names))


def is_shared(info: ChannelInfo, infos: Iterable[ChannelInfo]) -> bool:
    """Whether another message of its device has a channel of that name."""
    return any(one.name == info.name and one.device == info.device and one.message != info.message for one in infos)


def _columns(infos: Sequence[ChannelInfo], word: str, device: str) -> list[SignalColumn]:
    addressed = addressed_device(infos, word)
    name = word.removeprefix(f"{addressed}/") if addressed else word
    device = addressed or device
    own = [info for info in infos if info.device == device] if device else infos
    fitting = _fitting(own, name)
    for info in own if not fitting else ():  # by its title
        if info.title and f"{name}.".startswith(f"{info.title}."):
            name = info.name + name[len(info.title) :]
            fitting = _fitting(own, name)
            break
    messages = {info.message for info in own if name.startswith(f"{info.message}/")} if not fitting else set()
    for message in messages:
        own, name = [info for info in own if info.message == message], name.removeprefix(f"{message}/")
        fitting = _fitting(own, name)
    if not fitting:
        there = f"Channels: {', '.join(sorted({info.name for info in own})):.400}."
        if others := sorted({f"{info.device}/{name:.60}" for info in _fitting(infos, name)}):
            there = f"Another device has it: {', '.join(others):.400}."
        columns = [f"{info.name}.{column.name}" for info in own for column in info.columns]
        near = near_miss(name, [*(info.name for info in own), *columns])
        raise DomainError("not-found", f"Signal {word:.60} not found{near}.", there)
    length = len(fitting[0].name)
    devices = sorted({info.device for info in fitting})
    if len(devices) > 1:
        hint = f"Name one: {', '.join(f'{one}/{word:.60}' for one in devices):.400}."
        raise DomainError("which-device", f"Several devices have {word:.60}.", hint)
    if len(several := sorted({info.message for info in fitting})) > 1:
        prefix = f"{addressed}/" if addressed else ""
        hint = f"Name one: {', '.join(f'{prefix}{message}/{name:.60}' for message in several):.400}."
        raise DomainError("which-message", f"Several messages have {word:.60}.", hint)
    info = max(fitting, key=lambda one: one.id)  # of several with one name, the newest
    message = info.message if is_shared(info, infos) else ""
    rest = name[length + 1 :]
    if not rest:
        return [SignalColumn(info, at, message=message) for at in range(len(info.columns))]
    names = [column.name for column in info.columns]
    if rest not in names:
        hint = f"It has: {', '.join(names):.400}."
        raise DomainError("not-found", f"{info.name} has no column {rest:.60}.", hint)
    return [SignalColumn(info, names.index(rest), message=message)]


def recorded_samples(
    store: ColumnStore, column: SignalColumn, t0: float, t1: float, base: Base = "device"
) -> tuple[Floats, Floats]:
    """Samples of a column of a recording, t0 ≤ t ≤ t1.

    Raises:
        DomainError: "too-many": more than MAX_VALUES samples.
    """
    channel = column.info.id
    lo, hi = store.between(channel, t0, t1, base)
    _check_size(column, hi - lo)
    parts = list(store.values(channel, column.at, lo, hi))
    values = np.concatenate(parts) if parts else np.empty(0)
    return store.clock(channel, lo, hi, "key" if base == "device" else "arrival"), values.astype(np.float64)


def live_samples(
    store: ChannelStore, columns: Sequence[SignalColumn], t0: float, t1: float, base: Base = "device"
) -> ReadSamples:
    """Samples of a live device, t0 ≤ t ≤ t1, as far as memory holds them.

    Returns:
        Gives the samples of one of the columns, in any thread; this function copies these in the event loop.
    """
    by_channel: dict[int, list[int]] = {}
    for one in columns:
        by_channel[one.info.id] = sorted({*by_channel.get(one.info.id, ()), one.at})
    copies: Mapping[int, list[NDArray[np.generic]]] = {
        number: stored_values(store.of(number), t0, base, own) for number, own in by_channel.items()
    }

    def samples(column: SignalColumn) -> tuple[Floats, Floats]:
        number = column.info.id
        at = by_channel[number].index(column.at)
        rows = query_columns(column.info, copies[number], t0, t1, 0, columns=[at], base=base).rows
        assert isinstance(rows, ExactRows)  # no buckets were requested
        time = rows.arrival if base == "arrival" else np.where(np.isnan(rows.time), rows.arrival, rows.time)
        _check_size(column, len(time))
        return np.maximum.accumulate(time), rows.columns[0].astype(np.float64)

    return samples


def _check_size(column: SignalColumn, n: int) -> None:
    if n > MAX_VALUES:
        hint = f"Request a shorter range; at most {grouped(MAX_VALUES)} samples are analysed at once."
        raise DomainError("too-many", f"{column.name} has too many samples in that range.", hint)
