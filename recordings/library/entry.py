"""One recording in the list of the library."""

from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

from imuscope.recordings.library.recording_probe import CAPTURE_FORMATS, RecordingProbe
from imuscope.recordings.sidecar import Edits
from imuscope.recordings.system.regular_file import readable_name


@dataclass(slots=True)
class LibraryEntry:
    """One recording in the list.

    Args:
        files: of the recording, in order; the first names it.
        probe: metadata of the file itself, completed when it is first opened.
        edits: changes made by the user, over those in the file.
        indexed: whether it was indexed since its last change (Library.index).
        is_current: whether it was indexed by this decoder, and not only by an earlier one.
        deleted: unix s, while it is in the bin.
    """

    id: str
    files: list[Path]
    size: int
    modified: float
    probe: RecordingProbe
    edits: Edits
    thumbnail: list[list[float]]
    losses: list[float]
    marker_texts: list[str]
    motion: str = ""
    marks: list[float] = field(default_factory=list)
    indexed: bool = False
    is_current: bool = False
    deleted: float | None = None

    @property
    def path(self) -> Path:
        return self.files[0]

    @property
    def title(self) -> str:
        return self.edits.title or self.probe.title or Path(self.name).stem

    @property
    def name(self) -> str:
        """Name of its first file, as text."""
        return readable_name(self.path)

    @property
    def full_name(self) -> str:
        """Name of the file that holds everything of it (recordings/library/download.py)."""
        return f"{self.path.stem}.mcap" if self.probe.format in CAPTURE_FORMATS else self.path.name

    @property
    def markers(self) -> int:
        """Number of markers, including those added later."""
        return max(self.probe.markers, len(self.marker_texts)) + len(self.edits.markers)

    @property
    def began(self) -> float:
        """Sort key of the list."""
        return self.probe.started if self.probe.started is not None else self.modified

    def contains(self, words: Collection[str]) -> bool:
        """Whether all these words (case-folded) occur in the metadata."""
        if not words:
            return True
        devices = [text for one in self.probe.devices for text in (one.name, one.product, one.serial_number)]
        edits = self.edits
        markers = [marker.text for marker in edits.markers]
        texts = (self.title, self.name, *(edits.tags or ()), edits.notes or "", *devices, *markers)
        text = "\n".join((*texts, *self.marker_texts)).casefold()
        return all(word in text for word in words)
