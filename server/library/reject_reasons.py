"""Explanations of the reasons for rejecting frames."""

from collections.abc import Mapping

from imuscope.protocols.family.info import ProtocolInfo

EXPLAINED: Mapping[str, str] = {
    "bad_checksum": "the checksum does not match",
    "bad_size": "invalid length",
    "bad_type": "unknown packet type",
    "bad_item": "an item is longer than the remaining bytes, or has an invalid size for its kind",
    "bad_id": "bus identifier and message are both 0",
    "bad_crc8": "the header is damaged, or is not a header",
    "bad_version": "unsupported version",
    "bad_mode": "unknown mode",
    "bad_crc32": "the payload is damaged",
    "far_ahead": "intact, but its sequence number is far ahead, and no second frame confirms it",
    "truncated": "the data ends within the frame",
    "successor": "the preamble of the protocol's successor",
}
"""Explanation of reject reasons, for display; families have more (Decoding.remedies, listed_rejects)."""


def explained_rejects(family: ProtocolInfo) -> dict[str, str]:
    """Explanations of the reject reasons of a family's frames."""
    return {
        **EXPLAINED,
        **{reason: one.listed for reason, one in family.decoding.remedies.items()},
        **family.decoding.listed_rejects,
    }
