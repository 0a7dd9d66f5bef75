"""Entries of the list, until a file that they come from changes: a list of thousands looks at each and reads none."""

import os
from collections.abc import Callable
from pathlib import Path

from imuscope.recordings.library.entry import LibraryEntry


def state_of(path: Path) -> tuple[int, int, int] | None:
    """Identity of a file's content: its number, size and time of change, ns; None if it is not there."""
    try:
        stat = os.stat(path)
    except OSError:
        return None
    return stat.st_ino, stat.st_size, stat.st_mtime_ns


class EntryCache:
    """Entries by path, each with the state of all that it was made of."""

    def __init__(self) -> None:
        self._entries: dict[Path, tuple[object, LibraryEntry]] = {}

    def of(self, path: Path, state: object) -> LibraryEntry | None:
        """The entry of a file that is in that state."""
        known = self._entries.get(path)
        return known[1] if known is not None and known[0] == state else None

    def learn(self, path: Path, state: object, entry: LibraryEntry) -> None:
        self._entries[path] = state, entry

    def keep(self, is_there: Callable[[Path], bool]) -> None:
        """Forget files that are gone."""
        self._entries = {path: known for path, known in self._entries.items() if is_there(path)}
