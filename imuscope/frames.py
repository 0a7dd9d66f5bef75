"""Several signals on one axis of time, as columns of a frame.

    axis       |  |  |  |  |  |  |  |     times of the signal with the most samples, or even ones
    nearest    5  5  5  6  6  ·  ·  7     the nearest sample, no farther than half a step of its signal; else empty
    interpolate                           linear between two samples (angles by the shorter way, quaternions on the
                                          sphere), and empty across a gap or a step of the clock

What has no values between two, a count, a flag or a choice, is that of the nearest sample in both.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats, Ints
from imuscope.protocols.clocks.unix_time import seconds
from imuscope.protocols.rotations import slerp
from imuscope.recordings.columns.units import Units
from imuscope.signals import ImuscopeError, Signal, choice, distinct

Align = Literal["nearest", "interpolate"]
MOST_VALUES = 50_000_000
SLACK = 1 + 1e-6  # of half a step, on which an even axis may fall
DISCRETE = ("status", "counter")


@dataclass(frozen=True, slots=True)
class Frame:
    """Columns of the same length, (n,), and their units, by heading."""

    time_ns: Ints
    columns: dict[str, NDArray[Any]]
    units: dict[str, str]


def frame_of(signals: Sequence[Signal], align: Align, rate: float, units: Units) -> Frame:
    """The signals on one axis.

    Args:
        rate: of even times, Hz; 0 for those of the signal with the most samples.
    """
    choice("align", align, ("nearest", "interpolate"))
    if not 0 <= rate < math.inf:
        raise ImuscopeError(f"rate={rate!r} is no rate; give samples per second, or 0.")
    if not any(map(len, signals)):
        raise ImuscopeError("There are no samples; name signals that have some.")
    signals = [one.in_units(units) for one in signals]
    most = max(signals, key=len)
    time_ns = _even(signals, rate) if rate else most.time_ns
    times = seconds(time_ns) if rate else _key(most)
    frame = Frame(time_ns, {}, {})
    parts = [pair for one in signals for pair in zip(_on(one, times, align), one.units, strict=True)]
    for heading, (values, unit) in zip(_headings(signals), parts, strict=True):
        frame.columns[heading], frame.units[heading] = values, unit
    return frame


def _headings(signals: Sequence[Signal]) -> list[str]:
    """Names of the columns: "RateOfTurn.x", the name alone of a signal of one column; after "DEVICE/" if shared."""
    count = Counter(one.name for one in signals)
    names = [f"{one.device.name}/{one.name}" if count[one.name] > 1 else one.name for one in signals]
    pairs = zip(names, signals, strict=True)
    return distinct(
        [name if len(one.columns) == 1 else f"{name}.{column}" for name, one in pairs for column in one.columns]
    )


def _key(signal: Signal) -> Floats:
    """Times of its samples that never fall, unix s: those by which analyses pair them."""
    return signal._store.clock(signal._channel, signal.start, signal.stop)  # noqa: SLF001 - of this package


def _even(signals: Sequence[Signal], rate: float) -> Ints:
    first = min(int(one.time_ns.min()) for one in signals if len(one))
    last = max(int(one.time_ns.max()) for one in signals if len(one))
    count = int((last - first) * rate / 1e9) + 1
    if count * sum(len(one.columns) for one in signals) > MOST_VALUES:
        raise ImuscopeError(f"rate={rate:g} gives {count} rows, which are too many; choose a lower one.")
    times: Ints = first + np.rint(np.arange(count) * (1e9 / rate)).astype(np.int64)
    return times


def _on(signal: Signal, times: Floats, align: Align) -> list[NDArray[Any]]:
    """Its columns at these times."""
    from imuscope.server.library.recording_detail import channels_of

    own, columns = _key(signal), [signal.column(k) for k in range(len(signal.columns))]
    if np.array_equal(own, times):
        return columns
    info = channels_of(signal._store)[signal._channel]  # noqa: SLF001
    shown = [info.columns[at] for at in signal._own]  # noqa: SLF001
    discrete = [info.kind in DISCRETE or bool(one.choices or one.bits) for one in shown]
    between: list[NDArray[Any]] = []
    if align == "interpolate" and len(own) > 1 and not all(discrete):
        between = _between(signal, own, times, [one.period for one in shown], is_rotation=info.kind == "quaternion")
    rows, is_near = _nearest(own, times, signal.rate)
    return [
        between[k] if between and not discrete[k] else _where(is_near, values, rows) for k, values in enumerate(columns)
    ]


def _nearest(own: Floats, times: Floats, rate: float) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Row of the nearest sample of each time, and whether it is within half a step."""
    if not len(own):
        return np.zeros(len(times), np.int64), np.zeros(len(times), np.bool_)
    after = np.minimum(np.searchsorted(own, times), len(own) - 1)
    before = np.maximum(after - 1, 0)
    rows = np.where(np.abs(times - own[before]) < np.abs(own[after] - times), before, after)
    reach = 0.5 * SLACK / rate if rate > 0 else 0.0
    return rows, np.abs(own[rows] - times) <= reach


def _where(known: NDArray[np.bool_], values: NDArray[Any], rows: NDArray[np.int64]) -> NDArray[Any]:
    """The values of these rows, NaN where they are not known; their type stays where it can."""
    if known.all():
        return values[rows]
    is_float = values.dtype.kind == "f"
    result = np.full(len(rows), np.nan, values.dtype if is_float else np.float64)
    result[known] = values[rows[known]]
    return result


def _between(
    signal: Signal, own: Floats, times: Floats, periods: Sequence[float], *, is_rotation: bool
) -> list[NDArray[Any]]:
    """Values between the samples before and after each time; NaN outside, in gaps and across steps of the clock."""
    from imuscope.server.extensions.analysis.compare.comparison import neighbours
    from imuscope.server.extensions.analysis.signals.pairs import on_circle
    from imuscope.server.extensions.analysis.signals.signals import Signal as Samples
    from imuscope.server.library.recording_detail import segments_of

    breaks = segments_of(signal._store).get(signal.device.id, ())  # noqa: SLF001
    near = neighbours(Samples(signal.name, "", 0.0, own, own, breaks=breaks), times)
    part, after = near.part, near.before + 1
    whole = replace(signal, columns=("w", "x", "y", "z"), _own=(0, 1, 2, 3)) if is_rotation else signal
    values = np.column_stack([whole.column(k) for k in range(len(whole.columns))]).astype(np.float64)
    low, high = values[near.before], values[after]
    if is_rotation:
        mixed = slerp(low, high, part)
    else:
        change = high - low
        for k, period in enumerate(periods):
            change[:, k] -= period * np.round(change[:, k] / period) if period else 0.0
        mixed = low + part[:, np.newaxis] * change
        for k, period in enumerate(periods):
            mixed[:, k] = on_circle(mixed[:, k], period, values[:, k]) if period else mixed[:, k]
    mixed[part >= 1], mixed[part <= 0] = high[part >= 1], low[part <= 0]  # a neighbour of it may be NaN
    result = np.full((len(times), values.shape[1]), np.nan)
    result[near.inside] = mixed
    return [result[:, at] for at in (signal._own if is_rotation else range(len(signal.columns)))]  # noqa: SLF001
