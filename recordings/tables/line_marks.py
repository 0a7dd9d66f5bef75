"""Marks that a logger writes around the cells of a row, beside what separates them.

10:15:00.000 -> 1,2,3           the stamp of Arduino's serial monitor: it becomes the first cell, as do
[2026-01-02 10:15:00.000] 1,2   those of other terminals, and of Python's logging (… 10:15:00,000 INFO name: 1,2)
33,Jogging,491059,-0.6,0.5;     a mark at the end of each row, as in WISDM: it is left out
0.01<tab>0.5,0.4,-0.6,0.2       numbers of a quaternion in one cell, as in OpenSim: a cell of its own for each

Names beside the numbers, as programs print them, which must be the same words in the same places of all rows: these
become the heading, and the numbers the cells.

Mag: 0.53 -0.80 -0.75  Accel: 0.05 0.35 9.49          one name, three numbers: Mag[0] to Mag[2]
16:35:12.186,GYRO: X=0.1,Y=0.2,Z=0.3,TEMP: 25         a name of several: GYRO.X, GYRO.Y, GYRO.Z
ax:0.1 ay:0.2 az:9.81, t=1234                         Arduino's serial plotter
Linear Accel X = 12, Y = -2, Z = -3                   the later axes go with the first
Roll: 1.2 deg, Pitch: 3.4 deg                         a unit behind the number
"""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

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
MIN_NUMBERS = 3  # numbers of a list: two could be one with a decimal comma
MIN_SHARE = 0.8  # of the lines have a mark, or the same words
CELLS = "\t"  # between the cells that are made of a row
FEWEST_ROWS = 3  # with the same words
_MOMENT = r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?Z?|\d{1,2}:\d\d:\d\d(?:[.,]\d+)?"
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_VALUE = re.compile(rf"(?<![\w^\[.])(?:{_MOMENT}|{_NUMBER}|\bnan\b)(?![\w]*\])", re.IGNORECASE)
_FIRST = re.compile(rf"^\s*\[\s*({_MOMENT}|{_NUMBER})\s*\]", re.IGNORECASE)
_BETWEEN = re.compile(r"[,;|\t]|\s{2,}")
_QUOTES = re.compile(r"[\"'{}<>]|\[(?!\d+\])|(?<!\d)\]")
_ROUND = re.compile(r"^(?P<name>.*?)\s*[(\[](?!\d+[)\]])(?P<unit>[^()\[\]]*)[)\]]$")
_PRINTED_UNIT = re.compile(
    r"m/s(?:\^?2|²|/s)?|[mu]?g|(?:deg|°|rad|dps)(?:/s)?|°?[CF]|[nuµm]?T|[hk]?Pa|[mu]?s|m|cm|mm|V|mV|%", re.IGNORECASE
)
_AXIS = re.compile(r"^(?P<group>.*[A-Za-z])[ ._]+[XxYyZz]$")
_TAIL = re.compile(r"[^\W\d]\w*")
_WORD = re.compile(r"[^\W\d_]")


@dataclass(frozen=True, slots=True)
class RowLabels:
    """Names in the rows of a table.

    Args:
        names: headings, one for each number.
        labels: words before each number, as in the rows.
    """

    names: tuple[str, ...]
    labels: tuple[str, ...]

    def cells(self, line: str) -> str:
        """The numbers of a row, as a line of cells; another line as it is."""
        labels, _, values = _parsed(line)
        return CELLS.join(values) + line[len(line.rstrip("\r\n")) :] if labels == self.labels else line


def labels_of(lines: Sequence[str]) -> RowLabels | None:
    """The names in the rows of a text file; None unless most rows have the same ones."""
    rows = [line for line in lines if line.strip()]
    if len(rows) < FEWEST_ROWS or not any(_is_labelled(_parsed(row)[0]) for row in rows[-FEWEST_ROWS:]):
        return None
    parsed = [_parsed(row)[:2] for row in rows]
    labels, count = Counter(one for one, _ in parsed).most_common(1)[0]
    if count <= MIN_SHARE * len(rows) or not _is_labelled(labels):
        return None
    units = next(units for one, units in parsed if one == labels)
    return RowLabels(_names(labels, units), labels)


