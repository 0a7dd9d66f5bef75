"""`imuscope decode FILE -o OUT`: convert any readable file to files for other programs.

The file is decoded to columns, as when a page opens it (server/library/decode.py), in a temporary folder beside OUT.
The columns are exported in the format of OUT's suffix (recordings/exporters). The progress bar covers both; decoding is
the first half.
"""

import difflib
import math
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from imuscope.protocols.registry.families import remedies
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.columns.units import Units
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.exporters import FORMATS, ExportRequest, by_suffix, export
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.sources import damage_of
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.errors import UsageError
from imuscope.server.library.computed_signals import compute_signals
from imuscope.server.library.decode import REMARK, decode
from imuscope.server.services.extension import FileOutput, file_outputs
from imuscope.server.text.printable import printable

SHOW_AFTER_S = 1.0  # shorter work shows no bar
_PROGRESS_CELLS = 30
_EVERY_S = 0.1
MOST_DAMAGE = 5  # sentences
MOST_SENTENCES = 12  # on the clock of a file


class Bar:
    """A progress bar on a terminal; no output otherwise."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._shows = out.isatty()
        self._next = time.monotonic() + SHOW_AFTER_S
        self._drawn = False

    def show(self, share: float) -> None:
        """Show the progress, 0..1."""
        if self._shows and time.monotonic() >= self._next:
            self._next = time.monotonic() + _EVERY_S
            self._drawn = True
            full = round(share * _PROGRESS_CELLS)
            self._out.write(f"\r{'█' * full}{'·' * (_PROGRESS_CELLS - full)} {share:4.0%}")
            self._out.flush()

    def clear(self) -> None:
        if self._drawn:
            self._out.write(f"\r{' ' * (_PROGRESS_CELLS + 6)}\r")
            self._out.flush()


@dataclass(frozen=True, slots=True)
class DecodedPart:
    """Part of a file to decode.

    Args:
        begin_s, end_s: seconds from the beginning of the file.
        device: "" for all, or for the only one.
        signals: names, titles or messages; () for all.
        with_position: false: an output that can leaves out everything that reveals where it was recorded.
        units: of the values.
    """

    begin_s: float = 0.0
    end_s: float | None = None
    device: str = ""
    signals: tuple[str | int, ...] = ()
    with_position: bool = True
    units: Units = "shown"


def decode_file(
    path: Path, out: Path, reading: DecodeOptions, notes: TextIO, part: DecodedPart = DecodedPart()
) -> list[Path]:
    """Decode a file and return the files that were written.

    Args:
        out: output file; its suffix selects the format.
        reading: decode options; without a protocol it is detected.
        notes: stream for the progress bar and for reports of damaged or rejected data.
        part: part of the file to decode.

    Raises:
        UsageError, RecordingError: decoding failed; no files are left behind.
    """
    _check_output(out, path, part)
    bar, rejected, clocks, empty = Bar(notes), list[str](), list[str](), ""
    try:
        with tempfile.TemporaryDirectory(prefix=".decode-", dir=out.parent) as folder:
            source = open_file(path, reading.protocol, reading.table)
            store = Path(folder) / "columns"
            columns = decode(
                source, store, all_protocols(), reading, lambda share: bar.show(share / 2), compute=compute_signals
            )
            clocks = time_sentences(columns)
            rejected = [one["text"] for one in columns.manifest["events"] if one["data"].get("reason") in remedies()]
            empty = empty_words(columns, path.name)
            written = _written(columns, path, out, part, lambda share: bar.show(0.5 + share / 2))
    except RecordingError:
        if rejected or empty:
            raise UsageError((rejected or [empty])[0]) from None
        raise
    except OSError as error:
        raise UsageError(f"{out}: {(error.strerror or 'it cannot be written').lower()}") from None
    finally:
        bar.clear()
    for words in [*clocks, *rejected, *(damage.words for damage in damage_of(source)[:MOST_DAMAGE])]:
        print(f"imuscope: {printable(words)}", file=notes)
    return written


def export_columns(columns: ColumnStore, path: Path, out: Path, part: DecodedPart) -> list[Path]:
    """Write a part of an opened file; see `decode_file`.

    Raises:
        UsageError, RecordingError: it is not possible; no files are left behind.
    """
    _check_output(out, path, part)
    try:
        return _written(columns, path, out, part, lambda _: None)
    except OSError as error:
        raise UsageError(f"{out}: {(error.strerror or 'it cannot be written').lower()}") from None


def _check_output(out: Path, path: Path, part: DecodedPart) -> None:
    _format_of(out, with_position=part.with_position)
    if not out.parent.is_dir():
        raise UsageError(f"folder not found: {out.parent}")
    if out.exists() and out.samefile(path):
        raise UsageError("OUT is the input file; give another name")


def _written(
    columns: ColumnStore, path: Path, out: Path, part: DecodedPart, step: Callable[[float], None]
) -> list[Path]:
    export_format, output = _format_of(out, with_position=part.with_position)
    request = _export_request(columns, path, part)
    if output is not None:
        if part.units != "shown":
            raise UsageError(f"{output.title.partition(':')[0]} has units of its own; leave out --units")
        return output.write(request, out, step, with_position=part.with_position)
    assert export_format is not None  # the suffix was checked
    return export(export_format, request, out, step)


def time_sentences(columns: ColumnStore, *, of_device: bool = True) -> list[str]:
    """The clock that is the time axis of a file that imuscope did not record, why, and its steps; and remarks on it."""
    axis = (columns.manifest.get("time") or {}).get("sentences", [])
    events = [one["text"] for one in columns.manifest["events"] if _concerns_time(one, bool(axis))]
    if of_device or any(words in events for words in axis):
        events = [*axis, *(words for words in events if words not in axis)]
    more = [f"… and {len(events) - MOST_SENTENCES} more events of its clock."] if len(events) > MOST_SENTENCES else []
    return [*events[:MOST_SENTENCES], *more]


def empty_words(columns: ColumnStore, name: str) -> str:
    """Words on a file without samples: its contents and its damage; "" if it has some."""
    manifest = columns.manifest
    if any(one["kind"] != "bytes" for one in manifest["channels"]):
        return ""
    counts = {kind: n for one in manifest["figures"].values() for kind, n in one["messages"].items()}
    kinds = ", ".join(f"{kind} ({n})" for kind, n in list(counts.items())[:MOST_SENTENCES])
    remarks = [one["text"] for one in manifest["events"] if one["data"].get("reason") == REMARK]
    remarks = [] if any("no stamp" in words for words in remarks) else remarks
    texts = [f"It holds: {kinds}."] if kinds else []
    damage = [one["words"] for one in manifest["damage"][:MOST_DAMAGE]]
    return " ".join([f"{name} has no numbers that can be shown.", *remarks, *texts, *damage])


def _concerns_time(event: dict[str, Any], has_axis: bool) -> bool:
    is_guess = event["data"].get("kind") == "guessed"
    return (event["kind"] == "clock" and (has_axis or is_guess)) or event["data"].get("reason") == REMARK


def _format_of(out: Path, *, with_position: bool) -> tuple[str | None, FileOutput | None]:
    """The export format, or the output of an extension, that a suffix selects: exactly one of both.

    Raises:
        UsageError: the suffix selects none, or what it selects always shows positions.
    """
    export_format = by_suffix(out.name)
    outputs = file_outputs()
    output = outputs.get(out.suffix.lower())
    if not with_position and not (output is not None and output.hides_position):
        hiding = [one for one in outputs.values() if one.hides_position]
        only = f"applies to {', '.join(one.title.partition(':')[0] for one in hiding) or 'no installed output'} only"
        remedy = f"; let OUT end with {' or '.join(one.suffix for one in hiding)}" if hiding else ""
        raise UsageError(f"--without-position {only}{remedy}")
    if export_format is None and output is None:
        known = ", ".join([*dict.fromkeys(one.suffix for one in FORMATS.values()), *outputs])
        raise UsageError(
            f"{out.suffix or 'a name without suffix'} is not a valid format; OUT ends with one of: {known}"
        )
    return (None, output) if output is not None else (export_format, None)


def _export_request(columns: ColumnStore, path: Path, part: DecodedPart) -> ExportRequest:
    """The export request of a part.

    Raises:
        UsageError: unknown device or signal, or a time range outside of the file.
    """
    manifest = columns.manifest
    devices = {one["id"]: one["name"] for one in manifest["devices"]}
    if part.device and part.device not in devices:
        listed = ", ".join(f"{one} ({name})" for one, name in devices.items())
        raise UsageError(f"{path.name} has no device {part.device!r}; it has: {listed}")
    t0, t1 = time_range_of(columns, path.name, part.begin_s, part.end_s)
    columns = columns.in_units(part.units)
    if not part.signals:
        return ExportRequest(columns, path, path.name, t0, t1, device=part.device)
    kinds = [*manifest["channels"], *manifest.get("payloads", ())]
    names = {name: None for one in kinds for name in (one["id"], one["name"], one["message"], one["title"])}
    for name in part.signals:
        if name not in names:
            known = [one for one in names if isinstance(one, str)]
            near = difflib.get_close_matches(str(name), known, 5, 0.4) or known[:5]
            raise UsageError(f"{path.name} has no signal {name!r}; nearest are: {', '.join(near)}")
    chosen = tuple(
        one["id"] for one in kinds if {*part.signals} & {one[key] for key in ("id", "name", "message", "title")}
    )
    return ExportRequest(columns, path, path.name, t0, t1, chosen, part.device)


def time_range_of(store: ColumnStore, name: str, begin_s: float, end_s: float | None) -> tuple[float, float]:
    """First and last time of a part, unix s; infinite without a limit.

    Args:
        begin_s, end_s: seconds from the beginning of the file.

    Raises:
        UsageError: the part is empty.
    """
    begin, end = store.manifest["started"] or 0.0, store.manifest["ended"]
    t0 = begin + begin_s if begin_s else -math.inf
    t1 = math.inf if end_s is None else begin + end_s
    if not t0 < t1 or begin_s < 0 or (end is not None and t0 > end):
        raise UsageError(f"{name} lasts {(end or begin) - begin:.3f} s; that range is empty")
    return t0, t1
