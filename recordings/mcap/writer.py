"""A recording on disk: MCAP, written so that a power failure loses next to nothing.

A recording holds the bytes on the wire: every chunk, in both directions, with its arrival time. Samples are decoded
from them when the file is opened, so a better decoder improves old files.

    channel               encoding                    one message is
    rx/<device>           application/octet-stream    a chunk as received from the device; log time: its arrival, ns
    tx/<device>           application/octet-stream    a chunk as sent to the device
    events                json                        one event of the session (server/wire/, EventInfo)
    notes                 json                        {"kind": "marker" | "note", "text", "device"}
    snapshot/<device>     json                        configuration: {"values", "missing", "reason", …}
    <topic>               cdr, json, protobuf         a message as received from a device that sends messages, with its
                                                      schema, sequence number and publish time; log time: its arrival.
                                                      Metadata of the channel: "imuscope.device"

    metadata              name                        holds (strings)
    of the recording      recording                   format, title, created (ISO 8601), host, version
    of a device           device/<device>             source, link, protocol, product, serial_number, firmware, baud, …;
                                                      written again whenever more is known: the last one counts
    of later edits        edit                        title, tags, notes, pinned: changes made by the user

During recording the file is written record by record, unbuffered and unchunked: if the process dies, at most the data
not yet handed over is lost, and `sync` bounds the loss of a power cut. A closed recording is rewritten with chunks,
compression and indexes (recordings/mcap/compaction.py). Both forms, and a truncated one, are valid for every MCAP
reader that tolerates a missing end; recordings/mcap/reader.py reads them.

The writer of the mcap library is not used. It takes one message at a time: flushed after each run of 8 chunks, so that
SIGKILL loses nothing, it writes 332 000 chunks/s, and this one 1 228 000 (7 594 000 by os.write alone); not flushed it
lost 21 of 20 000, in chunks, as it writes by default, 1 106. It packs 269 000/s, recordings/mcap/chunked.py 1 997 000.
Nor does it remove a record that a full disk has cut off, which a reader would take for the end of the file
(tests/bench/mcap_library.py).

`format` is 1, and 1 if absent. It is raised when an earlier reader would misread the file; a reader rejects a file with
a number it does not know (`errors.check_format_version`).

Keys are never recorded.

Source: MCAP specification, https://mcap.dev/spec.
"""

import contextlib
import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from mcap.opcode import Opcode
from mcap.records import Header, Metadata, MetadataIndex

from imuscope.protocols.messages.records import HEAD, Definitions, MessageChannel, records_of
from imuscope.recordings.errors import RecordingError, disk_error
from imuscope.recordings.mcap.records import (
    MAGIC,
    MESSAGE_HEAD,
    FileContents,
    SchemaKey,
    bytes_of,
    ending,
    message,
    messages,
)
from imuscope.recordings.system import file_lock
from imuscope.recordings.system.atomic_write import PRIVATE, open_private

Direction = Literal["rx", "tx"]
ChannelKey = str | tuple[str, MessageChannel]
"""Topic, or device and channel of a device that sends messages."""

PROFILE = "imuscope"
FORMAT = 1
RAW_ENCODING = "application/octet-stream"
RECORDING, DEVICE, EDIT = "recording", "device/", "edit"
EVENTS, NOTES, SNAPSHOT, SIGNALS = "events", "notes", "snapshot/", "signals/"
DEVICE_KEY = "imuscope.device"
"""Key in the metadata of a channel of messages: the device."""

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
_SIGNALS_SCHEMA = {
    "type": "object",
    "properties": {"signals": {"type": "array", "items": {"type": "object"}}, "address": {"type": "string"}},
}


def is_simulated(about: Mapping[str, str]) -> bool:
    """Whether a simulator made the data of a recorded device. Recordings of earlier versions have only its link."""
    return about.get("simulated", "") != "" or about.get("link") == "simulator"