def _parsed(line: str) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Of each number in a line: the words before it, the unit behind it, and itself. Words between these are left out:
    "25 m, GPS: FIX, SAT=" is a unit, a state, and the next name.
    """
    labels: list[str] = []
    units: list[str] = []
    values: list[str] = []
    end = 0
    line = _FIRST.sub(r"\1 ", line.rstrip())
    for match in _VALUE.finditer(line):
        behind = _TAIL.match(line, match.end())
        if behind is not None and behind[0] and not _PRINTED_UNIT.fullmatch(behind[0]):  # 3D_FIX
            continue
        unit, words = _unit_before(re.sub(r"\s{2,}", "  ", line[end : match.start()].replace("\t", " | ")))
        units += [unit] if values else []
        labels.append(_BETWEEN.split(words)[-1])
        values.append(match[0])
        end = match.end()
    return tuple(labels), (*units, _unit_before(f"{line[end:]},")[0]), tuple(values)


def _is_labelled(labels: tuple[str, ...]) -> bool:
    """Whether two numbers or more have a name with a colon or an equals sign before them."""
    return sum(_WORD.search(one) is not None and one.rstrip(" \"'[({")[-1:] in (":", "=") for one in labels) > 1


def _names(labels: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    """Headings of the numbers behind some words."""
    named: list[str] = []
    its_units: list[str] = []
    group = ""
    for label, behind in zip(labels, units, strict=True):
        name, unit, group = _label(label, named[-1] if named else "", group)
        named.append(name)
        its_units.append(behind or unit)
    return tuple(f"{name} ({unit})" if unit else name for name, unit in zip(_numbered(named), its_units, strict=True))


def _unit_before(text: str) -> tuple[str, str]:
    """The unit of the number before some words, and the words without it."""
    first = _BETWEEN.split(text.lstrip(), maxsplit=1)
    head = first[0].strip().strip("'\"")
    if _PRINTED_UNIT.fullmatch(head) and (len(first) > 1 or not text.rstrip().endswith((":", "="))):
        return head, first[1] if len(first) > 1 else ""
    word, _, rest = text.strip().partition(" ")
    if rest and not text.startswith(",") and _PRINTED_UNIT.fullmatch(word) and not rest.lstrip().startswith((":", "=")):
        return word, rest
    return "", text


def _label(text: str, previous: str, group: str) -> tuple[str, str, str]:
    """Heading and unit of a number, and the group of those behind it."""
    parts = [one.strip(" ,;|\t-") for one in re.split(r"[:=]", _QUOTES.sub(" ", text))]
    parts = [one for one in parts if _WORD.search(one)]
    if not parts:
        return "", "", group
    unit = ""
    if (round_ := _ROUND.match(parts[0])) is not None:
        parts[0], unit = round_["name"], round_["unit"]
    if len(parts) > 1:
        return f"{parts[0]}.{parts[-1]}", unit, f"{parts[0]}|{unit}"
    if len(parts[0]) == 1 and group:
        name, _, its_unit = group.partition("|")
        return f"{name}.{parts[0]}", unit or its_unit, group
    axis = _AXIS.match(previous)
    if len(parts[0]) == 1 and parts[0].lower() in "xyz" and axis is not None:
        return f"{axis['group']} {parts[0]}", unit, ""
    return parts[0], unit, ""


def _numbered(labels: Sequence[str]) -> list[str]:
    """Names, with an index for the numbers that have the name of the one before, and "time" for a first one without."""
    names: list[str] = []
    heads = [next((one for one in reversed(labels[: place + 1]) if one), "time") for place in range(len(labels))]
    for place, head in enumerate(heads):
        run = place
        while run and not labels[run]:
            run -= 1
        behind = place + 1 < len(labels) and not labels[place + 1]
        names.append(f"{head}[{place - run}]" if run != place or (behind and labels[place]) else head)
    return names


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
    is_stamped = len(stamped) > MIN_SHARE * len(rows)
    cells = stamped if is_stamped else rows
    ended = [row for row in cells if _END.search(row) and row.count(";") == 1 and _CELLS.search(row)]
    has_end = len(ended) > MIN_SHARE * len(cells)
    marks = LineMarks(has_end=has_end)
    return LineMarks(separator_of([marks.removed(row) for row in cells]) or ",", has_end) if is_stamped else marks


def _widths(rows: Sequence[str]) -> Sequence[int]:
    """Numbers in each cell of rows with lists in their cells, the same in most; none of other rows."""
    cells = [row.strip().split(LIST) for row in rows]
    widths = Counter(tuple(cell.count(",") + 1 for cell in row) for row in cells)
    one, count = widths.most_common(1)[0] if widths else ((), 0)
    is_list = len(one) > 1 and max(one) >= MIN_NUMBERS and 2 not in one and count > MIN_SHARE * len(cells)
    return one if is_list and all(_NUMBERS.fullmatch(cell) for row in cells[:-1] for cell in row) else ()
