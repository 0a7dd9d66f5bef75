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
    of the recording      recording                   format, title, created (ISO 8601), host, version
    of a device           device/<device>             source, link, protocol, product, serial_number, firmware, baud, …;
                                                      written again whenever more of it is known: the last one holds
    of what came later    edit                        title, tags, notes, pinned: what a person changed

While it is recorded the file is written record by record, unbuffered and unchunked: whatever happens to the process, at
most what had not been handed over is lost, and `sync` bounds what a power cut can take. A closed recording is rewritten
with chunks, compression and indexes (recordings/compaction.py). Both forms, and a torn one, are valid to every reader
of MCAP that tolerates a missing end; reading is in recordings/mcap_reader.py.

`format` is 1, and so is a recording that names none. It is raised when a reader of before would misread what is
written; a reader meets a number that it does not know with one sentence, and opens nothing (`check_format_version`).

A key never gets into a recording.

Source: MCAP specification, https://mcap.dev/spec.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

from mcap.opcode import Opcode
from mcap.records import Channel, Header, McapRecord, Metadata, MetadataIndex, Schema, Statistics

from recordings import file_lock
from recordings.mcap_records import MAGIC, bytes_of, ending, message

Direction = Literal["rx", "tx"]

PROFILE = "imuscope"
FORMAT = 1
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


READABLE = "Is it there, and may this server read it?"
_FREE = "Free some space, or delete recordings; what was recorded until now is kept."
_HINTS = {
    errno.ENOSPC: _FREE,
    errno.EDQUOT: _FREE,
    errno.EFBIG: "Raise the limit (`ulimit -f`), or split recordings earlier (`split_mb`); what there is is kept.",
    errno.EACCES: "Give the user that runs imuscope write permission there, or choose another folder with --data.",
    errno.EROFS: "Choose another folder with --data.",
    errno.ENOENT: "Was the folder removed? Choose another with --data.",
    errno.EEXIST: "Choose another name.",
    errno.EIO: "The disk or its cable is failing: copy what is on it elsewhere, then look at the system's log (dmesg).",
}
_WORDS = {
    errno.ENOSPC: "The disk is full",
    errno.EDQUOT: "The disk quota is used up",
    errno.EFBIG: "The file has reached the largest size that the system allows",
    errno.EEXIST: "There is a file of that name already",
    errno.EIO: "The disk failed (input/output error)",
}


