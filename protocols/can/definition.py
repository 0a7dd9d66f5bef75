"""Definition of the messages of a device on a CAN bus, as a line of the stream.

    #CAN {"kind": "mti", "identifiers": {"021": "Quaternion", "19FF0034": "Acceleration"}, "tick_ns": 100000}

Until there is one, the identifiers are those of a device as it is delivered. A step of the clock of the log, which is
that of a device without one of its own, is a line too:

    #CAN {"step_ns": -2000000000}
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass

from imuscope.protocols.can.lines import EXTENDED_BIT, MARK
from imuscope.protocols.can.mti import MTI
from imuscope.protocols.can.rows import CanDeviceKind, CanRow

KINDS: Mapping[str, CanDeviceKind] = {"mti": MTI}


@dataclass(frozen=True, slots=True)
class CanDefinition:
    """The messages of a device.

    Args:
        kind: a key of KINDS.
        rows: by identifier; EXTENDED is added to one of 29 bits.
        tick_ns: length of a tick of its clock.
        remarks: conclusions from the log, in sentences.
    """

    kind: str
    rows: Mapping[int, CanRow]
    tick_ns: int
    remarks: tuple[str, ...] = ()

    def line(self) -> bytes:
        identifiers = {identifier_text(number): row.name for number, row in self.rows.items()}
        body = {"kind": self.kind, "identifiers": identifiers, "tick_ns": self.tick_ns, "remarks": self.remarks}
        return MARK + json.dumps(body).encode() + b"\n"


def default_definition() -> CanDefinition:
    """The messages of an MTi as it is delivered."""
    kind = "mti"
    rows = {row.identifier: row for row in KINDS[kind].rows}
    return CanDefinition(kind, rows, KINDS[kind].ticks_ns[0])


def read_definition(body: bytes) -> CanDefinition | None:
    """The definition in the text of a line; None if it is not one."""
    try:
        values = json.loads(body)
        name = str(values["kind"])
        kind, rows = KINDS[name], dict[int, CanRow]()
        for text, message in values["identifiers"].items():
            row = kind.row(str(message))
            if row is not None:
                rows[number_of(text)] = row
        tick_ns = int(values["tick_ns"])
        remarks = tuple(str(words)[:1000] for words in values.get("remarks", ()))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return CanDefinition(name, rows, tick_ns, remarks) if tick_ns in kind.ticks_ns else None


def step_line(by_ns: int) -> bytes:
    """The line before the frames after a step of the clock of the log."""
    return MARK + json.dumps({"step_ns": by_ns}).encode() + b"\n"


def read_step(body: bytes) -> int | None:
    """The step in the text of a line, ns; None if it is not one."""
    try:
        return int(json.loads(body)["step_ns"])
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None


def identifier_text(number: int) -> str:
    """An identifier as in a log: three hexadecimal digits, or eight for 29 bits."""
    return f"{number - EXTENDED_BIT:08X}" if number >= EXTENDED_BIT else f"{number:03X}"


def number_of(text: str) -> int:
    """The number of an identifier as in a log; an `0x` before it may be there.

    Raises:
        ValueError: it is not one.
    """
    digits = text.strip().lower().removeprefix("0x")
    number = int(digits, 16)
    if not 0 <= number < EXTENDED_BIT >> 2 or len(digits) > 8 or number < 0 or not digits.isalnum():
        raise ValueError(f"{text} is not an identifier of CAN")
    return number + EXTENDED_BIT if len(digits) == 8 or number > 0x7FF else number
