"""Form of a text table: where it begins, what separates the columns, decimal sign, and what stands above it.

// Update Rate: 100.0Hz          metadata: comments of #, // or %, and lines of another number of columns
sep=,                            names the separator (Excel, Xsens DOT)
#timestamp [ns],w_RS_S_x,…       a comment above the first row with as many columns is the heading
1500000000000000000,0.0,…        first row
"""

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import dropwhile, pairwise
from pathlib import Path

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.tables.dates import Order, is_moment, is_time_of_day, order_of, unix_seconds, utc_text
from imuscope.recordings.tables.head_values import CREATED, VBO_UNITS, note, section, with_units
from imuscope.recordings.tables.headings import ColumnHeading
from imuscope.recordings.tables.line_marks import CELLS, NO_MARKS, LineMarks, RowLabels, labels_of, marks_of
from imuscope.recordings.tables.options import OTHERS, TableOptions
from imuscope.recordings.tables.time_units import FASTEST_FRACTION, is_dated

LONGEST_LINE = 4 << 20  # of the comment with the markers in an exported CSV file
SAMPLE_BYTES, SAMPLE_ROWS = 1 << 18, 2000
FEWEST_ROWS = 3  # of numbers, in a file whose name does not say that it is a table
MAX_COLUMNS = 500  # that are read
MOST_COLUMNS = 20_000  # of a file, of which the user names some
LONGEST_CELL = 10_000  # characters of a row with line breaks in it: else a quotation mark is only an inch
MAX_HEAD_LINES, MAX_BLANK_LINES = 200, 20
START_NAMES = (
    *("start time", "start", "start_time", "starttime", "recording start", "logging started", "capture date"),
    *("recording date", "recorded", "recorded on", "recorded at", "log date", "session date", "date/time", "datetime"),
    *("creation date", "created", "created on", CREATED, "timestamp", "time", "date"),
)
START_PAIRS = tuple((f"{of}date", f"{of}time") for of in ("start ", "", "recording ", "log "))
ORDERS: Mapping[str, Order] = {"m": "mdy", "d": "dmy"}  # first letter of a date format
GPS_NAMES, GPS_PARTS = ("gpst", "gps time"), ("GPS week", "tow (s)")
GYROFLOW = "tscale"  # the head of a log for Gyroflow has it
SCALES = {"t": ("tscale", "s"), "g": ("gscale", "rad/s"), "a": ("ascale", "g"), "m": ("mscale", "G")}
"""First letter of a column → the factor in that head, and the unit of the product."""
UNIT_SHARE = 0.5  # of the words in a line of units are units
MIN_SHARE = 0.8  # of the lines have as many cells as there are columns
SEPARATORS = "\t;|, "
_UNIT = re.compile(
    r"|[(\[].*[)\]]|[mnuµ]?s(?:ecs?)?|seconds|(?:deg|degrees?|°|rad|dps)(?:/s(?:ec)?)?|[mck]?m|km/?h|kph|m?g|[unµm]?t|"
    r"m/s(?:ec)?(?:\^?2|²|/s)?|m/\(s(?:ec)?\^2\)|m?gauss|[hk]?pa|m?bar|psi|(?:deg|°)?[cf]|[mk]?v|[mk]?a|[mk]?w|%|k?hz|"
    r"lsb|counts?|no_units|unitless|n/a|-|none|utc|weeks|local_flux|k?ohms?|rpm|bpm|mph|kn|kts|knots|ft|in|mi|min|hours|"
    r"k?nm?|m?kg|lb|l/h|l/min|lux|db[mv]?|ppm|afr|ratio|[µu]m|m\^?3|deg/s(?:\^2|²)",
    re.IGNORECASE,
)
_SEP = re.compile(r"^\s*\"?sep=(.)\"?\s*$", re.IGNORECASE)
_IS_TIMED = re.compile(r":|\d_\d\d-\d\d-\d\d")
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
        has_lines: whether a cell in quotation marks may have several lines.
        unused: names in the heading behind those of the columns.
        odd_units: words in the line of units that are none, by column.
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
    has_lines: bool = False
    unused: int = 0
    odd_units: Mapping[int, str] = field(default_factory=dict)

    def bytes_of_numbers(self, size: int) -> float:
        """Bytes of a float64 for each cell of such a file of this size."""
        cells = sum(map(len, self.sample))
        return 8 * size * cells / (sum(len(cell) for row in self.sample for cell in row) + cells) if cells else 0.0

    @property
    def started(self) -> float | None:
        """Start time in the head, unix s; None without one, or if its day may be its month."""
        pairs = [f"{self.metadata.get(date, '')} {self.metadata.get(clock, '')}" for date, clock in START_PAIRS]
        texts = [*(text for name in START_NAMES if _IS_TIMED.search(text := self.metadata.get(name, ""))), *pairs]
        stamp = self.metadata.get("timestamp", "")
        if GYROFLOW in self.metadata and stamp.isdecimal() and is_dated(float(stamp), math.inf):
            return float(stamp)
        return next((at for text in texts if (at := self._moment(text)) is not None), None)

    @property
    def day(self) -> float | None:
        """The date in the head, where it has no time of day: its midnight, unix s; None without one."""
        texts = (self.metadata.get(name, "") for name in START_NAMES)
        days = (at for text in texts if not _IS_TIMED.search(text) and (at := self._moment(text)) is not None)
        return next(days, None) if self.started is None else None

    def _moment(self, text: str) -> float | None:
        stated = self.metadata.get("date format", "")
        created: Order | None = "dmy" if text == self.metadata.get(CREATED) else None
        order = created or ORDERS.get(stated[:1].lower()) or order_of([text], math.inf)[0]
        return unix_seconds(text, order) if order is not None and is_moment(text) else None

    def scale(self, name: str) -> tuple[float, str]:
        """Factor and unit of the numbers in a column that the head of a log for Gyroflow names; 1 and "" for others."""
        key, unit = SCALES.get(name.strip().lower()[:1], ("", ""))
        stated = self.metadata.get(key, "") if GYROFLOW in self.metadata else ""
        return (float(stated), unit) if is_number(stated) else (1.0, "")


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
        return [cell.strip('"') for cell in line.split()]
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # a cell of more than 128 kB
        return line.split(separator)


