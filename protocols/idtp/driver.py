"""Driver of IDTP devices. It only sends frames; the protocol has no settings, answers or commands.

This one composes and sends frames of any type, in any mode.

Source: IDTP v2.1.0.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from imuscope.protocols.commands.transactions import (
    ByteRange,
    DeviceContext,
    DeviceDriver,
    Send,
    Transaction,
    WaitFor,
)
from imuscope.protocols.events import Batch, Event, Reply
from imuscope.protocols.idtp.commands import ANY, DATA, HEADER, TYPE, commands, reading_fields
from imuscope.protocols.idtp.custom_payloads import Schema
from imuscope.protocols.idtp.frames import HEADER as FRAME_HEADER
from imuscope.protocols.idtp.frames import HEADER_SIZE, MODES, PREAMBLE, TRAILERS, TYPE_AT
from imuscope.protocols.idtp.json_codec import frame_from_json
from imuscope.protocols.idtp.messages import MESSAGES
from imuscope.protocols.idtp.payloads import row_of
from imuscope.protocols.schema.fields import Command
from imuscope.protocols.schema.layouts import EncodeError, size_of, unpack

_WORDS = ((4, 4, "timestamp"), (8, 4, "sequence"), (12, 2, "device_id"), (14, 2, "payload_size"))
_TRAILER = ("", "CRC-32", "HMAC-SHA256")


def name_of(frame: bytes, schema: Schema) -> str:
    """The payload type's name, or its number; "" for other bytes."""
    if len(frame) < HEADER_SIZE or frame[:4] != PREAMBLE:
        return ""
    row = row_of(frame[TYPE_AT], frame[16] & 0xF == 0, schema)
    return row.name if row else f"0x{frame[TYPE_AT]:02X}"


def annotate(frame: bytes, schema: Schema) -> list[ByteRange]:
    """See imuscope.protocols.commands.transactions.DeviceDriver.annotate.

        49 44 54 50 | 28 46 0F 00 | 01 00 00 00 | 66 00 | 0C 00 | 21 | 00 | 00 | E7 | 00 00 00 3F | …  | trailer
        preamble      timestamp     sequence      device  size    ver  mode type CRC   acc_x

    Source: IDTP v2.1.0, section 4.1.
    """
    if not name_of(frame, schema):
        return [ByteRange(0, len(frame), "unknown")] if frame else []
    return list(_frame(frame, schema))


def _frame(frame: bytes, schema: Schema) -> Iterator[ByteRange]:
    _, _, _, _, size, version, mode, kind = FRAME_HEADER.unpack_from(frame)
    yield ByteRange(0, 4, "preamble IDTP")
    for at, length, name in _WORDS:
        value = int.from_bytes(frame[at : at + length], "little")
        yield ByteRange(at, length, f"{name} = {value}", "" if name == "payload_size" else name)
    yield ByteRange(16, 1, f"version {version >> 4}.{version & 0xF}", "version")
    yield ByteRange(17, 1, f"mode {MODES[mode]}" if mode < len(MODES) else f"mode {mode}", "mode")
    yield ByteRange(18, 1, f"type {name_of(frame, schema)}", "type")
    yield ByteRange(19, 1, "CRC-8 of the header")
    end = min(HEADER_SIZE + size, len(frame))
    yield from _payload(frame[HEADER_SIZE:end], kind, version, schema)
    if end < len(frame):
        trailer = mode < len(MODES) and len(frame) - end == TRAILERS[mode]
        yield ByteRange(end, len(frame) - end, _TRAILER[mode] if trailer else "trailer")


def _payload(payload: bytes, kind: int, version: int, schema: Schema) -> Iterator[ByteRange]:
    row = row_of(kind, version & 0xF == 0, schema)
    fields = reading_fields(row) if row else ()
    at = 0
    if sum(size_of(field) for field in fields) <= len(payload):
        for field in fields:
            value = unpack((field,), payload, at)[field.name]
            words = ", ".join(f"{one:.6g}" for one in (value if isinstance(value, list) else [value]))
            unit = f" {field.unit}" if field.unit and field.scale == 1 and field.bias == 0 else ""
            yield ByteRange(HEADER_SIZE + at, size_of(field), f"{field.name} = {words}{unit}", field.name)
            at += size_of(field)
    if at < len(payload):
        yield ByteRange(
            HEADER_SIZE + at, len(payload) - at, "payload" if not at else "trailing bytes", "" if at else "data"
        )


Values = Mapping[str, Any]
ALIVE_S = 1.5


class IdtpDriver(DeviceDriver):
    """See imuscope.protocols.commands.transactions.DeviceDriver.

    Args:
        schema: rows of the vendor's own payload types, see custom_payloads.py.
    """

    name = "idtp"
    usual_rates = (921_600, 115_200, 460_800, 230_400, 57_600, 38_400, 19_200, 9_600)

    def __init__(self, schema: Schema | None = None) -> None:
        self._schema: Schema = schema or {}

    def commands(self, known: DeviceContext) -> Sequence[Command]:
        return list(commands(self._schema).values())

    def frame(self, command: str, values: Values, known: DeviceContext) -> bytes:
        """A payload type by its name, or by its number ("0x80") with `data` as hex."""
        fields = dict(values)
        defaults = {field.name: field.default for field in HEADER}
        if command == ANY:
            kind = fields.pop(TYPE.name, TYPE.default)
            if not isinstance(kind, int) or not 0 <= kind <= 255:
                raise EncodeError(f"{TYPE.name} is a whole number from 0 to 255, given {kind!r}", TYPE.name)
            fields.setdefault(DATA.name, "")
            names = {row.id: row.name for row in (*MESSAGES, *self._schema.values())}
            command = names.get(kind, f"0x{kind:02X}")
        record = {"message": command, "fields": {**defaults, **fields}}
        return frame_from_json(record, known.settings.get("key"), self._schema)

    def annotate(self, frame: bytes) -> list[ByteRange]:
        return annotate(frame, self._schema)

    def name_of(self, frame: bytes) -> str:
        return name_of(frame, self._schema)

    def run(self, command: str, values: Values, known: DeviceContext) -> Transaction[Values]:
        """Transactions of IDTP: none, as devices do not answer."""
        yield Send(self.frame(command, values, known), command)
        return {}

    def is_alive(self, known: DeviceContext) -> Transaction[bool]:
        """Whether the device streams."""

        def match(event: Event) -> bool | None:
            return True if isinstance(event, (Batch, Reply)) else None

        return bool((yield WaitFor(match, ALIVE_S, "a frame")))
