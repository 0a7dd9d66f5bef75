"""When was that? The clocks in Inertial Sense data, brought to one time.

A device counts seconds since it was switched on, and knows GPS time only after its receiver's first fix. Its messages
carry one or the other:

    UP        seconds (or ms) since start: IMU, magnetometer, barometer         time, timeMs, imu.time
    WEEK_TOW  GPS week and time of week: INS                                    week+timeOfWeek
    FIX       the same of a receiver, whose clock says nothing without a fix    week+timeOfWeekMs
    TOW       time of week alone: GNSS velocity, satellites, sigmas             timeOfWeek, timeOfWeekMs
    GTIME     seconds since 1970 in GPS time, and their fraction: raw GNSS      time.time

`update_time` is given the clocks in the order of the stream and keeps one time, in ns:

    before the first fix   up-time. A week of 0 says that there was none; the time of week beside it is up-time then,
                           and never a date in 1980.
    from then on           UTC, ns since the Unix epoch. Up-time is shifted by what the two clocks differ. GPS position
                           says it exactly (towOffset). Until one passes by, the first set with a date is taken to come
                           as far behind its last one as that was behind the one before (`due`); of a set that was not
                           seen before, the newest up-time stands for the same moment, which is right to one period.

The change of epoch is a Step of kind "sync" whose `by` is the whole shift; a device that starts again is a "reset".
A time of week without any week known has no time. Rows older than the newest by less than LATE_NS are just late: a
logger writes its data sets in turns, some seconds of one and then the same seconds of the next. So a device that is
reset in its first seconds is told by a set that goes back against *itself*: each set keeps its order (`is_reset`).

GPS time is ahead of UTC by the leap seconds since 1980. The table is of LEAP_SECONDS_AS_OF; a later leap second would
show as one second too much. Source: IERS Bulletin C; GPS week and epoch: IS-GPS-200, 3.3.4.
"""

from __future__ import annotations

import numpy as np

from protocols.framing import Bytes
from protocols.jit import FLAG, INT, compiled, inlined, several, unsigned

LEAP_SECONDS_AS_OF = "2025-07-07"  # IERS Bulletin C 70: none at the end of 2025

NONE, UP, WEEK_TOW, FIX, TOW, GTIME = range(6)

# What is known of a device's clocks: shift, how well it is known, newest up-time, newest UTC, newest week, epoch. A
# tuple, because compiled code keeps its numbers in registers; an array would be counted in and out of every function.
TimeState = tuple[int, int, int, int, int, int]
TimeReport = tuple[TimeState, int, int, int, int]
STATE = several(INT, INT, INT, INT, INT, INT)
TOLD = several(STATE, INT, INT, INT, INT)
NOT_SHIFTED, ROUGHLY, EXACTLY = range(3)
UNKNOWN, FROM_START, FROM_1970 = range(3)

NO_STEP, SYNC, RESET, JUMP = range(4)
STEPS = ("", "sync", "reset", "jump")

S = 1_000_000_000
WEEK_S = 604_800
GPS_EPOCH = 315_964_800  # 1980-01-06, Unix seconds
FIRST_WEEK = 1024  # no such device is older than 1999; smaller numbers are noise
LAST_WEEK = 8191
LATE_NS = 10 * S
BACK_NS = (
    S // 2
)  # a set that goes back by more than its jitter, to a time near zero, comes from a device that restarted
SOON = 10  # of its period: so much later than a set that is due at the same moment another one's clock may be read
DATED = 1 << 62  # the up-time, for comparison, of a set that carried a week
NEAR_NS = 2 * S  # an exact shift that differs from the rough one by more is not believed
TOLD_NS = 5_000_000  # a correction of the shift below this is no event
LONGEST_UP_S = 1e9
HIGHEST = 0x41D00000  # upper half of a float64 of 2^30
ONE, TWO, THREE = (unsigned(n) for n in (1, 2, 3))  # a sum with a plain number would be signed again

# Unix seconds from which GPS time is ahead of UTC by one second more
_LEAPS = np.array(
    [
        *(362793600, 394329600, 425865600, 489024000, 567993600, 631152000, 662688000, 709948800, 741484800),
        *(773020800, 820454400, 867715200, 915148800, 1136073600, 1230768000, 1341100800, 1435708800, 1483228800),
    ],
    np.int64,
)


@compiled(INT, INT)
def leap_seconds(unix_s: int) -> int:
    """How much GPS time is ahead of UTC at `unix_s` (either time scale), s."""
    n = len(_LEAPS)
    while n > 0 and unix_s < _LEAPS[n - 1]:
        n -= 1
    return n


