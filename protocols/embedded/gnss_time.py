"""Time in the messages of a GNSS receiver: NMEA 0183 and UBX, for captures whose device has no other clock.

    $GNRMC,103000.50,A,…,010126,…     time of day and date
    $GNGGA,103000.50,…                time of day; the date is that of the last sentence with one
    UBX-NAV-…                         time of week (iTOW, ms) in the first four bytes of the payload
    UBX-NAV-PVT, -PVAT, -TIMEUTC      and the date, which places the week, if the receiver marks it as valid
    UBX-NAV-TIMEGPS, UBX-TIM-TP       and the GPS week; the time of TIM-TP is that of the next pulse
    $VNINS,333811.9,1694,…            time of week and week of VectorNav

Until a date is known, times count from midnight, or from the start of the week. Midnight and the end of the week are
continued. Sources: NMEA 0183; u-blox F9 HPG 1.32 interface description, 3.15; IERS Bulletin C
(leap seconds).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.embedded.nmea import number_of
from imuscope.protocols.events import Text

S = 1_000_000_000
DAY_NS, WEEK_NS = 86_400 * S, 604_800 * S
TIME_AT = {"GGA": 1, "RMC": 1, "ZDA": 1, "GNS": 1, "GST": 1, "GBS": 1, "GLL": 5}  # field with the time of day
WEEKLY = frozenset({"$VNGPS", "$VNGPE", "$VNINS", "$VNINE"})  # begin with time of week, s, and week
GPS_EPOCH_NS = 315_964_800 * S
LEAPS = ((1_483_228_800, 18), (1_435_708_800, 17), (1_341_100_800, 16), (1_230_768_000, 15), (0, 14))
"""Unix s from which GPS is ahead of UTC by so much, s."""
OLDEST_YEAR = 2000
_UBX_HEAD_BYTES = 6  # bytes of a UBX frame before its payload
_VERSION_FIRST = frozenset(
    {"NAV-HPPOSECEF", "NAV-HPPOSLLH", "NAV-EELL", "NAV-ODO", "NAV-RELPOSNED", "NAV-SVIN", "NAV-PL"}
)
DATES = {"NAV-PVT": (4, 16, 11, 3), "NAV-PVAT": (6, 20, 5, 3), "NAV-TIMEUTC": (12, 8, 19, 4)}
"""Places of the date, of the fraction of its second, ns, and of the flags that mark it as valid; and their bits."""
_TIMEGPS_BYTES, _WEEK_VALID, _LEAP_VALID = 16, 2, 4
_TIM_TP_BYTES, _IN_UTC = 16, 1
_PULSE = "TIM-TP"
CORRECTION_NS = S // 2  # the fraction of UTC and the time of week are rounded apart


@dataclass(slots=True)
class GnssTimes:
    """Times of some messages.

    Args:
        offset: (n,) of the messages in the stream.
        time_ns: (n,) since 1970, or since an unknown midnight or week.
        is_dated: whether the last of them is since 1970.
        kind: "day" or "week": what the last of them counts in; "" without any.
        elapsed_ns: (n,) since a midnight or start of a week that stays the same when the date becomes known.
    """

    offset: Ints
    time_ns: Ints
    is_dated: bool
    kind: str = ""
    elapsed_ns: Ints = field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(slots=True)
class GnssClock:
    """Clock of one receiver, from its messages."""

    _midnight_ns: int | None = None  # of the current day, since 1970
    _week_ns: int | None = None  # start of the current week, since 1970, by UTC
    _last: dict[str, int] = field(default_factory=dict)  # time of day or of week, by kind
    _turns: dict[str, int] = field(default_factory=dict)  # midnights or weeks passed without a date, ns
    _first_ns: int | None = None  # the start that times without a date counted from

    def times(self, texts: Sequence[Text]) -> GnssTimes:
        """Times of those messages that have one, in order."""
        rows = [(text.offset, *one) for text in texts if (one := _time_of(text)) is not None]
        pulses = [(text.offset, *one) for text in texts if text.name == _PULSE and (one := _of_pulse(text)) is not None]
        rows = rows or pulses
        if len({kind for _, kind, _, _ in rows}) > 1:
            dated = {kind for _, kind, _, date in rows if date is not None}
            is_week = (
                "week" in dated or self._week_ns is not None or not ("day" in dated or self._midnight_ns is not None)
            )
            rows = [
                row for row in rows if (row[1] == "week") == is_week
            ]  # one clock, not two that differ by a leap second
        self._learn([(kind, within, date) for _, kind, within, date in (*rows, *pulses)])
        times, firsts = [], []
        is_dated = False
        for _, kind, within, date in rows:
            if date is not None:
                self._set(kind, within, date)
            elif within < self._last.get(kind, within) - DAY_NS // 2:
                self._turn(kind)
            self._last[kind] = within
            start = self._midnight_ns if kind == "day" else self._week_ns
            is_dated = start is not None
            if start is not None and self._first_ns is None:
                self._first_ns = start - self._turns.get(kind, 0)
            times.append(within + (start if start is not None else self._turns.get(kind, 0)))
            firsts.append(self._first_ns or 0)
        offsets = np.array([row[0] for row in rows], np.int64)
        time_ns = np.array(times, np.int64)
        kind = rows[-1][1] if rows else ""
        return GnssTimes(offsets, time_ns, is_dated, kind, time_ns - np.array(firsts, np.int64))

    def _learn(self, rows: Sequence[tuple[str, int, int | None]]) -> None:
        """Take the first date for the messages before it."""
        for name in ("day", "week"):
            known = self._midnight_ns if name == "day" else self._week_ns
            date = next(((within, date) for kind, within, date in rows if kind == name and date is not None), None)
            if known is None and date is not None:
                self._set(name, *date)

    def _set(self, kind: str, within: int, date_ns: int) -> None:
        if kind == "day":
            self._midnight_ns = date_ns
        elif self._week_ns is None or abs(date_ns - within - self._week_ns) > CORRECTION_NS:
            self._week_ns = date_ns - within

    def _turn(self, kind: str) -> None:
        """Continue after midnight, or after the end of the week."""
        length = DAY_NS if kind == "day" else WEEK_NS
        self._turns[kind] = self._turns.get(kind, 0) + length
        if kind == "day" and self._midnight_ns is not None:
            self._midnight_ns += length
        if kind == "week" and self._week_ns is not None:
            self._week_ns += length


def _time_of(text: Text) -> tuple[str, int, int | None] | None:
    """Kind ("day" or "week"), ns within it, and the date: midnight, or the time itself; None without a time."""
    if text.protocol == "nmea" and text.name:
        return _of_sentence(text.line)
    return _of_frame(text.name, text.line) if text.protocol == "ubx" and text.name.startswith("NAV-") else None


def _of_sentence(line: str) -> tuple[str, int, int | None] | None:
    cells = line.partition("*")[0].split(",")
    if cells[0] in WEEKLY:
        return _of_week(cells)
    at = TIME_AT.get(cells[0][-3:], 0)
    if cells[0] == "$PUBX" and len(cells) > 3 and cells[1] in ("00", "04"):
        at = 2
    if not at or len(cells) <= at:
        return None
    within = _time_of_day(cells[at])
    if within is None:
        return None
    date = ""
    if cells[0].endswith("RMC") and len(cells) > 9:
        date = cells[9]
    elif cells[0].endswith("ZDA") and len(cells) > 4:
        date = f"{cells[2]}{cells[3]}{cells[4][2:]}"
    elif cells[0] == "$PUBX" and cells[1] == "04":
        date = cells[3]
    return "day", within, _midnight(date)


def _of_week(cells: Sequence[str]) -> tuple[str, int, int | None] | None:
    """Time of a week and week, which are 0 until there is one."""
    seconds, week = (number_of(cell) for cell in [*cells, "", ""][1:3])
    if seconds is None or not 0 <= seconds < WEEK_NS // S or not week or not 0 < week < 1 << 16:
        return None
    within = round(seconds * 1e9)
    return "week", within, _utc_of_week(int(week), within)


def _utc_of_week(week: int, within: int) -> int:
    """Week and time of week of GPS as UTC, ns since 1970."""
    time_ns = GPS_EPOCH_NS + week * WEEK_NS + within
    return time_ns - next(leaps for begin, leaps in LEAPS if time_ns >= (begin + leaps) * S) * S


def _time_of_day(cell: str) -> int | None:
    """hhmmss.sss as ns since midnight."""
    whole, _, part = cell.partition(".")
    if len(whole) != 6 or not whole.isdecimal() or (part and not part.isdecimal()):
        return None
    hour, minute, second = int(whole[:2]), int(whole[2:4]), int(whole[4:])
    if hour > 23 or minute > 59 or second > 60:
        return None
    return ((hour * 60 + minute) * 60 + second) * S + int(f"{part:0<9}"[:9])


def _midnight(date: str) -> int | None:
    """Ddmmyy as ns since 1970."""
    if len(date) != 6 or not date.isdecimal() or int(date[4:]) >= 80:
        return None
    try:
        return int(datetime(OLDEST_YEAR + int(date[4:]), int(date[2:4]), int(date[:2]), tzinfo=UTC).timestamp()) * S
    except ValueError:
        return None


def _of_frame(name: str, line: str) -> tuple[str, int, int | None] | None:
    frame = bytes.fromhex(line)
    payload = frame[_UBX_HEAD_BYTES:-2]
    if len(payload) < 4 or name in _VERSION_FIRST:
        return None
    within = int.from_bytes(payload[:4], "little") * 1_000_000
    if within >= WEEK_NS:
        return None
    if name == "NAV-TIMEGPS":
        return "week", within, _of_gps_time(payload, within)
    at, nano_at, valid_at, bits = DATES.get(name, (0, 0, 0, 0))
    is_valid = at > 0 and len(payload) >= max(nano_at + 4, valid_at + 1) and payload[valid_at] & bits == bits
    return "week", within, _date(payload, at, nano_at) if is_valid else None


def _of_gps_time(payload: bytes, within: int) -> int | None:
    """UTC by the week, and the leap seconds of the message if it has them."""
    if len(payload) < _TIMEGPS_BYTES or not payload[11] & _WEEK_VALID:
        return None
    week, leaps = int.from_bytes(payload[8:10], "little"), int.from_bytes(payload[10:11], "little", signed=True)
    if not payload[11] & _LEAP_VALID:
        return _utc_of_week(week, within)
    return GPS_EPOCH_NS + week * WEEK_NS + within - leaps * S


def _of_pulse(text: Text) -> tuple[str, int, int | None] | None:
    """Time of the next pulse, and its date."""
    payload = bytes.fromhex(text.line)[_UBX_HEAD_BYTES:-2]
    if len(payload) < _TIM_TP_BYTES or (within := int.from_bytes(payload[:4], "little") * 1_000_000) >= WEEK_NS:
        return None
    week = int.from_bytes(payload[12:14], "little")
    if not week:
        return "week", within, None
    if payload[14] & _IN_UTC:  # both count from the epoch of GPS
        start = GPS_EPOCH_NS + week * WEEK_NS
        return "week", within, start + within
    return "week", within, _utc_of_week(week, within)


def _date(payload: bytes, at: int, nano_at: int) -> int | None:
    """UTC of a navigation solution, ns since 1970."""
    year = int.from_bytes(payload[at : at + 2], "little")
    month, day, hour, minute, second = payload[at + 2 : at + 7]
    if year < OLDEST_YEAR:
        return None
    try:
        moment = datetime(year, month, day, hour, minute, min(second, 59), tzinfo=UTC)
    except ValueError:
        return None
    return int(moment.timestamp()) * S + int.from_bytes(payload[nano_at : nano_at + 4], "little", signed=True)
