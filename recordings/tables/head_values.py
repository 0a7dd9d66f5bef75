"""Values in the lines above a table: names with their values, dates, a rate in words, and the units of VBO files."""

import re
from collections.abc import Callable, Sequence
from itertools import pairwise, takewhile

from imuscope.recordings.tables.dates import is_moment

CREATED = "file created on"  # of VBOX and RaceChrono, day first
VBO_UNITS = "[channel units]"
_PAIR = re.compile(r"^\s*(?P<name>[^:=,;\t{}]{1,60})(?:[:=]\s*[,;\t]?|[,;\t])\s*(?P<value>.{1,200}?)\s*$")
_EQUAL = re.compile(r"\b\w++ ?= ?[^,;=\t]+")  # a word is tried once: a note may be one of a hundred thousand letters
_CREATED = re.compile(r"^\s*(file created on)\s+(\d\S*)(?:\s*(?:@|at)\s*(\d\S*))?", re.IGNORECASE)
_FORMAT = re.compile(r"\bdate format ([MdyMD]{1,4}[./-][MdyMD]{1,4}[./-][MdyMD]{1,4})")
_START = re.compile(r"^\s*(start (?:date|time))\s+(\d\S*)\s*$", re.IGNORECASE)
_AT_RATE = re.compile(r"\bat (\d+(?:\.\d+)? ?Hz)\b")


def note(metadata: dict[str, str], line: str, split: Callable[[str, str], list[str]]) -> None:
    """Note pairs of a name and a value, of the whole line and of its pieces, and a rate in words."""
    quoted = split(line, ",") if '"' in line else []
    for name, value in pairwise(quoted):
        if name and value:
            metadata.setdefault(name.strip().lower(), value)
    whole = _PAIR.match(line)
    dated = [line] if whole is not None and is_moment(whole["value"].strip("\"',; \t")) else []  # Mar 2, 2026
    for piece in (*dated, *re.split("[,;\t]", line), line, *_EQUAL.findall(line)):
        if (match := _PAIR.match(piece)) is not None and match["value"].strip():
            metadata.setdefault(match["name"].strip(' "').lower(), match["value"].strip("\"',; \t"))
    if (rate := _AT_RATE.search(line)) is not None:
        metadata.setdefault("rate", rate[1])
    if (created := _CREATED.match(line)) is not None:
        metadata.setdefault(CREATED, " ".join(filter(None, created.groups()[1:])))
    if (start := _START.match(line)) is not None:
        metadata.setdefault(start[1].lower(), start[2])
    if (stated := _FORMAT.search(line)) is not None:
        metadata.setdefault("date format", stated[1])


def section(lines: Sequence[str], name: str) -> list[str]:
    """Lines of a section in the head of a VBO file, each for itself."""
    begin = next((at + 1 for at, line in enumerate(lines) if line.strip().lower() == name), len(lines))
    return [*filter(None, map(str.strip, takewhile(lambda line: not line.strip().startswith("["), lines[begin:])))]


def with_units(headings: Sequence[str], units: Sequence[str]) -> list[str]:
    """Names with the units of the last of them, as in VBO files: the channels of VBOX itself have none.

    Args:
        units: "" for a word that is none.
    """
    first = len(headings) - len(units)
    if first < 0:
        return [*headings]
    named = zip(headings[first:], units, strict=True)
    return [*headings[:first], *(f"{name} ({unit})" if unit else name for name, unit in named)]
