"""Text logs whose rows begin with the name of a sensor or message: the rows of each name are a table of their own.

ACCE;0.012;100.012;0.1;0.2;9.8;3             GetSensorData; a comment has the columns: % ACCE;AppTimestamp(s);…
Raw,72065123,10084000000,…                   GnssLogger
%RAWIMUSA,2167,144140.000;2167,…*59b7864b    NovAtel: week and time of week in the header, columns by the message
IMU 1624426287.2 0.01 0.02 0.03 0 0 9.8      as GNSS and ODOM rows between them
gyroscope,411480,-0.28,0.04,0.14             several sensors of one form, without a heading
$COL,IMU,time,wx,wy,wz                       FlySight: columns and units in rows of their own, then $IMU,603389.4,15.1,…
2026-01-02 10:15:00.00: IMU {TimeUS : 1, …}  mavlogdump, as text
4000,imu,-0.19,0.22,-9.9                     the time before the name, as in replays of PX4
"""

import csv
import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from io import StringIO, TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.file_names import clean_name
from imuscope.recordings.readers.file_suffixes import suffixes
from imuscope.recordings.readers.formats.compressed import temporary_source
from imuscope.recordings.readers.formats.decompressing import UnpackedFolder
from imuscope.recordings.readers.formats.table_set import TableSet
from imuscope.recordings.readers.registry import OpenRequest
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.tables.clock import AmbiguousTableError
from imuscope.recordings.tables.clocks.names import SENSOR, words_of
from imuscope.recordings.tables.dates import is_moment
from imuscope.recordings.tables.format import (
    LONGEST_LINE,
    MIN_SHARE,
    SAMPLE_BYTES,
    TableFormat,
    format_of,
    is_number,
    split,
)
from imuscope.recordings.tables.line_marks import labels_of
from imuscope.recordings.tables.options import TableOptions
from imuscope.recordings.tables.table_source import CsvSource, TableSource

if TYPE_CHECKING:
    from imuscope.recordings.sources import Source