class RecordingError(Exception):
    """The world failed (a full disk, a folder that is gone): one sentence, and what to do."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


class McapWriter:
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
            self._file = AtomicRecordFile(path)
        except OSError as error:
            raise disk_error(error, path) from None
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[str, Channel] = {}
        self._counts: dict[int, int] = {}
        self._metadata: list[MetadataIndex] = []
        self._first: int | None = None
        self._last = 0
        self._closed = False
        library = f"imuscope {about.get('version', '')}".strip()
        try:
            self._write([MAGIC + bytes_of(Header(PROFILE, library))])
            self._tell(RECORDING, {**about, "format": FORMAT})
        except RecordingError:
            with contextlib.suppress(OSError):
                path.unlink()  # a full disk leaves no empty recording behind
            raise

    def device(self, device: str, about: Mapping[str, Any]) -> None:
        """What is known about a device; the last call holds."""
        self._tell(DEVICE + device, about)

    def chunk(self, device: str, direction: Direction, data: bytes, arrival_ns: int) -> None:
        """Bytes as they came, or as they were sent."""
        self.chunks([(device, direction, data, arrival_ns)])

    def chunks(self, chunks: Iterable[tuple[str, Direction, bytes, int]]) -> None:
        """Many of them, (device, direction, data, arrival ns) each, in one write."""
        records = [
            self._message(f"{direction}/{device}", RAW_ENCODING, None, arrival_ns, data)
            for device, direction, data, arrival_ns in chunks
        ]
        self._write(records)

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
        """Let the disk have it: what was written before survives a power cut. May be called in another thread."""
        if not self._closed:
            try:
                self._file.sync()
            except OSError as error:
                if not self._closed:  # meanwhile, by who writes: then that one tells why
                    raise disk_error(error, self.path) from None

    def close(self) -> None:
        """End the file as the format wants it. It can be opened as it is; packing makes it small and quick.

        One that somebody else has shortened gets no summary: it would point beside what it describes.
        """
        if self.is_shortened():
            self.give_up()
        if not self._closed:
            self._write([ending(self.size, self._summary())])
            self.sync()
            self._closed = True
            self._file.close()

    def give_up(self) -> None:
        """Let go of the file as it is: torn, and whole up to there."""
        self._closed = True
        self._file.close()

    def is_there(self) -> bool:
        """Is the file still to be found by its name?"""
        return self._closed or self._file.is_at(self.path)

    def is_shortened(self) -> bool:
        """Whether somebody else cut off some of what was written."""
        return not self._closed and self._file.is_shortened()

    def copy_to(self, path: Path) -> None:
        """Write what is in this file again, into another one: its own may have no name any more.

        Raises:
            OSError: that cannot be.
        """
        self._file.copy_to(path)

    def _json(self, topic: str, name: str, schema: Mapping[str, Any], body: Mapping[str, Any], time_ns: int) -> None:
        data = json.dumps(body, ensure_ascii=False, separators=(",", ":")).encode()
        self._write([self._message(topic, "json", (name, schema), time_ns, data)])

    def _tell(self, name: str, about: Mapping[str, Any]) -> None:
        record = bytes_of(Metadata(name=name, metadata=_strings(about)))
        self._metadata.append(MetadataIndex(offset=self.size, length=len(record), name=name))
        self._write([record])

    def _message(
        self, topic: str, encoding: str, schema: tuple[str, Mapping[str, Any]] | None, time_ns: int, data: bytes
    ) -> bytes:
        """The record of a message, before it those that tell of its channel where it is the first."""
        channel = self._channels.get(topic)
        told = b""
        if channel is None:
            told = self._channel(topic, encoding, schema)
            channel = self._channels[topic]
        number = channel.id
        self._counts[number] = self._counts.get(number, 0) + 1
        self._first = time_ns if self._first is None or time_ns < self._first else self._first
        self._last = max(self._last, time_ns)
        return told + message(number, time_ns, data)

    def _channel(self, topic: str, encoding: str, schema: tuple[str, Mapping[str, Any]] | None) -> bytes:
        records: list[McapRecord] = []
        number = 0
        if schema is not None:
            name, body = schema
            if name not in self._schemas:
                data = json.dumps(body).encode()
                self._schemas[name] = Schema(id=len(self._schemas) + 1, data=data, encoding="jsonschema", name=name)
                records.append(self._schemas[name])
            number = self._schemas[name].id
        self._channels[topic] = Channel(
            id=len(self._channels) + 1, topic=topic, message_encoding=encoding, metadata={}, schema_id=number
        )
        records.append(self._channels[topic])
        return b"".join(bytes_of(record) for record in records)

    def _summary(self) -> list[tuple[int, list[McapRecord]]]:
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=0,
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=self._first or 0,
            message_end_time=self._last,
            schema_count=len(self._schemas),
        )
        return [
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.METADATA_INDEX, list(self._metadata)),
        ]

    def _write(self, records: list[bytes]) -> None:
        if self._closed:
            raise RecordingError(f"{self.path.name} is closed.", "Begin another recording.")
        try:
            self._file.write(records)
        except OSError as error:
            self._closed = True
            self._file.cut()
            raise disk_error(error, self.path) from None
        finally:
            self.size = self._file.count


class AtomicRecordFile:
    """An unbuffered file that takes whole records: of one that does not fit any more, what was written is cut off.

    It is appended to, so that what comes after somebody else's truncation stands behind what is left, without a hole.
    """

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        file_lock.hold(self._fd)
        self.count = 0

    def write(self, records: list[bytes]) -> None:
        data = b"".join(records)
        view = memoryview(data)
        done = 0
        try:
            while done < len(view):
                done += os.write(self._fd, view[done:])
        except OSError:
            for record in records:  # those that are whole stay
                if len(record) > done:
                    break
                self.count += len(record)
                done -= len(record)
            raise
        self.count += done

    def sync(self) -> None:
        os.fdatasync(self._fd)

    def is_at(self, path: Path) -> bool:
        try:
            return os.path.samestat(os.fstat(self._fd), path.stat())
        except OSError:
            return False

    def is_shortened(self) -> bool:
        count = self.count  # before the size: it grows meanwhile
        try:
            return os.fstat(self._fd).st_size < count
        except OSError:
            return False

    def copy_to(self, path: Path) -> None:
        with open(f"/proc/self/fd/{self._fd}", "rb") as old, path.open("xb") as new:
            shutil.copyfileobj(old, new, 1 << 20)
            new.flush()
            os.fsync(new.fileno())

    def cut(self) -> None:
        """Back to the last whole record; a disk that cannot even do that keeps a torn end, which readers skip."""
        with contextlib.suppress(OSError):
            if not self.is_shortened():
                os.ftruncate(self._fd, self.count)
        self.close()

    def close(self) -> None:
        fd, self._fd = self._fd, -1
        if fd >= 0:
            with contextlib.suppress(OSError):
                os.close(fd)


def _strings(about: Mapping[str, Any]) -> dict[str, str]:
    return {name: "" if value is None else str(value) for name, value in about.items()}


def check_format_version(name: str, told: object, known: int = FORMAT) -> RecordingError | None:
    """What to say of a file that tells a later format than is known here; None where it can be read.

    Args:
        told: what it says of its format, whatever that is; nothing counts as the first.
    """
    text = str(told)
    if isinstance(told, bool) or not (text.isascii() and text.isdigit()) or int(text[:9]) <= known:
        return None
    words = f"{name} was written by a newer imuscope (format {text[:9]}; this one reads {known})."
    return RecordingError(words, "Update imuscope; the file is left as it is.")


def disk_error(error: OSError, path: Path) -> RecordingError:
    """What a person is told when the disk fails."""
    said = _WORDS.get(error.errno or 0, (error.strerror or "It cannot be written").capitalize())
    return RecordingError(f"{said}: {path.name}.", _HINTS.get(error.errno or 0, ""))
