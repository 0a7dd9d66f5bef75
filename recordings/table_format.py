"""Form of a text table: where it begins, what separates the columns, decimal sign, and what stands above it.

// Update Rate: 100.0Hz          metadata: comments of #, // or %, and lines of another number of columns
sep=,                            names the separator (Excel, Xsens DOT)
#timestamp [ns],w_RS_S_x,…       a comment above the first row with as many columns is the heading
1500000000000000000,0.0,…        first row
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from imuscope.recordings.mcap_writer import RecordingError
from imuscope.recordings.regular_file import open_regular
from imuscope.recordings.table_dates import is_moment, is_time_of_day, order_of, unix_seconds, utc_text
from imuscope.recordings.table_lines import NO_MARKS, LineMarks, marks_of
from imuscope.recordings.time_units import FASTEST_FRACTION, is_dated

LONGEST_LINE = 4 << 20  # of the comment with the markers in an exported CSV file
SAMPLE_BYTES, SAMPLE_ROWS = 1 << 18, 2000
FEWEST_ROWS = 3  # of numbers, in a file whose name does not say that it is a table
MAX_COLUMNS = 500
MAX_HEAD_LINES = 200
START_NAMES = ("start time", "start", "start_time", "starttime", "recording start", "logging started", "time", "date")
GPS_NAMES, GPS_PARTS = ("gpst", "gps time"), ("GPS week", "tow (s)")
MOST = 0.8  # of the lines have as many cells as there are columns
SEPARATORS = "\t;|, "
_UNIT = re.compile(
    r"|[(\[].*[)\]]|[mnuµ]?s(?:ecs?)?|seconds|(?:deg|degrees?|°|rad|dps)(?:/s(?:ec)?)?|[mck]?m|km/?h|kph|m?g|[unµm]?t|"
    r"m/s(?:ec)?(?:\^?2|²|/s)?|m/\(s(?:ec)?\^2\)|m?gauss|[hk]?pa|mbar|(?:deg|°)?c|m?v|%|hz|lsb|counts?|no_units|unitless|"
    r"n/a|-|none|utc|weeks|local_flux|kohms",
    re.IGNORECASE,
)
_SEP = re.compile(r"^\s*\"?sep=(.)\"?\s*$", re.IGNORECASE)
_PAIR = re.compile(r"^\s*(?P<name>[^:=,;\t{}]{1,60})(?:[:=]\s*[,;\t]?|[,;\t])\s*(?P<value>.{1,200}?)\s*$")
_EQUAL = re.compile(r"\w+ ?= ?[^,;=\t]+")
_AT_RATE = re.compile(r"\bat (\d+(?:\.\d+)? ?Hz)\b")
_COMMENTS = ("#", "//", "% ", "%%", "@")
_MARKS = "#/%@ \t"
_PREFIX = re.compile(r"^[^,;\t:]*: +(?=\S)")  # before the names in a comment: "format: time, ax, ay"
_UNIT_APART = re.compile(r"(?<=[^\s)\]])[ \t]+([(\[][^)\]]*[)\]])")
_LETTER = re.compile(r"\w")  # a cell of dashes names nothing
_COMMA = re.compile(r"^[+-]?\d*,\d+(?:[eE][+-]?\d+)?$")
_POINT = re.compile(r"^[+-]?\d*\.\d+(?:[eE][+-]?\d+)?$")


@dataclass(frozen=True, slots=True)
class TableFormat:
    """Form of a table.

    Args:
        skip: lines before the first row.
        separator: one character; " " for any run of blanks.
        decimal: "." or ",".
        headings: of the columns; empty without a heading.
        sample: the first rows, as text.
        metadata: what stands above the heading, by name in lower case.
        columns: their number.
        marks: around the cells of a row.
        is_ragged: whether many rows have another number of cells.
    """

    skip: int
    separator: str
    decimal: str
    headings: Sequence[str]
    sample: Sequence[Sequence[str]]
    columns: int
    metadata: Mapping[str, str] = field(default_factory=dict)
    marks: LineMarks = NO_MARKS
    is_ragged: bool = False

    @property
    def started(self) -> float | None:
        """Start time in the head, unix s; None without one, or if its day may be its month."""
        texts = [text for name in START_NAMES if ":" in (text := self.metadata.get(name, ""))]
        return next((at for one in texts if order_of([one], np.inf)[0] and (at := unix_seconds(one)) is not None), None)


def is_number(text: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma."""
    try:
        float(text.strip().replace(",", ".", 1) if "." not in text else text)
    except ValueError:
        return False
    return True


def split(line: str, separator: str) -> list[str]:
    """Cells of a line."""
    if separator == " ":
        return line.split()
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:  # a cell of more than 128 kB
        return line.split(separator)


