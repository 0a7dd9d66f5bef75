"""Snapshots of device settings: contents, time and reason. Snapshots are text files that can be read, edited and
shared.

    <data>/snapshots/xbus-0080A1B2/20261121T044324Z-before-this-change.yaml

    # Settings of an MTi-630, serial number 0080A1B2
    imuscope: 1
    title: "Before this change"
    taken: "2026-11-21T04:43:24Z"
    reason: "before writing Output configuration"
    protocol: "xbus"
    product: "MTi-630-8A1G6"
    serial_number: "0080A1B2"
    firmware: "1.12.0"
    pinned: false
    settings:
      # Output configuration
      OutputConfiguration:
        outputs:
          - {data_identifier: 0x2010, output_frequency: 100}  # Quaternion, 100 Hz
      # Filter profile
      FilterProfile:
        profile: "Responsive/VRU"
    missing:
      CanConfig: "message unknown"

Values are wire values by field name, as `imuscope inspect` prints them; the comments explain them. Settings that a file
lacks are listed under `missing` with the reason. A file is written completely or not at all
(recordings/system/atomic_write.py).

ruamel.yaml, which keeps comments, is not used: a file is written once and never written again, so there are none to
keep, and each comment would have to be attached to its value by hand. It writes 5 kB in 82 ms; here that takes 0.5 ms.

A name never becomes a path: it is looked up among the existing files. A text is read by snapshot_text.py, in a server
in a process of its own; its meaning is checked by the driver.
"""

import json
import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from imuscope.protocols.schema.fields import Field, Setting
from imuscope.recordings.errors import ExplainedError
from imuscope.recordings.system import atomic_write
from imuscope.server.configuration.api_models import SnapshotBody, SnapshotInfo
from imuscope.server.configuration.value_format import comment, entry_comment

FORMAT = 1
MAX_SEARCHED = 20  # newest snapshots that are searched for an earlier value; reading all would take seconds
MAX_FILES = 200  # of one device; the oldest that are not pinned are deleted first
MAX_TITLE = 120
_PLAIN_KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_.]*\Z")
_YAML_WORDS = ("y", "n", "yes", "no", "on", "off", "true", "false", "null")


class SnapshotError(ExplainedError, ValueError):
    """A snapshot that cannot be read or saved; `hint` says what to do."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Settings of one device at one time.

    Args:
        taken: unix seconds.
        values: wire values by setting and field.
        missing: setting → why it is missing.
        imported: uploaded by the user; not reported by a device here.
    """

    protocol: str
    product: str = ""
    serial_number: str = ""
    firmware: str = ""
    title: str = ""
    reason: str = ""
    taken: float = 0.0
    pinned: bool = False
    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    missing: Mapping[str, str] = field(default_factory=dict)
    imported: bool = False

    def info(self, name: str) -> SnapshotInfo:
        return SnapshotInfo(
            name=name,
            title=self.title,
            taken=self.taken,
            reason=self.reason,
            product=self.product,
            serial_number=self.serial_number,
            firmware=self.firmware,
            settings=len(self.values),
            missing=len(self.missing),
            pinned=self.pinned,
        )

    def body(self, name: str) -> SnapshotBody:
        values = {setting: dict(fields) for setting, fields in self.values.items()}
        return SnapshotBody(self.info(name), values, dict(self.missing))


# ── text ─────────────────────────────────────────────────────────────────────────────────────────────────────────────


