"""Protocol interface for composing frames from words or JSON; see server/commands/compose.py."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from imuscope.protocols.commands.transactions import DeviceContext, DeviceDriver
from imuscope.protocols.schema.fields import Command, Field

FrameRecord = Mapping[str, Any]
"""A frame as `imuscope inspect` prints it."""
OPAQUE = Field("data", "bytes", (-1,), title="Payload", doc="Opaque payload, as hex.")


@dataclass(frozen=True, slots=True)
class ProtocolComposer:
    """Protocol interface for composing.

    Args:
        driver: its commands.
        messages: every other message that inspect names → its fields.
        frame_of: encodes a record as specified in its json_codec.py.
        opaque_fields: fields of a message known only by number ("0x80").
        numbered: whether a message may be given by number alone.
        listed: fields of messages that inspect may print differently: in another form, or as parts of a frame.
        elements: of a record, arrays of which its frame holds only a part → names of the elements that are there.
        of_devices: names of messages that only a device sends: they are composed, and not sent to one.
        strings: protocols of the non-frame output of its devices → encoder of such a record; None if the line is
            enough.
    """

    name: str
    driver: DeviceDriver
    messages: Mapping[str, tuple[Field, ...]]
    frame_of: Callable[[FrameRecord], bytes]
    opaque_fields: tuple[Field, ...] = (OPAQUE,)
    numbered: bool = True
    listed: Mapping[str, tuple[Field, ...]] | None = None
    strings: Mapping[str, Callable[[FrameRecord], bytes] | None] = field(default_factory=dict)
    of_devices: frozenset[str] = frozenset()
    elements: Callable[[FrameRecord], Mapping[str, Sequence[str]]] = lambda record: {}

    def command(self, name: str) -> Command | None:
        """A command by name; the $ of a sentence is optional."""
        commands = {row.name: row for row in self.driver.commands(DeviceContext())}
        return commands.get(name) or commands.get(name.removeprefix("$"))

    def forms(self, name: str) -> list[Command]:
        """A command in each of its forms, which share a name and differ by the bracketed suffix."""
        first = self.command(name)
        rows = self.driver.commands(DeviceContext())
        return [first, *(row for row in rows if row.name.startswith(f"{first.name} ("))] if first else []

    def names(self) -> list[str]:
        """Names of everything it can compose."""
        return [*(row.name for row in self.driver.commands(DeviceContext())), *self.messages]
