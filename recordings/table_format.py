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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from imuscope.recordings.mcap_writer import RecordingError
from imuscope.recordings.regular_file import open_regular
from imuscope.recordings.table_dates import is_moment

LONGEST_LINE = 4 << 20  # of the comment with the markers in an exported CSV file
SAMPLE_BYTES, SAMPLE_ROWS = 1 << 18, 2000
FEWEST_ROWS = 3  # of numbers, in a file whose name does not say that it is a table
MAX_COLUMNS = 500
MAX_HEAD_LINES = 200
SEPARATORS = ",;\t|"
_SEP = re.compile(r"^\s*\"?sep=(.)\"?\s*$", re.IGNORECASE)
_PAIR = re.compile(r"^\s*(?P<name>[^:=,;\t{}]{1,60})[:=]\s*[,;\t]?\s*(?P<value>.{1,200}?)\s*$")
_COMMENTS = ("#", "//", "% ", "%%")
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
    """

    skip: int
    separator: str
    decimal: str
    headings: Sequence[str]
    sample: Sequence[Sequence[str]]
    columns: int
    metadata: Mapping[str, str] = field(default_factory=dict)


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


def format_of(path: Path) -> TableFormat:
    """Form of the table in a file.

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
    return _format(path.name, [line.rstrip("\r\n") for line in lines])


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


def _format(name: str, lines: list[str]) -> TableFormat:
    metadata: dict[str, str] = {}
    forced, comment, comment_at, at = "", "", -1, 0
    while at < min(len(lines), MAX_HEAD_LINES):
        line = lines[at]
        if (sep := _SEP.match(line)) is not None:
            forced = sep[1]
        elif line.lstrip().startswith(_COMMENTS):
            if line.strip(" #/%"):
                comment, comment_at = line.lstrip().lstrip("#/% "), at
            _note(metadata, comment)
        elif line.strip() and not _is_metadata(lines, at, forced):
            break
        else:
            _note(metadata, line)
        at += 1
    if at >= len(lines) or at == MAX_HEAD_LINES:
        raise _no_table(name)
    separator = forced if forced and forced in lines[at] else _separator(lines[at])
    cells = split(lines[at], separator)
    if len(cells) < 2:
        raise _no_table(name)
    if len(cells) > MAX_COLUMNS:
        raise RecordingError(f"{name} has {len(cells)} columns; {MAX_COLUMNS} are read.", "Leave some out.")
    headings: list[str] = cells
    first = at + 1
    if _is_data(cells):
        first = at
        above = split(comment, separator) if comment_at >= 0 else []
        headings = above if len(above) == len(cells) and not _is_data(above) else []
    rows = [split(line, separator) for line in lines[first:] if line.strip()]
    sample = [row for row in rows if len(row) == len(cells)]
    return TableFormat(first, separator, _decimal(sample, separator), headings, sample, len(cells), metadata)


def _no_table(name: str) -> RecordingError:
    return RecordingError(f"{name} is not a table.", "The first line must name the columns, separated by commas.")


def _note(metadata: dict[str, str], line: str) -> None:
    match = _PAIR.match(line)
    if match is not None:
        metadata.setdefault(match["name"].strip().lower(), match["value"].strip("\"',; \t"))


def _separator(line: str) -> str:
    best = max(SEPARATORS, key=line.count)
    return best if line.count(best) else " "


def _is_metadata(lines: Sequence[str], at: int, forced: str) -> bool:
    """Whether a line stands above the table: the lines after it have another number of columns, or it is a name and a
    value with a colon.
    """
    separator = forced if forced and forced in lines[at] else _separator(lines[at])
    cells = split(lines[at], separator)
    after = [line for line in lines[at + 1 : at + 4] if line.strip()]
    if not after:
        return False
    if len(cells) <= 3 and cells[0].rstrip().endswith(":") and not is_number(cells[0]):
        return True
    if separator == " " and len(cells) != len(split(after[0], separator)) and any(_separator(x) != " " for x in after):
        return True
    return len(cells) < 2 <= len(split(after[-1], _separator(after[-1]))) and _is_data(
        split(after[-1], _separator(after[-1]))
    )


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