def format_of(path: Path, *, may_be_narrow: bool = False) -> TableFormat:
    """Form of the table in a file.

    Args:
        may_be_narrow: whether one column of numbers is a table; else it lacks a time.

    Raises:
        RecordingError: it is none.
    """
    with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig", errors="replace", newline="") as file:
        lines: list[str] = []
        size = 0
        while len(lines) < SAMPLE_ROWS and size < SAMPLE_BYTES and (line := file.readline(LONGEST_LINE)):
            lines.append(line)
            size += len(line)
        if len(lines) > 2 and not lines[-1].endswith(("\n", "\r")) and file.read(1):
            lines.pop()
    return _format(path.name, [line.rstrip("\r\n") for line in lines], may_be_narrow=may_be_narrow)


def has_rows(path: Path) -> bool:
    """Whether a file of unknown format is a table with rows of numbers."""
    with open_regular(path) as file:
        if b"\0" in file.read(SAMPLE_BYTES):
            return False
    try:
        form = format_of(path)
    except RecordingError:
        return False
    return len(form.sample) >= FEWEST_ROWS and all(map(_is_data, form.sample[:FEWEST_ROWS]))


def _format(name: str, lines: list[str], *, may_be_narrow: bool) -> TableFormat:
    forced = next((match[1] for line in lines[:MAX_HEAD_LINES] if (match := _SEP.match(line)) is not None), "")
    marks = marks_of(lines, lambda rows: forced or _separator(rows))
    lines = [marks.removed(marks.headings(line)) for line in lines] if marks else lines
    separator, count = _shape([line for line in lines if line.strip() and not _is_comment(line)], forced)
    if count > MAX_COLUMNS:
        raise RecordingError(f"{name} has {count} columns; {MAX_COLUMNS} are read.", "Leave some out.")
    metadata: dict[str, str] = {}
    above: dict[bool, list[list[str]]] = {False: [], True: []}  # whether a comment → lines of as many cells as the rows
    first = heading_at = len(lines)
    for at, line in enumerate(lines[:MAX_HEAD_LINES]):
        is_comment = _is_comment(line)
        cells = _head_cells(line, separator, count)
        if separator == " " and len(cells) == count and not cells[-1]:  # no cell of blanks is empty
            cells = _with_time(cells[:-1], next((row for row in map(str.split, lines[at:]) if _is_data(row)), []))
        if not is_comment and len(cells) == count and _is_data(cells):
            first = at
            break
        if marks.separator and is_moment(cells[0]):
            cells[0] = "time"
        _note(metadata, line.strip(_MARKS))
        if len(cells) == count and not _is_data(cells) and sum(map(bool, map(_LETTER.search, cells))) > (count > 2):
            heading_at = at if not above[False] and not is_comment else heading_at
            above[is_comment].append(cells)
    if first == len(lines) and above[False]:  # without a row of numbers, the first line that can be the heading is it
        first, above[False] = heading_at + 1, above[False][:1]
    rows = [split(line, separator) for line in lines[first:] if line.strip()]
    start = 0.0 if any(above.values()) else _empatica_start(rows[:2])
    may_be_narrow = may_be_narrow or start > 0
    if count == 1 and first < len(lines) and not may_be_narrow:
        hint = "Give a table that has their times, too, or their rate: --rate 100."
        raise RecordingError(f"{name} has one column of numbers.", hint)
    if count < 2 - may_be_narrow or first == len(lines):
        raise RecordingError(f"{name} is not a table.", "The first line must name the columns, separated by commas.")
    if start:
        metadata |= {"start time": utc_text(start), "rate": rows[1][0]}
        first, rows = first + 2, rows[2:]
    sample = [row for row in rows if len(row) == count]
    headings = _headings(above[False] or above[True])
    decimal, is_ragged = _decimal(sample, separator), len(sample) < MOST * len(rows)
    return TableFormat(first, separator, decimal, headings, sample, count, metadata, marks, is_ragged)


def _empatica_start(rows: Sequence[Sequence[str]]) -> float:
    """Start in the first row of a table without a heading, if it is a date in every cell, and the second row a rate."""
    cells = [{cell.strip() for cell in row} for row in rows]
    if len(rows) < 2 or any(len(one) > 1 for one in cells):
        return 0.0
    start, rate = (float(one) if one.replace(".", "", 1).isdecimal() else 0.0 for row in cells for one in row)
    return start if is_dated(start, np.inf) and 0 < rate < FASTEST_FRACTION and rate == round(rate) else 0.0


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS) or _SEP.match(line) is not None


