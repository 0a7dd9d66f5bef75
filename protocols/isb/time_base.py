"""Time base: UTC, GPS time and time since power-up, mapped to one time scale.

A device counts seconds since power-up and knows GPS time only after its receiver's first fix. Each message carries one
or the other:

    UP        seconds (or ms) since start: IMU, magnetometer, barometer         time, timeMs, imu.time
    WEEK_TOW  GPS week and time of week: INS                                    week+timeOfWeek
    FIX       the same of a receiver, whose clock is meaningless without a fix  week+timeOfWeekMs
    TOW       time of week alone: GNSS velocity, satellites, sigmas             timeOfWeek, timeOfWeekMs
    GTIME     seconds since 1970 in GPS time, and their fraction: raw GNSS      time.time

`update_time` takes the clocks in stream order and keeps one time, in ns:

    before the first fix   up-time. A week of 0 means no fix yet; the time of week beside it is then up-time, never a
                           date in 1980.
    afterwards             UTC, ns since the Unix epoch. Up-time is shifted by the difference of the two clocks. GPS
                           position gives it exactly (towOffset). Until one arrives, the first set with a date is
                           assumed to lag its last one by as much as that lagged the one before (`due`); for a set not
                           seen before, the newest up-time is taken as the same moment, which is right to one period.

The change of epoch is a Step of kind "sync" whose `by` is the whole shift; a device restart is a "reset". A time of
week has no time until a week is known. Rows older than the newest by less than LATE_NS are just late: a logger writes
its data sets in turns, some seconds of one and then the same seconds of the next. A reset in a device's first seconds
is therefore detected by a set that goes back against *itself*: each set keeps its order (`is_reset`).

GPS time is ahead of UTC by the leap seconds since 1980. The table is of LEAP_SECONDS_AS_OF; a later leap second would
show as one second too much. Source: IERS Bulletin C; GPS week and epoch: IS-GPS-200, 3.3.4.
"""

import numpy as np

from imuscope.protocols.arrays import Bytes
from imuscope.protocols.native.kernels import FLAG, INT, compiled, inlined, several, unsigned

LEAP_SECONDS_AS_OF = "2025-07-07"  # IERS Bulletin C 70: none at the end of 2025

NONE, UP, WEEK_TOW, FIX, TOW, GTIME = range(6)

# State of a device's clocks: shift, its quality, newest up-time, newest UTC, newest week, epoch. A tuple, because
# machine code keeps its numbers in registers.
TimeState = tuple[int, int, int, int, int, int]
TimeReport = tuple[TimeState, int, int, int, int]
STATE = several(INT, INT, INT, INT, INT, INT)
REPORT = several(STATE, INT, INT, INT, INT)
NOT_SHIFTED, ROUGHLY, EXACTLY = range(3)
UNKNOWN, FROM_START, FROM_1970 = range(3)

NO_STEP, SYNC, RESET, JUMP = range(4)
STEPS = ("", "sync", "reset", "jump")

S = 1_000_000_000
WEEK_S = 604_800
GPS_EPOCH = 315_964_800  # 1980-01-06, Unix seconds
FIRST_WEEK = 1024  # the hardware is newer than 1999; smaller numbers are noise
LAST_WEEK = 8191
LATE_NS = 10 * S
BACK_NS = S // 2  # a set that goes back by more than its jitter, to a time near zero, comes from a restarted device
SOON_DIVISOR = 10  # of its period: another set's clock may be read this much later than a set due at the same moment
DATED = 1 << 62  # the up-time, for comparison, of a set that carried a week
NEAR_NS = 2 * S  # an exact shift that differs from the rough one by more is rejected
REPORTED_STEP_NS = 5_000_000  # a smaller correction of the shift is not reported as an event
LONGEST_UP_S = 1e9
MAX_UPPER_HALF = 0x41D00000  # upper half of a float64 of 2^30
ONE, TWO, THREE = (unsigned(n) for n in (1, 2, 3))  # a sum with a plain number would be signed again

