"""Figures of every signal in every minute, for the table `minutes`.

Questions over many recordings read these: a row for 60,000 samples at 1 kHz. Memory is that of one minute of a signal.

White noise is estimated from second differences, x[n] − 2x[n+1] + x[n+2], whose variance is six times that of the
noise: motion and drift, which are smooth, hardly count. As a one-sided density it is σ √(2 / rate), the way data sheets
have it. A filter in the sensor makes it too small, vibration too great.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.statistics import wrapped
from imuscope.recordings.columns.store import ColumnStore
from imuscope.server.extensions.fleet.store.metadata import Row, moment
from imuscope.server.library.recording_detail import channels_of
from imuscope.server.wire import ChannelInfo, ColumnInfo

MINUTE_S = 60.0
MIN_SAMPLES = 25  # of a minute, for an estimate of its noise
FIGURES = ("vector", "quaternion", "euler", "scalar", "record")
QUANTITIES = {
    **dict.fromkeys(("rad/s", "°/s"), "rate of turn"),
    **dict.fromkeys(("m/s²", "g"), "acceleration"),
    **dict.fromkeys(("T", "µT", "G", "a.u."), "magnetic field"),
    "°C": "temperature",
    **dict.fromkeys(("Pa", "hPa", "kPa"), "pressure"),
}


def minute_rows(store: ColumnStore) -> Iterator[Row]:
    """Rows of all signals but counters and status words, signal by signal within a channel."""
    for info in channels_of(store).values():
        if info.kind in FIGURES:
            yield from _channel(store, info)


def _channel(store: ColumnStore, info: ChannelInfo) -> Iterator[Row]:
    names = [f"{info.name}.{column.name}" for column in info.columns]
    for start, lo, hi in _minutes(store, info.id):
        when = moment(start)
        if when is None:
            continue
        span = store.clock(info.id, lo, hi)
        rate = (len(span) - 1) / (span[-1] - span[0]) if len(span) > 1 and span[-1] > span[0] else math.nan
        parts = [np.concatenate(list(store.values(info.id, at, lo, hi))) for at in range(len(info.columns))]
        shared = {"device": info.device, "message": info.message, "minute": when}
        for name, column, part in zip(names, info.columns, parts, strict=True):
            if column.bits or column.choices:
                continue
            yield from _row(name, column.unit, column.axis, part, column.period, rate, shared)
        if _is_vector(info.columns):
            norm = np.sqrt(sum(np.square(part.astype(np.float64)) for part in parts))
            yield from _row(f"{info.name}.norm", info.columns[0].unit, "norm", norm, 0.0, rate, shared)


def _is_vector(columns: Sequence[ColumnInfo]) -> bool:
    return [column.axis for column in columns] == ["x", "y", "z"] and len({column.unit for column in columns}) == 1


def _minutes(store: ColumnStore, channel: int) -> Iterator[tuple[float, int, int]]:
    """(start, first row, past the last) of each minute with samples."""
    lo, rows = 0, store.rows(channel)
    while lo < rows:
        start = math.floor(float(store.clock(channel, lo, lo + 1)[0]) / MINUTE_S) * MINUTE_S
        hi = max(store.row_at(channel, np.nextafter(start + MINUTE_S, -np.inf)) + 1, lo + 1)
        yield start, lo, hi
        lo = hi


def _row(
    name: str, unit: str, axis: str, values: NDArray[Any], period: float, rate: float, shared: Row
) -> Iterator[Row]:
    numbers = values.astype(np.float64)
    finite = np.isfinite(numbers)
    if not finite.any():
        return
    numbers = numbers if finite.all() else numbers[finite]
    least, greatest = float(numbers.min()), float(numbers.max())
    anchor = float(numbers[0]) if period else 0.0
    centred = wrapped(numbers - anchor, period) if period else numbers
    mean = float(centred.mean())
    sigma = float(centred.std(ddof=1)) if len(centred) > 1 else 0.0
    with np.errstate(over="ignore"):
        rms = float(np.sqrt(np.square(numbers).mean()))
    yield {
        **shared,
        "signal": name,
        "unit": unit,
        "quantity": "" if period else _quantity(name, unit),
        "axis": axis,
        "count": len(numbers),
        "min": least,
        "max": greatest,
        "mean": float(wrapped(anchor + mean, period)) if period else mean,
        "sigma": sigma,
        "rms": rms,
        "rate": rate if math.isfinite(rate) else None,
        "noise": _noise(centred, rate) if finite.all() else None,
    }


def _quantity(name: str, unit: str) -> str:
    """Quantity of a signal; acceleration without gravity is another one than what an accelerometer measures."""
    quantity = QUANTITIES.get(unit, "")
    return "free acceleration" if quantity == "acceleration" and "free" in name.lower() else quantity


def _noise(values: Floats, rate: float) -> float | None:
    if len(values) < MIN_SAMPLES or not math.isfinite(rate):
        return None
    return float(np.std(np.diff(values, 2)) / math.sqrt(6.0)) * math.sqrt(2.0 / rate)
