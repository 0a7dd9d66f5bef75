"""A recording on disk: MCAP, written so that a fall of the power loses next to nothing.

What is recorded is what was on the wire: every chunk of bytes, both ways, with the time at which it arrived. Samples
are made of them again when the file is opened, so a better decoder improves old files.

    channel               encoding                    one message is
    rx/<device>           application/octet-stream    a chunk as it came from the device; log time: its arrival, ns
    tx/<device>           application/octet-stream    a chunk as it was sent to the device
    events                json                        one event of the session (server/wire.py, EventInfo)
    notes                 json                        {"kind": "marker" | "note", "text", "device"}
    snapshot/<device>     json                        configuration: {"values", "missing", "reason", …}

    metadata              name                        holds (strings)
    of the recording      recording                   title, created (ISO 8601), host, version
    of a device           device/<device>             source, link, protocol, product, serial_number, firmware, baud, …;
                                                      written again whenever more of it is known: the last one holds
    of what came later    edit                        title, tags, notes, pinned: what a person changed

While it is recorded the file is written record by record, unbuffered and unchunked: whatever happens to the process, at
most what had not been handed over is lost, and `sync` bounds what a power cut can take. A closed recording is rewritten
with chunks, compression and indexes (recordings/packing.py). Both forms, and a torn one, are valid to every reader of
MCAP that tolerates a missing end; reading is in recordings/blocks.py.

A key never gets into a recording.

Source: MCAP specification, https://mcap.dev/spec.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter

Direction = Literal["rx", "tx"]

PROFILE = "imuscope"
RAW_ENCODING = "application/octet-stream"
SUFFIX = ".mcap"
RECORDING, DEVICE, EDIT = "recording", "device/", "edit"
EVENTS, NOTES, SNAPSHOT = "events", "notes", "snapshot/"

_EVENT_SCHEMA = {
    "type": "object",
    "properties": {"kind": {"type": "string"}, "level": {"type": "string"}, "text": {"type": "string"}},
}
_NOTE_SCHEMA = {
    "type": "object",
    "properties": {"kind": {"type": "string"}, "text": {"type": "string"}, "device": {"type": "string"}},
}
_SNAPSHOT_SCHEMA = {
    "type": "object",
    "properties": {"values": {"type": "object"}, "missing": {"type": "object"}, "reason": {"type": "string"}},
}


_FREE = "Free some space, or delete recordings; what was recorded until now is kept."
_HINTS = {
    errno.ENOSPC: _FREE,
    errno.EDQUOT: _FREE,
    errno.EACCES: "Give the user that runs imuscope write permission there, or choose another folder with --data.",
    errno.EROFS: "Choose another folder with --data.",
    errno.ENOENT: "Was the folder removed? Choose another with --data.",
    errno.EEXIST: "Choose another name.",
}
_WORDS = {
    errno.ENOSPC: "The disk is full",
    errno.EDQUOT: "The disk quota is used up",
    errno.EEXIST: "There is a file of that name already",
}


class RecordingError(Exception):
    """The world failed (a full disk, a folder that is gone): one sentence, and what to do."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


