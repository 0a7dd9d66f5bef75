"""Dates and times of day in the cells of a table.

2026-01-01T10:30:25.5Z     ISO 8601, with blank, point or comma; UTC if it names no zone
2026/01/01 10:30:25        year first
01.02.2026 10:30           day first, as dates with points are
01/02/2026 10:30:25 PM     day or month first: `order` decides, or the cells themselves (`order_of`)
10:30:25.010               time of day; the date comes from elsewhere
14-Jul-2026 10:30:25       English month; 13-May-21; Tue Jul 14 10:30:25 2026; July 14, 2026 10:30:25
20260101_103025010000      packed; hhmmss.sss of GNSS programs is `packed_clock`
"""

import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from itertools import pairwise
from typing import Literal, NamedTuple

Order = Literal["mdy", "dmy"]

HOUR_S = 3600.0
DAY_S = 86400.0
WEEK_S = 604_800.0
GPS_EPOCH = 315_964_800.0
LAST_YEAR_S = 5e10  # of the years that a date has room for
OLD_YEARS = 70  # from which on a year of two digits is one of the last century
_DATE = re.compile(r"^\s*(\d{1,4})([./-])(\d{1,2})\2(\d{1,4})(?!\d)")
ZONES = {
    **dict.fromkeys(("UTC", "GMT", "WET"), "+00"),
    **dict.fromkeys(("CET", "WEST"), "+01"),
    **dict.fromkeys(("CEST", "EET"), "+02"),
    **dict.fromkeys(("EEST", "MSK"), "+03"),
    **dict.fromkeys(("JST", "KST"), "+09"),
    **{"AEST": "+10", "AEDT": "+11", "EDT": "-04", "EST": "-05", "MDT": "-06", "PDT": "-07", "PST": "-08"},
}
"""Names of zones that have one meaning."""
ZONE = "|".join(ZONES)
_CLOCK = re.compile(
    rf"^\s*(\d{{1,2}}):(\d{{2}})(?::(\d{{2}})(?:(?:[.,]|:(?=\d{{3}}\b))(\d{{1,12}}))?)?\s*([AaPp]\.?[Mm]\.?)?\s*(Z|(?:UTC|GMT)?[+-]\d{{1,2}}(?::?\d{{2}})?|{ZONE})?\s*$"
)
_PACKED = re.compile(
    r"^\s*((?:19|20)\d\d)(0[1-9]|1[0-2])(0[1-9]|[12]\d|3[01])[T _-]?([01]\d|2[0-3])([0-5]\d)([0-5]\d)[.,]?(\d*)\s*$"
)
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_IN_WORDS = re.compile(rf"^\s*(\d{{1,2}})[- ]({'|'.join(_MONTHS)})[a-z]*[- ](\d{{4}}|\d\d)\b", re.IGNORECASE)
_WEEKDAY = re.compile(r"^\s*(?:mon|tue|wed|thu|fri|sat|sun)[a-z]*\.?,?\s+(?=\w)", re.IGNORECASE)
_MONTH_FIRST = re.compile(
    rf"^\s*(?P<month>{'|'.join(_MONTHS)})[a-z]*\.?\s+(?P<day>\d{{1,2}})(?:,\s*(?P<year>\d{{4}})\b)?(?P<clock>[^a-z]*?)\s*"
    rf"(?:\b(?P<zone>{ZONE})\b)?\s*(?P<last>(?<=\s)(?:19|20)\d\d)?\s*(?P<half>[ap]m)?\s*$",
    re.IGNORECASE,
)
_DASHED = re.compile(r"^(\s*\d{4}-\d\d-\d\d)_(\d\d)[-:](\d\d)[-:](\d\d)(?:[-_.](\d{3}))?\b")  # of a DOT
_PLACE = re.compile(r"\s*\[[\w/+-]+\]\s*$")  # of a zone whose offset is there, as Java writes it
_MINUTES = re.compile(r"^\s*([0-5]?\d):([0-5]\d)[.,](\d{1,6})\s*$")  # of a spreadsheet, which leaves out the hour
_DAYS = re.compile(
    r"^\s*(-?\d+) days?,? *(?:\+?(\d{1,2}:\d{2}:\d{2}(?:\.\d{1,12})?))?\s*$"
)  # a difference, as Python writes it
_PACKED_CLOCK = re.compile(r"^\s*([0-2]\d)([0-5]\d)([0-5]\d)(\.\d+)?\s*$")


