"""Definitions of computed signals, stored in the data folder by device.

    signals.json    {"xbus-0080A1B2": [{"name": "Total acceleration", "expression": "norm(Acceleration)"}]}

A device is known by its protocol and serial number, and by its source until it has sent one: it may have another
id in the next run. The file is replaced atomically; unreadable parts count as absent.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import read_object
from imuscope.server.errors import DomainError
from imuscope.server.wire import DeviceInfo, key_of

FILE = "signals.json"
MAX_SIGNALS = 50  # of one device
MAX_NAME = 60
MAX_TEXT = 4000


@dataclass(frozen=True, slots=True)
class SignalDefinition:
    """A computed signal.

    Attributes:
        name: of its channel.
        expression: over other channels (docs/guide/analysis.md).
    """

    name: str
    expression: str


class SignalDefinitions:
    """The file.

    Args:
        folder: the data folder.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE
        self._known = self._read()
        self._listeners: list[Callable[[], None]] = []

    def on_change(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call a function after each change; the returned function ends that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    def of(self, device: DeviceInfo) -> Sequence[SignalDefinition]:
        """The definitions of a device, in order of their creation."""
        return tuple(self._known.get(key_of(device), ()))

    def put(self, device: DeviceInfo, definition: SignalDefinition) -> None:
        """Store a definition in place of the one of its name.

        Raises:
            DomainError: "full", "name" or "disk".
        """
        if not is_name(definition.name):
            hint = f"Give 1 to {MAX_NAME} characters, without “/”, “.” and quotation marks."
            raise DomainError("name", f"{definition.name:.80} is not a valid signal name.", hint)
        own = list(self.of(device))
        names = [one.name for one in own]
        if definition.name in names:
            own[names.index(definition.name)] = definition
        elif len(own) >= MAX_SIGNALS:
            raise DomainError("full", f"{device.name} has {MAX_SIGNALS} computed signals.", "Remove one first.")
        else:
            own.append(definition)
        self._write(device, own)

    def remove(self, device: DeviceInfo, name: str) -> None:
        """Remove a definition.

        Raises:
            DomainError: "not-found" or "disk".
        """
        own = [one for one in self.of(device) if one.name != name]
        if len(own) == len(self.of(device)):
            raise DomainError("not-found", f"Signal {name:.60} not found.", "It may have been removed.")
        self._write(device, own)

    def _write(self, device: DeviceInfo, own: Sequence[SignalDefinition]) -> None:
        known = {**self._known, key_of(device): list(own)}
        text = json.dumps({key: [asdict(one) for one in all_] for key, all_ in known.items() if all_}, indent=1)
        try:
            atomic_write.write_atomic(self._path, text)
        except OSError as error:
            message = f"The definition cannot be stored: {error.strerror or error}."
            raise DomainError("disk", message, "Free some space, or check the rights of the data folder.") from None
        self._known = known
        for listener in tuple(self._listeners):
            listener()

    def _read(self) -> dict[str, list[SignalDefinition]]:
        return {str(key): definitions_in(rows) for key, rows in read_object(self._path).items()}


def definitions_in(rows: Any) -> list[SignalDefinition]:
    """The valid definitions among some JSON."""
    definitions = []
    for row in rows if isinstance(rows, list) else ():
        name, text = (row.get("name"), row.get("expression")) if isinstance(row, dict) else (None, None)
        if isinstance(name, str) and isinstance(text, str) and is_name(name) and len(text) <= MAX_TEXT:
            definitions.append(SignalDefinition(name, text))
    return definitions[:MAX_SIGNALS]


def is_name(name: str) -> bool:
    """Whether a channel can have this name, and an expression name it."""
    return 0 < len(name) <= MAX_NAME and name == name.strip() and name.isprintable() and not set(name) & set("/.\"'")
