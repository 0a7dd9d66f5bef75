"""Metadata of files that another process has read, until the files change."""

from collections.abc import Callable, Sequence
from pathlib import Path

from imuscope.recordings.library.recording_probe import RecordingProbe
from imuscope.recordings.readers.file_suffixes import ALWAYS_LISTED

Stamp = tuple[int, int]
"""Size and time of change, ns, of a file."""
NEVER: Stamp = (-1, 0)


class ProbeCache:
    """Metadata by path; the files themselves are not looked at."""

    def __init__(self) -> None:
        self._probes: dict[Path, tuple[Stamp, RecordingProbe | None]] = {}
        self._headings: dict[Path, list[str]] = {}  # of tables that were read since they were last listed

    def has(self, path: Path, stamp: Stamp, written: str = "") -> bool:
        """Whether it has a file as it is now, or one that is being written as it was."""
        return path in self._probes and (self._probes[path][0] == stamp or path.stem == written)

    def learn(self, path: Path, stamp: Stamp, probe: RecordingProbe | None, heading: Sequence[str]) -> None:
        """Store the metadata of a file; None if it is not a recording."""
        self._probes[path] = stamp, probe
        self._headings[path] = list(heading)

    def of(self, path: Path) -> RecordingProbe | None:
        """Metadata of a file; None unless it is a recording, or has the suffix of one and was not read yet."""
        suffix = path.suffix.lower()
        unread = RecordingProbe(suffix[1:]) if suffix in ALWAYS_LISTED else None
        return self._probes.get(path, (NEVER, unread))[1]

    def may_be_recording(self, path: Path) -> bool:
        """Whether a file is a recording, or was not read yet."""
        return path not in self._probes or self._probes[path][1] is not None

    def take_heading(self, path: Path) -> list[str]:
        """The heading of a table, once; [] without one."""
        return self._headings.pop(path, [])

    def move(self, path: Path, target: Path, *, is_renamed: bool = False) -> None:
        """Follow a file to its new path. A renamed one is read again: its name says something of it."""
        if path in self._probes:
            stamp, probe = self._probes.pop(path)
            self._probes[target] = (NEVER if is_renamed else stamp), probe

    def keep(self, is_there: Callable[[Path], bool]) -> None:
        """Forget files that are gone."""
        self._probes = {path: known for path, known in self._probes.items() if is_there(path)}
        self._headings = {path: heading for path, heading in self._headings.items() if path in self._probes}

    def __len__(self) -> int:
        return len(self._probes)