def _shape(body: Sequence[str], forced: str) -> tuple[str, int]:
    """Separator and number of columns of most lines of the second half; 0 columns without lines."""
    tail = body[len(body) // 2 :][:SAMPLE_ROWS]
    best: tuple[tuple[bool, ...], str, int] = ((), " ", 0)
    for separator in forced if forced and tail and forced in tail[-1] else SEPARATORS:
        rows = [split(line, separator) for line in tail]
        count, times = Counter(map(len, rows)).most_common(1)[0] if rows else (0, 0)
        is_table = count > 1 and times > MOST * len(rows)
        is_headed = any(len(_head_cells(line, separator, count)) == count for line in body[: len(body) - len(tail)])
        key = (is_table, any(map(_is_data, rows[-FEWEST_ROWS:])), count > 1, separator != " ", is_headed)
        if key > best[0]:
            best = key, separator, count
    return best[1:]


def _separator(rows: list[str]) -> str:
    """Separator of some rows; "" if they have one cell each."""
    separator, count = _shape(rows, "")
    return separator if count > 1 else ""


def _head_cells(line: str, separator: str, count: int) -> list[str]:
    """Cells of a line above the rows, as many as they have if only an empty one at the end is too many or too few."""
    if _is_comment(line):
        line = _PREFIX.sub("", line.lstrip(_MARKS))
    cells = [cell.strip() for cell in split(_UNIT_APART.sub(r"\1", line) if separator == " " else line, separator)]
    if len(cells) == count + 1 and not cells[-1]:
        cells.pop()
    return [*cells, ""] if len(cells) == count - 1 and cells and line.rstrip().endswith(cells[-1]) else cells


def _with_time(cells: list[str], row: Sequence[str]) -> list[str]:
    """Names above blank-separated rows, in which one name stands for two cells: a date and a time of day, or the GPS
    week and its seconds.
    """
    days = [is_moment(one) and not is_time_of_day(one) for one in row]
    place = next((i for i, one in enumerate(days[:-1]) if one and is_time_of_day(row[i + 1])), None)
    if place is not None and len(row) == len(cells) + 1:
        return [*cells[: place + 1], "time", *cells[place + 1 :]]
    is_week = cells[0].lower() in GPS_NAMES and len(row) == len(cells) + 1 and row[0].isdecimal()
    return [*GPS_PARTS, *cells[1:]] if is_week else cells


def _headings(lines: Sequence[list[str]]) -> list[str]:
    """Headings of the lines above the rows: the last with the most names, with the units of a line of units."""
    units = lines[-1] if len(lines) > 1 and all(map(_UNIT.fullmatch, lines[-1])) else []
    names = max(reversed(lines[:-1] if units else lines), key=_distinct_names, default=[])
    plain = [unit[1:-1] if unit[:1] in ("(", "[") else unit for unit in units or [""] * len(names)]
    return [f"{name} ({unit})" if unit and name else name for name, unit in zip(names, plain, strict=True)]


def _distinct_names(cells: Sequence[str]) -> int:
    return len({*cells}) - 2 * sum(is_number(cell) or is_moment(cell) for cell in cells)


def _note(metadata: dict[str, str], line: str) -> None:
    """Note pairs of a name and a value, of the whole line and of its pieces, and a rate in words."""
    for piece in (*re.split("[,;\t]", line), line, *_EQUAL.findall(line)):
        if (match := _PAIR.match(piece)) is not None:
            metadata.setdefault(match["name"].strip().lower(), match["value"].strip("\"',; \t"))
    if (rate := _AT_RATE.search(line)) is not None:
        metadata.setdefault("rate", rate[1])


def _is_data(cells: Sequence[str]) -> bool:
    """Whether a line is a row of numbers and times, not of names."""
    filled = [cell for cell in cells if cell.strip()]
    values = [cell for cell in filled if is_number(cell) or is_moment(cell)]
    return bool(values) and len(values) >= 0.75 * len(filled)


def _decimal(sample: Sequence[Sequence[str]], separator: str) -> str:
    if separator == ",":
        return "," if _quoted_commas(sample) else "."
    commas = sum(_COMMA.match(cell.strip()) is not None for row in sample for cell in row)
    points = sum(_POINT.match(cell.strip()) is not None for row in sample for cell in row)
    return "," if commas > points else "."


def _quoted_commas(sample: Sequence[Sequence[str]]) -> bool:
    """Whether cells of a table that is separated by commas have a decimal comma, inside of quotation marks."""
    cells = [cell.strip() for row in sample for cell in row]
    commas = sum(_COMMA.match(cell) is not None for cell in cells)
    return commas > 0 and not any(_POINT.match(cell) for cell in cells)