class _Date(NamedTuple):
    """A date: its year, the two other numbers, and their order if the form of the date says it."""

    year: int
    first: int
    second: int
    order: Order | None


def is_moment(text: str) -> bool:
    """Whether a cell looks like a date, a time of day, or both."""
    if any(pattern.match(text) for pattern in (_DATE, _CLOCK, _PACKED, _IN_WORDS, _MINUTES, _DAYS)):
        return True
    match = _MONTH_FIRST.match(_plain(text)) if text.lstrip()[:1].isalpha() else None
    return match is not None and (match["year"] or match["last"]) is not None


def _plain(text: str) -> str:
    """A date without the names of its day and its place."""
    return _PLACE.sub("", _WEEKDAY.sub("", text))


def _with_colons(match: re.Match[str]) -> str:
    return f"{match[1]} {match[2]}:{match[3]}:{match[4]}.{match[5] or 0}"


def is_time_of_day(text: str) -> bool:
    """Whether a cell is a time of day alone."""
    return (
        is_of_hour(text) or is_duration(text) or _CLOCK.match(text) is not None or _PACKED_CLOCK.match(text) is not None
    )


def is_of_hour(text: str) -> bool:
    """Whether a cell is minutes and seconds, without the hour."""
    return _MINUTES.match(text) is not None


def is_duration(text: str) -> bool:
    """Whether a cell is a number of days and a time: 0 days 00:00:01.5."""
    return _DAYS.match(text) is not None


def are_packed(cells: Sequence[str], newest: float, *, named: bool) -> bool:
    """Whether all cells are packed dates with times, none later than `newest`, or hhmmss.sss: these only if the heading
    says it, a zero is in front, or a minute ends and they are evenly spaced as that.
    """
    if not cells or not all(map(_PACKED_CLOCK.match, cells)):
        moments = [unix_seconds(cell) if _PACKED.match(cell) else None for cell in cells]
        return bool(cells) and all(moment is not None and moment <= newest for moment in moments)
    seconds = [seconds_of_day(cell) or 0.0 for cell in cells]
    steps = sorted(after - before for before, after in pairwise(seconds))
    is_even = len(steps) > 1 and 0 < steps[-1] < min(2 * steps[0], HOUR_S)
    return named or cells[0].startswith("0") or (is_even and len({cell[:4] for cell in cells}) > 1)


def are_dates(cells: Sequence[str]) -> bool:
    """Whether all cells are packed dates with times."""
    return bool(cells) and all(map(_PACKED.match, cells))


def _date(text: str) -> tuple[_Date, str] | None:
    match = _DATE.match(text)
    if match is None:
        return None
    first, last, rest = match[1], match[4], text[match.end() :]
    if len(first) == 4:
        return _Date(int(first), int(match[3]), int(last), "mdy"), rest
    if len(last) not in (2, 4):
        return None
    return _Date(_year(last), int(first), int(match[3]), "dmy" if match[2] == "." else None), rest


def _year(text: str) -> int:
    """A year of two or four digits. As usual, two-digit years 70 to 99 belong to the last century."""
    return int(text) + (0 if len(text) > 2 else 1900 if int(text) >= OLD_YEARS else 2000)


@lru_cache(maxsize=4096)
def _midnight(date: _Date, order: Order) -> float | None:
    month, day = (date.first, date.second) if (date.order or order) == "mdy" else (date.second, date.first)
    try:
        return datetime(date.year, month, day, tzinfo=UTC).timestamp()
    except ValueError:
        return None


def order_of(cells: Iterable[str], newest: float) -> tuple[Order | None, bool]:
    """Whether day or month is first, None if both are possible; and whether it matters.

    Args:
        newest: no sample is later than that, unix s.
    """
    dates = [parsed[0] for text in cells if (parsed := _date(text)) is not None and parsed[0].order is None]
    if all(date.first == date.second for date in dates):
        return "dmy", False
    orders: tuple[Order, ...] = ("mdy", "dmy")
    midnights = {order: [_midnight(date, order) for date in dates] for order in orders}
    possible = [order for order in orders if all(one is not None and one <= newest for one in midnights[order])]
    return (possible[0] if len(possible) == 1 else None), True


