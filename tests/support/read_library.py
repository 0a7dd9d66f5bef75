"""A library whose files are read in the test's process; a server has them read in another."""

from __future__ import annotations

from pathlib import Path

from imuscope.recordings.library.entry import LibraryEntry
from imuscope.recordings.library.library import Library
from imuscope.recordings.library.probe import probe
from imuscope.recordings.library.recording_probe import TABLE_FORMATS
from imuscope.recordings.library.table_preview import check_upload, heading_of


class ReadLibrary(Library):
    """As Library, with what is in its files."""

    def all(self, search: str = "") -> list[LibraryEntry]:
        self._read()
        return super().all(search)

    def get(self, recording: str) -> LibraryEntry:
        self._read()
        return super().get(recording)

    def rename(self, recording: str, name: str) -> LibraryEntry:
        return self.get(super().rename(recording, name).id)

    def upload(self, path: Path) -> LibraryEntry:
        """Check a complete upload, and add it."""
        try:
            result = check_upload(path)
        except BaseException:
            self.refuse(path)
            raise
        return self.add_file(path, result, heading_of(path) if self.tables else ())

    def _read(self) -> None:
        for path, stamp in self.unread().items():
            result = probe(path)
            is_table = bool(self.tables) and result is not None and result.format in TABLE_FORMATS
            self.learn(path, stamp, result, heading_of(path) if is_table else ())
