"""Registry of readers: formats of files that imuscope did not write.

Each file of `recordings/readers/formats/` registers a reader when it is imported, and so does each module named in the
entry-point group `imuscope.readers` of another package. docs/add-a-reader.md explains how to write one.

A reader is found by the first bytes of a file, and only if no reader knows these, by its suffix.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from imuscope.protocols.family.plugins import Registry
from imuscope.recordings.tables.options import TableOptions

if TYPE_CHECKING:
    from imuscope.recordings.sources import Source

HEAD_BYTES = 512  # of a file, by which its format is recognised


@dataclass(frozen=True, slots=True)
class OpenRequest:
    """A file to be opened.

    Args:
        open_packed: opens a file that an archive holds, with the protocol ("" to recognise it) and options of a table.
        protocol: of a capture in an archive; "" to recognise it.
        table: options of a table.
        is_packed: whether it comes out of an archive, so that it must not be one itself.
    """

    path: Path
    open_packed: "Callable[[Path, str, TableOptions], Source]"
    protocol: str = ""
    table: TableOptions = field(default_factory=TableOptions)
    is_packed: bool = False


ReadFile = Callable[[OpenRequest], "Source"]


@dataclass(frozen=True, slots=True)
class FileReader:
    """One format.

    Args:
        name: unique ("bag").
        title: display name.
        suffixes: of its files, in lower case, with the dot.
        read: takes a request, returns the source. It raises RecordingError for a file that cannot be read.
        marks: the first bytes of its files: offset → any of these.
        order: readers are tried in ascending order.
        is_container: whether the file holds other files, which other readers open.
        modules: of packages that a smaller installation may lack.
        extra: what brings them.
        recognises: whether these are the first bytes (HEAD_BYTES) of its files, if they have no fixed marks.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    read: ReadFile
    marks: Mapping[int, tuple[bytes, ...]] = field(default_factory=dict, hash=False)
    order: int = 100
    is_container: bool = False
    modules: tuple[str, ...] = ()
    extra: str = ""
    recognises: Callable[[bytes], bool] | None = None

    def has_mark(self, head: bytes) -> bool:
        """Whether the first bytes of a file are those of this format."""
        if self.recognises is not None and self.recognises(head):
            return True
        return any(head.startswith(mark, offset) for offset, marks in self.marks.items() for mark in marks)


READERS = Registry[FileReader]("reader", "imuscope.recordings.readers.formats", "imuscope.readers")
register_reader = READERS.register


def reader_suffixes() -> tuple[str, ...]:
    return tuple(dict.fromkeys(suffix for one in READERS.all().values() for suffix in one.suffixes))


def marked_reader(head: bytes) -> FileReader | None:
    """The reader that knows the first bytes of a file."""
    return next((one for one in READERS.all().values() if one.has_mark(head)), None)


def suffix_reader(suffix: str) -> FileReader | None:
    """The reader of files with this suffix (".npy") whose first bytes are not known: only one without marks."""
    return next(
        (one for one in READERS.all().values() if suffix in one.suffixes and not (one.marks or one.recognises)), None
    )
