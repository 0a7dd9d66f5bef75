"""Unit of times that name none, from all that the numbers themselves say.

A unit is possible if the sampling rate that it gives is one that a sensor can have, and if the times are either a date
that the file can hold (`dated`) or the running time of a device:

    timestamp   1127500000, 112510000, …    s: one sample in 2.8 h · ms: 0.1 Hz · µs: 100 Hz · ns: 100 kHz

Columns of an accelerometer or gyroscope exclude what no such sensor does. Where more than one unit remains, none is
taken: the caller asks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

UNITS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
SPELLINGS: Mapping[str, str] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "µs", "μs", "usec", "usecs", "micros", "microsecond", "microseconds"), "µs"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(
        (
            "sek",
            "sekunden",
            "seconde",
            "secondes",
            "segundos",
            "secondi",
            "seconden",
            "с",
            "сек",
            "секунды",
            "秒",
            "초",
        ),
        "s",
    ),
    **dict.fromkeys(
        ("millisekunden", "millisecondes", "milisegundos", "millisecondi", "мс", "мсек", "毫秒", "ミリ秒", "밀리초"),
        "ms",
    ),
    **dict.fromkeys(
        ("mikrosekunden", "microsecondes", "microsegundos", "microsecondi", "мкс", "微秒", "マイクロ秒", "마이크로초"),
        "µs",
    ),
    **dict.fromkeys(
        ("nanosekunden", "nanosecondes", "nanosegundos", "nanosecondi", "нс", "纳秒", "ナノ秒", "나노초"), "ns"
    ),
}
LONG: Mapping[str, str] = {
    **dict.fromkeys(("min", "mins", "minute", "minutes", "minuten", "minutos", "minuti", "мин", "分钟", "分"), "min"),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours", "stunden", "heures", "horas", "ore", "小时", "時間"), "h"),
    **dict.fromkeys(("d", "day", "days", "tage", "jours"), "d"),
}
"""Spellings of units that only a heading can name."""
FACTORS: Mapping[str, float] = {**UNITS, "min": 60.0, "h": 3600.0, "d": 86_400.0}
OLDEST = 946_684_800.0  # 2000-01-01: an earlier date is that of a clock that is not set
FASTEST, FASTEST_FRACTION = 34_000.0, 5_000.0  # Hz; of counts, and of numbers with a fraction
SLOWEST = 1e-5  # Hz, of anything
SLOWEST_INERTIAL, SLOWEST_DATED = 0.41, 0.05  # Hz, of an inertial sensor; with dates or decimals
SLOW_DATED, SLOW_OLD = 2.5, 11.5  # Hz: below, a date does not decide; recent, of an inertial sensor; or old
WEEKS = 12 * 86400.0  # s
RECENT = 6 * 365 * 86400.0  # s before the file was written
USUAL_S = 1.0  # of a step in s of few numbers with decimals
LONGEST_RUN = 400 * 86400.0  # s, of a device without a restart
LONG_RUN, FASTEST_LONG = 86400.0, 11_000.0  # who samples faster does not run for so long
FEW = 8  # steps
USUAL = 3.0  # times the median step: longer ones are gaps
UNSORTED = 0.1  # of the steps go back: more than by resets and wraps
CLOSE = 0.2  # of a rate that is known


@dataclass(frozen=True, slots=True)
class UnitReading:
    """One possible reading of times.

    Args:
        rate: samples per second in that unit; 0 if unknown.
        dated: whether the times are a date, else since the start of a device.
    """

    unit: str
    rate: float
    dated: bool

    @property
    def factor(self) -> float:
        return UNITS[self.unit]

    def words(self) -> str:
        """In a sentence: "ms (100 Hz)"."""
        return f"{self.unit} ({rate_text(self.rate)})" if self.rate else self.unit


def rate_text(rate: float) -> str:
    """A rate in words."""
    for size, unit in ((1e9, "GHz"), (1e6, "MHz"), (1e4, "kHz")):
        if rate >= size:
            return f"{rate / (1000 if unit == 'kHz' else size):.4g} {unit}"
    if rate >= 0.01 or rate <= 0:
        return f"{rate:.4g} Hz"
    return f"one sample in {1 / rate:.4g} s"


def in_order(times: Floats) -> Floats:
    """The times, sorted if so many step back that the rows have no order: their neighbours then say nothing."""
    return np.sort(times) if len(times) > 1 and (np.diff(times) < 0).mean() > UNSORTED else times


def usual_step(times: Floats) -> float:
    """Median step between neighbours that advance, of few the smaller one of two; 0 if none does."""
    steps = np.diff(in_order(times))
    steps = steps[steps > 0]
    return _median(steps) if len(steps) else 0.0


def _median(steps: Floats) -> float:
    """The median; of few, between two, the smaller one: the other may be the step of a clock that is set."""
    return float(np.quantile(steps, 0.5, method="lower" if len(steps) < FEW else "linear"))


def is_dated(first: float, newest: float) -> bool:
    """Whether a time since 1970, s, is a date that a file can hold that was last written at `newest`."""
    return OLDEST <= first <= newest


def mean_step(times: Floats) -> float:
    """Mean of the steps that are not gaps, which rounding does not change; 0 if none advances."""
    steps = np.diff(in_order(times))
    steps = steps[steps > 0]
    return float(steps[steps <= USUAL * _median(steps)].mean()) if len(steps) else 0.0


def possible_units(
    times: Floats, *, inertial: bool, newest: float, rate: float = 0.0, fraction: bool = False
) -> list[UnitReading]:
    """Units that times without one can have; dated ones first.

    Args:
        times: (n,) as in the file, finite.
        fraction: whether they are written with decimals.
        inertial: whether the table has columns of an accelerometer or gyroscope.
        newest: no sample is later than that, unix s.
        rate: sampling rate that is known from elsewhere, Hz; 0: unknown.
    """
    begin = int(np.flatnonzero(times)[0]) if times.any() else 0
    is_unset = len(times) - begin > 1 and times[begin] > np.ptp(times[begin:])  # zeros of before the clock was set
    times = times[begin:] if is_unset else times
    step = mean_step(times)
    each = len(times) / max(len(np.unique(times)), 1)  # rows of one time: several samples, by a clock that is coarse
    first, last = float(np.median(times)), float(np.abs(times).max())  # the first may be of before the clock was set
    fraction |= bool((times != np.round(times)).any())
    matches = []
    for unit, factor in UNITS.items():
        its_rate = 1 / (step * factor) if step * factor else 0.0
        dated = is_dated(first * factor, newest)
        if its_rate * each > FASTEST:
            continue
        if step and not _is_rate(its_rate, each, inertial=inertial, fraction=fraction, dated=dated):
            continue
        if rate and step and abs(its_rate - rate) > CLOSE * rate:
            continue
        if not dated and (last * factor > LONGEST_RUN or (last * factor > LONG_RUN and its_rate * each > FASTEST_LONG)):
            continue
        matches.append(UnitReading(unit, its_rate, dated))
    return sorted(matches, key=lambda one: not one.dated)


def _is_rate(rate: float, each: float, *, inertial: bool, fraction: bool, dated: bool) -> bool:
    """Whether a sensor can have a rate of times, each of which several rows have."""
    if rate > (FASTEST_FRACTION if fraction else FASTEST):
        return False
    return rate * each >= ((SLOWEST_DATED if dated or fraction else SLOWEST_INERTIAL) if inertial else SLOWEST)


def decided(readings: Sequence[UnitReading], times: Floats, *, inertial: bool, newest: float) -> UnitReading | None:
    """The reading to take; None if several remain.

    Args:
        times, inertial, newest: as for `possible_units`.
    """
    if len(readings) == 1:
        return readings[0]
    dated = [one for one in readings if one.dated]
    if len(dated) != 1:
        return None
    usual = float(np.median(times))
    recent = usual * dated[0].factor > newest - RECENT
    others = [one for one in readings if not one.dated]
    if recent and not inertial:  # rather a date than a device that has run for weeks, whatever the rate
        others = [one for one in others if usual * one.factor < WEEKS]
    steps = np.diff(in_order(times)) * dated[0].factor
    best = 1 / float(steps[steps > 0].min()) if (steps > 0).any() else 0.0
    least = SLOW_OLD if not recent else SLOW_DATED if inertial else np.inf
    return None if others and best < least else dated[0]