def seconds_of_day(text: str) -> float | None:
    """Seconds since midnight UTC of a time of day; negative or above a day with an offset from UTC."""
    if (match := _MINUTES.match(text)) is not None:
        return int(match[1]) * 60 + int(match[2]) + float(f"0.{match[3]}")
    if (match := _DAYS.match(text)) is not None:
        return int(match[1]) * DAY_S + (seconds_of_day(match[2]) or 0.0 if match[2] else 0.0)
    match = _CLOCK.match(text)
    if match is None:
        packed = _PACKED_CLOCK.match(text)
        parts = [float(part or 0) for part in packed.groups()] if packed is not None else []
        return parts[0] * 3600 + parts[1] * 60 + parts[2] + parts[3] if parts else None
    hour, minute, second = int(match[1]), int(match[2]), int(match[3] or 0)
    if match[5]:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + (12 if match[5][0] in "pP" else 0)
    if hour > 24 or minute > 59 or second > 60:
        return None
    fraction = float(f"0.{match[4]}") if match[4] else 0.0
    return hour * 3600 + minute * 60 + second + fraction - _offset(match[6])


def _offset(zone: str | None) -> float:
    zone = re.sub(f"^(?:{ZONE})", "", ZONES.get(zone or "", zone or ""), flags=re.IGNORECASE)
    if not zone or zone[0] not in "+-":
        return 0.0
    digits = zone[1:].replace(":", "")
    hours, minutes = (digits[:-2], digits[-2:]) if len(digits) > 2 else (digits, "0")
    seconds = int(hours) * 3600 + int(minutes) * 60
    return float(seconds if zone[0] == "+" else -seconds)


def unix_seconds(text: str, order: Order = "dmy") -> float | None:
    """A date, with or without a time of day, as unix s; None if it is neither."""
    if (packed := _PACKED.match(text)) is not None:
        text = "{}-{}-{}T{}:{}:{}.{:0<6.6}".format(*packed.groups())
    text = _DASHED.sub(_with_colons, _plain(text))
    if (match := _MONTH_FIRST.match(text)) is not None and (year := match["year"] or match["last"]):
        day = f"{year}-{_MONTHS.index(match['month'].lower()[:3]) + 1:02}-{match['day']:0>2}"
        text = f"{day} {match['clock'].strip(' ,')}{match['half'] or ''}{match['zone'] or ''}".strip()
    if (match := _IN_WORDS.match(text)) is not None:
        text = f"{_year(match[3])}-{_MONTHS.index(match[2].lower()) + 1:02}-{match[1]:0>2}{text[match.end() :]}"
    matches = _date(text)
    if matches is not None:
        midnight, rest = _midnight(matches[0], order), matches[1].lstrip("T ,;_-/")
        clock = seconds_of_day(rest) if rest.strip() else 0.0
        if midnight is not None and clock is not None:
            return midnight + clock
    try:
        moment = datetime.fromisoformat(text.strip().replace(" UTC", "Z"))
    except ValueError:
        return None
    return (moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)).timestamp()


def dated_name(name: str) -> float | None:
    """Date and time in the name of a file (2026-01-01_10-30-25), read as UTC, unix s."""
    match = re.search(
        r"(?<!\d)(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)[-_T .]?([0-2]\d)[-_.:h]?([0-5]\d)[-_.:m]?([0-5]\d)", name
    )
    if match is None:
        return None
    try:
        return datetime(*map(int, match.groups()), tzinfo=UTC).timestamp()  # type: ignore[misc, arg-type]
    except ValueError:
        return None


def utc_text(seconds: float) -> str:
    """A time in words: 2026-01-01 10:30:25.000 UTC."""
    if not abs(seconds) < LAST_YEAR_S:
        return f"{seconds:.6g} s since 1970"
    moment = datetime.fromtimestamp(0, UTC) + timedelta(seconds=round(seconds, 3))
    return f"{moment:%Y-%m-%d %H:%M:%S}.{moment.microsecond // 1000:03d} UTC"


def cells_of(rows: Sequence[Sequence[str]], column: int) -> list[str]:
    """Cells of a column that are not empty."""
    return [row[column].strip() for row in rows if row[column].strip()]