FEWEST_ROWS = 2  # of a name
MOST_NAMES = 64
MIN_NUMBER_SHARE = 0.5  # share of the cells behind a name that are numbers: a network has a name, too
_ROW = re.compile(
    r"^[#%$]?\s*(?:(?P<time>-?\d+(?:\.\d+)?)[,;\t|])?"
    r"(?P<name>[A-Za-z][\w-]{0,40})(?P<separator>[,;\t|]| +)(?P<rest>.*)$"
)
_COLUMNS = re.compile(r"(?:^|[\s'\"#%:])(?P<name>[A-Za-z][\w-]{0,40})(?P<separator>[,;\t|])(?P<rest>[^'\"]*)")
KEY = re.compile(
    r"^(?:sensor|device|imu|node)(?:_?(?:type|name|id|address))?$|^attribute$|^mac(?:_?address)?$|^address$"
)
NUMBERED = re.compile(r"^(?:sensor|device|imu|node)_?(?:id|nr|no|num|number|index)$")
_DECLARED = re.compile(r"^\$(?P<what>COL|UNIT),(?P<name>[A-Za-z]\w{0,40}),(?P<rest>.*)$")
_NOVATEL = re.compile(r"^(?:\[\w+\])?[#%](?P<name>[A-Z0-9]+A),(?P<head>[^;]*);(?P<body>[^*]*)\*[0-9A-Fa-f]{8}\s*$")
_MAVLINK = re.compile(
    r"^(?P<time>\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d+): (?P<name>[A-Z][A-Z0-9_]{1,40}) \{(?P<body>[^{}]*)\}\s*$"
)
_MEMBER = re.compile(r"(?:^|, )(?P<name>[A-Za-z_]\w*) : (?P<value>\[[^\]]*\]|.*?)(?=, [A-Za-z_]\w* : |$)")
_LONG_HEAD = "port,sequence,idle,time status,week,time of week (s),receiver status,reserved,version"
_SHORT_HEAD = "week,time of week (s)"
_RAW_IMU = "imu week,imu seconds,imu status,accel z,accel -y,accel x,gyro z,gyro -y,gyro x"
_INSPVA = (
    "ins week,ins seconds,latitude (deg),longitude (deg),height (m),velocity north (m/s),velocity east (m/s),"
    "velocity up (m/s),roll (deg),pitch (deg),azimuth (deg),status"
)
_SOLUTION = "solution status,position type,latitude (deg),longitude (deg),height (m),undulation (m)"
_INSPVAX = (
    f"ins status,{_SOLUTION.partition(',')[2]},velocity north (m/s),velocity east (m/s),velocity up (m/s),roll (deg),"
    "pitch (deg),azimuth (deg),deviation of latitude (m),deviation of longitude (m),deviation of height (m),"
    "deviation of velocity north (m/s),deviation of velocity east (m/s),deviation of velocity up (m/s),"
    "deviation of roll (deg),deviation of pitch (deg),deviation of azimuth (deg),extended status,seconds since update"
)
_BESTPOS = (
    f"{_SOLUTION},datum,deviation of latitude (m),deviation of longitude (m),deviation of height (m),station,"
    "differential age (s),solution age (s),satellites,satellites in solution"
)
_BESTVEL = "solution status,velocity type,latency (s),age (s),horizontal speed (m/s),track (deg),vertical speed (m/s)"
_INS = "ins week,ins seconds"
NOVATEL_COLUMNS = {
    **dict.fromkeys(("INSPVAXA", "INSPVASXA"), _INSPVAX),
    **dict.fromkeys(("BESTPOSA", "BESTGNSSPOSA", "PSRPOSA", "RTKPOSA"), _BESTPOS),
    **dict.fromkeys(("BESTVELA", "BESTGNSSVELA", "PSRVELA"), _BESTVEL),
    **dict.fromkeys(("INSATTA", "INSATTSA"), f"{_INS},roll (deg),pitch (deg),azimuth (deg),status"),
    **dict.fromkeys(("INSATTQSA",), f"{_INS},quaternion w,quaternion x,quaternion y,quaternion z,status"),
    **dict.fromkeys(("INSPOSA", "INSPOSSA"), f"{_INS},latitude (deg),longitude (deg),height (m),status"),
    **dict.fromkeys(
        ("INSVELA", "INSVELSA"), f"{_INS},velocity north (m/s),velocity east (m/s),velocity up (m/s),status"
    ),
    **dict.fromkeys(("RAWIMUA", "RAWIMUSA"), _RAW_IMU),
    **dict.fromkeys(("RAWIMUXA", "RAWIMUSXA"), f"imu error,imu type,{_RAW_IMU}"),
    **dict.fromkeys(("INSPVAA", "INSPVASA"), _INSPVA),
}
"""Columns behind the header, as the manual of OEM7 receivers names them; y of an IMU has the opposite sign."""


def has_typed_rows(path: Path) -> bool:
    """Whether the rows of a text file begin with two names or more, of unlike form or of sensors, or have a column of
    names of sensors or devices.
    """
    with open_regular(path) as file:
        head = file.read(SAMPLE_BYTES)
    if b"\0" in head:
        return False
    if _names_column(path) is not None:
        return True
    lines = [line for line in head.decode("utf-8", "replace").splitlines()[:-1] if line.strip()]
    if sum(map(bool, map(_MAVLINK.match, lines))) > MIN_SHARE * len(lines):
        return True
    if labels_of(lines) is not None:  # the numbers have names, not the rows
        return False
    if any(map(_DECLARED.match, lines)) or sum(map(bool, map(_NOVATEL.match, lines))) > MIN_SHARE * len(lines):
        return True
    rows = [row for line in lines if (row := _row(line)) is not None]
    plain = [line for line in lines if line.lstrip()[:1] not in "#%/"]
    names = {name for name, count in Counter(name for name, _, _ in rows).items() if count >= FEWEST_ROWS}
    if not 2 <= len(names) <= MOST_NAMES or len(rows) < MIN_SHARE * len(plain):
        return False
    sizes = {(name, len(cells)) for name, _, cells in rows if name in names}
    unlike = len({size for _, size in sizes}) > 1 and len(sizes) < 2 * len(names)
    return unlike or (sum(map(bool, map(SENSOR.search, names))) > 1 and _row(plain[0]) is not None)


