"""Header of a binary frame of samples; its layout is drawn in server/wire/__init__.py."""

from __future__ import annotations

import struct

SUBPROTOCOL = "imuscope.v1"
OPCODE_SAMPLES = 1
FLAG_HISTORY = 1
HEADER = struct.Struct("<BBHIIIQIId")
HEADER_FIELDS = ("opcode", "flags", "columns", "channel", "n", "dropped", "sequence", "size", "reserved", "now")
assert HEADER.size == 40
