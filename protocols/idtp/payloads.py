"""Payload types and their fields: from (version, type, length) to a row, and from many payloads to columns.

    shorter than its type    intact, but not decoded: kept as bytes
    longer                   the fields at its start are decoded; the rest is shown as bytes, and the frame is marked
    no description           kept as bytes

Every decoded message has one column more than the wire has fields: its Status, with the mode and the irregularities of
each frame. Odd values are kept: a NaN is a gap in any plot. A quaternion whose norm is not 1 is not a rotation; it is
marked, and NaN in its column, so that no attitude is drawn from it. (`imuscope inspect` shows it as sent.)

Source: IDTP v2.1.0, section 4.5, with its errata 2, 8, 10 and 11.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from imuscope.protocols.arrays import Array, Bytes, Ints
from imuscope.protocols.idtp.custom_payloads import Schema
from imuscope.protocols.idtp.messages import (
    BY_ID,
    NOT_FINITE,
    NOT_UNIT,
    QUATERNION,
    STANDARD_END,
    TOO_LONG,
    UNVERIFIED,
    opaque,
    rest,
    status_of,
)
from imuscope.protocols.native.kernels import INTS, NOTHING, READ_ROWS, ROWS, TABLE, compiled, unsigned
from imuscope.protocols.rotations import UNIT_TOLERANCE
from imuscope.protocols.schema.fields import Field, Message
from imuscope.protocols.schema.layouts import Layout, LazyColumns, element, size_of

Rotation = Literal["enu_from_body", "body_from_enu"]


def row_of(kind: int, old: bool, schema: Schema) -> Message | None:
    """The row of a payload type, or None. `old`: version 2.0, whose types are all the vendor's own."""
    if not old and kind < STANDARD_END:
        return BY_ID[kind]
    return schema.get(kind)


@compiled(NOTHING, READ_ROWS, TABLE, INTS, ROWS)
def check_finite(rows: Bytes, floats: Ints, modes: Ints, status: Bytes) -> None:
    """Start the status of each row: its mode, and whether one of its floats is not finite.

    Args:
        floats: (2, k): position of each float's highest byte in a row, and which bits of the byte before it belong to
            the exponent, which is all ones in a NaN or an infinity.
        status: (n, 1), written.
    """
    for f in range(unsigned(len(rows))):
        odd = 0
        for k in range(unsigned(floats.shape[1])):
            at = unsigned(floats[0, k])
            if int(rows[f, at]) & 0x7F == 0x7F:
                low = floats[1, k]
                odd |= int(int(rows[f, at - unsigned(1)]) & low == low)
        status[f, 0] = modes[f] | odd << NOT_FINITE


class Payload:
    """One layout: the meaning of (version, type, length).

    Args:
        old: version 2.0.
        tick_ns: unit of the timestamp.

    Attributes:
        message: with its Status, as in batches.
        width: bytes of a payload that are read.
        error: "" or a notice for the user: "shorter …", "longer …".
    """

    def __init__(self, kind: int, old: bool, length: int, schema: Schema, tick_ns: int) -> None:
        row = row_of(kind, old, schema)
        size = sum(size_of(field) for field in row.fields) if row else 0
        self.error = ""
        self.marks = 0
        if row is None:
            row = opaque(kind, length)
        elif length < size:
            self.error = f"{row.name} has {length} bytes instead of {size} and is not decoded"
            row = opaque(kind, length, f"{row.name}Bytes")
        elif length > size:
            self.error = f"{row.name} has {length} bytes instead of {size}; the rest is shown as bytes"
            self.marks = 1 << TOO_LONG
            row = replace(row, fields=(*row.fields, rest(row.name, length - size)))
        self.status = status_of(row.name).name
        fields = (*row.fields, status_of(row.name))
        self.message = replace(row, fields=fields, time="timestamp", tick_ns=tick_ns, wrap=2**32)
        self.layout = Layout.of(row.fields)
        self.width = self.layout.size
        self.floats = _floats(row.fields)
        self.has_quaternion = QUATERNION in row.fields
        self.scaled = any(field.scale != 1 or field.bias != 0 for field in row.fields)


def _floats(fields: tuple[Field, ...]) -> Ints:
    """Offsets of the floats; see `check_finite`."""
    places: list[tuple[int, int]] = []
    at = 0
    for field in fields:
        if field.dtype in ("<f4", "<f8"):
            step = element(field).itemsize
            places += [
                (end - 1, 0x80 if step == 4 else 0xF0) for end in range(at + step, at + size_of(field) + 1, step)
            ]
        at += size_of(field)
    return np.array(places, np.int64).reshape(-1, 2).T.copy()


class DecodedPayload(Mapping[str, Array]):
    """Field → column, with the Status; made on first access (see events.Batch)."""

    __slots__ = ("_modes", "_payload", "_plain", "_rotation", "_rows", "_special", "_unverified")

    def __init__(self, payload: Payload, rows: Bytes, modes: Ints, unverified: bool, rotation: Rotation) -> None:
        self._payload = payload
        self._rows = rows
        self._modes = modes
        self._unverified = unverified
        self._rotation = rotation
        self._plain: LazyColumns | None = None
        self._special: dict[str, Array] | None = None

    def __getitem__(self, name: str) -> Array:
        payload = self._payload
        if name == payload.status or (payload.has_quaternion and name == QUATERNION.name):
            if self._special is None:
                self._special = self._make()
            return self._special[name]
        if payload.scaled:  # multiplying a signalling NaN would warn
            with np.errstate(all="ignore"):
                return self._columns[name]
        return self._columns[name]

    @property
    def _columns(self) -> LazyColumns:
        if self._plain is None:
            self._plain = self._payload.layout.columns(self._rows)
        return self._plain

    def __iter__(self) -> Iterator[str]:
        yield from self._columns
        yield self._payload.status

    def __len__(self) -> int:
        return len(self._columns) + 1

    def _make(self) -> dict[str, Array]:
        """The Status, and the quaternion if the message has one."""
        table = np.empty((len(self._rows), 1), np.uint8)
        check_finite(self._rows, self._payload.floats, self._modes, table)
        status = table[:, 0]
        if marks := self._payload.marks | int(self._unverified) << UNVERIFIED:
            status |= np.uint8(marks)
        made = {self._payload.status: status}
        if self._payload.has_quaternion:
            made[QUATERNION.name] = self._quaternion(status)
        return made

    def _quaternion(self, status: Array) -> Array:
        """The quaternion, with NaN where it is invalid; such rows are marked in `status`."""
        column = self._columns[QUATERNION.name].copy()
        with np.errstate(all="ignore"):
            squares = column.astype(np.float64)
            squares *= squares
            norm = np.sqrt(squares[:, 0] + squares[:, 1] + squares[:, 2] + squares[:, 3])  # einsum is slower
            odd = ~(np.abs(norm - 1) <= UNIT_TOLERANCE)
        if odd.any():
            status[odd] |= np.uint8(1 << NOT_UNIT)
            column[odd] = np.nan
        if self._rotation == "body_from_enu":
            column[:, 1:] *= -1  # the inverse of a unit quaternion is its conjugate
        return column
