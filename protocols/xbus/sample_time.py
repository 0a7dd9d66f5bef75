"""Choice of the clock of an MTData2 sample, frame by frame.

The loop of decoder.py's section "Time", compiled. Each frame is decided from the frames before it alone, so the result
does not depend on how the stream was cut:

    has     the best clock in the message: SampleTimeFine, SampleTimeCoarse, or UtcTime if its flags call it valid;
            none in a GNSS message without a fix
    clock   the best clock seen in the stream so far; a message with a worse one, or none, has no device time
"""

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.native.kernels import BYTES, FOUR, INT, INTS, TABLE, compiled
from imuscope.protocols.xbus.frames import COARSE, FINE, FIX, GNSS, NO_FIX, NO_GNSS, UTC_AT

NO_CLOCK, UTC, COARSE_CLOCK, FINE_CLOCK = range(4)

VALID = 4  # of the flags of UtcTime: UTC is known
S = 1_000_000_000
_BEFORE_MARCH = 3  # months are counted from March on, so that a leap day is the last of its year
_DAYS_TO_1970 = 719_468  # from 0000-03-01


@compiled(INT, INT, INT, INT)
def days_since_1970(year: int, month: int, day: int) -> int:
    """Days from 1970-01-01 to a date of the Gregorian calendar; days past the end of a month run into the next."""
    shifted = (month - _BEFORE_MARCH) % 12
    march_year = year - (1 if month < _BEFORE_MARCH else 0)
    leap_days = march_year // 4 - march_year // 100 + march_year // 400
    return 365 * march_year + leap_days + (153 * shifted + 2) // 5 + day - 1 - _DAYS_TO_1970


@compiled(INT, BYTES, INT)
def utc_at(data: Bytes, at: int) -> int:
    """UtcTime at `at`, ns since the Unix epoch; -1 if its flags call it invalid, or it is not a time."""
    ns = int(data[at]) << 24 | int(data[at + 1]) << 16 | int(data[at + 2]) << 8 | int(data[at + 3])
    year = int(data[at + 4]) << 8 | int(data[at + 5])
    month, day = int(data[at + 6]), int(data[at + 7])
    hour, minute, second = int(data[at + 8]), int(data[at + 9]), int(data[at + 10])
    if int(data[at + 11]) & VALID == 0 or ns > S or hour >= 24 or minute >= 60 or second > 60:
        return -1
    if year < 1970 or year >= 2262 or month < 1 or month > 12 or day < 1 or day > 31:
        return -1
    return (((days_since_1970(year, month, day) * 24 + hour) * 60 + minute) * 60 + second) * S + ns


@compiled(FOUR, BYTES, TABLE, INT, INT, INTS, INTS, INTS)
def select_clock(
    data: Bytes, walked: Ints, clock: int, fix: int, used: Ints, times: Ints, better: Ints
) -> tuple[int, int, int, int]:
    """Decide n frames.

    Args:
        walked: output of `walk` of frames.py for them.
        clock: the best clock before them.
        fix: the last fix reported by a GNSS receiver of the device.
        used: (n,), written: the frame's clock, NO_CLOCK where it has no device time.
        times: (n,), written: ns since the Unix epoch where that is UTC, 0 elsewhere.
        better: (3,), written: the frames that introduced a better clock.

    Returns:
        clock and fix after them; number of rows of `better`; number of frames without a time.
    """
    steps = 0
    untimed = 0
    for f in range(walked.shape[1]):
        gnss = walked[GNSS, f]
        if gnss in (NO_FIX, FIX):
            fix = gnss
        has = NO_CLOCK
        times[f] = 0
        if gnss == NO_GNSS or fix == FIX:
            if walked[FINE, f] >= 0:
                has = FINE_CLOCK
            elif walked[COARSE, f] >= 0:
                has = COARSE_CLOCK
            elif walked[UTC_AT, f] >= 0:
                utc = utc_at(data, walked[UTC_AT, f])
                if utc >= 0:
                    has = UTC
                    times[f] = utc
        if has > clock:
            if clock > NO_CLOCK:
                better[steps] = f
                steps += 1
            clock = has
        if has < clock:
            has = NO_CLOCK
        untimed += 1 if has == NO_CLOCK else 0
        used[f] = has
    return clock, fix, steps, untimed
