"""Choices on how tables are read, by their heading: the next file with the same heading is read as the last one was.

    <data>/table-readings.json    {"imuscope": 1, "tables": [{"heading": ["time", "gx"], "reading": {"unit": "ms"}}]}

The choices for a heading that was used last come last. A table without a heading is not remembered.
"""

import json
import threading
from collections.abc import Sequence
from pathlib import Path

from imuscope.recordings.errors import disk_error
from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import read_regular
from imuscope.recordings.system.tolerant_json import loads
from imuscope.recordings.tables.options import FileReading, reading_from

FILE = "table-readings.json"
VERSION = 1
MAX_HEADINGS = 200
MAX_BYTES = 8 << 20

Heading = tuple[str, ...]


class TableMemory:
    """The file; threads may share it.

    Args:
        folder: the data folder; None to store nothing beyond this process.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._path = folder / FILE if folder is not None else None
        self._lock = threading.Lock()
        self._readings: dict[Heading, FileReading] = {}
        self._read()

    def __bool__(self) -> bool:
        """Whether anything is remembered."""
        return bool(self._readings)

    def of(self, heading: Sequence[str]) -> FileReading | None:
        """The choices for tables with this heading; None without any."""
        return self._readings.get(_clean(heading))

    def remember(self, heading: Sequence[str], reading: FileReading) -> None:
        """Remember the choices for a heading; forget it if there are none.

        Raises:
            RecordingError: they cannot be stored.
        """
        key = _clean(heading)
        with self._lock:
            if not any(key) or (not reading and key not in self._readings):
                return
            changed = {one: known for one, known in self._readings.items() if one != key}
            if reading:
                changed[key] = reading
            self._readings = dict(list(changed.items())[-MAX_HEADINGS:])
            self._write()

    def _read(self) -> None:
        if self._path is None:
            return
        try:
            if self._path.stat().st_size > MAX_BYTES:
                return
            body = loads(read_regular(self._path).decode())
            tables = body["tables"] if body["imuscope"] == VERSION else []
            for one in tables:
                reading = reading_from(one["reading"])
                if reading and all(isinstance(text, str) for text in one["heading"]):
                    self._readings[tuple(one["heading"])] = reading
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return

    def _write(self) -> None:
        if self._path is None:
            return
        tables = [{"heading": list(key), "reading": one.as_json()} for key, one in self._readings.items()]
        body = {"imuscope": VERSION, "tables": tables}
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            atomic_write.write_atomic(self._path, json.dumps(body, ensure_ascii=False, indent=1))
        except OSError as error:
            raise disk_error(error, self._path) from None


def _clean(heading: Sequence[str]) -> Heading:
    return tuple(text.strip().strip("\ufeff") for text in heading)
