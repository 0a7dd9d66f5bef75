"""`imuscope decode FILE -o OUT`: any file that can be read, decoded into files that other programs read.

The file becomes columns, as when a page opens it (server/library/decode.py), in a folder beside OUT that is gone
afterwards; the columns become what OUT's suffix says (recordings/exporters). The bar counts both, decoding as the first
half.
"""

from __future__ import annotations

import difflib
import math
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from recordings.column_store import ColumnStore
from recordings.exporters import FORMATS, ExportRequest, by_suffix, export
from recordings.importers import open_file
from recordings.mcap_writer import RecordingError
from server.devices.decode_options import DecodeOptions
from server.devices.protocol_set import speech
from server.library.decode import decode
from server.printable import printable

REFUSED = ("no_key", "bad_hmac", "below_min_mode")
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


@dataclass(frozen=True, slots=True)
class DecodedPart:
    """What of a file is decoded.

    Args:
        begin_s, end_s: seconds from its beginning.
        device: "" for all, or for the only one.
        channels: by name; () for all.
    """

    begin_s: float = 0.0
    end_s: float | None = None
    device: str = ""
    channels: tuple[str, ...] = ()


def decode_file(
    path: Path, out: Path, reading: DecodeOptions, notes: TextIO, part: DecodedPart = DecodedPart()
) -> list[Path]:
    """The files that were written.

    Args:
        out: its suffix chooses the format.
        reading: how the bytes are to be read; without a protocol it is recognised.
        notes: for the bar, and what was damaged or refused.
        part: of the file.
    Raises:
        DecodeError: it cannot be done; nothing is left behind.
    """
    format = by_suffix(out.suffix)
    if format is None:
        known = ", ".join(dict.fromkeys(one.suffix for one in FORMATS.values()))
        raise DecodeError(
            f"{out.suffix or 'a name without suffix'} is not a valid format; OUT ends with one of: {known}"
        )
    if not out.parent.is_dir():
        raise DecodeError(f"there is no folder {out.parent}")
    if out.exists() and out.samefile(path):
        raise DecodeError("OUT is the file that is to be decoded")
    bar, refused = Bar(notes), list[str]()
    try:
        with tempfile.TemporaryDirectory(prefix=".decode-", dir=out.parent) as folder:
            source = open_file(path, reading.protocol)
            store = Path(folder) / "columns"
            columns = decode(source, store, speech(), reading, lambda share: bar.show(share / 2))
            refused = [one["text"] for one in columns.manifest["events"] if one["data"].get("reason") in REFUSED]
            wish = _wish(columns, path, part)
            made = export(format, wish, out, lambda share: bar.show(0.5 + share / 2))
    except RecordingError as error:
        if refused:
            raise DecodeError(refused[0]) from None
        raise DecodeError(f"{error.message} {error.hint}".strip()) from None
    except OSError as error:
        raise DecodeError(f"{out}: {(error.strerror or 'it cannot be written').lower()}") from None
    finally:
        bar.clear()
    for words in [*refused, *(damage.words for damage in source.damage[:5])]:
        print(f"imuscope: {printable(words)}", file=notes)
    return made


def _wish(columns: ColumnStore, path: Path, part: DecodedPart) -> ExportRequest:
    """The part in the terms of the exporters. DecodeError: there is no such device, channel or time."""
    told = columns.manifest
    devices = {one["id"]: one["name"] for one in told["devices"]}
    if part.device and part.device not in devices:
        listed = ", ".join(f"{one} ({name})" for one, name in devices.items())
        raise DecodeError(f"{path.name} holds no device {part.device!r}; there are: {listed}")
    start = told["started"] or 0.0
    t0 = start + part.begin_s if part.begin_s else -math.inf
    t1 = math.inf if part.end_s is None else start + part.end_s
    if not t0 < t1 or part.begin_s < 0 or (told["ended"] is not None and t0 > told["ended"]):
        raise DecodeError(f"{path.name} lasts {(told['ended'] or start) - start:.3f} s; nothing lies in that range")
    if not part.channels:
        return ExportRequest(columns, path, path.name, t0, t1, device=part.device)
    kinds = [*told["channels"], *told.get("payloads", ())]
    names = {name: None for one in kinds for name in (one["name"], one["message"])}
    for name in part.channels:
        if name not in names:
            near = difflib.get_close_matches(name, names, 5, 0.4) or list(names)[:5]
            raise DecodeError(f"{path.name} has no channel {name!r}; nearest are: {', '.join(near)}")
    chosen = tuple(one["id"] for one in kinds if {one["name"], one["message"]} & set(part.channels))
    return ExportRequest(columns, path, path.name, t0, t1, chosen, part.device)
