"""The ISB vectors of tests/golden/isb, and where each came from.

data.json, commands.json   vendor: encoded by the vendor's public code
computed.json              computed by tests/oracles/isb.py, for data sets that the others do not meet
forms.json                 computed by tests/oracles/isb_forms.py: packet types, raw GNSS kinds, older structures
formats.json               the structures as the facts give them, for the oracle
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from typing import Any

from tests.support.source_files import ROOT

GOLDEN = ROOT / "tests" / "golden" / "isb"

DATA: list[dict[str, Any]] = json.loads((GOLDEN / "data.json").read_text())
COMMANDS: list[dict[str, Any]] = json.loads((GOLDEN / "commands.json").read_text())
COMPUTED: list[dict[str, Any]] = json.loads((GOLDEN / "computed.json").read_text())
FORMS: list[dict[str, Any]] = json.loads((GOLDEN / "forms.json").read_text())
FORMATS: dict[str, Any] = json.loads((GOLDEN / "formats.json").read_text())


def packet(vector: dict[str, Any]) -> bytes:
    """The bytes of a vector."""
    return bytes.fromhex(vector["packet_hex"])


def everything() -> Iterator[bytes]:
    """The packets of all vectors."""
    for vector in (*DATA, *COMMANDS, *COMPUTED, *FORMS):
        yield packet(vector)


def by_did(did: int) -> bytes:
    """The vendor's packet of a data set."""
    return next(packet(vector) for vector in DATA if vector["did"] == did)


TEXTS = {17: ("swVersion", "hwVersion", "extension"), 18: ("swVersion", "hwVersion", "extension"), 37: ("s",)}
EVENT = 119
"""Data sets whose texts (and the data of an event, as hex) the vectors have as lists of numbers."""


def vendor_fields(vector: dict[str, Any]) -> dict[str, Any]:
    """The values of a vector with texts as text."""
    fields = dict(vector["fields"])
    for name in TEXTS.get(vector["did"], ()):
        raw = bytes(fields[name])
        parts = [raw[i : i + 30] for i in range(0, len(raw), 30)] if name == "extension" else [raw]
        texts = [part.rstrip(b"\0").decode("latin-1") for part in parts]
        fields[name] = texts if name == "extension" else texts[0]
    if vector["did"] == EVENT:
        fields["data"] = bytes(fields["data"]).hex()
    return fields


def leaves(value: Any, name: str = "") -> dict[str, list[Any]]:
    """Plain values by the path of each leaf, as formats.json names them; numbers as lists."""
    if isinstance(value, dict) and (not value or not set(value) <= {"f32", "f64"}):
        results: dict[str, list[Any]] = {}
        for part, inner in value.items():
            results.update(leaves(inner, f"{name}.{part}" if name else part))
        return results
    if isinstance(value, list) and value and isinstance(value[0], dict) and not set(value[0]) <= {"f32", "f64"}:
        results = {}
        for k, inner in enumerate(value):
            results.update(leaves(inner, f"{name}[{k}]"))
        return results
    return {name: [_number(one) for one in (value if isinstance(value, list) else [value])]}


def _number(value: Any) -> Any:
    """A float that is not finite, from its spelling."""
    if not isinstance(value, dict):
        return value
    ((kind, digits),) = value.items()
    return struct.unpack(">f" if kind == "f32" else ">d", bytes.fromhex(digits))[0]
