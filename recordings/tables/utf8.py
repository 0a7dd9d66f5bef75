"""A text file as UTF-8, whatever its bytes, without the marks around its lines."""

import codecs
import io
import re
from typing import BinaryIO

from imuscope.recordings.sources import FileDamage
from imuscope.recordings.tables.line_marks import NO_MARKS, LineMarks

ODD = "\ufffd"
NO_UTF8 = "Some characters are not UTF-8; they are left out."
_RETURN, _RETURN_INSIDE = re.compile(r"\r(?!\n)"), re.compile(r"\r(?!\n|\Z)")  # of an old Mac


class Utf8(io.RawIOBase):
    """A file as UTF-8, whatever its bytes: invalid ones are replaced, and reported once.

    Args:
        marks: to be left out of the lines.
        squeeze: make one blank of several, and none at the beginning of a line.
    """

    def __init__(
        self, file: BinaryIO, damage: list[FileDamage], marks: LineMarks = NO_MARKS, *, squeeze: bool = False
    ) -> None:
        self._file = file
        self._marks = marks
        self._damage = damage
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._squeeze = squeeze
        self._held = ""

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        while data := self._file.read(size):
            if text := self._squeezed(self._decoder.decode(data)):
                return self._report(text)
        return self._report(self._squeezed(self._decoder.decode(b"", True), end=True))

    def _squeezed(self, text: str, *, end: bool = False) -> str:
        if not self._squeeze and not self._marks:
            return text
        text = _RETURN.sub("\n", self._held + text) if end else _RETURN_INSIDE.sub("\n", self._held + text)
        cut = len(text) if end else text.rfind("\n") + 1
        self._held = text[cut:]
        lines = self._marks.removed(text[:cut])
        if not self._squeeze:
            return lines
        return re.sub(r"[ \t]+(?=\r?$)|^[ \t]+", "", re.sub(r"[ \t]+", " ", lines), flags=re.MULTILINE)

    def _report(self, text: str) -> bytes:
        if ODD in text and not any(one.words == NO_UTF8 for one in self._damage):
            self._damage.append(FileDamage(-1, NO_UTF8))
        return text.encode()