class McapWriter:
    """A recording in progress.

    Args:
        path: of a file that does not exist yet.
        about: the recording's own metadata; values become strings.
        definitions: channels of each device that sends messages, defined in an earlier part; extended here.

    Raises:
        RecordingError: the file cannot be created. Every method raises it when writing fails; data written until then
            stays, and the file is closed.
    """

    def __init__(self, path: Path, about: Mapping[str, Any], definitions: dict[str, Definitions] | None = None) -> None:
        self.path = path
        self.size = 0
        try:
            self._file = AtomicRecordFile(path)
        except OSError as error:
            raise disk_error(error, path) from None
        self._contents = FileContents[ChannelKey]()
        self._definitions = definitions if definitions is not None else {}
        self._metadata: list[MetadataIndex] = []
        self._closed = False
        library = f"imuscope {about.get('version', '')}".strip()
        try:
            self._write([MAGIC + bytes_of(Header(PROFILE, library))])
            self._write_metadata(RECORDING, {**about, "format": FORMAT})
        except RecordingError:
            with contextlib.suppress(OSError):
                path.unlink()  # a full disk leaves no empty recording behind
            raise

    def device(self, device: str, about: Mapping[str, Any]) -> None:
        """Set the metadata of a device; the last call counts."""
        self._write_metadata(DEVICE + device, about)

    def chunk(self, device: str, direction: Direction, data: bytes, arrival_ns: int) -> None:
        """Write bytes as received or sent."""
        self.runs([(device, direction, ((data, arrival_ns),))])

    def runs(self, runs: Iterable[tuple[str, Direction, Sequence[tuple[bytes, int]]]]) -> None:
        """Write runs of chunks, (device, direction, (data, arrival ns) of each, at least one), at once."""
        records: list[bytes] = []
        for device, direction, chunks in runs:
            number = self.bytes_channel(device, direction)
            self.count(number, len(chunks), min(chunks, key=_time)[1], max(chunks, key=_time)[1])
            records += messages(number, chunks)
        self._write(records)

    def bytes_channel(self, device: str, direction: Direction) -> int:
        """Number of the channel of a device's bytes, which is described now if it is new."""
        topic = f"{direction}/{device}"
        if topic not in self._contents.channels:
            self._write([self._channel(topic, topic, RAW_ENCODING, None, {})])
        return self._contents.channels[topic].id

    def fileno(self) -> int:
        """The file's descriptor, for a loop that appends records by itself (direct_writer.py)."""
        return self._file.fileno()

    def note_written(self, size: int, unwritten: Sequence[bytes], part: int) -> None:
        """Count bytes that were appended to the file, and append records of which a part was."""
        self._file.count += size
        self._write(unwritten, part)

    def messages(self, device: str, chunks: Iterable[tuple[bytes, int]]) -> None:
        """Write messages of a device, given as records of protocols/messages/records.py with their arrival, ns. One
        whose channel is not defined is left out.
        """
        definitions = self._definitions.setdefault(device, Definitions())
        out: list[bytes] = []
        for data, arrival_ns in chunks:
            for opcode, record in records_of(data):
                if opcode == Opcode.MESSAGE:
                    out += self._copied(device, definitions, record, arrival_ns)
                else:
                    with contextlib.suppress(ValueError):
                        definitions.read(opcode, record[HEAD.size :])
        if out:
            self._write(out)

    def _copied(self, device: str, definitions: Definitions, record: bytes, arrival_ns: int) -> list[bytes]:
        """The record of a message in this file, after those of its channel if it is the first."""
        opcode, size, channel_id, sequence, _, publish_ns = MESSAGE_HEAD.unpack_from(record)
        channel = definitions.channels.get(channel_id)
        if channel is None:
            return []
        key = (device, channel)
        out = []
        if key not in self._contents.channels:
            metadata = {**channel.metadata, DEVICE_KEY: device}
            schema = (channel.schema, channel.schema_encoding, channel.schema_data) if channel.schema else None
            out.append(self._channel(key, channel.topic, channel.encoding, schema, metadata))
        number = self._contents.channels[key].id
        self.count(number, 1, arrival_ns, arrival_ns)
        head = MESSAGE_HEAD.pack(opcode, size, number, sequence, arrival_ns, publish_ns or arrival_ns)
        return [*out, head + record[MESSAGE_HEAD.size :]]

    def event(self, event: Mapping[str, Any], time_ns: int) -> None:
        self._json(EVENTS, "imuscope.Event", _EVENT_SCHEMA, event, time_ns)

    def write_note(self, kind: Literal["marker", "note"], text: str, time_ns: int, device: str = "") -> None:
        self._json(NOTES, "imuscope.Note", _NOTE_SCHEMA, {"kind": kind, "text": text, "device": device}, time_ns)

    def snapshot(self, device: str, body: Mapping[str, Any], time_ns: int) -> None:
        """Write the configuration of a device, as read."""
        self._json(SNAPSHOT + device, "imuscope.Snapshot", _SNAPSHOT_SCHEMA, body, time_ns)

    def computed_signals(self, device: str, body: Mapping[str, Any], time_ns: int) -> None:
        """Write the definitions of the computed signals of a device, in place of those before."""
        self._json(SIGNALS + device, "imuscope.Signals", _SIGNALS_SCHEMA, body, time_ns)

    def sync(self) -> None:
        """Flush to disk: data written before survives a power cut. May be called in another thread."""
        if not self._closed:
            try:
                self._file.sync()
            except OSError as error:
                if not self._closed:  # if the writer closed it, the writer reports the cause
                    raise disk_error(error, self.path) from None

    def close(self) -> None:
        """Finish the file as the format requires. It can be opened as it is; compaction makes it small and quick.

        A file that another program has truncated gets no summary: its offsets would be wrong.
        """
        if self.is_shortened():
            self.give_up()
        if not self._closed:
            self._write([ending(self.size, self._contents.summary(self._metadata))])
            self.sync()
            self._closed = True
            self._file.close()

    def give_up(self) -> None:
        """Close the file unfinished: truncated, but intact up to there."""
        self._closed = True
        self._file.close()

    def is_there(self) -> bool:
        """Whether the file still exists under its name."""
        return self._closed or self._file.is_at(self.path)

    def is_shortened(self) -> bool:
        """Whether another program truncated the file."""
        return not self._closed and self._file.is_shortened()

    def copy_to(self, path: Path) -> None:
        """Write the contents of this file to another one: the source may be unlinked.

        Raises:
            OSError: writing failed.
        """
        self._file.copy_to(path)

    def _json(self, topic: str, name: str, schema: Mapping[str, Any], body: Mapping[str, Any], time_ns: int) -> None:
        data = json.dumps(body, ensure_ascii=False, separators=(",", ":")).encode()
        self._write([self._message(topic, "json", (name, schema), time_ns, data)])

    def _write_metadata(self, name: str, about: Mapping[str, Any]) -> None:
        record = bytes_of(Metadata(name=name, metadata=_strings(about)))
        self._metadata.append(MetadataIndex(offset=self.size, length=len(record), name=name))
        self._write([record])

    def _message(
        self, topic: str, encoding: str, schema: tuple[str, Mapping[str, Any]] | None, time_ns: int, data: bytes
    ) -> bytes:
        """The record of a message, preceded by its channel's records if it is the first."""
        described = b""
        if topic not in self._contents.channels:
            as_bytes = (schema[0], "jsonschema", json.dumps(schema[1]).encode()) if schema is not None else None
            described = self._channel(topic, topic, encoding, as_bytes, {})
        number = self._contents.channels[topic].id
        self.count(number, 1, time_ns, time_ns)
        return described + message(number, time_ns, data)

    def count(self, channel: int, count: int, first_ns: int, last_ns: int) -> None:
        """Count messages for the summary."""
        self._contents.count(channel, count, first_ns, last_ns)

    def _channel(
        self,
        key: ChannelKey,
        topic: str,
        encoding: str,
        schema: SchemaKey | None,
        metadata: Mapping[str, str],
    ) -> bytes:
        """The records of a new channel.

        Args:
            schema: name, encoding, data.
        """
        return b"".join(map(bytes_of, self._contents.add(key, topic, encoding, schema, metadata)))

    def _write(self, records: Sequence[bytes], part: int = 0) -> None:
        if self._closed:
            raise RecordingError(f"{self.path.name} is closed.", "Begin another recording.")
        try:
            self._file.write(records, part)
        except OSError as error:
            self._closed = True
            self._file.cut()
            raise disk_error(error, self.path) from None
        finally:
            self.size = self._file.count


