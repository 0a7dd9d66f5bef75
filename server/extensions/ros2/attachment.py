"""The attachment of a ROS 2 message over Zenoh: its number, its time, its publisher. Pure.

    0   i64   sequence number of the message, counted by its publisher
    8   i64   source timestamp: time of publication, ns since 1970
    16  u8    16: length of the following
    17  16 B  GID of the publisher                                             little-endian, 33 bytes

rmw_zenoh drops messages without it. A GID is the XXH3 hash (128 bits) of the publisher's liveliness token.

Source: rmw_zenoh, attachment_helpers.cpp and liveliness_utils.cpp; Zenoh serialization format (a tuple of both
numbers and a sequence of bytes).
"""

import struct
from dataclasses import dataclass

LAYOUT = struct.Struct("<qqB16s")
GID_SIZE = 16
assert LAYOUT.size == 33


class AttachmentError(ValueError):
    """Bytes that are not an attachment of a ROS 2 message."""


@dataclass(frozen=True, slots=True)
class Attachment:
    """Attachment of a message.

    Args:
        sequence: counts the messages of a publisher; a step of more than one is a loss.
        time_ns: of publication, ns since 1970.
        gid: of the publisher, 16 bytes.
    """

    sequence: int
    time_ns: int
    gid: bytes

    def encode(self) -> bytes:
        return LAYOUT.pack(self.sequence, self.time_ns, GID_SIZE, self.gid)

    @classmethod
    def decode(cls, data: bytes) -> "Attachment":
        """Read an attachment.

        Raises:
            AttachmentError: another length, as of other versions of rmw_zenoh.
        """
        if len(data) != LAYOUT.size or data[16] != GID_SIZE:
            raise AttachmentError(f"an attachment of {len(data)} bytes, not {LAYOUT.size}")
        sequence, time_ns, _, gid = LAYOUT.unpack(data)
        return cls(sequence, time_ns, gid)


def gid_of(token: str) -> bytes:
    """GID of an endpoint, from its liveliness token."""
    import xxhash  # here, so that a server without ROS 2 starts without it

    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(GID_SIZE, "little")