def _names_column(path: Path) -> tuple[TableFormat, int] | None:
    """The form of a table with a heading, and its column of names of sensors or devices; None without one."""
    try:
        form = format_of(path)
    except RecordingError:
        return None
    if form.is_ragged:
        return None
    with open_regular(path) as file:
        lines = file.read(SAMPLE_BYTES).decode("utf-8", "replace").splitlines()
    if any(map(_MAVLINK.match, lines[:FEWEST_ROWS])):
        return None
    comments = [line for line in lines if line[:1] in "#%"]
    described = {match["name"] for line in comments for match in _COLUMNS.finditer(line)}
    for column, heading in enumerate(form.headings):
        names = {row[column].strip() for row in form.sample}
        most = min(MOST_NAMES, len(form.sample) // FEWEST_ROWS)  # so that one has rows enough
        if not 2 <= len(names) <= most or any(is_moment(one) or not one for one in names):
            continue
        if any(map(is_number, names)):
            if NUMBERED.match(words_of(heading)) and all(map(str.isdecimal, names)):
                return form, column
            continue
        if column == 0 and names & described:  # each name has columns of its own
            continue
        if KEY.match(words_of(heading)) or sum(map(bool, map(SENSOR.search, names))) > 1:
            return form, column
    return None


def open_typed_rows(request: OpenRequest) -> "Source":
    """The tables of a file with typed rows.

    Raises:
        RecordingError: none of them can be read.
    """
    unpacked, by_column = UnpackedFolder(request.path), _names_column(request.path)
    if by_column is not None:
        source = temporary_source(unpacked, request, lambda: _written_by_column(request.path, unpacked, *by_column))
    else:
        source = temporary_source(unpacked, request, lambda: _written(request.path, unpacked))
    return _with_one_unit(source, request.table) if isinstance(source, TableSet) else source


def _with_one_unit(source: TableSet, options: TableOptions) -> TableSet:
    """The tables, in which a time whose unit is open has that of the same column of another one: it is one clock."""
    axes = [one.axis for one in source.members if one.axis is not None]
    members: list[TableSource] = []
    for one in source.members:
        refusal = one.refusal if isinstance(one, CsvSource) else None
        open_clock = refusal.clock if isinstance(refusal, AmbiguousTableError) else None
        same = [axis for axis in axes if open_clock is not None and axis.clock.columns == open_clock.columns]
        units = {axis.clock.unit for axis in same}
        if open_clock is not None and len(units) == 1 and units <= {reading.unit for reading in open_clock.readings}:
            one = CsvSource(one.path, replace(options, unit=units.pop()))
            if one.axis is not None and one.axis.clock.epoch == same[0].clock.epoch:
                one.axis.origin, one.axis.dated_by = same[0].origin, same[0].dated_by
        members.append(one)
    source.members = members
    return source


def _row(line: str) -> tuple[str, str, list[str]] | None:
    """Name, separator and the cells behind it; None for any other line."""
    if (novatel := _NOVATEL.match(line)) is not None:
        return novatel["name"], ",", f"{novatel['head']},{novatel['body']}".split(",")
    if (mavlink := _MAVLINK.match(line)) is not None:
        values = [one["value"].replace(",", " ").strip() for one in _MEMBER.finditer(mavlink["body"])]
        return mavlink["name"], ",", [mavlink["time"], *values]
    match = _ROW.match(line)
    if match is None:
        return None
    separator = match["separator"].strip(" ")
    cells = [*([match["time"]] if match["time"] else []), *match["rest"].split(separator or None)]
    filled = [cell for cell in cells if cell.strip()]
    numbers = sum(is_number(cell) or is_moment(cell) for cell in filled)
    enough = len(filled) - 1 if not separator else MIN_NUMBER_SHARE * len(filled)  # words between blanks are a sentence
    return (match["name"], separator or " ", cells) if numbers > enough else None


def _heading(line: str, row: tuple[str, str, list[str]] | None, columns: dict[str, str]) -> None:
    """Note the columns that a line names: those of a comment, and of a NovAtel message at its first row."""
    if row is not None and _NOVATEL.match(line) is not None:
        head = _LONG_HEAD if "#" in line.partition(",")[0] else _SHORT_HEAD
        named = [*head.split(","), *NOVATEL_COLUMNS.get(row[0], "").split(",")]
        columns.setdefault(row[0], ",".join([*named, *[""] * len(row[2])][: len(row[2])]))
    elif row is not None and (mavlink := _MAVLINK.match(line)) is not None:
        members = [one["name"] for one in _MEMBER.finditer(mavlink["body"])]
        columns.setdefault(row[0], ",".join(["host time", *members]))  # of the machine that received it
    elif (declared := _DECLARED.match(line)) is not None:
        names = columns.get(declared["name"], "").split(",")
        units = declared["rest"].split(",")
        if declared["what"] == "COL":
            columns[declared["name"]] = declared["rest"]
        elif len(units) == len(names):
            both = zip(names, units, strict=True)
            columns[declared["name"]] = ",".join(f"{name} ({unit})" if unit else name for name, unit in both)
    elif row is None:
        for match in _COLUMNS.finditer(line):
            columns.setdefault(match["name"], match["rest"].strip())


def _written(path: Path, unpacked: UnpackedFolder) -> list[Path]:
    """A file of each name, in the order of the names, and without them."""
    columns: dict[str, str] = {}
    tables = TypedTables(path, unpacked)
    with TextIOWrapper(open_regular(path), encoding="utf-8-sig", errors="replace") as file:
        for line in iter(lambda: file.readline(LONGEST_LINE), ""):
            row = _row(line.rstrip())
            _heading(line.rstrip(), row, columns)
            if row is not None:
                tables.add(row[0], row[1].join(row[2]), _fitting(columns.get(row[0], ""), row))
    files = tables.files()
    if not files:
        hint = "Give a longer part of the log: a table needs two rows of one name."
        raise RecordingError(f"{path.name} has one row of each message only.", hint)
    return files


def _fitting(heading: str, row: tuple[str, str, list[str]]) -> str:
    """The columns that a line names, without empty ones if there are too many: Mag_X(uT);;Mag_Y(uT)."""
    names = heading.split(row[1])
    return heading if len(names) <= len(row[2]) else row[1].join(filter(None, names))


def _written_by_column(path: Path, unpacked: UnpackedFolder, form: TableFormat, column: int) -> list[Path]:
    """A file of each name in a column, and without it."""
    heading = _line(form.headings, column, form.separator)
    tables = TypedTables(path, unpacked)
    with TextIOWrapper(open_regular(path), encoding="utf-8-sig", errors="replace") as file:
        for line in islice(iter(lambda: file.readline(LONGEST_LINE), ""), form.skip, None):
            cells = split(form.marks.removed(line.rstrip("\r\n")), form.separator)
            if len(cells) == form.columns and (name := cells[column].strip()):
                name = f"{form.headings[column].strip()} {name}" if name.isdecimal() else name
                tables.add(name, _line(cells, column, form.separator), heading)
    return tables.files()


def csv_line(cells: Sequence[str], separator: str = ",") -> str:
    out = StringIO()
    csv.writer(out, delimiter=separator, lineterminator="").writerow(cells)
    return out.getvalue()


def _line(cells: Sequence[str], without: int, separator: str) -> str:
    """Cells of a row but one as a line."""
    return csv_line([*cells[:without], *cells[without + 1 :]], separator)


class TypedTables:
    """Tables in a folder, written as their rows come."""

    def __init__(self, path: Path, unpacked: UnpackedFolder) -> None:
        state = path.stat()
        unpacked.check(state.st_size)
        self._written = state.st_mtime
        self._folder = unpacked.path
        self._files: dict[str, TextIO] = {}
        self._rows: Counter[str] = Counter()

    def add(self, name: str, line: str, heading: str) -> None:
        """Add a row; the heading, if there is one, stands above the first."""
        if name not in self._files:
            if len(self._files) == MOST_NAMES:
                return
            place = self._folder / clean_name(f"{name}.csv", suffixes())
            place = (
                place if not place.exists() else self._folder / clean_name(f"{len(self._files)} {name}.csv", suffixes())
            )
            self._files[name] = place.open("x", encoding="utf-8")
            self._files[name].write(f"{heading}\n" if heading else "")
        self._files[name].write(f"{line}\n")
        self._rows[name] += 1

    def files(self) -> list[Path]:
        """The files, closed; without those of a single row."""
        for file in self._files.values():
            file.close()
            os.utime(file.name, (self._written, self._written))  # tables without a date are dated by it
        return [Path(file.name) for name, file in self._files.items() if self._rows[name] >= FEWEST_ROWS]
