"""Marks that a logger writes around the cells of a row, beside what separates them.

10:15:00.000 -> 1,2,3           the stamp of Arduino's serial monitor: it becomes the first cell, as do
[2026-01-02 10:15:00.000] 1,2   those of other terminals, and of Python's logging (… 10:15:00,000 INFO name: 1,2)
33,Jogging,491059,-0.6,0.5;     a mark at the end of each row, as in WISDM: it is left out
0.01<tab>0.5,0.4,-0.6,0.2       numbers of a quaternion in one cell, as in OpenSim: a cell of its own for each
ax: 0.1, ay: 0.2                names beside the numbers (labels.py)
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from imuscope.recordings.tables.labels import RowLabels

_STAMP = re.compile(
    r"^[ \t]*\[?(\d{1,2}:\d\d:\d\d(?:[.,]\d+)?|\d{4}-\d\d-\d\d[ T]\d{1,2}:\d\d:\d\d(?:[.,]\d+)?)"
    r"(?:\]:? ?| -> ?|: | (?:DEBUG|INFO|WARN(?:ING)?|ERROR)\b[^:\n]*: ?)",
    re.MULTILINE,
)
_END = re.compile(r";[ \t]*(?=\r?$)", re.MULTILINE)
_CELLS = re.compile(r"[,\t]")
LIST = "\t"  # between cells with lists
_NUMBERS = re.compile(r"[-+]?[\d.][\d.eE+-]*(?:,[-+]?[\d.][\d.eE+-]*)*")
_QUATERNION = re.compile(r"DataType=Quaternion\s*$")
QUATERNION = 4
FEWEST = 3  # numbers of a list: two could be one with a decimal comma
MOST = 0.8  # of the lines have a mark


@dataclass(frozen=True, slots=True)
class LineMarks:
    """Marks of a table.

    Args:
        separator: that replaces the arrow behind a stamp; "" without stamps.
        has_end: whether rows end with a semicolon that separates nothing.
        widths: numbers in each cell of a row with lists in them; none in other tables.
        is_quaternion: whether the head of the file says that a list of four is one, with w first.
        labels: names in the rows; None in other tables.
    """

    separator: str = ""
    has_end: bool = False
    widths: Sequence[int] = ()
    is_quaternion: bool = False
    labels: RowLabels | None = None

    def __bool__(self) -> bool:
        return self.has_end or bool(self.separator) or bool(self.widths) or self.labels is not None

    def headings(self, line: str) -> str:
        """A line above the rows with a name for each number of their lists."""
        cells = line.split(LIST)
        if len(cells) != len(self.widths) or "," in line:
            return line
        named = [
            f"{cell}.{'wxyz'[i]}"
            if width == QUATERNION and self.is_quaternion
            else f"{cell}[{i}]"
            if width > 1
            else cell
            for cell, width in zip(cells, self.widths, strict=True)
            for i in range(width)
        ]
        return LIST.join(named)

    def removed(self, text: str) -> str:
        """Whole lines without them."""
        if self.labels is not None:
            return "".join(map(self.labels.cells, text.splitlines(keepends=True)))
        if self.has_end:
            text = _END.sub("", text)
        if self.widths:
            text = text.replace(",", LIST)
        return _STAMP.sub(self._first_cell, text) if self.separator else text

    def _first_cell(self, match: re.Match[str]) -> str:
        """A stamp as a cell, whatever separates the others."""
        return match[1].replace(",", ".").replace(" ", "T") + self.separator


NO_MARKS = LineMarks()


def marks_of(lines: Sequence[str], separator_of: Callable[[list[str]], str]) -> LineMarks:
    """The marks of a table's lines.

    Args:
        separator_of: finds what separates the cells of some rows.
    """
    rows = [line for line in lines if line.strip()]
    if widths := _widths(rows[len(rows) // 2 :]):
        return LineMarks(widths=widths, is_quaternion=any(map(_QUATERNION.match, rows)))
    stamped = [_STAMP.sub("", row) for row in rows if _STAMP.match(row)]
    is_stamped = len(stamped) > MOST * len(rows)
    cells = stamped if is_stamped else rows
    ended = [row for row in cells if _END.search(row) and row.count(";") == 1 and _CELLS.search(row)]
    has_end = len(ended) > MOST * len(cells)
    marks = LineMarks(has_end=has_end)
    return LineMarks(separator_of([marks.removed(row) for row in cells]) or ",", has_end) if is_stamped else marks


def _widths(rows: Sequence[str]) -> Sequence[int]:
    """Numbers in each cell of rows with lists in their cells, the same in most; none of other rows."""
    cells = [row.strip().split(LIST) for row in rows]
    widths = Counter(tuple(cell.count(",") + 1 for cell in row) for row in cells)
    one, count = widths.most_common(1)[0] if widths else ((), 0)
    is_list = len(one) > 1 and max(one) >= FEWEST and 2 not in one and count > MOST * len(cells)
    return one if is_list and all(_NUMBERS.fullmatch(cell) for row in cells[:-1] for cell in row) else ()