class Writer:
    """A recording that is being made.

    Args:
        path: of a file that must not exist yet.
        about: the recording's own metadata; values become strings.
    Raises:
        RecordingError: the file cannot be made. So does every method here when it cannot be written on; what was
            written until then stays, and the file is closed.
    """

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        self.path = path
        self.size = 0
        try:
            self._file = _Whole(path)
        except OSError as error:
            raise problem(error, path) from None
        self._mcap = McapWriter(
            self._file,  # type: ignore[arg-type]  # it asks for write, tell and flush
            use_chunking=False,
            compression=CompressionType.NONE,
            index_types=IndexType.NONE,
            enable_crcs=True,
        )
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._closed = False
        self._write(self._mcap.start, PROFILE, f"imuscope {about.get('version', '')}".strip())
        self._write(self._mcap.add_metadata, RECORDING, _strings(about))

    def device(self, device: str, about: Mapping[str, Any]) -> None:
        """What is known about a device; the last call holds."""
        self._write(self._mcap.add_metadata, DEVICE + device, _strings(about))

    def chunk(self, device: str, direction: Direction, data: bytes, arrival_ns: int) -> None:
        """Bytes as they came, or as they were sent."""
        self._add(f"{direction}/{device}", RAW_ENCODING, None, arrival_ns, data)

    def event(self, event: Mapping[str, Any], time_ns: int) -> None:
        """Something that happened."""
        self._json(EVENTS, "imuscope.Event", _EVENT_SCHEMA, event, time_ns)

    def note(self, kind: Literal["marker", "note"], text: str, time_ns: int, device: str = "") -> None:
        """A marker dropped by a key stroke, or a sentence."""
        self._json(NOTES, "imuscope.Note", _NOTE_SCHEMA, {"kind": kind, "text": text, "device": device}, time_ns)

    def snapshot(self, device: str, body: Mapping[str, Any], time_ns: int) -> None:
        """The configuration of a device, as read."""
        self._json(SNAPSHOT + device, "imuscope.Snapshot", _SNAPSHOT_SCHEMA, body, time_ns)

    def sync(self) -> None:
        """Let the disk have it: what was written before survives a power cut."""
        if not self._closed:
            self._write(self._file.sync)

    def close(self) -> None:
        """End the file as the format wants it. It can be opened as it is; packing makes it small and quick."""
        if not self._closed:
            self._write(self._mcap.finish)
            self._write(self._file.sync)
            self._closed = True
            self._file.close()

    def _json(self, topic: str, name: str, schema: Mapping[str, Any], body: Mapping[str, Any], time_ns: int) -> None:
        data = json.dumps(body, ensure_ascii=False, separators=(",", ":")).encode()
        self._add(topic, "json", (name, schema), time_ns, data)

    def _add(
        self, topic: str, encoding: str, schema: tuple[str, Mapping[str, Any]] | None, time_ns: int, data: bytes
    ) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            number = 0
            if schema is not None:
                name, body = schema
                if name not in self._schemas:
                    told = json.dumps(body).encode()
                    self._schemas[name] = self._write(self._mcap.register_schema, name, "jsonschema", told)
                number = self._schemas[name]
            channel = self._channels[topic] = self._write(self._mcap.register_channel, topic, encoding, number)
        self._write(self._mcap.add_message, channel, time_ns, data, time_ns)

    def _write(self, method: Any, *arguments: Any) -> Any:
        if self._closed:
            raise RecordingError(f"{self.path.name} is closed.")
        try:
            result = method(*arguments)
        except OSError as error:
            self._closed = True
            self._file.cut()
            raise problem(error, self.path) from None
        self.size = self._file.count
        return result


class _Whole:
    """An unbuffered file that takes whole records or none: what is left of a failed one is cut off again.

    Not an io.RawIOBase: the writer of MCAP would put a buffer before that.
    """

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self.count = 0

    def write(self, data: bytes | bytearray | memoryview) -> int:
        view = memoryview(data).cast("B")
        done = 0
        while done < len(view):
            done += os.write(self._fd, view[done:])
        self.count += done
        return done

    def tell(self) -> int:
        return self.count

    def flush(self) -> None:
        """Nothing is held back."""

    def sync(self) -> None:
        os.fdatasync(self._fd)

    def cut(self) -> None:
        """Back to the last whole record; a disk that cannot even do that keeps a torn end, which readers skip."""
        with contextlib.suppress(OSError):
            os.ftruncate(self._fd, self.count)
        self.close()

    def close(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self._fd)


def _strings(about: Mapping[str, Any]) -> dict[str, str]:
    return {name: "" if value is None else str(value) for name, value in about.items()}


def problem(error: OSError, path: Path) -> RecordingError:
    """What a person is told when the disk fails."""
    said = _WORDS.get(error.errno or 0, (error.strerror or "It cannot be written").capitalize())
    return RecordingError(f"{said}: {path.name}.", _HINTS.get(error.errno or 0, ""))
