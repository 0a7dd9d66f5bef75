"""`imuscope decode FILE -o OUT`: any file that can be read, decoded into files that other programs read.

The file becomes columns, as when a page opens it (server/library/opening.py), in a folder beside OUT that is gone
afterwards; the columns become what OUT's suffix says (recordings/exporters). The bar counts both, decoding as the first
half.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import TextIO

from recordings.container import RecordingError
from recordings.exporters import FORMATS, Wish, by_suffix, export
from recordings.importers import open_file
from server.library.opening import decode
from server.live.reading import Reading
from server.live.speech import speech

PATIENCE_S = 1.0  # work that is over sooner shows no bar
_CELLS = 30
_EVERY_S = 0.1


class DecodeError(Exception):
    """What a person can put right, in one line."""


class Bar:
    """A bar on a terminal; nothing on anything else."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._shows = out.isatty()
        self._next = time.monotonic() + PATIENCE_S
        self._drawn = False

    def show(self, share: float) -> None:
        """How far it is, 0..1."""
        if self._shows and time.monotonic() >= self._next:
            self._next = time.monotonic() + _EVERY_S
            self._drawn = True
            full = round(share * _CELLS)
            self._out.write(f"\r{'█' * full}{'·' * (_CELLS - full)} {share:4.0%}")
            self._out.flush()

    def clear(self) -> None:
        """Leave the line as it was."""
        if self._drawn:
            self._out.write(f"\r{' ' * (_CELLS + 6)}\r")
            self._out.flush()


def decode_file(path: Path, out: Path, reading: Reading, notes: TextIO) -> list[Path]:
    """The files that were written.

    Args:
        out: its suffix chooses the format.
        reading: how the bytes are to be read; without a protocol it is recognised.
        notes: for the bar, and what was damaged.
    Raises:
        DecodeError: it cannot be done; nothing is left behind.
    """
    format = by_suffix(out.suffix)
    if format is None:
        known = ", ".join(dict.fromkeys(one.suffix for one in FORMATS.values()))
        raise DecodeError(f"{out.suffix or 'a name without suffix'} is no format; OUT ends with one of: {known}")
    if not out.parent.is_dir():
        raise DecodeError(f"there is no folder {out.parent}")
    if out.exists() and out.samefile(path):
        raise DecodeError("OUT is the file that is to be decoded")
    bar = Bar(notes)
    try:
        with tempfile.TemporaryDirectory(prefix=".decode-", dir=out.parent) as folder:
            source = open_file(path, reading.protocol)
            store = Path(folder) / "columns"
            columns = decode(source, store, speech(), reading, lambda share: bar.show(share / 2))
            wish = Wish(columns, path, path.name)
            made = export(format, wish, out, lambda share: bar.show(0.5 + share / 2))
    except RecordingError as error:
        raise DecodeError(f"{error.message} {error.hint}".strip()) from None
    except OSError as error:
        raise DecodeError(f"{out}: {(error.strerror or 'it cannot be written').lower()}") from None
    finally:
        bar.clear()
    for damage in source.damage[:5]:
        print(f"imuscope: {damage.words}", file=notes)
    return made
