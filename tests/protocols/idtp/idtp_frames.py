"""Frames of IDTP, valid and invalid."""

from imuscope.protocols.idtp.frames import CRC_AT, VERSION_AT
from tests.oracles import idtp as oracle


def with_version(frame: bytes, version: int) -> bytes:
    """The frame as a device of another version sends it: with checksums that fit."""
    head = frame[:VERSION_AT] + bytes([version]) + frame[VERSION_AT + 1 : CRC_AT]
    whole = head + bytes([oracle.crc8(head)]) + frame[CRC_AT + 1 : -4]
    return whole + oracle.crc32(whole).to_bytes(4, "little")
