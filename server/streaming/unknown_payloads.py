"""What is in payloads that nobody has described? Their bytes, the newest of each kind, for a person to look at.

    Batch  0x80        data (n, 6) uint8  ─> "0x80"      06 00 E8 03 …   12 000 of them, 100 /s
    Batch  MTData2     0x4FF0 (n, 3)      ─> "0x4FF0"
    Reply  DID_RTK_DEBUG_2  data          ─> "DID_RTK_DEBUG_2"

A vendor's own payload, an identifier newer than the tables, a data set whose layout is not public: none of it can be
plotted, and none of it is to vanish. Kinds are bounded in number and in what is kept; what is beyond is counted.
Taking one costs a look into a dictionary and keeps a reference: bytes are copied and spelled when the page is told,
twice a second.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.events import Batch, Reply
from protocols.schema import Field, Message
from server import wire
from server.devices.link_stats import RateMeter

MOST_KINDS = 32  # of one device; noise that passes the checksum must not fill memory
MOST_BYTES = 1024  # told of one payload; its true size is told too
_MOST_PLANS = 256


@dataclass(slots=True)
class _Kind:
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
    """Is this field nothing but bytes?"""
    return field.dtype == "bytes"


@dataclass(frozen=True, slots=True)
class Payloads:
    """Payloads of one kind and length, for who keeps every one of them.

    Args:
        message: name of the message that they came in.
        name, column: of the kind; of the quantity in a table of the message.
        offset: (n,) where their frames began in the stream.
        arrival, time: (n,) float64, unix s; `time` by the device's clock, NaN where it has none.
        rows: (n, k) uint8.
    """

    device: str
    message: str
    name: str
    column: str
    doc: str
    verified: bool
    offset: NDArray[np.int64]
    arrival: NDArray[np.float64]
    time: NDArray[np.float64]
    rows: NDArray[np.uint8]

    @property
    def kind(self) -> tuple[str, str, str, bool]:
        """What those of all lengths have in common."""
        return self.device, self.message, self.name, self.verified


class UnknownPayloads:
    """The undescribed payloads of one device.

    Args:
        device: DeviceInfo.id.
        keep: is given all payloads of a kind in a drain, one Payloads for each length, where somebody keeps them.
    """

    def __init__(self, device: str, keep: Callable[[Sequence[Payloads]], None] | None = None) -> None:
        self._device = device
        self._keep = keep
        self._drained: dict[tuple[str, str, str, bool], list[Payloads]] = {}
        self._kinds: dict[tuple[str, bool], _Kind] = {}
        self._plans: dict[int, tuple[Message, tuple[Field, ...]]] = {}
        self.beyond = 0  # payloads of kinds that there was no room for

    def __bool__(self) -> bool:
        return bool(self._kinds)

    def batch(self, batch: Batch, time: NDArray[np.float64]) -> None:
        """Keep the newest of what nobody described in it; next to nothing where all is described.

        Args:
            time: (n,) device time of its samples, unix s.
        """
        known = self._plans.get(id(batch.message))
        if known is None or known[0] is not batch.message:
            if len(self._plans) >= _MOST_PLANS:
                self._plans.clear()
            opaque = tuple(field for field in batch.message.fields if is_opaque(field))
            known = self._plans[id(batch.message)] = (batch.message, opaque)
        for one in known[1]:
            column = batch.columns.get(one.name)
            if column is not None and len(column):
                newest = np.frombuffer(np.ascontiguousarray(column[-1]).tobytes(), np.uint8)
                arrival = float(batch.arrival_ns[-1]) / 1e9
                self._take(batch.message, one, newest, len(column), arrival, batch.verified)
                if self._keep is not None:
                    rows = np.ascontiguousarray(column).view(np.uint8).reshape(len(column), -1)
                    clocks = (batch.offset, batch.arrival_ns / 1e9, time)
                    self._collect(batch.message, one, batch.verified, clocks, rows)

    def reply(self, reply: Reply) -> bool:
        """Keep a reply that is nothing but bytes; False for any other, which is left to the log of events."""
        fields = reply.message.fields
        if len(fields) != 1 or not is_opaque(fields[0]):
            return False
        data = reply.values.get(fields[0].name)
        if not isinstance(data, bytes | bytearray):
            return False
        arrival = reply.arrival_ns / 1e9
        self._take(reply.message, fields[0], bytes(data), 1, arrival, True)
        if self._keep is not None:
            rows = np.frombuffer(data, np.uint8)[None]
            clocks = (np.array([reply.offset]), np.array([arrival]), np.array([np.nan]))
            self._collect(reply.message, fields[0], True, clocks, rows)
        return True

    def drained(self) -> None:
        """A drain is over: hand on what was collected. Lengths of one kind come as batches of their own."""
        if self._keep is not None and self._drained:
            for parts in self._drained.values():
                self._keep(parts)
            self._drained.clear()

    def _collect(
        self,
        message: Message,
        one: Field,
        verified: bool,
        clocks: tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]],
        rows: NDArray[np.uint8],
    ) -> None:
        column = "value" if message.split else one.name
        name = _name(message, one)
        part = Payloads(self._device, message.name, name, column, one.doc, verified, *clocks, rows)
        self._drained.setdefault(part.kind, []).append(part)

    def _take(
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
            if len(self._kinds) >= MOST_KINDS:
                self.beyond += count
                return
            number = one.id if one.id >= 0 else message.id
            kind = _Kind(name, number, message.title or message.name, one.doc or message.doc, verified)
            self._kinds[name, verified] = kind
        kind.newest, kind.arrival = newest, arrival
        kind.meter.add(count, arrival)

    def report(self, now: float) -> list[wire.RawPayload]:
        """The newest payload of every kind, in the order in which the kinds appeared."""
        return [
            wire.RawPayload(
                device=self._device,
                name=kind.name,
                id=kind.id,
                message=kind.message,
                doc=kind.doc,
                verified=kind.verified,
                count=kind.meter.total,
                rate=kind.meter.rate(now),
                size=len(kind.newest),
                hex=bytes(kind.newest[:MOST_BYTES]).hex(),
                arrival=kind.arrival,
            )
            for kind in self._kinds.values()
        ]


def _name(message: Message, one: Field) -> str:
    """What a kind of payload is called."""
    several = sum(map(is_opaque, message.fields)) > 1
    return one.name if message.split else f"{message.name}.{one.name}" if several else message.name


def described(columns: Mapping[str, Any], fields: tuple[Field, ...]) -> dict[str, Field]:
    """The fields that are there and whose meaning is known, by name; of duplicates, the last."""
    return {field.name: field for field in fields if field.name in columns and not is_opaque(field)}