def to_text(snapshot: Snapshot, rows: Mapping[str, Setting]) -> str:
    """A snapshot as YAML.

    Args:
        rows: the settings by name, for the comments; settings without a row have no comments.
    """
    timestamp = datetime.fromtimestamp(snapshot.taken, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    device = snapshot.product or "device"
    number = f", serial number {snapshot.serial_number}" if snapshot.serial_number else ""
    about = "".join(c if c.isprintable() else " " for c in f"# Settings of {device}{number}")
    head = [about, f"imuscope: {FORMAT}"]
    head += [f"title: {_quoted(snapshot.title)}", f'taken: "{timestamp}"', f"reason: {_quoted(snapshot.reason)}"]
    head += [f"{name}: {_quoted(getattr(snapshot, name))}" for name in ("protocol", "product", "serial_number")]
    head += [f"firmware: {_quoted(snapshot.firmware)}", f"pinned: {'true' if snapshot.pinned else 'false'}"]
    head += ["imported: true"] if snapshot.imported else []
    lines = [*head, "settings:" if snapshot.values else "settings: {}"]
    for name, values in snapshot.values.items():
        row = rows.get(name)
        if row is not None and row.title:
            lines.append(f"  # {row.title}")
        lines.append(f"  {_key(name)}:" + ("" if values else " {}"))
        lines += _record(values, row.fields if row is not None else (), "    ")
    if snapshot.missing:
        lines.append("missing:")
        lines += [f"  {_key(name)}: {_quoted(why)}" for name, why in snapshot.missing.items()]
    return "\n".join(lines) + "\n"


def _record(values: Mapping[str, Any], fields: tuple[Field, ...], indent: str) -> Iterator[str]:
    known = {row.name: row for row in fields}
    for name, value in values.items():
        row = known.get(name)
        if row is not None and row.fields and isinstance(value, list) and value:
            yield f"{indent}{_key(name)}:"
            for one in value:
                comment_text = entry_comment(row.fields, one)
                yield f"{indent}  - {_flow(_hexed(row.fields, one))}" + (
                    f"  # {_line(comment_text)}" if comment_text else ""
                )
        elif row is not None and row.fields and isinstance(value, Mapping) and value:
            yield f"{indent}{_key(name)}:"
            yield from _record(value, row.fields, indent + "  ")
        else:
            comment_text = comment(row, value) if row is not None else ""
            shown = _Hex(value) if row is not None and _is_identifier(row) and isinstance(value, int) else value
            yield f"{indent}{_key(name)}: {_flow(shown)}" + (f"  # {_line(comment_text)}" if comment_text else "")


class _Hex(int):
    """An identifier, written in hex as in documents and on labels; YAML reads it as a number."""


def _is_identifier(field: Field) -> bool:
    return field.base == 16 or bool(field.key_mask and not field.choices)


def _hexed(fields: tuple[Field, ...], entry: Any) -> Any:
    """A record of a list with its identifiers in hex."""
    if not isinstance(entry, Mapping):
        return entry
    names = {field.name for field in fields if _is_identifier(field)}
    return {
        name: _Hex(part) if name in names and isinstance(part, int) and part >= 0 else part
        for name, part in entry.items()
    }


def _flow(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, _Hex) and value >= 0:
        return f"0x{value:0{4 if value < 1 << 16 else 8}X}"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(str(name))}: {_flow(part)}" for name, part in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(part) for part in value) + "]"
    if isinstance(value, float):
        text = repr(value)
        return text.replace("e", ".0e", 1) if "e" in text and "." not in text else text
    return _quoted(value) if isinstance(value, str) else json.dumps(value)


def _quoted(text: str) -> str:
    """Text in quotes, so that YAML never reads it as a number, a date or "no"."""
    return '"' + "".join(_character(one) for one in text) + '"'


def _character(one: str) -> str:
    if one in '"\\':
        return "\\" + one
    if one.isprintable():
        return one
    if "\ud800" <= one <= "\udfff":
        return "\ufffd"  # an unpaired surrogate could not be read again
    return f"\\U{ord(one):08x}" if ord(one) > 0xFFFF else f"\\u{ord(one):04x}"


def _key(name: str) -> str:
    return name if _PLAIN_KEY.match(name) and name.lower() not in _YAML_WORDS else _quoted(name)


def _line(text: str) -> str:
    return " ".join(text.split())


# ── files ────────────────────────────────────────────────────────────────────────────────────────────────────────────


