"""Recognition of devices by the identifiers of a log, as far as length and content of the frames agree.

    as delivered    11 bits, the numbers of the table
    with a base     the low 7 bits of an identifier are a number of the table, the others are the same for several
    as named        by the user, identifier by identifier

A user can give each message another identifier (SetCanOutputConfig). A base is found where at least three messages fit
by their length, and as far as their content says more than that (a quaternion has length 1). It is reported, as is
everything else that is concluded here.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Ints
from imuscope.protocols.can.definition import KINDS, CanDefinition, identifier_text, number_of
from imuscope.protocols.can.rows import CanDeviceKind, CanRow
from imuscope.protocols.schema.plural import counted

MIN_FITTING_SHARE = 0.9  # of the frames of an identifier
MIN_MESSAGES, MIN_LENGTHS = 3, 2  # messages with a base
LOW_BITS = 0x7F
RATE_TOLERANCE = 0.2  # of a rate


@dataclass(slots=True)
class CanIdentifier:
    """An identifier of a log.

    Args:
        number: EXTENDED is added to one of 29 bits.
        of_length: number of frames by their length.
        stamps, data: (n,) ns, (n, 8) bytes of the first of them.
    """

    bus: str
    number: int
    of_length: dict[int, int] = field(default_factory=dict)
    stamps: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    data: NDArray[np.uint8] = field(default_factory=lambda: np.empty((0, 8), np.uint8))

    @property
    def frames(self) -> int:
        return sum(self.of_length.values())

    def fits(self, row: CanRow) -> bool:
        """Whether its frames can be that message."""
        if self.of_length.get(row.size, 0) < MIN_FITTING_SHARE * self.frames:
            return False
        if row.is_plausible is None or not len(self.data):
            return True
        return float(row.is_plausible(self.data).mean()) >= MIN_FITTING_SHARE


@dataclass(frozen=True, slots=True)
class CanDevice:
    """A device of a log, with its messages."""

    bus: str
    definition: CanDefinition
    title: str


def devices_of(log: Sequence[CanIdentifier], named: Mapping[str, str]) -> list[CanDevice]:
    """The devices of a log.

    Args:
        named: identifier as in the log → its message, by the user; "" leaves it out. Other keys are ignored.

    Raises:
        ValueError: there is no such message.
    """
    devices = []
    for name, kind in KINDS.items():
        chosen = _chosen(kind, named)
        for bus in dict.fromkeys(one.bus for one in log):
            of_bus = [one for one in log if one.bus == bus]
            for rows, words in _sets(kind, of_bus, chosen):
                tick_ns, clock = _tick(kind, rows, of_bus)
                remarks = tuple(filter(None, (words, clock, kind.remark if _has_frame(rows) else "")))
                devices.append(CanDevice(bus, CanDefinition(name, rows, tick_ns, remarks), kind.title))
    return devices


def message_names() -> list[str]:
    """Names of all messages that an identifier can be given."""
    return [row.name for kind in KINDS.values() for row in kind.rows]


def _chosen(kind: CanDeviceKind, named: Mapping[str, str]) -> dict[int, CanRow | None]:
    chosen: dict[int, CanRow | None] = {}
    for text, name in named.items():
        try:
            number = number_of(text)
        except ValueError:
            continue
        row = kind.row(name)
        if row is None and name:
            raise ValueError(f"{text} = {name}: there is no such message. {', '.join(message_names())}")
        chosen[number] = row
    return chosen


def _sets(
    kind: CanDeviceKind, log: Sequence[CanIdentifier], chosen: Mapping[int, CanRow | None]
) -> Iterator[tuple[dict[int, CanRow], str]]:
    """The rows of each device on a bus, with a sentence on how they were found."""
    named = {one.number: row for one in log if (row := chosen.get(one.number)) is not None}
    rest = [one for one in log if one.number not in chosen]
    known = {row.identifier: row for row in kind.rows}
    usual = {one.number: known[one.number] for one in rest if one.number in known and one.fits(known[one.number])}
    if named:
        words = f"Identifiers as named: {_listed(named)}."
        yield {**usual, **named}, words
    elif any(row.role != "report" for row in usual.values()):
        yield usual, ""
    bases: dict[int, dict[int, CanRow]] = {}
    for one in rest:
        row = known.get(one.number & LOW_BITS)
        if row is not None and one.number not in known and one.fits(row):
            bases.setdefault(one.number & ~LOW_BITS, {})[one.number] = row
    for base, rows in bases.items():
        lengths = {row.size for row in rows.values()}
        if len(rows) >= MIN_MESSAGES and len(lengths) >= MIN_LENGTHS:
            text = identifier_text(base)
            words = (
                f"Identifiers from {text} on are taken for those of the documents, by {counted(len(rows), 'message')}"
            )
            yield rows, f"{words} that fit: {_listed(rows)}."


def _listed(rows: Mapping[int, CanRow]) -> str:
    return ", ".join(f"{identifier_text(number)} {row.name}" for number, row in sorted(rows.items()))


def _has_frame(rows: Mapping[int, CanRow]) -> bool:
    return any("ENU" in row.field.frame for row in rows.values())


def _tick(kind: CanDeviceKind, rows: Mapping[int, CanRow], log: Sequence[CanIdentifier]) -> tuple[int, str]:
    """Length of a tick of the clock of a device, ns, and a sentence where it is not the usual one or not sure."""
    usual = kind.ticks_ns[0]
    number = next((number for number, row in rows.items() if row.role == "time"), None)
    one = next((one for one in log if one.number == number), None)
    if one is None or len(one.data) < 2:
        return usual, ""
    name = rows[one.number].name
    ticks = np.diff(np.ascontiguousarray(one.data[:, :4]).view(">u4")[:, 0].astype(np.int64))
    passed = np.diff(one.stamps)
    good = (ticks > 0) & (passed > 0)
    if (one.stamps < 0).any() or not good.any():
        return usual, f"{name} is taken to count {usual // 1000} µs: the log has no times to compare it with."
    measured = float(np.median(passed[good] / ticks[good]))
    for tick_ns in kind.ticks_ns:
        if abs(measured / tick_ns - 1) < RATE_TOLERANCE:
            words = "" if tick_ns == usual else f"{name} counts {tick_ns // 1000} µs, by the times of the log."
            return tick_ns, words
    return usual, f"{name} is taken to count {usual // 1000} µs, though it does not run like the times of the log."
