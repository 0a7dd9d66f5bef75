"""Persistent upload results: `uploads.json` in the data folder, so that uploads resume after a restart.

Only results are in it: stored, or refused because the file cannot be read. A recording of the library without a result
is pending. If the file is lost, every recording is checked again, and found in the store by its content.
"""

import json
from collections.abc import Collection
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from imuscope.recordings.library.entry import LibraryEntry
from imuscope.recordings.system import atomic_write

FILE = "uploads.json"
VERSION = 1


@dataclass(frozen=True, slots=True)
class UploadOutcome:
    """End of an upload.

    Args:
        size, modified: of the file then; a file that changed since is checked again.
        time: unix s.
        recording, object, checksum: in the store: identifier, key, SHA-256.
        reason: why it was refused.
        edits: time of change of the sidecar that went along, ns; 0 for none.
    """

    size: int
    modified: float
    state: Literal["stored", "refused"]
    time: float
    recording: str = ""
    object: str = ""
    checksum: str = ""
    reason: str = ""
    edits: int = 0


class UploadLog:
    """The ends of uploads by file name.

    Args:
        store, robot: outcomes of others do not count.
    """

    def __init__(self, data: Path, store: str, robot: str) -> None:
        self._path = data / FILE
        self._head = {"version": VERSION, "store": store, "robot": robot}
        self._outcomes: dict[str, UploadOutcome] = {}

    def load(self) -> None:
        """Read the file; an unreadable one counts as empty. Call it in a thread."""
        try:
            body = json.loads(self._path.read_text(encoding="utf-8"))
            if {name: body.get(name) for name in self._head} == self._head:
                self._outcomes = {name: UploadOutcome(**one) for name, one in body["recordings"].items()}
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
            self._outcomes = {}

    def of(self, entry: LibraryEntry) -> UploadOutcome | None:
        """Outcome of a recording; None if there is none of its file as it is now."""
        latest = self._outcomes.get(entry.path.name)
        return latest if latest is not None and (latest.size, latest.modified) == (entry.size, entry.modified) else None

    def add(self, entry: LibraryEntry, outcome: UploadOutcome) -> None:
        """Add an outcome; `save` writes it."""
        self._outcomes[entry.path.name] = outcome

    def remove(self, entry: LibraryEntry) -> None:
        """Forget the outcome of a recording."""
        self._outcomes.pop(entry.path.name, None)

    def keep_only(self, names: Collection[str]) -> None:
        """Forget files that the library has no longer."""
        self._outcomes = {name: one for name, one in self._outcomes.items() if name in names}

    def save(self) -> None:
        """Write the file. Call it in a thread.

        Raises:
            OSError: it cannot be written; the old one stays.
        """
        recordings = {name: asdict(one) for name, one in self._outcomes.copy().items()}
        atomic_write.write_atomic(self._path, json.dumps({**self._head, "recordings": recordings}, ensure_ascii=False))
