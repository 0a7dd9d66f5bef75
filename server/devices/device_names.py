"""Lasting names of devices: their keys, their ids in later runs, and the names given by users.

    devices.json    {"next": 3, "ids": {"/dev/ttyUSB0": ["1"], "sim:xbus": ["2"]},
                     "names": {"xbus-0080800006": "left wheel"}}

A sensor is known by its protocol and serial number, and by its source until it has sent one. The id of a device
is that of its source: it stays the same when the server is started again, whatever the order of its sources, and an id
is never given to another source. So what a link, a tab or a script holds means the same device, or nothing.

The file is replaced atomically; unreadable parts count as absent.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import TypeVar

from imuscope.recordings import atomic_write
from imuscope.recordings.regular_file import read_regular
from imuscope.server.errors import DomainError
from imuscope.server.links.source_url import is_printable

log = logging.getLogger("imuscope.devices")
T = TypeVar("T")

FILE = "devices.json"
MAX_NAME = 60
MAX_SOURCES = 1000
MAX_IDS = 64  # of one source: as many devices as can be open
MAX_NAMES = 10_000


class DeviceNames:
    """The file.

    Args:
        folder: the data folder; None to store nothing beyond this process.
    """

    def __init__(self, folder: Path | None) -> None:
        self._path = folder / FILE if folder is not None else None
        self._next = 1
        self._ids: dict[str, list[str]] = {}
        self._names: dict[str, str] = {}
        self._listeners: list[Callable[[], None]] = []
        self._read()

    def id_of(self, source: str, ids_in_use: Collection[str]) -> str:
        """The id of a source that is opened; a new one if all of its ids are taken by devices that are open."""
        known = self._ids.get(source, [])
        free = next((one for one in known if one not in ids_in_use), None)
        if free is not None:
            return free
        new = str(self._next)
        self._next += 1
        self._ids.pop(source, None)  # the sources used last are kept
        self._ids[source] = [*known, new][:MAX_IDS]
        for old in [one for one in self._ids if one != source][: max(0, len(self._ids) - MAX_SOURCES)]:
            del self._ids[old]
        self._save()
        return new

    def name_of(self, key: str) -> str:
        """The name that users gave a device; "" if none."""
        return self._names.get(key, "")

    def on_change(self, listener: Callable[[], None]) -> None:
        """Call `listener` after each change of a name."""
        self._listeners.append(listener)

    def rename(self, key: str, name: str) -> str:
        """Name a device, "" to forget its name; returns the name as stored.

        Raises:
            DomainError: "bad-value" if it is too long or cannot be shown, "full", or "disk".
        """
        clean = " ".join(name.split())
        if len(clean) > MAX_NAME:
            raise DomainError("bad-value", f"name: {len(clean)} characters are too many.", f"Use at most {MAX_NAME}.")
        if not is_printable(clean):
            raise DomainError("bad-value", "name: some characters cannot be shown.", "Leave them out.")
        if clean and key not in self._names and len(self._names) >= MAX_NAMES:
            raise DomainError("full", f"{MAX_NAMES:,} devices have names.".replace(",", " "), "Clear another first.")
        before = dict(self._names)
        self._names.pop(key, None)
        if clean:
            self._names[key] = clean
        try:
            self._write()
        except OSError as error:
            self._names = before
            words = f"The name cannot be stored: {error.strerror or error}."
            raise DomainError("disk", words, "Check free space and permissions of the data folder.") from None
        for listener in self._listeners:
            listener()
        return clean

    def move(self, old: str, new: str) -> None:
        """Give the name of a source to the sensor at it, once its number is known."""
        if old in self._names and new not in self._names:
            self._names[new] = self._names.pop(old)
            self._save()

    def _save(self) -> None:
        try:
            self._write()
        except OSError as error:
            log.warning("The ids of devices cannot be stored: %s.", error.strerror or error)

    def _write(self) -> None:
        if self._path is not None:
            content = {"next": self._next, "ids": self._ids, "names": self._names}
            self._path.parent.mkdir(parents=True, exist_ok=True)
            atomic_write.write_atomic(self._path, json.dumps(content, indent=1, ensure_ascii=False))

    def _read(self) -> None:
        if self._path is None:
            return
        try:
            content = json.loads(read_regular(self._path))
        except (OSError, ValueError, RecursionError):
            return
        if not isinstance(content, dict):
            return
        for source, ids in _texts(content.get("ids"), list):
            self._ids[source] = [one for one in ids if isinstance(one, str) and one.isascii() and one.isdigit()]
        self._names = dict(_texts(content.get("names"), str))
        next_number = content.get("next")
        used = [int(one) for ids in self._ids.values() for one in ids]
        self._ids = {source: ids[:MAX_IDS] for source, ids in self._ids.items()}
        self._next = max([next_number if type(next_number) is int else 1, *(one + 1 for one in used)])


def _texts(rows: object, kind: type[T]) -> list[tuple[str, T]]:
    """The rows of an object of JSON whose values are of a type."""
    return [(key, value) for key, value in rows.items() if isinstance(value, kind)] if isinstance(rows, Mapping) else []