def format_of(path: Path, *, may_be_narrow: bool = False) -> TableFormat:
    """Form of the table in a file.

    Args:
        may_be_narrow: whether one column of numbers is a table; else it lacks a time.

    Raises:
        RecordingError: it is not one.
    """
    with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig", errors="replace", newline="") as file:
        lines: list[str] = []
        size = blank = left_out = 0  # blank lines in a row, and those outside of the sample
        while len(lines) < SAMPLE_ROWS and size < SAMPLE_BYTES and (line := file.readline(LONGEST_LINE)):
            blank = 0 if line.strip() else blank + 1
            size += len(line)
            if blank > MAX_BLANK_LINES and len(lines) < MAX_HEAD_LINES:
                left_out += 1
                continue
            lines.append(line)
        if len(lines) > 2 and not lines[-1].endswith(("\n", "\r")) and file.read(1):
            lines.pop()
    plain = [line.rstrip("\r\n") for line in lines]
    joined = _joined(plain)
    form = _format(path.name, joined, may_be_narrow=may_be_narrow)
    has_lines = len(joined) < len(plain) and form.separator != " "
    return replace(form, skip=form.skip + left_out, has_lines=has_lines)


def _joined(lines: list[str]) -> list[str]:
    """Lines, in which one goes on while a quotation mark is open; as they are if one never closes."""
    if not any(line.count('"') % 2 for line in lines):
        return lines
    out: list[str] = []
    is_open = False
    for line in lines:
        if is_open:
            out[-1] += f" {line}"
        else:
            out.append(line)
        is_open ^= line.count('"') % 2 == 1
    longest = max(map(len, out))
    return lines if longest > LONGEST_CELL else out[:-1] if is_open else out


def has_rows(path: Path) -> bool:
    """Whether a file of unknown format is a table with rows of numbers."""
    with open_regular(path) as file:
        if b"\0" in file.read(SAMPLE_BYTES):
            return False
    try:
        form = format_of(path)
    except RecordingError:
        return False
    rows = [*dropwhile(lambda row: not _is_data(row), form.sample)]
    return len(rows) >= FEWEST_ROWS and all(map(_is_data, rows[:FEWEST_ROWS]))


