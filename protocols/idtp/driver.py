"""Driver of IDTP devices. It only sends frames; the protocol has no settings, answers or commands.

This one composes and sends frames of any type, in any mode.

Source: IDTP v2.1.0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from imuscope.protocols.idtp import annotate as annotated
from imuscope.protocols.idtp.commands import ANY, DATA, HEADER, TYPE, commands
from imuscope.protocols.idtp.custom_payloads import Schema
from imuscope.protocols.idtp.json_codec import frame_from_json
from imuscope.protocols.idtp.messages import MESSAGES
from imuscope.protocols.schema.fields import Command
from imuscope.protocols.schema.layouts import EncodeError

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
        return annotated.annotate(frame, self._schema)

    def name_of(self, frame: bytes) -> str:
        return annotated.name_of(frame, self._schema)

    def run(self, command: str, values: Values, known: DeviceContext) -> Transaction[Values]:
        """Transactions of IDTP: none, as devices do not answer."""
        yield Send(self.frame(command, values, known), command)
        return {}

    def is_alive(self, known: DeviceContext) -> Transaction[bool]:
        """Whether the device streams."""

        def match(event: Event) -> bool | None:
            return True if isinstance(event, (Batch, Reply)) else None

        return bool((yield WaitFor(match, ALIVE_S, "a frame")))
