"""Names of columns with times: conventions of programs, as data, and what such a heading says."""

import functools
import re

from imuscope.recordings.tables.headings import ColumnHeading
from imuscope.recordings.tables.time_units import LONG_SPELLINGS, SPELLINGS

DAYS = ("datenum", "mjd", "jd", "julian_date", "serial_date")
SERIAL_DAYS = {
    "Excel, since 1899-12-30": -25_569.0 * 86_400,
    "MATLAB, since the year 0": -719_529.0 * 86_400,
    "MJD, since 1858-11-17": -40_587.0 * 86_400,
    "JD, since 4713 BC": -2_440_587.5 * 86_400,
}
"""Counts of days that some programs write for a date → their zero, unix s."""
ZEROS = {
    "Windows, since 1601": ("100 ns", 1e-7, -11_644_473_600.0),
    ".NET, since the year 1": ("100 ns", 1e-7, -62_135_596_800.0),
    "LabVIEW, since 1904": ("s", 1.0, -2_082_844_800.0),
    "Apple, since 2001": ("s", 1.0, 978_307_200.0),
}
"""Programs that count from another zero → unit, s per number, and the zero, unix s."""
WORLD = (
    "zeit(?:stempel|punkt)?|uhrzeit|laufzeit|messzeit|temps|heure|horodatage|tiempo|hora|tempo|ora|czas|tijd|tijdstip|tid|"
    "aika|čas|idő|zaman|время|час|时间|时间戳|時間|時刻|タイムスタンプ|시간"
)
"""A time in other languages."""
TIMES = re.compile("^(?:t|time_?(?:stamp)?|date|date_?time|utc|epoch?|" + WORLD + "|" + "|".join(DAYS) + ")$")
MIN_RISING = 0.9  # of the steps, of dates in a column that no heading names
FINE, FINE_UNITS = "sample_time_fine", {"100 µs": 1e-4, "µs": 1e-6}  # of an MTi, and of a DOT
FINE_SLOWEST, FINE_FASTEST = 0.9, 2100.0  # Hz: 1 Hz to 2 kHz of an MTi, and what its clock is off
COUNTERS = re.compile("^(?:packet|sample)_(?:counter|number)$|^(?:counter|samples?|count)$")
JSON_NAMES = ("columns", "sensors", "fields", "names", "headers", "desc", "axes", "channels", "labels", "index")
"""Members of a JSON object that name the cells of the rows beside them, or number these."""
JSON_RATES = dict.fromkeys(("interval_ms", "intervalMs", "sampling_interval_ms", "period_ms"), "sampling rate")
"""Members that are the time between samples, ms."""
UTC_PARTS = ("year", "month", "day", "hour", "minute", "second", "nano")
FIRST_WEEK = 1024.0  # the GPS week of 1999: earlier logs are rare, small numbers are not
NO_UNIT = re.compile(r"utc|gps|gnss|local|unix|epoch|boot|ros|iso|rfc|:|date|time|since")  # in the brackets of a time
DECIMALS = re.compile(r"[.,]\d")
MIN_ROWS = 3  # rows whose steps say something
_STEMS = (
    f"{WORLD}|timers?|times?|gpst|gpstime|stamps?|time_?stamps?|date_?time|t|ts|clock|elapsed|uptime|realtime|epoch?"
)
_BEFORE = (
    "sensor|system|sys|device|dev|host|unix|gps|gnss|ins|utc|log|logging|local|elapsed|relative|rel|boot|sample|rec|"
    "record|recording|ros|rosbag|imu|header|msg|field|wall|phone|cpu|mcu|chip|since|arrival|server|client|packet|start|"
    "offset|clock|pc|computer|test|run|experiment|received?|recv|rx"
)
_AFTER = (
    "(?:in_)?(?:"
    + "|".join(SPELLINGS)
    + ")|utc|gps|elapsed|boot|sample|unix|epoch|since_?(?:1970|reboot|boot|start)|cal"
)
TIME = re.compile(
    rf"^(?:(?:{_BEFORE})_)*(?:{_STEMS})(?:_(?:{_AFTER}))*$|^(?:[a-z0-9]+_)+(?:time_?stamp|date_?time)(?:_(?:{_AFTER}))*$"
)
ELAPSED = re.compile(
    rf"^(?:(?:elapsed|ins|gps|unix)_)?(?:{'|'.join(one for one in SPELLINGS if len(one) > 3)})(?:_elapsed)?$"
)
RUNNING = re.compile(r"(?:^|_)(?:uptime|elapsed|boot|runtime|laufzeit|since_(?:re)?(?:boot|start))(?:_|$)")
UNIX = re.compile(r"(?:^|_)(?:unix|posix|utc)(?:_|$)")
"""Headings of times since the start of a device, and of those since 1970."""
TIMELIKE = re.compile("tim|stamp|clock|epoch")
ZONE = re.compile(
    r"^(?:utc|gmt)?\s*(?P<sign>[+-])(?P<hours>\d{1,2}):?(?P<minutes>\d\d)?$", re.IGNORECASE
)  # in brackets
ZONES = {"jst": 9 * 3600.0}  # headings that are a zone → s by which it is ahead of UTC
OF_HOST = re.compile(r"^(?:server|client|rosbag|arrival|host|pc|computer|received?|recv|rx)_")
OF_WEEK = ("time_of_week", "i_tow", "itow", "tow", "gps_tow", "gps_time_of_week", "sow", "gps_sow", "seconds_of_week")
OF_DAY = ("time_of_day", "tod", "sod", "msod", "seconds_of_day", "second_of_day", "of_day", "sec_of_day")
GPS_TIME = ("gpst", "gps_time", "gpstime", "gps_sec", "gps_second", "gps_seconds", "ins_second", "ins_seconds")
"""Names of a time of week, if the numbers are below a week."""
WEEK_BITS = 1024.0  # weeks, after which a number of ten bits starts again
CYCLE_NAMES = ("gps_cycle", "week_cycle", "rollovers", "gps_week_rollovers")
"""Names of how often it has done so."""
WEEK_NAMES = ("week", "gps_week", "gpsweek", "gps_week_number", "week_number", "gps_wn", "wn")
IS_GNSS = re.compile(r"^(?:\w+_)?(?:lat|latitude|lon|long|longitude)(?:_|$)")
_SENSORS = "acc|gyr|mag|imu|grav|orient|rot|quat|att|euler|baro|press|temp|light|prox|gps|gnss|pos|loc|wifi|ble"
SENSOR = re.compile(_SENSORS, re.IGNORECASE)
INERTIAL = re.compile(
    r"acc(?!ur|ou|es|ep|um)|gyr|angular|omega|imu|^[agw][ _.]?[xyz]$|^[aw]_rs|pqr|uvw|quat|attitude|roll|pitch|"
    r"beschl|drehrate|aceler|giro[sc]|ускорен|гироск|加速度|角速度|陀螺|ジャイロ|가속도",
    re.IGNORECASE,
)


@functools.lru_cache(4096)
def words_of(name: str) -> str:
    """A heading in lower case with _ between its words: timeOfWeekMs is time_of_week_ms."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.strip())
    return re.sub(r"[^\w%]+", "_", spaced.lower()).strip("_")


def named_unit(heading: ColumnHeading) -> str:
    """Unit that the heading of a time names, "" for none."""
    text = heading.unit.strip().lower()
    if unit := SPELLINGS.get(text) or LONG_SPELLINGS.get(text, ""):
        return unit
    words = [word for word in words_of(heading.name).split("_") if word in SPELLINGS]
    return SPELLINGS[words[-1]] if words else ""


def has_odd_unit(heading: ColumnHeading) -> bool:
    """Whether the brackets of a heading name a unit that is not known: ticks, counts."""
    text = heading.unit.strip().lower()
    return bool(text) and not named_unit(heading) and not NO_UNIT.search(text)


def without_unit(words: str) -> str:
    stem, _, last = words.rpartition("_")
    return stem if last in SPELLINGS else words


def is_plain(heading: ColumnHeading) -> bool:
    words = words_of(heading.name)
    return any(map(TIMES.match, (words, without_unit(words)))) or heading.name.startswith("__")
