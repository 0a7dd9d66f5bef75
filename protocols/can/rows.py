"""A message on a CAN bus, as a row of a table: its identifier, its bytes and the quantity in them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.layouts import Layout, size_of

Payloads = NDArray[np.uint8]
"""(n, 8): the bytes of n frames."""

Role = Literal["", "time", "counter", "utc", "report", "apart", "part"]


@dataclass(frozen=True, slots=True)
class CanRow:
    """One message.

    Args:
        identifier: as delivered, of 11 bits.
        field: the quantity, with its type on the bus.
        size: bytes of its frames.
        role: "time" and "counter" of a sample group, "utc"; a "report" is an event; one that is "apart" belongs to no
            sample group; a "part" is joined with others (rows of `joined`).
        values: (n, 8) bytes → (n, …) values, where scale and type of the field do not say it.
        is_plausible: (n, 8) bytes → (n,) whether they can be this message, where more than the length says it.
        source: documents and programs that agree on the row.
    """

    identifier: int
    field: Field
    size: int
    source: str
    role: Role = ""
    values: Callable[[Payloads], Array] | None = None
    is_plausible: Callable[[Payloads], NDArray[np.bool_]] | None = None

    @property
    def name(self) -> str:
        """Name of the message, which is that of its quantity."""
        return self.field.name

    def column(self, payloads: Payloads) -> Array:
        """Values of n frames, in displayed units."""
        if self.values is not None:
            return self.values(payloads)
        layout = Layout([(self.field, ((0, size_of(self.field)),))], payloads.shape[1])
        column: Array = layout.columns(np.ascontiguousarray(payloads))[self.field.name]
        return column


@dataclass(frozen=True, slots=True)
class JoinedQuantity:
    """A vector whose elements are messages of their own; they stay apart where one of them is missing."""

    field: Field
    parts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class CanDeviceKind:
    """The messages of a kind of devices.

    Args:
        title: display name.
        rows: in the order in which the device sends them.
        ticks_ns: lengths that a tick of its clock may have, by its firmware; the first is the usual one.
        remark: what its messages do not say, in a sentence.
    """

    title: str
    rows: tuple[CanRow, ...]
    ticks_ns: tuple[int, ...]
    joined: tuple[JoinedQuantity, ...] = ()
    remark: str = ""

    def row(self, name: str) -> CanRow | None:
        """The row of that name, however it is written; None if there is none."""
        return next((row for row in self.rows if row.name.lower() == name.strip().lower()), None)
