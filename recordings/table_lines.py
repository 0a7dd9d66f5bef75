"""Marks that a logger writes around the cells of a row, beside what separates them.

10:15:00.000 -> 1,2,3           the stamp of Arduino's serial monitor: it becomes the first cell
33,Jogging,491059,-0.6,0.5;     a mark at the end of each row, as in WISDM: it is left out
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

_STAMP = re.compile(r"^([ \t]*\d{1,2}:\d\d:\d\d(?:[.,]\d+)?) -> ?", re.MULTILINE)
_END = re.compile(r";[ \t]*(?=\r?$)", re.MULTILINE)
_CELLS = re.compile(r"[,\t]")
MOST = 0.8  # of the lines have a mark


@dataclass(frozen=True, slots=True)
class LineMarks:
    """Marks of a table.

    Args:
        separator: that replaces the arrow behind a stamp; "" without stamps.
        has_end: whether rows end with a semicolon that separates nothing.
    """

    separator: str = ""
    has_end: bool = False

    def __bool__(self) -> bool:
        return self.has_end or bool(self.separator)

    def removed(self, text: str) -> str:
        """Whole lines without them."""
        if self.has_end:
            text = _END.sub("", text)
        return _STAMP.sub(rf"\1{self.separator}", text) if self.separator else text


NO_MARKS = LineMarks()


def marks_of(lines: Sequence[str], separator_of: Callable[[list[str]], str]) -> LineMarks:
    """The marks of a table's lines.

    Args:
        separator_of: finds what separates the cells of some rows.
    """
    rows = [line for line in lines if line.strip()]
    stamped = [_STAMP.sub("", row) for row in rows if _STAMP.match(row)]
    is_stamped = len(stamped) > MOST * len(rows)
    cells = stamped if is_stamped else rows
    ended = [row for row in cells if _END.search(row) and row.count(";") == 1 and _CELLS.search(row)]
    has_end = len(ended) > MOST * len(cells)
    marks = LineMarks(has_end=has_end)
    return LineMarks(separator_of([marks.removed(row) for row in cells]) or ",", has_end) if is_stamped else marks