# Unix seconds of the leap seconds: from each on GPS time is ahead of UTC by one second more
_LEAPS = np.array(
    [
        *(362793600, 394329600, 425865600, 489024000, 567993600, 631152000, 662688000, 709948800, 741484800),
        *(773020800, 820454400, 867715200, 915148800, 1136073600, 1230768000, 1341100800, 1435708800, 1483228800),
    ],
    np.int64,
)


@compiled(INT, INT)
def leap_seconds(unix_s: int) -> int:
    """GPS time minus UTC at `unix_s` (either time scale), s."""
    n = len(_LEAPS)
    while n > 0 and unix_s < _LEAPS[n - 1]:
        n -= 1
    return n


@compiled(INT, INT, INT)
def utc_ns(week: int, tow_ns: int) -> int:
    """GPS week and time of week as ns since the Unix epoch, UTC."""
    start = GPS_EPOCH + week * WEEK_S
    leap = leap_seconds(start)
    if leap < len(_LEAPS) and start + WEEK_S >= _LEAPS[leap]:  # a leap second falls into this week; a division is slow
        leap = leap_seconds(start + tow_ns // S)
    return (start - leap) * S + tow_ns


def store_offset() -> TimeState:
    """Initial state of a newly connected device."""
    return 0, NOT_SHIFTED, -1, -1, -1, UNKNOWN


@inlined
def four(data: Bytes, at: int) -> int:
    """The u32 at `at`."""
    i = unsigned(at)
    return int(data[i]) | int(data[i + ONE]) << 8 | int(data[i + TWO]) << 16 | int(data[i + THREE]) << 24


@inlined
def double_ns(data: Bytes, at: int) -> int:
    """The float64 at `at`, seconds, as ns; -1 if it is not a time (negative, not finite, beyond 30 years)."""
    low, high = four(data, at), four(data, at + 4)
    if high >= MAX_UPPER_HALF:  # negative or too large
        return -1
    seconds = np.int64(high << 32 | low).view(np.float64)
    return int(seconds * 1e9 + 0.5) if seconds < LONGEST_UP_S else -1


@inlined
def up_time(kind: int, ns: int, week: int) -> int:
    """Time since start, from a set's clock: ns, DATED if it knows the date, -1 if unknown."""
    if kind == UP or (kind == WEEK_TOW and week == 0):
        return ns
    return DATED if kind == WEEK_TOW and ns >= 0 else -1


@inlined
def is_reset(before: int, up: int) -> bool:
    """Whether the device restarted, from two up-times of one data set, the earlier one first (see `up_time`)."""
    return 0 <= up < LATE_NS and before > up + BACK_NS


@inlined
def spacing(every: int, before: int, up: int) -> int:
    """Interval of a set by its up-time: the smallest observed, since packets may be lost; -1 if unknown."""
    if before < 0 or before >= DATED or up >= DATED or up <= before:
        return every
    return up - before if every < 0 else min(every, up - before)


@inlined
def due(state: TimeState, week: int, before: int, every: int) -> TimeState:
    """The newest up-time as that of a set that just gave its first date, from when it was due.

    Args:
        before, every: its own last up-time and its interval; negative if unknown.
    """
    if state[5] == FROM_1970 or every <= 0 or before < 0 or before >= DATED or week < FIRST_WEEK or week > LAST_WEEK:
        return state
    missed = max(0, state[2] - before - every // SOON_DIVISOR)
    up = before + every * max(1, -(-missed // every))
    return state[0], state[1], up, state[3], state[4], state[5]


@compiled(REPORT, STATE, INT)
def restart(state: TimeState, up: int) -> TimeReport:
    """Restart at this up-time, after the device was power-cycled; returns as `update_time`."""
    shift, _, last_up, last_utc, _, epoch = state
    by = up - (last_utc if epoch == FROM_1970 else last_up)
    return (shift, NOT_SHIFTED, up, -1, -1, FROM_START), up, 1, RESET, by


@compiled(REPORT, STATE, INT)
def _up(state: TimeState, up: int) -> TimeReport:
    shift, shifted, last_up, last_utc, week, epoch = state
    if last_up >= 0 and up < last_up - LATE_NS:
        return restart(state, up)
    last_up = max(last_up, up)
    time = up
    if epoch == FROM_1970:
        if shifted == NOT_SHIFTED:
            shifted = ROUGHLY
            shift = last_utc - up
        time = up + shift
    else:
        epoch = FROM_START
    return (shift, shifted, last_up, last_utc, week, epoch), time, 1, NO_STEP, 0


@compiled(REPORT, STATE, INT, INT)
def _gps(state: TimeState, utc: int, week: int) -> TimeReport:
    shift, shifted, last_up, last_utc, _, epoch = state
    step = NO_STEP
    by = 0
    if epoch != FROM_1970:
        if last_up >= 0:
            shifted = ROUGHLY
            shift = utc - last_up
            step = SYNC
            by = shift
    elif last_utc >= 0 and utc < last_utc - LATE_NS:
        step = JUMP
        by = utc - last_utc
        last_utc = utc
        if shifted != NOT_SHIFTED:
            shifted = ROUGHLY
            shift = utc - last_up
    return (shift, shifted, last_up, max(last_utc, utc), week, FROM_1970), utc, 1, step, by


@compiled(REPORT, STATE, INT, FLAG)
def _time_of_week(state: TimeState, tow: int, fixed: bool) -> TimeReport:
    """Time of week without a week: uses the newest week, or the one before or after; up-time before the first fix."""
    _, _, last_up, last_utc, week, epoch = state
    if fixed and epoch == FROM_1970 and week >= 0 and tow <= (WEEK_S + 1) * S:
        utc = utc_ns(week, tow)
        if utc - last_utc > WEEK_S * S // 2:
            utc -= WEEK_S * S
        elif last_utc - utc > WEEK_S * S // 2:
            utc += WEEK_S * S
        return state, utc, 1, NO_STEP, 0
    if epoch == FROM_START and abs(tow - last_up) < LATE_NS:
        return state, tow, 1, NO_STEP, 0
    return state, 0, 0, NO_STEP, 0


@compiled(REPORT, STATE, INT, INT, INT)
def update_time(state: TimeState, kind: int, ns: int, week: int) -> TimeReport:
    """The time of one message.

    Args:
        state: state of the device's clocks; see `store_offset`.
        kind: UP, WEEK_TOW, FIX, TOW or GTIME.
        ns: the clock as ns: up-time, time of week, or since 1970; negative if it is not a time.
        week: GPS week; ignored unless `kind` is WEEK_TOW or FIX.

    Returns:
        new state; time in ns, 1 if there is a time; kind of step before it (usually NO_STEP), its size.
    """
    if ns < 0:
        return state, 0, 0, NO_STEP, 0
    if kind == UP or (kind == WEEK_TOW and week == 0):
        return _up(state, ns)
    if kind in (WEEK_TOW, FIX) and week != 0:
        if week < FIRST_WEEK or week > LAST_WEEK or ns > (WEEK_S + 1) * S:
            return state, 0, 0, NO_STEP, 0
        return _gps(state, utc_ns(week, ns), week)
    if kind == GTIME:
        if state[5] != FROM_1970 or ns < (GPS_EPOCH + FIRST_WEEK * WEEK_S) * S:
            return state, 0, 0, NO_STEP, 0
        return state, ns - leap_seconds(ns // S) * S, 1, NO_STEP, 0
    return _time_of_week(state, ns, kind == TOW)


@compiled(REPORT, STATE, INT, INT)
def correct_offset(state: TimeState, week: int, offset_ns: int) -> TimeReport:
    """Apply the difference of up-time and time of week that GPS position gives (towOffset).

    Returns:
        as `update_time`, without a time; a step only if up-time moves by more than REPORTED_STEP_NS.
    """
    old, shifted, last_up, last_utc, newest, epoch = state
    if epoch != FROM_1970 or shifted == NOT_SHIFTED or offset_ns <= 0:
        return state, 0, 0, NO_STEP, 0
    shift = utc_ns(week, 0) + offset_ns
    by = shift - old
    if abs(by) > NEAR_NS:
        return state, 0, 0, NO_STEP, 0
    state = (shift, EXACTLY, last_up, last_utc, newest, epoch)
    return state, 0, 0, SYNC if abs(by) > REPORTED_STEP_NS else NO_STEP, by