def _format(name: str, lines: list[str], *, may_be_narrow: bool) -> TableFormat:
    if (labels := labels_of(lines)) is not None:
        return _labelled(lines, labels)
    forced = next((match[1] for line in lines[:MAX_HEAD_LINES] if (match := _SEP.match(line)) is not None), "")
    marks = marks_of(lines, lambda rows: forced or _separator(rows))
    lines = [marks.removed(marks.headings(line)) for line in lines] if marks else lines
    separator, count = _shape([line for line in lines if line.strip() and not _is_comment(line)], forced)
    if count > MOST_COLUMNS:
        raise RecordingError(f"{name} has {count} columns; {MAX_COLUMNS} are read.", "Give a part of them.")
    metadata: dict[str, str] = {}
    above: dict[bool, list[list[str]]] = {False: [], True: []}  # whether a comment → lines of as many cells as the rows
    longer: list[str] = []  # the last line above with more names than the rows have cells
    shorter: list[str] = []  # the last one with a name too few
    index = ""  # the only name in a line below the others, as pandas writes that of its index
    first = heading_at = len(lines)
    padded = _padded_lines(lines, separator, count)
    for line in lines[:padded]:
        note(metadata, line.strip().rstrip(separator).strip(_MARKS), split)
    for at, line in enumerate(lines[:MAX_HEAD_LINES]):
        if at < padded:
            continue
        is_comment = _is_comment(line)
        cells = _head_cells(line, separator, count)
        if separator == " " and len(cells) == count and not cells[-1]:  # no cell of blanks is empty
            cells = _with_time(cells[:-1], next((row for row in map(str.split, lines[at:]) if _is_data(row)), []))
        if not is_comment and len(cells) == count and _is_data(cells):
            first = at
            break
        if marks.separator and is_moment(cells[0]):
            cells[0] = "time"
        note(metadata, line.strip(_MARKS), split)
        if len(cells) == count - 1 and separator == " " and not is_comment and not _is_data(cells):
            shorter = cells
        if len(cells) == count > 2 and not is_comment and above[False] and cells[0] and not any(cells[1:]):
            index = cells[0]
        if not is_comment and count > 2 and len(cells) > count and not _is_data(cells):
            longer = cells
        if len(cells) == count and not _is_data(cells) and sum(map(bool, map(_LETTER.search, cells))) > (count > 2):
            heading_at = at if not above[False] and not is_comment else heading_at
            above[is_comment].append(cells)
    while heading_at < first - 1 < len(lines) - 1 and _is_like(
        row := _head_cells(lines[first - 1], separator, count), _head_cells(lines[first], separator, count)
    ):
        first -= 1
        above[False] = [cells for cells in above[False] if cells != row]
    if first == len(lines) and above[False]:  # without a row of numbers, the first line that can be the heading is it
        first, above[False] = heading_at + 1, above[False][:1]
    rows = [split(line, separator) for line in lines[first:] if line.strip()]
    start = 0.0 if any(above.values()) else _empatica_start(rows[:2])
    may_be_narrow = may_be_narrow or start > 0
    if count == 1 and first < len(lines) and not may_be_narrow:
        named = split(lines[first - 1], ",") if first else []
        if len(named) > 1:
            raise RecordingError(
                f"{name}: {', '.join(named[1:])} have no numbers.", f"Its rows have {named[0]} alone: write them again."
            )
        hint = "Give a table that has their times, too, or their rate: --rate 100."
        raise RecordingError(f"{name} has one column of numbers.", hint)
    if count < 2 - may_be_narrow or first == len(lines):
        filled = [line for line in lines if line.strip()]
        if len(filled) == 1 and (count > 1 or separator in filled[0]):
            raise RecordingError(f"{name} has a heading, but no rows.", "Give a table with samples.")
        raise RecordingError(f"{name} is not a table.", "The first line must name the columns, separated by commas.")
    if not any(above.values()) and _is_numbering(rows[:2]):
        first, rows = first + 1, rows[1:]
    if start:
        metadata |= {"start time": utc_text(start), "rate": rows[1][0]}
        first, rows = first + 2, rows[2:]
    sample = [row for row in rows if len(row) == count]
    headings, odd_units = _headings(above[False] or above[True])
    unused = 0
    if not headings and longer and not any(map(_is_bare, longer[:count])):
        headings, unused = longer[:count], len(longer) - count
    decimal, is_ragged = _decimal(sample, separator), len(sample) < MIN_SHARE * len(rows)
    if headings and not headings[-1] and _numbers_rows(sample):
        headings = ["", *headings[:-1]]
    if not headings and shorter and _numbers_rows(sample):
        headings = ["", *shorter]
    if units := section(lines[:first], VBO_UNITS):
        headings = with_units(headings, [one if _UNIT.fullmatch(one) and one[0] not in "([" else "" for one in units])
    if headings and index and not headings[0]:
        headings = [index, *headings[1:]]
    form = TableFormat(first, separator, decimal, headings, sample, count, metadata, marks, is_ragged, unused=unused)
    return replace(form, odd_units=odd_units)


