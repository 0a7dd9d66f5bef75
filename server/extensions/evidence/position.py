"""Detection of data that reveal the position of a recording, and its removal from files for others.

Left out are whole signals and settings whose names, units or frames say that they hold a position or come from a GNSS
receiver, and in every text the numbers that lie where the recording was made. Velocities, accelerations and
orientations in a local frame stay: they show how something moved, not where.

A quantity in an earth-centred frame is a position in disguise: compared with the same one in a local frame, it gives
latitude and longitude.
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from imuscope.recordings.columns.store import ColumnStore
from imuscope.server.wire import ChannelInfo, ColumnInfo

REDACTED = "[position left out]"
LENGTHS = {"m", "mm", "cm", "km", "ft"}

# Words of names and titles, lower case; names are split where a capital letter or a digit begins.
_WORDS = {
    *("lat", "lon", "lng", "latitude", "longitude", "latlon", "latlong", "lla", "llh", "alt", "altitude", "height"),
    *("hmsl", "msl", "geoid", "undulation", "ellipsoid", "ecef", "wgs", "utm", "mgrs", "position", "pos", "location"),
    *("gnss", "gps", "glonass", "galileo", "beidou", "pvt", "nav", "fix", "sat", "satellite", "satellites", "sv"),
    *("svinfo", "ephemeris", "almanac", "pseudorange", "rtk", "rtcm", "nmea", "gga", "ntrip", "baseline"),
    *("ned", "enu", "declination", "inclination", "gravity", "origin"),
}
_FRAME_WORDS = {"ned", "enu"}  # in the name of a velocity they name its frame
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[a-z]+")

_NUMBER = re.compile(r"(?<!\d)(?<!\d[.,_])[-+\u2212]?\d+(?:[.,_]\d+)?")
_PAIR = re.compile(r"[-+\u2212]?\d{1,3}[.,]\d{3,}°?\s*[NSns]?\s*[,;/ ]\s*[-+\u2212]?\d{1,3}[.,]\d{3,}°?\s*[EWew]?")
_SEXAGESIMAL = re.compile(
    r"\d{1,3}\s*°\s*\d{1,2}(?:[.,]\d+)?\s*['′’](?:\s*\d{1,2}(?:[.,]\d+)?\s*(?:\"|″|”|''))?\s*[NSEW]?"
)
_NMEA = re.compile(r"\b\d{4,5}\.\d{2,}\s*,?\s*[NSEW]\b")
_PLUS_CODE = re.compile(r"\b[23456789CFGHJMPQRVWX]{4,8}\+[23456789CFGHJMPQRVWX]{2,3}\b")
ALWAYS = (_PAIR, _SEXAGESIMAL, _NMEA, _PLUS_CODE)

NEAR_DEG = {2: 0.02, 3: 0.1, 4: 1.0}  # by decimals: a number this near to a recorded latitude or longitude is one
NEAR_M = 50_000.0  # and this near to a recorded coordinate in an earth-centred frame
LEAST_ECEF_M = 10_000.0  # smaller coordinates are numbers like any others


def words_of(text: str) -> set[str]:
    """Words of a name: "PositionEcef_x" has position, ecef and x."""
    return {word.lower() for word in _WORD.findall(text)}


def names_position(text: str) -> bool:
    """Whether a name or title says that its value is a position or leads to one."""
    return bool(words_of(text) & _WORDS)


def reveals_position(info: ChannelInfo, column: ColumnInfo) -> bool:
    """Whether a column reveals the position of its device."""
    if column.unit in LENGTHS or info.unit in LENGTHS or "ECEF" in info.frame:
        return True
    names = words_of(" ".join((info.name, info.title, info.group, info.message, column.name, column.label)))
    words = names & _WORDS
    is_motion = bool(names & {"velocity", "vel", "acceleration", "quaternion", "euler", "orientation"})
    return bool(words - _FRAME_WORDS if is_motion else words)


@dataclass(slots=True)
class Scrubber:
    """Removes numbers that lie where the recording was made from texts, and counts them.

    Args:
        degrees: ranges of latitudes and longitudes, °.
        metres: ranges of coordinates in an earth-centred frame, m.
    """

    degrees: list[tuple[float, float]] = field(default_factory=list)
    metres: list[tuple[float, float]] = field(default_factory=list)
    removed: int = 0

    def __call__(self, text: str) -> str:
        """The text without positions."""
        for pattern in ALWAYS:
            text, n = pattern.subn(REDACTED, text)
            self.removed += n
        return _NUMBER.sub(self._number, text)

    def _number(self, match: re.Match[str]) -> str:
        digits = match[0]
        if not self._is_position(re.sub("[,_]", ".", digits).replace("\u2212", "-")):
            return digits
        self.removed += 1
        return REDACTED

    def _is_position(self, digits: str) -> bool:
        value = abs(float(digits))
        decimals = len(digits.partition(".")[2])
        sizes = [(abs(low), abs(high)) for low, high in self.degrees]
        degrees = [(value, NEAR_DEG[min(decimals, 4)])] if decimals >= 2 else []
        if decimals >= 4 and value <= 2 * math.pi:
            degrees.append((math.degrees(value), NEAR_DEG[4]))
        if decimals == 0 and value >= 1e6:
            degrees += [(value / scale, NEAR_DEG[4]) for scale in (1e6, 1e7)]
        if any(min(ends) - near <= one <= max(ends) + near for one, near in degrees for ends in sizes):
            return True
        far = [(abs(low), abs(high)) for low, high in self.metres]
        lengths = [value / scale for scale in (1.0, 100.0, 1000.0)] if value >= LEAST_ECEF_M else []
        return any(
            one >= LEAST_ECEF_M and min(ends) - NEAR_M <= one <= max(ends) + NEAR_M for one in lengths for ends in far
        )


def scrubber_of(store: ColumnStore, infos: Iterable[ChannelInfo]) -> Scrubber:
    """The scrubber for all positions of a recording."""
    scrubber = Scrubber()
    for info in infos:
        for at, column in enumerate(info.columns):
            names = words_of(f"{column.name} {column.label}")
            is_angle = bool(names & {"lat", "lon", "latitude", "longitude"})
            is_far = (column.unit == "m" and "ECEF" in info.frame) or "ecef" in names | words_of(info.name)
            if (is_angle or is_far) and (ends := _ends(store, info.id, at)) is not None:
                (scrubber.degrees if is_angle else scrubber.metres).append(ends)
    return scrubber


def _ends(store: ColumnStore, channel: int, column: int) -> tuple[float, float] | None:
    span = store.span(channel)
    if span is None:
        return None
    least, most = math.inf, -math.inf
    for part in store.values(channel, column, 0, store.rows(channel)):
        finite = part[abs(part) > 1e-9]  # zeros stand for "not known yet"; NaN compares false
        if len(finite):
            least, most = min(least, float(finite.min())), max(most, float(finite.max()))
    return (least, most) if math.isfinite(least) and math.isfinite(most) else None


def scrubbed(value: Any, scrub: Scrubber) -> Any:
    """A JSON value with all its texts scrubbed; its numbers stay."""
    if isinstance(value, str):
        return scrub(value)
    if isinstance(value, list):
        return [scrubbed(one, scrub) for one in value]
    if isinstance(value, dict):
        return {name: scrubbed(one, scrub) for name, one in value.items()}
    return value
