"""Tables of what a protocol family supports, made from its own tables, for docs/supported-devices.md."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SupportTable:
    """One table.

    Args:
        title: its heading.
        about: a sentence or two before it; `code` stands between backquotes.
        head: titles of the columns.
        rows: as many cells each.
    """

    title: str
    about: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
