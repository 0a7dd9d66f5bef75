"""The Xbus vectors of tests/golden/xbus, and where each came from.

data.json, commands.json   vendor: encoded or read back by the vendor's public code, or examples of the document
hex_frames.json            device-capture: frames quoted from real devices
sample.mtb                 a file in the layout of the vendor's program
computed.json              computed by tests/oracles/xbus.py, for rows that the others do not meet
"""

import json
from collections.abc import Iterator
from typing import Any

from tests.support.source_files import ROOT

GOLDEN = ROOT / "tests" / "golden" / "xbus"

DATA: list[dict[str, Any]] = json.loads((GOLDEN / "data.json").read_text())
COMMANDS: list[dict[str, Any]] = [v for v in json.loads((GOLDEN / "commands.json").read_text()) if v["message_hex"]]
DEVICE: list[dict[str, Any]] = json.loads((GOLDEN / "hex_frames.json").read_text())
COMPUTED: dict[str, Any] = json.loads((GOLDEN / "computed.json").read_text())


def frame(vector: dict[str, Any]) -> bytes:
    """The bytes of a vector."""
    return bytes.fromhex(vector["message_hex"])


def everything() -> Iterator[bytes]:
    """The frames of all vectors."""
    for vector in (*DATA, *COMMANDS, *DEVICE, *COMPUTED["messages"], *COMPUTED["items"]):
        yield frame(vector)


def flat(value: Any) -> list[Any]:
    """Numbers of a nested value, in order; records by the order of their fields."""
    if isinstance(value, dict):
        return [number for part in value.values() for number in flat(part)]
    if isinstance(value, (list, tuple)):
        return [number for part in value for number in flat(part)]
    return [value]
