"""The attachment of ROS 2 messages, against the serializer of Zenoh."""

import pytest
from zenoh.ext import Int64, z_serialize

from imuscope.server.extensions.ros2.attachment import Attachment, AttachmentError, gid_of
from tests.support.each_row import each_row

GID = bytes(range(16))


@each_row(("sequence", "time_ns"), [(1, 1_795_000_000_123_456_789), (0, 0), (2**63 - 1, -1)])
def test_bytes_are_those_of_zenohs_serializer(sequence: int, time_ns: int) -> None:
    expected = bytes(z_serialize((Int64(sequence), Int64(time_ns), GID)))
    attachment = Attachment(sequence, time_ns, GID)
    assert attachment.encode() == expected
    assert Attachment.decode(expected) == attachment


@each_row("data", [b"", bytes(32), bytes(33), bytes(34), b"\x0fsequence_number" + bytes(60)])
def test_other_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(AttachmentError):
        Attachment.decode(data)


def test_gid_is_the_xxh3_hash_of_the_token_low_half_first() -> None:
    # The empty input of XXH3-128 has the published value 99aa06d3014798d86001c324468d497f (high half first).
    assert gid_of("") == bytes.fromhex("99aa06d3014798d86001c324468d497f")[::-1]
    assert gid_of("@ros2_lv/0/a") != gid_of("@ros2_lv/0/b")
