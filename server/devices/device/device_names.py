"""Lasting names of devices: their keys, their ids and topics in later runs, and the names given by users.

    devices.json    {"next": 3, "ids": {"/dev/ttyUSB0": ["1"], "sim:xbus": ["2"]},
                     "topics": {"/dev/ttyUSB0": ["imu"], "sim:xbus": ["imu_2"]},
                     "products": {"1": ["xbus", "MTi-630-8A1G6", "MTi-630"]},
                     "names": {"xbus-0080800006": "left wheel"}}

A sensor is known by its protocol and serial number, and by its source until it has sent one. The id of a device
is that of its source: it stays the same when the server is started again, whatever the order of its sources, and an id
is never given to another source. So what a link, a tab or a script holds means the same device, or nothing.

The topic is the name under which programs of others subscribe to a device. It depends on the source without its
options, and never on what the device turns out to be: a product that is learnt later, or not because the driver of the
robot was there first, renames nothing. One that a simulator had is free for a real device when the simulator is not
there.

The file is replaced atomically; unreadable parts count as absent.
"""

import json
import logging
import re
from collections.abc import Callable, Collection, Mapping
from itertools import count
from pathlib import Path
from typing import TypeVar

from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import read_object
from imuscope.server.errors import DomainError
from imuscope.server.links.source_url import is_printable

log = logging.getLogger("imuscope.devices")
T = TypeVar("T")

FILE = "devices.json"
MAX_NAME = 60
MAX_SOURCES = 1000
MAX_IDS = 64  # of one source: as many devices as can be open
MAX_NAMES = 10_000
TOPIC = "imu"
SIMULATED = "sim:"


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
        self._topics: dict[str, list[str]] = {}
        self._configured: Mapping[str, str] = {}
        self._announced: dict[str, str] = {}  # topics of the devices that are open
        self._products: dict[str, list[str]] = {}
        self.moved: dict[str, str] = {}  # topics that devices had in earlier runs, and have no longer
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

    def give_topics(self, topics: Mapping[str, str]) -> None:
        """Use these topics for sources, named with or without their options."""
        self._configured = topics

    def topic_of(self, device: str, source: str) -> str:
        """The topic of a device that is opened."""
        place = source.partition("?")[0]
        used = set(self._announced.values())
        known = self._topics.get(place, [])
        before = next((one for one in known if one not in used), "")
        configured = self._configured.get(source) or self._configured.get(place, "")
        used |= set(self._configured.values())
        topic = (
            configured
            if configured and configured not in self._announced.values()
            else ""
            if before in used
            else before
        )
        if not topic:
            others = [(key, one) for key, topics in self._topics.items() if key != place for one in topics]
            is_reserved = [not key.startswith(SIMULATED) or place.startswith(SIMULATED) for key, _ in others]
            used |= {one for (_, one), reserved in zip(others, is_reserved, strict=True) if reserved}
            topic = next(name for n in count(1) if (name := TOPIC if n == 1 else f"{TOPIC}_{n}") not in used)
        if topic != before:
            for topics in self._topics.values():
                topics[:] = [one for one in topics if one not in (topic, before)]
            self._topics = {key: topics for key, topics in self._topics.items() if topics and key != place}
            self._topics[place] = [*[one for one in known if one not in (topic, before)], topic][-MAX_IDS:]
            for old in [one for one in self._topics if one != place][: max(0, len(self._topics) - MAX_SOURCES)]:
                del self._topics[old]
            self._save()
            if before:
                self.moved[device] = before
        self._announced[device] = topic
        return topic

    def withdraw(self, device: str) -> None:
        """Note that a device was removed; its topic waits for its source."""
        self._announced.pop(device, None)

    def identified(self, device: str, protocol: str, product: str, name: str) -> None:
        """Remember what a device is."""
        known = [protocol, product, name]
        if self._products.get(device) != known:
            self._products.pop(device, None)
            self._products = dict([*self._products.items(), (device, known)][-MAX_NAMES:])
            self._save()

    def former(self, device: str) -> tuple[str, str, str]:
        """Protocol, product and displayed name of a device when it was identified last, in earlier runs too."""
        protocol, product, name = self._products.get(device, ("", "", ""))
        return protocol, product, name

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
            content = {"next": self._next, "ids": self._ids, "topics": self._topics, "products": self._products}
            content["names"] = self._names
            self._path.parent.mkdir(parents=True, exist_ok=True)
            atomic_write.write_atomic(self._path, json.dumps(content, indent=1, ensure_ascii=False))

    def _read(self) -> None:
        content = read_object(self._path) if self._path is not None else {}
        for source, ids in _texts(content.get("ids"), list):
            self._ids[source] = [one for one in ids if isinstance(one, str) and one.isascii() and one.isdigit()]
        self._names = dict(_texts(content.get("names"), str))
        self._topics = {
            place: [one for one in topics if isinstance(one, str) and re.fullmatch(r"[A-Za-z]\w*", one, re.ASCII)]
            for place, topics in _texts(content.get("topics"), list)
        }
        self._products = {
            device: about
            for device, about in _texts(content.get("products"), list)
            if len(about) == 3 and all(isinstance(one, str) and is_printable(one) for one in about)
        }
        next_number = content.get("next")
        used = [int(one) for ids in self._ids.values() for one in ids]
        self._ids = {source: ids[:MAX_IDS] for source, ids in self._ids.items()}
        self._next = max([next_number if type(next_number) is int else 1, *(one + 1 for one in used)])


def _texts(rows: object, kind: type[T]) -> list[tuple[str, T]]:
    """The rows of an object of JSON whose values are of a type."""
    return [(key, value) for key, value in rows.items() if isinstance(value, kind)] if isinstance(rows, Mapping) else []
