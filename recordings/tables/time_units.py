"""Unit of times that name none, from all that the numbers themselves say.

A unit is possible if the sampling rate that it gives is one that a sensor can have, and if the times are either a date
that the file can hold (`dated`) or the running time of a device:

    timestamp   1127500000, 112510000, …    s: one sample in 2.8 h · ms: 0.1 Hz · µs: 100 Hz · ns: 100 kHz

Columns of an accelerometer or gyroscope exclude what no such sensor does. Where more than one unit remains, none is
taken: the caller asks.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Floats

UNITS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
_SPELLINGS = {
    "s": "s sec secs second seconds sek sekunden seconde secondes segundos secondi seconden с сек секунды 秒 초",
    "ms": "ms msec msecs millis millisecond milliseconds millisekunden millisecondes milisegundos millisecondi мс мсек "
    "毫秒 ミリ秒 밀리초",
    "µs": "us µs μs usec usecs micros microsecond microseconds mikrosekunden microsecondes microsegundos microsecondi "
    "мкс 微秒 マイクロ秒 마이크로초",
    "ns": "ns nsec nsecs nanos nanosec nanosecond nanoseconds nanosekunden nanosecondes nanosegundos nanosecondi нс "
    "纳秒 ナノ秒 나노초",
    "min": "min mins minute minutes minuten minutos minuti мин 分钟 分",
    "h": "h hr hrs hour hours stunden heures horas ore 小时 時間",
    "d": "d day days tage jours",
}
_UNITS = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in spellings.split()}
SPELLINGS: Mapping[str, str] = {spelling: unit for spelling, unit in _UNITS.items() if unit in UNITS}
LONG_SPELLINGS: Mapping[str, str] = {spelling: unit for spelling, unit in _UNITS.items() if unit not in UNITS}
"""Spellings of units that only a heading can name."""
FACTORS: Mapping[str, float] = {**UNITS, "min": 60.0, "h": 3600.0, "d": 86_400.0}
OLDEST_UNIX_S = 946_684_800.0  # 2000-01-01: an earlier date is that of a clock that is not set
RECENT_S = 6 * 365 * 86400.0  # s before the file was written: most logs are opened sooner
# Rates, Hz. Where sensors set no limit, they are those with which no table is read in a wrong unit of all that
# tests/recordings/tables/test_time_units.py makes; steps there are up to a fifth longer or shorter than usual.
MAX_HZ = 34_000.0  # 32 kHz, the fastest output of an ICM-42688-P, by an oscillator that is 6 % fast
FASTEST_FRACTION = 5_000.0  # 4 kHz, steps a fifth shorter: faster loggers write whole numbers
MIN_HZ = 1e-5  # one sample a day, of anything
SLOWEST_INERTIAL = 0.41  # 0.5 Hz, steps a fifth longer; 0.4 Hz would be 400 Hz in the next unit
SLOWEST_DATED = 0.05  # of an inertial sensor, with dates or decimals: a logger that sleeps 20 s between samples
# A date in one unit is a device that has run for 11 to 21 days in the next one, at a thousand times the rate.
LONGEST_RUN = 400 * 86400.0  # s, of a device without a restart: a year and a month
LONG_RUN, FASTEST_LONG = 86400.0, 11_000.0  # s; 8 kHz of flight controllers, steps a fifth shorter and rounded
FASTEST_WEEKS = 2_500.0  # 2 kHz, steps a fifth shorter: of an inertial sensor that has run for as long as a recent date
MIN_MEDIAN_STEPS = 8  # steps, of which one when a clock is set moves the median
EVEN_STEPS = 1e-4  # of a step: a mean that differs by less is the median
GAP_STEPS = 3.0  # times the median step: longer ones are gaps
UNSORTED_SHARE = 0.1  # of the steps go back: more than by resets and wraps
RATE_TOLERANCE = 0.2  # of a rate that is known: a head may round it, and samples may be missing


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
    for size, unit in ((1e9, "GHz"), (1e6, "MHz"), (1e4, "kHz")):
        if rate >= size:
            return f"{rate / (1000 if unit == 'kHz' else size):.4g} {unit}"
    if rate >= 0.01 or rate <= 0:
        return f"{rate:.4g} Hz"
    return f"one sample in {1 / rate:.4g} s"


def in_order(times: Floats) -> Floats:
    """The times, sorted if so many step back that the rows have no order: their neighbours then say nothing."""
    return np.sort(times) if len(times) > 1 and (np.diff(times) < 0).mean() > UNSORTED_SHARE else times


def usual_step(times: Floats) -> float:
    """Median step between neighbours that advance; 0 if none does. With few steps the lower median: the other may
    be that of a clock that is set.
    """
    steps = _advances(times)
    is_short = len(steps) < MIN_MEDIAN_STEPS
    return float(np.quantile(steps, 0.5, method="lower" if is_short else "linear")) if len(steps) else 0.0


def _advances(times: Floats) -> Floats:
    steps = np.diff(in_order(times))
    return steps[steps > 0]


def is_dated(first: float, newest: float) -> bool:
    """Whether a time since 1970, s, is a date that a file can hold that was last written at `newest`."""
    return OLDEST_UNIX_S <= first <= newest


def mean_step(times: Floats) -> float:
    """Mean of the steps that are not gaps, which rounding does not change; 0 if none advances."""
    steps = _advances(times)
    return float(steps[steps <= GAP_STEPS * usual_step(times)].mean()) if len(steps) else 0.0


def row_step(times: Floats) -> float:
    """Time from row to row outside of gaps, s: where steps vary, or several rows have one time, by their number; 0 if
    none advances.
    """
    steps, usual = np.diff(in_order(times)), usual_step(times)
    near = steps[np.abs(steps - usual) <= usual / 2]
    if 2 * len(near) > len(steps):
        return usual if abs(near.mean() - usual) < EVEN_STEPS * usual else float(near.mean())
    if not usual:
        return 0.0
    rising = np.flatnonzero(steps > 0)
    lengths, sizes = steps[rising[1:]], np.diff(rising)  # of packets; those at the ends may lack samples
    inside = lengths <= GAP_STEPS * float(np.quantile(steps[rising], 0.9))
    return float(lengths[inside].sum() / sizes[inside].sum()) if inside.any() else float(steps[steps >= 0].mean())


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
    is_unset = len(times) - begin > 1 and times[begin] > np.ptp(times[begin:])  # zeros: the clock was not set yet
    times = times[begin:] if is_unset else times
    step = mean_step(times)
    each = len(times) / max(len(np.unique(times)), 1)  # rows of one time: several samples, by a clock that is coarse
    usual, last = float(np.median(times)), float(np.abs(times).max())  # not the first: the clock may be set later
    fraction |= bool((times != np.round(times)).any())
    fastest = FASTEST_FRACTION if fraction else MAX_HZ
    matches = []
    for unit, factor in UNITS.items():
        its_rate = 1 / (step * factor) if step * factor else 0.0
        dated = is_dated(usual * factor, newest)
        slowest = MIN_HZ if not inertial else SLOWEST_DATED if dated or fraction else SLOWEST_INERTIAL
        longest = LONG_RUN if its_rate * each > FASTEST_LONG else LONGEST_RUN
        is_rate = not step or (its_rate <= fastest and slowest <= its_rate * each <= MAX_HZ)
        is_known = not rate or not step or abs(its_rate - rate) <= RATE_TOLERANCE * rate
        if is_rate and is_known and (dated or last * factor <= longest):
            matches.append(UnitReading(unit, its_rate, dated))
    return sorted(matches, key=lambda one: not one.dated)


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
    recent = usual * dated[0].factor > newest - RECENT_S
    others = [one for one in readings if not one.dated]
    if recent and not inertial:  # rather a date than a device that has run for weeks, whatever the rate
        others = [one for one in others if usual * one.factor < OLDEST_UNIX_S / 1000]
    steps = _advances(times) * dated[0].factor
    best = 1 / float(steps.min()) if len(steps) else 0.0
    least = FASTEST_LONG if not recent else FASTEST_WEEKS if inertial else np.inf
    return None if others and 1000 * best < least else dated[0]
