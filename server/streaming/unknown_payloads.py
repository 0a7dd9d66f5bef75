"""Payloads that no table describes: the newest bytes of each kind, for display.

    Batch  0x80        data (n, 6) uint8  ─> "0x80"      06 00 E8 03 …   12 000 of them, 100 /s
    Batch  MTData2     0x4FF0 (n, 3)      ─> "0x4FF0"
    Reply  DID_RTK_DEBUG_2  data          ─> "DID_RTK_DEBUG_2"

A vendor's own payload, an identifier newer than the tables, or a data set with a private layout cannot be plotted, but
must not be hidden. The number of kinds and the stored bytes are bounded; payloads of further kinds are counted. Adding
one costs a dictionary lookup and stores a reference; bytes are copied and formatted for the page twice a second.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Ints
from imuscope.protocols.clocks.unix_time import NO_TIME
from imuscope.protocols.events import Batch, Reply
from imuscope.protocols.schema.fields import Field, Message
from imuscope.server import wire
from imuscope.server.concurrency.rate_meter import RateMeter

MAX_KINDS = 32  # of one device; noise that passes the checksum must not fill memory
MAX_BYTES = 1024  # reported of one payload, besides its true size
_MAX_PLANS = 256


@dataclass(slots=True)
class _PayloadKind:
    """One kind of payload and its newest bytes."""

    name: str
    id: int
    message: str
    doc: str
    verified: bool
    newest: NDArray[np.uint8] | bytes = b""
    arrival: float = 0.0
    meter: RateMeter = field(default_factory=RateMeter)


def is_opaque(field: Field) -> bool:
    """Whether the field is only bytes."""
    return field.dtype == "bytes"


@dataclass(frozen=True, slots=True)
class Payloads:
    """Payloads of one kind and length, for an archive that stores all of them.

    Args:
        message: name of their message.
        name, column: name of the kind; name of the quantity in a table of the message.
        offset: (n,) offsets of their frames in the stream.
        arrival_ns, time_ns: (n,) unix ns; the latter by the device's clock, NO_TIME if it has none.
        rows: (n, k) uint8.
    """

    device: str
    message: str
    name: str
    column: str
    doc: str
    verified: bool
    offset: NDArray[np.int64]
    arrival_ns: Ints
    time_ns: Ints
    rows: NDArray[np.uint8]

    @property
    def kind(self) -> tuple[str, str, str, bool]:
        """Kind shared by payloads of all lengths."""
        return self.device, self.message, self.name, self.verified


class UnknownPayloadTracker:
    """The undescribed payloads of one device.

    Args:
        device: DeviceInfo.id.
        keep: called with all payloads of a kind in a drain, one Payloads for each length; None: they are not stored.
    """

    def __init__(self, device: str, keep: Callable[[Sequence[Payloads]], None] | None = None) -> None:
        self._device = device
        self._store = keep
        self._drained: dict[tuple[str, str, str, bool], list[Payloads]] = {}
        self._kinds: dict[tuple[str, bool], _PayloadKind] = {}
        self._plans: dict[int, tuple[Message, tuple[Field, ...]]] = {}

    def __bool__(self) -> bool:
        return bool(self._kinds)

    def batch(self, batch: Batch, time_ns: Ints) -> None:
        """Store the newest undescribed payloads of a batch; costs almost nothing if all fields are described.

        Args:
            time_ns: (n,) device time of its samples, unix ns.
        """
        known = self._plans.get(id(batch.message))
        if known is None or known[0] is not batch.message:
            if len(self._plans) >= _MAX_PLANS:
                self._plans.clear()
            opaque = tuple(field for field in batch.message.fields if is_opaque(field))
            known = self._plans[id(batch.message)] = (batch.message, opaque)
        for one in known[1]:
            column = batch.columns.get(one.name)
            if column is not None and len(column):
                newest = np.frombuffer(np.ascontiguousarray(column[-1]).tobytes(), np.uint8)
                arrival = float(batch.arrival_ns[-1]) / 1e9
                self._add(batch.message, one, newest, len(column), arrival, batch.verified)
                if self._store is not None:
                    rows = np.ascontiguousarray(column).view(np.uint8).reshape(len(column), -1)
                    clocks = (batch.offset, batch.arrival_ns, time_ns)
                    self._collect(batch.message, one, batch.verified, clocks, rows)

    def reply(self, reply: Reply) -> bool:
        """Store a reply that contains only bytes; returns False for any other, which goes to the event log.

        A sealed one, for which imuscope asks itself at the begin of a recording, is archived but not displayed.
        """
        fields = reply.message.fields
        if len(fields) != 1 or not is_opaque(fields[0]):
            return False
        data = reply.values.get(fields[0].name)
        if not isinstance(data, bytes | bytearray):
            return False
        arrival = reply.arrival_ns / 1e9
        if not reply.message.sealed:
            self._add(reply.message, fields[0], bytes(data), 1, arrival, True)
        if self._store is not None:
            rows = np.frombuffer(data, np.uint8)[None]
            clocks = (np.array([reply.offset]), np.array([reply.arrival_ns]), np.array([NO_TIME]))
            self._collect(reply.message, fields[0], True, clocks, rows)
        return True

    def drained(self) -> None:
        """Pass on the payloads collected during a drain; lengths of one kind are separate Payloads."""
        if self._store is not None and self._drained:
            for parts in self._drained.values():
                self._store(parts)
            self._drained.clear()

    def _collect(
        self,
        message: Message,
        one: Field,
        verified: bool,
        clocks: tuple[Ints, Ints, Ints],
        rows: NDArray[np.uint8],
    ) -> None:
        column = "value" if message.channel_per_field else one.name
        name = _name(message, one)
        part = Payloads(self._device, message.name, name, column, one.doc, verified, *clocks, rows)
        self._drained.setdefault(part.kind, []).append(part)

    def _add(
        self,
        message: Message,
        one: Field,
        newest: NDArray[np.uint8] | bytes,
        count: int,
        arrival: float,
        verified: bool,
    ) -> None:
        name = _name(message, one)
        kind = self._kinds.get((name, verified))
        if kind is None:
            if len(self._kinds) >= MAX_KINDS:
                return
            number = one.id if one.id >= 0 else message.id
            kind = _PayloadKind(name, number, message.title or message.name, one.doc or message.doc, verified)
            self._kinds[name, verified] = kind
        kind.newest, kind.arrival = newest, arrival
        kind.meter.add(count, arrival)

    def report(self, now: float) -> list[wire.UnknownPayload]:
        """The newest payload of every kind, in the order in which the kinds appeared."""
        return [
            wire.UnknownPayload(
                device=self._device,
                name=kind.name,
                id=kind.id,
                message=kind.message,
                doc=kind.doc,
                verified=kind.verified,
                count=kind.meter.total,
                rate=kind.meter.rate(now),
                size=len(kind.newest),
                hex=bytes(kind.newest[:MAX_BYTES]).hex(),
                arrival=kind.arrival,
            )
            for kind in self._kinds.values()
        ]


def _name(message: Message, one: Field) -> str:
    several = sum(map(is_opaque, message.fields)) > 1
    return one.name if message.channel_per_field else f"{message.name}.{one.name}" if several else message.name


def described(columns: Mapping[str, Any], fields: tuple[Field, ...]) -> dict[str, Field]:
    """The present fields with known meaning, by name; of duplicates, the last."""
    return {field.name: field for field in fields if field.name in columns and not is_opaque(field)}
