"""Driver of IDTP devices. It only sends frames; the protocol has no settings, answers or commands.

So most of a Driver is empty here: this one composes and sends frames of any type, in any mode.

Source: IDTP v2.1.0.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, TypeVar

from protocols.events import Batch, Event, Reply
from protocols.idtp import annotate as annotated
from protocols.idtp.commands import ANY, DATA, HEADER, TYPE, commands
from protocols.idtp.custom_payloads import Schema
from protocols.idtp.json_codec import frame_from_json
from protocols.idtp.messages import MESSAGES
from protocols.layouts import EncodeError
from protocols.schema import Command, Setting
from protocols.transactions import (
    NO_STATES,
    BaudChange,
    ByteRange,
    DeviceContext,
    Harm,
    LinkLoad,
    ReopenLink,
    Send,
    Transaction,
    WaitFor,
    WriteResult,
)

T = TypeVar("T")
Values = Mapping[str, Any]
ALIVE_S = 1.5
RATES = (921_600, 115_200, 460_800, 230_400, 57_600, 38_400, 19_200, 9_600)


class IdtpDriver:
    """See protocols.transactions.DeviceDriver.

    Args:
        schema: rows of the vendor's own payload types, see custom_payloads.py.
    """

    name = "idtp"
    states: Mapping[str, str] = NO_STATES
    begins: Collection[str] = ()
    ends_rest = ""

    def __init__(self, schema: Schema | None = None) -> None:
        self._schema: Schema = schema or {}

    def commands(self, known: DeviceContext) -> Sequence[Command]:
        return list(commands(self._schema).values())

    def settings(self, known: DeviceContext) -> Sequence[Setting]:
        return ()

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

    def setting_frames(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False, old: Values | None = None
    ) -> list[bytes]:
        raise EncodeError("IDTP has no settings")

    def annotate(self, frame: bytes) -> list[ByteRange]:
        return annotated.annotate(frame, self._schema)

    def name_of(self, frame: bytes) -> str:
        return annotated.name_of(frame, self._schema)

    def within(self, body: Transaction[T], known: DeviceContext) -> Transaction[T]:
        return body

    def run(self, command: str, values: Values, known: DeviceContext) -> Transaction[Values]:
        """Transactions of IDTP: none, as devices do not answer."""
        yield Send(self.frame(command, values, known), command)
        return {}

    def unfinished(self, command: str, values: Values) -> str | None:
        return None

    def alters(self, command: str, values: Values, known: DeviceContext) -> Collection[str]:
        return ()

    def read(self, setting: str, known: DeviceContext) -> Transaction[Values]:
        yield from ()  # a transaction is a generator, even one that does nothing
        raise EncodeError("IDTP has no settings")

    def write(
        self, setting: str, values: Values, known: DeviceContext, *, held: bool = False
    ) -> Transaction[WriteResult]:
        yield from ()
        raise EncodeError("IDTP has no settings")

    def identify(self, known: DeviceContext) -> Transaction[DeviceContext]:
        """Identity from received frames: the number that every frame carries."""
        yield from ()
        return known

    def formerly(self, serial_number: str) -> Sequence[str]:
        return ()

    def line_change(self, setting: str, old: Values | None, new: Values, known: DeviceContext) -> BaudChange | None:
        return None

    def rates(self, values: Mapping[str, Values], known: DeviceContext) -> Sequence[int]:
        return ()

    def instead(
        self, command: str, values: Values, present: Mapping[str, Values], known: DeviceContext
    ) -> tuple[str, Values] | None:
        return None

    def risks(self, setting: str, old: Values | None, new: Values, known: DeviceContext) -> list[Harm]:
        return []

    def store_and_restart(self, known: DeviceContext) -> Transaction[None]:
        yield from ()

    def is_alive(self, known: DeviceContext) -> Transaction[bool]:
        """Whether the device streams."""

        def match(event: Event) -> bool | None:
            return True if isinstance(event, (Batch, Reply)) else None

        return bool((yield WaitFor(match, ALIVE_S, "a frame")))

    def restore_communication(self, known: DeviceContext) -> Transaction[bool]:
        """No procedure is documented; all usual rates are tried."""
        for baud in dict.fromkeys((known.baud or RATES[0], *RATES)):
            if (yield ReopenLink(baud)) and (yield from self.is_alive(known)):
                return True
        return False

    def load(self, settings: Mapping[str, Values], known: DeviceContext) -> LinkLoad:
        return LinkLoad((), 0.0)

    def fit_rates(self, settings: Mapping[str, Values], capacity: float, known: DeviceContext) -> Mapping[str, Values]:
        return settings

    def factory(self, known: DeviceContext) -> Mapping[str, Values]:
        return {}

    def same(self, setting: str, a: Values, b: Values) -> list[str]:
        return [name for name in a if name in b and a[name] != b[name]]
