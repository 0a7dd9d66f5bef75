"""Columns of a file while a command reads them: decoded into a temporary folder, with a progress bar."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.system.temporary_folder import TemporaryFolder
from imuscope.server.commands.decode import MOST_DAMAGE, Bar, empty_words, time_sentences
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.errors import UsageError
from imuscope.server.library.computed_signals import compute_signals
from imuscope.server.library.decode import decode
from imuscope.server.text.printable import printable


@contextlib.contextmanager
def decoded(path: Path, reading: DecodeOptions, notes: TextIO, *, of_device: bool = False) -> Iterator[ColumnStore]:
    """The columns of a file; they are gone afterwards.

    Args:
        reading: decode options; without a protocol it is detected.
        notes: stream for the progress bar, and for the clock that is the time axis.
        of_device: whether that is printed also where it is the clock of a device, as usual.

    Raises:
        UsageError, RecordingError, DomainError: the file cannot be decoded.
    """
    bar = Bar(notes)
    try:
        with TemporaryFolder() as folder:
            source = open_file(path, reading.protocol, reading.table)
            store = decode(source, folder / "columns", all_protocols(), reading, bar.show, compute=compute_signals)
            bar.clear()
            if words := empty_words(store, path.name):
                raise UsageError(printable(words))
            for words in time_sentences(store, of_device=of_device):
                print(f"imuscope: {printable(words)}", file=notes)
            yield store
            for one in store.manifest["damage"][:MOST_DAMAGE]:
                print(f"imuscope: {printable(one['words'])}", file=notes)
    except OSError as error:
        raise UsageError(f"{path}: {(error.strerror or 'it cannot be read').lower()}") from None
    finally:
        bar.clear()