def _is_numbering(rows: Sequence[Sequence[str]]) -> bool:
    """Whether the first row is 0, 1, 2, …: names of columns that have none, as pandas writes them."""
    numbers = [str(i) for i in range(len(rows[0]))] if rows else []
    return len(rows) > 1 and len(numbers) > FEWEST_ROWS and [*rows[0]] == numbers != rows[1]


def _is_bare(cell: str) -> bool:
    """Whether a cell of a heading is empty or a number."""
    return not cell.strip() or is_number(cell)


def _numbers_rows(sample: Sequence[Sequence[str]]) -> bool:
    """Whether the first cell of each row is its number, and the last one is not empty: R writes no name above it."""
    first = [row[0].strip().strip('"') for row in sample[:SAMPLE_ROWS]]
    is_counted = all(one.isdecimal() for one in first) and len(first) >= FEWEST_ROWS
    steps = {int(after) - int(before) for before, after in pairwise(first)} if is_counted else set()
    return steps == {1} and int(first[0]) <= 1 and all(row[-1].strip() for row in sample)


def _labelled(lines: Sequence[str], labels: RowLabels) -> TableFormat:
    """Form of a table with a name beside each number."""
    first = next(at for at, line in enumerate(lines) if labels.cells(line) != line)
    metadata: dict[str, str] = {}
    for line in lines[:first]:
        note(metadata, line.strip(_MARKS), split)
    rows = [labels.cells(line).split(CELLS) for line in lines[first:]]
    sample = [row for row in rows if len(row) == len(labels.names)]
    marks = LineMarks(labels=labels)
    return TableFormat(first, CELLS, ".", labels.names, sample, len(labels.names), metadata, marks)


def _empatica_start(rows: Sequence[Sequence[str]]) -> float:
    """Start in the first row of a table without a heading, if it is a date in every cell, and the second row a rate."""
    cells = [{cell.strip() for cell in row} for row in rows]
    if len(rows) < 2 or any(len(one) > 1 for one in cells):
        return 0.0
    start, rate = (float(one) if one.replace(".", "", 1).isdecimal() else 0.0 for row in cells for one in row)
    return start if is_dated(start, math.inf) and 0 < rate < FASTEST_FRACTION and rate == round(rate) else 0.0


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS) or _SEP.match(line) is not None


