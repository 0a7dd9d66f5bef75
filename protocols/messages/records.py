"""The stream of messages: records as in the data section of an MCAP file.

    schema    [3][length u64]  id u16 · name · encoding · data
    channel   [4][length u64]  id u16 · schema id u16 · topic · encoding · metadata
    message   [5][length u64]  channel id u16 · sequence u32 · log time u64 · publish time u64 · data

A channel is defined before its first message, and may be defined again: a reader that joins later waits for that. A
message that is logged has its arrival beside it, so a reader ignores the log time. A publish time or sequence number of
0 is unknown.

Source: MCAP specification, "Records", mcap.dev/spec.
"""

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

SCHEMA, CHANNEL, MESSAGE = 3, 4, 5
HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
MESSAGE_FIXED = MESSAGE_HEAD.size - HEAD.size
MAX_RECORD = 1 << 27  # bytes of a record; a longer one is damage
PLAUSIBLE = re.compile(rb"[\x03\x04\x05][\s\S]{3}[\x00-\x07]\x00{4}")  # the head of a record below MAX_RECORD_BYTES
COUNTED = "sequence"
"""Key of a channel's metadata, with the value "publisher": its sequence numbers count the messages of its publisher."""


@dataclass(frozen=True, slots=True)
class MessageChannel:
    """A channel: messages of one topic with one schema, of one publisher if they are counted.

    Args:
        encoding: of its messages ("cdr", "json", "protobuf").
        schema: name of the schema ("sensor_msgs/msg/Imu"); "" without one.
        schema_encoding: "ros2msg", "jsonschema", "protobuf".
    """

    id: int
    topic: str
    encoding: str
    schema: str = ""
    schema_encoding: str = ""
    schema_data: bytes = field(default=b"", repr=False)
    metadata: Mapping[str, str] = field(default_factory=dict, hash=False)

    @property
    def is_counted(self) -> bool:
        """Whether gaps of its sequence numbers are lost messages."""
        return self.metadata.get(COUNTED) == "publisher"


def definition(channel: MessageChannel) -> bytes:
    """The records that define a channel, its schema first."""
    schema = b""
    number = 0
    if channel.schema:
        number = channel.id or 0xFFFF
        body = struct.pack("<H", number) + _text(channel.schema) + _text(channel.schema_encoding)
        schema = _record(SCHEMA, body + struct.pack("<I", len(channel.schema_data)) + channel.schema_data)
    metadata = b"".join(_text(key) + _text(value) for key, value in channel.metadata.items())
    body = struct.pack("<HH", channel.id, number) + _text(channel.topic) + _text(channel.encoding)
    return schema + _record(CHANNEL, body + struct.pack("<I", len(metadata)) + metadata)


def message_record(channel: int, data: bytes, *, sequence: int = 0, publish_ns: int = 0) -> bytes:
    """The record of one message.

    Args:
        sequence: of its publisher; its low 32 bits count.
    """
    size = MESSAGE_FIXED + len(data)
    publish_ns = min(max(publish_ns, 0), (1 << 64) - 1)
    return MESSAGE_HEAD.pack(MESSAGE, size, channel, sequence & 0xFFFFFFFF, 0, publish_ns) + data


def records_of(data: bytes) -> Iterator[tuple[int, bytes]]:
    """The whole records in some bytes: opcode, record; up to the first incomplete one."""
    at = 0
    while len(data) - at >= HEAD.size:
        opcode, length = HEAD.unpack_from(data, at)
        whole = at + HEAD.size + length
        if whole > len(data):
            return
        yield opcode, data[at:whole]
        at = whole


class Definitions:
    """The channels defined so far in a stream."""

    def __init__(self) -> None:
        self.channels: dict[int, MessageChannel] = {}
        self._schemas: dict[int, tuple[str, str, bytes]] = {}

    def read(self, opcode: int, body: bytes) -> MessageChannel | None:
        """Read a schema or channel record; returns the channel if it is new or has changed.

        Raises:
            ValueError: the record is damaged.
        """
        fields = _Fields(body)
        if opcode == SCHEMA:
            number = fields.u16()
            self._schemas[number] = fields.text(), fields.text(), fields.blob()
            return None
        number, schema = fields.u16(), fields.u16()
        topic, encoding = fields.text(), fields.text()
        metadata = fields.strings()
        if schema and schema not in self._schemas:
            raise ValueError("a channel of an unknown schema")
        channel = MessageChannel(number, topic, encoding, *self._schemas.get(schema, ("", "", b"")), metadata)
        if self.channels.get(number) == channel:
            return None
        self.channels[number] = channel
        return channel


class _Fields:
    """Fields of a record, read one after the other. Raises ValueError beyond its end."""

    def __init__(self, body: bytes) -> None:
        self._body = body
        self._at = 0

    def blob(self) -> bytes:
        (size,) = struct.unpack("<I", self._take(4))
        return self._take(size)

    def text(self) -> str:
        return self.blob().decode()  # UnicodeDecodeError is a ValueError

    def u16(self) -> int:
        return int.from_bytes(self._take(2), "little")

    def strings(self) -> dict[str, str]:
        inner = _Fields(self.blob())
        texts: dict[str, str] = {}
        while inner._at < len(inner._body):
            key = inner.text()
            texts[key] = inner.text()
        return texts

    def _take(self, size: int) -> bytes:
        piece = self._body[self._at : self._at + size]
        if len(piece) < size:
            raise ValueError("a record ends within a field")
        self._at += size
        return piece


def _record(opcode: int, body: bytes) -> bytes:
    return HEAD.pack(opcode, len(body)) + body


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data
