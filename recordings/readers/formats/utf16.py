"""Text in UTF-16, as Windows and its PowerShell write it: opened as the same text in UTF-8."""

from __future__ import annotations

import codecs
from typing import TYPE_CHECKING

from imuscope.recordings.readers.formats.compressed import temporary_source
from imuscope.recordings.readers.formats.decompressing import UnpackedFolder
from imuscope.recordings.readers.registry import FileReader, OpenRequest, register_reader
from imuscope.recordings.system.regular_file import open_regular

if TYPE_CHECKING:
    from imuscope.recordings.sources import Source

MOST_ZERO = 0.8  # of every other byte, in text with few letters beyond ASCII
MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def is_utf16(head: bytes) -> bool:
    """Whether these are the first bytes of such a text: its mark, and characters of which half the bytes are zero."""
    high = head[3::2] if head.startswith(MARKS[0]) else head[2::2]
    return head.startswith(MARKS) and high.count(0) > MOST_ZERO * len(high)


def _open_utf16(request: OpenRequest) -> Source:
    unpacked = UnpackedFolder(request.path)
    with open_regular(request.path) as file:
        text = codecs.EncodedFile(file, "utf-8", "utf-16", "replace")
        return temporary_source(unpacked, request, lambda: [unpacked.write(request.path.name, text)])


register_reader(FileReader("utf16", "Text in UTF-16", (), _open_utf16, order=85, recognises=is_utf16))