class AtomicRecordFile:
    """An unbuffered file that takes whole records: a record that does not fit is removed again.

    It is opened for appending, so that after a truncation by another program new records follow the rest without a
    hole.
    """

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, PRIVATE)
        file_lock.hold(self._fd)
        self.count = 0

    def fileno(self) -> int:
        return self._fd

    def write(self, records: Sequence[bytes], done: int = 0) -> None:
        """Write records, of which `done` bytes are there already."""
        data = b"".join(records)
        view = memoryview(data)
        try:
            while done < len(view):
                done += os.write(self._fd, view[done:])
        except OSError:
            for record in records:  # whole records stay
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
        count = self.count  # before the size, which may grow in between
        try:
            return os.fstat(self._fd).st_size < count
        except OSError:
            return False

    def copy_to(self, path: Path) -> None:
        with open(f"/proc/self/fd/{self._fd}", "rb") as old, open_private(path, exclusive=True) as new:
            shutil.copyfileobj(old, new, 1 << 20)
            new.flush()
            os.fsync(new.fileno())

    def cut(self) -> None:
        """Truncate to the last whole record; if the disk fails at that too, a torn end remains, which readers skip."""
        with contextlib.suppress(OSError):
            if not self.is_shortened():
                os.ftruncate(self._fd, self.count)
        self.close()

    def close(self) -> None:
        fd, self._fd = self._fd, -1
        if fd >= 0:
            with contextlib.suppress(OSError):
                os.close(fd)


def _time(chunk: tuple[bytes, int]) -> int:
    return chunk[1]


def _strings(about: Mapping[str, Any]) -> dict[str, str]:
    return {name: "" if value is None else str(value) for name, value in about.items()}
