"""Decode options for tests, from the settings of a decoder instead of texts."""

from __future__ import annotations

from typing import Any

from imuscope.protocols.idtp.custom_payloads import written
from imuscope.server.devices.decode.decode_options import DecodeOptions, checked_options


def decode_options(protocol: str = "", *, schema: Any = None, **source: bytes | str | bool) -> DecodeOptions:
    """Decode options with these values: bytes of a key, rows of a schema, flags."""
    texts = {name: value.hex() if isinstance(value, bytes) else str(value) for name, value in source.items()}
    texts |= {name: "1" if value else "" for name, value in source.items() if isinstance(value, bool)}
    return checked_options(protocol, {**texts, "schema": written(schema) if schema else ""})
