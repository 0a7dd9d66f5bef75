"""Supported versions, modes and payload types of IDTP, for the documentation."""

from __future__ import annotations

from collections.abc import Iterator

from imuscope.protocols.family.support_tables import SupportTable
from imuscope.protocols.idtp.messages import MESSAGES, MODE_NAMES
from imuscope.protocols.schema.fields import Field

CHECKS = {0: "CRC-8", 1: "CRC-32", 2: "HMAC-SHA256; requires the device's key"}


def supported() -> Iterator[SupportTable]:
    """Modes, then payload types."""
    yield SupportTable(
        "Modes",
        "Devices of version 2.1, over any link. A key is given with `--key`, `?key=` or on the page.",
        ("mode", "frame protection"),
        tuple((name, CHECKS[number]) for number, name in MODE_NAMES.items()),
    )
    types = tuple((f"`0x{row.id:02X}`", row.name, row.doc.rstrip("."), _quantities(row.fields)) for row in MESSAGES)
    own = ("`0x80` … `0xFF`", "vendor-specific", "User-defined (`--schema` or Define payload)", "any")
    yield SupportTable(
        "Payload types",
        "A type without a definition is shown as bytes.",
        ("type", "name", "contents", "quantities"),
        (*types, own),
    )


def _quantities(fields: tuple[Field, ...]) -> str:
    return ", ".join(
        f"{field.title or field.name} ({field.unit})" if field.unit else field.title or field.name for field in fields
    )
