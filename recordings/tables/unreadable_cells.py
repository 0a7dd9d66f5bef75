"""Cells of a table that are not numbers: named by column and row, or as columns of text that are left out."""

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING

import numpy as np

from imuscope.protocols.schema.plural import counted
from imuscope.recordings.tables.cells import Cells

if TYPE_CHECKING:
    import pyarrow as pa

MOST_NAMED = 4
MAX_EXACT_INTEGER = 2.0**53  # whole numbers up to it are floats
MOST_TRIED = 100  # numbers of a block


class UnreadableCells:
    """Findings of one reading of a table.

    Args:
        name: the name of a column for people.
    """

    def __init__(self, name: Callable[[int], str]) -> None:
        self._name = name
        self._texts: dict[int, tuple[int, int, str]] = {}  # column → cells, first row, its text
        self._numeric: set[int] = set()  # columns with a number
        self._rounded: dict[int, str] = {}  # column → a whole number that float64 does not hold

    def clear(self) -> None:
        self._texts.clear()
        self._numeric.clear()
        self._rounded.clear()

    def note(self, column: int, texts: "pa.Array", cells: Cells, before: int) -> None:
        """Take note of a block of a column, `before` rows of which were read before."""
        if column not in self._numeric and np.isfinite(cells.values).any():
            self._numeric.add(column)
        if column not in self._rounded:
            sizes = np.abs(cells.values)
            large = np.flatnonzero((sizes >= MAX_EXACT_INTEGER) & (sizes < np.inf))[:MOST_TRIED]
            pairs = ((str(texts[int(row)].as_py()).strip(), cells.values[row]) for row in large)
            for text in (text for text, value in pairs if _is_whole(text) and int(text) != int(value)):
                self._rounded.setdefault(column, text)
        if len(cells.odd):
            first = int(cells.odd[0])
            count, row, text = self._texts.get(column, (0, before + first + 1, str(texts[first].as_py())))
            self._texts[column] = count + len(cells.odd), row, text

    def sentence(self, clock: Collection[int] = ()) -> str:
        """A sentence on the cells of columns of numbers and of the clock; "" if there are none."""
        listed = [(self._name(i), *one) for i, one in sorted(self._texts.items()) if i in self._numeric or i in clock]
        if not listed:
            return ""
        wrong = sum(count for _, count, _, _ in listed)
        cells = counted(wrong, "cell was not a number and was", "cells were not numbers and were")
        named = [
            f"{name} in row {row} ({text!r:.40})" + (f" and {count - 1} more" if count > 1 else "")
            for name, count, row, text in listed[:MOST_NAMED]
        ]
        return f"{cells} left empty: {', '.join(named)}."

    def rounded(self) -> str:
        """A sentence on whole numbers that are rounded; "" if none are."""
        if not self._rounded:
            return ""
        listed = ", ".join(f"{self._name(i)} ({text:.40})" for i, text in sorted(self._rounded.items()))
        return f"Whole numbers beyond 2⁵³ are rounded: {listed}."

    def texts(self) -> dict[int, str]:
        """The first text of each column that has nothing but texts."""
        return {i: text for i, (_, _, text) in self._texts.items() if i not in self._numeric}


def _is_whole(text: str) -> bool:
    return text.lstrip("+-").isdecimal()
