"""Columns of a table that are written in hexadecimal digits: 0x1388, or 00001388 and 0000139C."""

from __future__ import annotations

import re
from collections.abc import Sequence

FEWEST = 3  # cells
_DIGITS = re.compile(r"^(?:0[xX])?[0-9A-Fa-f]{2,16}$")
_LETTER = re.compile(r"[A-DFa-df]")  # 13e2 is also a number
_PREFIX = re.compile(r"^0[xX]")


def are_hexadecimal(cells: Sequence[str]) -> bool:
    """Whether all cells of a column are, and not all are numbers in the usual digits.

    Args:
        cells: not empty ones, stripped.
    """
    if len(cells) < FEWEST or not all(map(_DIGITS.match, cells)):
        return False
    if all(map(_PREFIX.match, cells)):
        return True
    letters = sum(1 for cell in cells if _LETTER.search(cell))
    digits = sum(1 for cell in cells if any(map(str.isdigit, cell)))
    return letters > 0 and digits > len(cells) / 2 and not any(map(_PREFIX.match, cells))


def number_of(text: str) -> float | None:
    return float(int(text, 16)) if _DIGITS.match(text) else None


def prefixed(text: str) -> float | None:
    """The number of a cell with the mark of such numbers; None without it."""
    return number_of(text) if _PREFIX.match(text) else None
