"""The IDTP vectors of tests/golden/idtp, and where each came from.

vectors.json    vendor: encoded and read by the reference implementation
computed.json   computed by tests/oracles/idtp.py: every payload type in every mode, and what has no description
"""

import json
from collections.abc import Iterator
from typing import Any

from tests.support.source_files import ROOT

GOLDEN = ROOT / "tests" / "golden" / "idtp" / "vectors.json"
ALL: dict[str, Any] = json.loads(GOLDEN.read_text())
VECTORS: list[dict[str, Any]] = ALL["vectors"]
COMPUTED: list[dict[str, Any]] = json.loads(GOLDEN.with_name("computed.json").read_text())
NEGATIVE: list[dict[str, Any]] = ALL["negative"]
KEY = bytes(range(32))


def key_of(vector: dict[str, Any]) -> bytes | None:
    """The key that a vector was made with, or is to be read with."""
    return bytes.fromhex(vector["key_hex"]) if vector["key_hex"] else None


def frame(vector: dict[str, Any]) -> bytes:
    """The bytes of a vector."""
    return bytes.fromhex(vector["frame_hex"])


def everything() -> Iterator[bytes]:
    """The frames of all vectors."""
    for vector in (*VECTORS, *COMPUTED):
        yield frame(vector)