@compiled(INT, INT, INT)
def utc_ns(week: int, tow_ns: int) -> int:
    """GPS week and time of week as ns since the Unix epoch, UTC."""
    start = GPS_EPOCH + week * WEEK_S
    leap = leap_seconds(start)
    if leap < len(_LEAPS) and start + WEEK_S >= _LEAPS[leap]:  # one falls into this week; a division is slow
        leap = leap_seconds(start + tow_ns // S)
    return (start - leap) * S + tow_ns


def store_offset() -> TimeState:
    """What is known of a device that has just been connected."""
    return 0, NOT_SHIFTED, -1, -1, -1, UNKNOWN


@inlined
def four(data: Bytes, at: int) -> int:
    """The u32 at `at`."""
    i = unsigned(at)
    return int(data[i]) | int(data[i + ONE]) << 8 | int(data[i + TWO]) << 16 | int(data[i + THREE]) << 24


@inlined
def double_ns(data: Bytes, at: int) -> int:
    """The float64 at `at`, seconds, as ns; -1 where it is no time (negative, not finite, beyond 30 years)."""
    low, high = four(data, at), four(data, at + 4)
    if high >= HIGHEST:  # negative, or too large to be worth a look
        return -1
    seconds = np.int64(high << 32 | low).view(np.float64)
    return int(seconds * 1e9 + 0.5) if seconds < LONGEST_UP_S else -1


@inlined
def up_time(kind: int, ns: int, week: int) -> int:
    """What a set's clock says of the time since start: ns, DATED where it knows the date, -1 where it says nothing."""
    if kind == UP or (kind == WEEK_TOW and week == 0):
        return ns
    return DATED if kind == WEEK_TOW and ns >= 0 else -1


@inlined
def is_reset(before: int, up: int) -> bool:
    """Did the device start again, by two up-times of one data set, the earlier one first (see `up_time`)?"""
    return 0 <= up < LATE_NS and before > up + BACK_NS


@inlined
def spacing(every: int, before: int, up: int) -> int:
    """How far apart a set comes by its up-time: the least that was seen, since packets may be lost; -1 if unknown."""
    if before < 0 or before >= DATED or up >= DATED or up <= before:
        return every
    return up - before if every < 0 else min(every, up - before)


@inlined
def due(state: TimeState, week: int, before: int, every: int) -> TimeState:
    """The newest up-time as that of a set which has just told its first date, by when it was due.

    Args:
        before, every: its own last up-time, and how far apart it comes; negative where they are not known.
    """
    if state[5] == FROM_1970 or every <= 0 or before < 0 or before >= DATED or week < FIRST_WEEK or week > LAST_WEEK:
        return state
    missed = max(0, state[2] - before - every // SOON)
    up = before + every * max(1, -(-missed // every))
    return state[0], state[1], up, state[3], state[4], state[5]


@compiled(TOLD, STATE, INT)
def begin_again(state: TimeState, up: int) -> TimeReport:
    """The device was switched off and on, and says this up-time; like `update_time`."""
    shift, _, last_up, last_utc, _, epoch = state
    by = up - (last_utc if epoch == FROM_1970 else last_up)
    return (shift, NOT_SHIFTED, up, -1, -1, FROM_START), up, 1, RESET, by


@compiled(TOLD, STATE, INT)
def _up(state: TimeState, up: int) -> TimeReport:
    shift, shifted, last_up, last_utc, week, epoch = state
    if last_up >= 0 and up < last_up - LATE_NS:
        return begin_again(state, up)
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


@compiled(TOLD, STATE, INT, INT)
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


@compiled(TOLD, STATE, INT, FLAG)
def _time_of_week(state: TimeState, tow: int, fixed: bool) -> TimeReport:
    """Without a week: the newest one's, or the one before or after it; up-time where there was no fix yet."""
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


@compiled(TOLD, STATE, INT, INT, INT)
def update_time(state: TimeState, kind: int, ns: int, week: int) -> TimeReport:
    """The time of one message.

    Args:
        state: what is known of the device's clocks; see `store_offset`.
        kind: UP, WEEK_TOW, FIX, TOW or GTIME.
        ns: the clock as ns: up-time, time of week, or since 1970; negative where it is no time.
        week: GPS week; ignored unless `kind` is WEEK_TOW or FIX.
    Returns:
        what is known now; time in ns, 1 if there is one; kind of step before it (NO_STEP mostly), by how much.
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


@compiled(TOLD, STATE, INT, INT)
def correct_offset(state: TimeState, week: int, offset_ns: int) -> TimeReport:
    """GPS position has told what up-time and time of week differ by (towOffset).

    Returns:
        like `update_time`, without a time; a step only where up-time moves by more than TOLD_NS.
    """
    old, shifted, last_up, last_utc, newest, epoch = state
    if epoch != FROM_1970 or shifted == NOT_SHIFTED or offset_ns <= 0:
        return state, 0, 0, NO_STEP, 0
    shift = utc_ns(week, 0) + offset_ns
    by = shift - old
    if abs(by) > NEAR_NS:
        return state, 0, 0, NO_STEP, 0
    state = (shift, EXACTLY, last_up, last_utc, newest, epoch)
    return state, 0, 0, SYNC if abs(by) > TOLD_NS else NO_STEP, by