def _shape(body: Sequence[str], forced: str) -> tuple[str, int]:
    """Separator and number of columns of most lines of the second half; 0 columns without lines."""
    tail = body[len(body) // 2 :][:SAMPLE_ROWS]
    best: tuple[tuple[bool, ...], str, int] = ((), " ", 0)
    for separator in forced if forced and tail and forced in tail[-1] else SEPARATORS:
        rows = [split(line, separator) for line in tail]
        count, times = Counter(map(len, rows)).most_common(1)[0] if rows else (0, 0)
        is_table = count > 1 and times > MIN_SHARE * len(rows)
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


def _headings(lines: Sequence[list[str]]) -> tuple[list[str], dict[int, str]]:
    """Headings of the lines above the rows: the last with the most names, with the units of a line of units; and
    its words that are not units.
    """
    units = lines[-1] if len(lines) > 1 and _are_units(lines[-1]) else []
    lines = lines[:-1] if units else lines
    odd = {at: unit for at, unit in enumerate(units) if not _UNIT.fullmatch(unit)}
    names = max(reversed(lines), key=_distinct_names, default=[])
    names = _under(lines[lines.index(names) - 1], names) if lines and lines.index(names) else names
    plain = [unit[1:-1] if unit[:1] in ("(", "[") else unit for unit in units or [""] * len(names)]
    named = enumerate(zip(names, plain, strict=True))
    return [f"{name} ({unit})" if unit and name and at not in odd else name for at, (name, unit) in named], odd


def _are_units(cells: Sequence[str]) -> bool:
    """Whether a line below the names is one of units: at least half of its words are units."""
    filled = list(filter(None, cells))
    units = [cell for cell in filled if _UNIT.fullmatch(cell)]
    return len(units) == len(filled) or len(units) >= max(UNIT_SHARE * len(filled), 1)


def _padded_lines(lines: Sequence[str], separator: str, count: int) -> int:
    """Lines of a preamble that a spreadsheet filled up with empty cells, before a heading that is wider than they."""
    if separator == " " or count <= FEWEST_ROWS:
        return 0
    widths: list[int] = []
    for at, line in enumerate(lines[:MAX_HEAD_LINES]):
        cells = [] if _is_comment(line) else _head_cells(line, separator, count)
        width = max((place + 1 for place, cell in enumerate(cells) if cell), default=0)
        is_heading = (
            width > count / 2 and not _is_data(cells) and sum(map(bool, map(_LETTER.search, cells))) > count / 2
        )
        if is_heading or (cells and len(cells) != count) or width > count / 2:
            return at if is_heading and len(list(filter(None, widths))) > 1 and max(widths) <= count / 2 else 0
        widths.append(width)
    return 0


def _under(groups: list[str], names: list[str]) -> list[str]:
    """Names with those of the groups above them, if they occur again without: x, y, z of accel and of gyro. A group
    may stand above its first column only.
    """
    filled = list(filter(None, names))
    if len({*filled}) == len(filled):
        return names
    runs: list[str] = []
    for cell in groups:
        runs.append(cell or (runs[-1] if runs else ""))
    joined = [f"{group}.{name}" if group and name else name or group for group, name in zip(runs, names, strict=True)]
    return joined if len({*joined}) > len({*names}) else names


def _distinct_names(cells: Sequence[str]) -> int:
    return len({*cells}) - 2 * sum(is_number(cell) or is_moment(cell) for cell in cells)


def _is_data(cells: Sequence[str]) -> bool:
    """Whether a line is a row of numbers and times, not of names."""
    filled = [cell for cell in cells if cell.strip()]
    values = [cell for cell in filled if is_number(cell) or is_moment(cell)]
    return bool(values) and len(values) >= 0.75 * len(filled)


def _is_like(cells: Sequence[str], row: Sequence[str]) -> bool:
    """Whether a line between the heading and the first row of numbers is a row with more texts: on, n.a., a note."""
    if len(cells) != len(row) or not any(map(is_number, cells)):
        return False
    if is_number(cells[0]) and is_number(row[0]):
        return True
    values = [is_number(cell) or is_moment(cell) for cell in cells if cell.strip()]
    return values[0] and not is_number(row[0]) and 2 * sum(values) >= len(values)


def _decimal(sample: Sequence[Sequence[str]], separator: str) -> str:
    """The decimal sign. Where commas separate the cells, a decimal comma stands inside of quotation marks."""
    cells = [cell.strip() for row in sample for cell in row]
    commas = sum(_COMMA.match(cell) is not None for cell in cells)
    points = sum(_POINT.match(cell) is not None for cell in cells)
    return "," if commas > points and not (points and separator == ",") else "."


def renamed(file: str, form: TableFormat, options: TableOptions) -> tuple[list[str], set[int]]:
    """Headings of the columns, with those of the user in place of the file's; and columns to leave out.

    Raises:
        RecordingError: too many are left.
    """
    texts = list(form.headings) or [""] * form.columns
    left_out = {i for i, text in enumerate(texts) if not text and not any(row[i].strip() for row in form.sample)}
    for i, text in enumerate(list(texts)):
        plain = ColumnHeading.of(text)
        key = next((key for key in (str(i + 1), plain.text, plain.name) if key and key in options.columns), None)
        if key is not None and options.columns[key]:
            texts[i] = options.columns[key]
        elif key is not None or options.columns.get(OTHERS, OTHERS) == "":
            left_out.add(i)
    if len(texts) - len(left_out) > MAX_COLUMNS:
        words = f"{file} has {len(texts)} columns; {MAX_COLUMNS} are read."
        hint = f"Name those to read in a file for --columns: a line “HEADING = NAME” for each, and “{OTHERS} =”."
        raise RecordingError(words, hint)
    return texts, left_out