class Snapshots:
    """The folder of snapshots. Every method reads or writes files, so do not use them on the event loop.

    Args:
        folder: <data>/snapshots; created with the first snapshot.
        formerly: protocol and serial number → earlier numbers of the same device.
        max_files: number of files of one device.

    Attributes:
        read: reads a text: snapshot_text.from_text, or what runs it in another process; raises SnapshotError.
    """

    def __init__(
        self, folder: Path, formerly: Callable[[str, str], Sequence[str]] | None = None, max_files: int = MAX_FILES
    ) -> None:
        self._folder = folder
        self._max_files = max_files
        self._formerly = formerly
        self._lock = threading.Lock()
        self._known: dict[Path, tuple[tuple[int, int], SnapshotInfo]] = {}
        self.read: Callable[[str], Snapshot] = _read_here

    def save(self, snapshot: Snapshot, rows: Mapping[str, Setting]) -> SnapshotInfo:
        """Write a snapshot.

        Raises:
            SnapshotError: it cannot be written.
        """
        folder = self._of(snapshot.protocol, snapshot.serial_number)
        text = to_text(snapshot, rows)
        with self._lock:
            name = self._unused_name(folder, snapshot)
            try:
                atomic_write.write_atomic(folder / f"{name}.yaml", text)
            except OSError as error:
                hint = f"Check free space and write permission of {self._folder}."
                raise SnapshotError(f"The snapshot could not be saved: {error.strerror}.", hint) from None
            self._prune(folder)
        return snapshot.info(name)

    def all(self, protocol: str, serial_number: str) -> list[SnapshotInfo]:
        """Snapshots of a device, newest first; an unreadable one gives the cause in its `reason`."""
        paths = self._everywhere(protocol, serial_number).values()
        infos = [info for path in paths if (info := self._info(path)) is not None]
        return sorted(infos, key=lambda info: (info.taken, info.name), reverse=True)

    def get(self, protocol: str, serial_number: str, name: str) -> Snapshot:
        """Read a snapshot.

        Raises:
            KeyError: unknown name.
            SnapshotError: it cannot be read.
        """
        return self.read(self.text(protocol, serial_number, name))

    def describe(self, protocol: str, serial_number: str) -> Iterator[Mapping[str, Mapping[str, Any]]]:
        """Values that the device reported here: those of its newest snapshots, then of older pinned ones."""
        infos = self.all(protocol, serial_number)
        for info in [*infos[:MAX_SEARCHED], *(one for one in infos[MAX_SEARCHED:] if one.pinned)]:
            with suppress(SnapshotError, KeyError):
                snapshot = self.get(protocol, serial_number, info.name)
                if not snapshot.imported:
                    yield snapshot.values

    def text(self, protocol: str, serial_number: str, name: str) -> str:
        """The content of a file; KeyError for an unknown name."""
        path = self._everywhere(protocol, serial_number)[name]
        try:
            return path.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise KeyError(name) from None
        except (OSError, UnicodeDecodeError):
            raise SnapshotError("This file cannot be read.", "Check whether another program changed it.") from None

    def delete(self, protocol: str, serial_number: str, name: str) -> None:
        """Delete a snapshot; KeyError for an unknown name."""
        atomic_write.remove(self._everywhere(protocol, serial_number)[name])

    def _everywhere(self, protocol: str, serial_number: str) -> dict[str, Path]:
        """The files of a device by name, including those under earlier serial numbers."""
        paths: dict[str, Path] = {}
        former = self._formerly(protocol, serial_number) if self._formerly is not None else ()
        for number in (*former, serial_number):
            paths |= self._paths(self._of(protocol, number))
        return paths

    def _of(self, protocol: str, serial_number: str) -> Path:
        return self._folder / f"{_safe(protocol) or 'unknown'}-{_safe(serial_number) or 'unknown'}"

    @staticmethod
    def _paths(folder: Path) -> dict[str, Path]:
        """The existing files by name; names from outside are only looked up here."""
        try:
            return {path.stem: path for path in folder.iterdir() if path.suffix == ".yaml" and path.is_file()}
        except OSError:
            return {}

    def _info(self, path: Path) -> SnapshotInfo | None:
        try:
            about = path.stat()
            known = self._known.get(path)
            key = (about.st_mtime_ns, about.st_size)
            if known is None or known[0] != key:
                known = self._known[path] = (key, _info_of(path, self.read))
            return known[1]
        except OSError:  # deleted in the meantime
            return None

    def _unused_name(self, folder: Path, snapshot: Snapshot) -> str:
        stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(snapshot.taken))
        slug = _safe(snapshot.title.lower().replace(" ", "-"))[:60] or "settings"
        there = self._paths(folder)
        name, count = f"{stamp}-{slug}", 1
        while name in there:
            count += 1
            name = f"{stamp}-{slug}-{count}"
        return name

    def _prune(self, folder: Path) -> None:
        """Delete the oldest files that are not pinned, beyond the maximum number."""
        paths = self._paths(folder)
        if len(paths) <= self._max_files:
            return
        removable = [name for name, path in sorted(paths.items()) if (info := self._info(path)) and not info.pinned]
        for name in removable[: len(paths) - self._max_files]:
            atomic_write.remove(paths[name])


def _read_here(text: str) -> Snapshot:
    """Read a text in this process: that of a command, or of a test."""
    snapshot: Snapshot = import_module("imuscope.server.configuration.snapshot_text").from_text(text)
    return snapshot


def _info_of(path: Path, read: Callable[[str], Snapshot]) -> SnapshotInfo:
    """Snapshot information of a file. An unreadable file is left alone, as a newer imuscope may be able to read it."""
    try:
        return read(path.read_text(encoding="utf-8")).info(path.stem)
    except UnicodeDecodeError:
        why = "This file is not text. Check whether another program changed it."
    except SnapshotError as error:
        why = f"{error} {error.hint}".strip()
    stamp, _, title = path.stem.partition("-")
    title = " ".join(title.split("-")).capitalize() or path.stem
    return SnapshotInfo(path.stem, title, _time_of_stamp(stamp), why, "", "", "", 0, 0, pinned=True, readable=False)


def _time_of_stamp(stamp: str) -> float:
    """Unix seconds of the time stamp (20261121T044324Z) at the beginning of a file name; 0 if invalid."""
    try:
        return datetime.strptime(stamp, "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC).timestamp()
    except ValueError:
        return 0.0


def _safe(text: str) -> str:
    """Letters, digits, dash and underscore of a text; never a path."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", text).strip("-")[:80]
