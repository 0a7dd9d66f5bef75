"""The protocol between the holder and the server, on a Unix stream socket.

    KIND (1)   LENGTH (4, little-endian)   BODY

Times are CLOCK_MONOTONIC in ns, which both processes share. Bodies that are not bytes are JSON.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from enum import IntEnum

from imuscope.server.system.light_modules import Any

VERSION = 1
HEADER = struct.Struct("<BI")
STAMP = struct.Struct("<q")
CLIENT = struct.Struct("<qI")
MOST_BODY = 1 << 20


class MessageKind(IntEnum):
    """Kind of a message: up to 0x3F from the holder, above from the server."""

    HELLO = 0x01
    """{"version", "pid", "source", "busy"}, once; busy: process of another server, after which the connection ends."""
    STATE = 0x02
    """The whole state, after each change and once a second: process.Holder.state."""
    DATA = 0x03
    """STAMP, then bytes of the device."""
    CLIENT_DATA = 0x04
    """CLIENT: time and number of a client, then the bytes that it sent and the device got."""
    DONE = 0x05
    """{"id"} or {"id", "error", "kind"}: end of a request; of a write with "at", its time."""

    WRITE = 0x41
    """Bytes for the device."""
    REQUEST = 0x42
    """{"id", "do", …}: see Holder in process.py."""


def message(kind: MessageKind, body: bytes) -> bytes:
    """Header and body of a message as bytes."""
    return HEADER.pack(kind, len(body)) + body


def json_message(kind: MessageKind, body: Any) -> bytes:
    """A message whose body is JSON, as bytes."""
    return message(kind, json.dumps(body, separators=(",", ":")).encode())


class MessageError(ValueError):
    """The other side does not speak this protocol."""


class MessageReader:
    """Bytes in, messages out."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> Iterator[tuple[MessageKind, bytes]]:
        """Every message that is complete.

        Raises:
            MessageError: an unknown kind, or a length out of range.
        """
        buffer = self._buffer
        buffer += data
        at = 0
        while len(buffer) - at >= HEADER.size:
            kind, length = HEADER.unpack_from(buffer, at)
            if length > MOST_BODY or kind not in MessageKind._value2member_map_:
                raise MessageError(f"message of kind {kind:#x} with {length} bytes")
            end = at + HEADER.size + length
            if len(buffer) < end:
                break
            yield MessageKind(kind), bytes(buffer[at + HEADER.size : end])
            at = end
        del buffer[:at]
