"""Output of the simulated MTi in Measurement state: every item of MTData2, computed from the shared drive and packed as
configured.

    configuration ──> streams: items sent together, at one rate (output_configuration.py)
    (id, Hz) …                  │
    drive(t), errors ──> values ┴──> rows of bytes ──> frames

An item is in the messages at which it is due, as in a real device. PacketCounter counts messages, of all streams. The
receiver's items carry an older time.

All messages of a quarter of a second are made at once: those with the same items are rows of one array, in which an
item is some columns, so that the cost is per item and not per message. The result depends on seed and time only, not
on how time is cut.

Source: MT0101P 2020.A, 5.3.5 SetOutputConfiguration and 5.3.6 MTData2.
"""

import zlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from imuscope.protocols.arrays import Array
from imuscope.protocols.simulator import trajectory
from imuscope.protocols.xbus import frames
from imuscope.protocols.xbus.output_configuration import ALWAYS, streams
from imuscope.protocols.xbus.simulator.signals import ItemValues, XbusSignalSource

BLOCK_NS = 250_000_000


@dataclass(frozen=True)
class Measurement:
    """One uninterrupted run of the measurement state.

    Args:
        configuration: (identifier, Hz) as granted, in the order of the message.
        begin_ns: device time of the first sample.
        run: inputs of the values.
    """

    configuration: tuple[tuple[int, int], ...]
    begin_ns: int
    run: XbusSignalSource

    @cached_property
    def streams(self) -> "tuple[_MeasuredStream, ...]":
        """The main stream, then GNSS, then high-rate ones."""
        return tuple(
            _MeasuredStream(self.run, stream.kind, stream.items, stream.rate, self.begin_ns)
            for stream in streams(self.configuration)
        )

    def block(self, number: int, counter: int) -> list[tuple[int, bytes]]:
        """All messages of a quarter of a second, as (device time ns of sending, frame), in order.

        Args:
            number: which quarter, from 0.
            counter: PacketCounter of the first of them.
        """
        parts = [(stream, *stream.times(number)) for stream in self.streams]
        sent = np.concatenate([times for _, _, times in parts]) if parts else np.empty(0, np.int64)
        order = np.argsort(sent, kind="stable")
        place = np.empty(len(order), np.int64)
        place[order] = np.arange(len(order))
        made: list[bytes] = [b""] * len(order)
        at = 0
        for stream, steps, times in parts:
            here = place[at : at + len(times)]
            for row, frame in zip(here.tolist(), stream.frames(steps, times, counter + here), strict=True):
                made[row] = frame
            at += len(times)
        return list(zip(sent[order].tolist(), made, strict=True))


@dataclass(frozen=True)
class _MeasuredStream:
    """Items sent together at one rate."""

    run: XbusSignalSource
    kind: str
    items: tuple[tuple[int, int], ...]
    rate: int
    begin_ns: int
    _errors: dict[str, trajectory.SensorErrors] = field(default_factory=dict, compare=False)

    @property
    def delayed(self) -> bool:
        return self.kind == "gnss"

    def errors(self, name: str, grade: trajectory.SensorGrade) -> trajectory.SensorErrors:
        if name not in self._errors:
            self._errors[name] = trajectory.SensorErrors(grade, self.run.seed ^ zlib.crc32(name.encode()), self.rate)
        return self._errors[name]

    def times(self, number: int) -> tuple[Array, Array]:
        """Steps of a quarter, and the device times of their messages."""
        first, end = (-(-quarter * BLOCK_NS * self.rate // 10**9) for quarter in (number, number + 1))
        steps = np.arange(first, end)
        every = [self.rate // rate for _, rate in self.items if rate != ALWAYS]
        if every and min(every) > 1:  # at some ticks nothing is due; unsent messages are not counted
            steps = steps[np.any([steps % one == 0 for one in every], axis=0)]
        return steps, self.begin_ns + steps * 10**9 // self.rate

    def frames(self, steps: Array, times: Array, counter: Array) -> list[bytes]:
        """One frame per step."""
        values = ItemValues(self.run, self, steps, times, counter)
        due = np.zeros(len(steps), np.int64)
        for bit, (_, rate) in enumerate(self.items):
            if rate != ALWAYS:
                due |= (steps % (self.rate // rate) == 0).astype(np.int64) << bit
        made: list[bytes] = [b""] * len(steps)
        for mask in np.unique(due).tolist():
            rows = np.flatnonzero(due == mask)
            chosen = [i for bit, (i, rate) in enumerate(self.items) if rate == ALWAYS or mask >> bit & 1]
            packed = _pack([(i, values.bytes_of(i)[rows]) for i in chosen])
            for row, frame in zip(rows.tolist(), packed, strict=True):
                made[row] = frame
        return made


def renumbered(frame: bytes, number: int) -> bytes:
    """An MTData2 frame with another packet counter, if it has one."""
    payload = bytearray(frame[6:-1] if frame[3] == frames.EXTENDED else frame[4:-1])
    for identifier, at, size in frames.items(bytes(payload))[0]:
        if identifier == frames.PACKET_COUNTER and size == 2:
            payload[at : at + 2] = (number & 0xFFFF).to_bytes(2, "big")
    return frames.build(frames.MTDATA2, bytes(payload))


def _pack(items: list[tuple[int, Array]]) -> list[bytes]:
    """Frames of n messages with the same items, each item given as (identifier, (n, size) bytes)."""
    n = len(items[0][1])
    size = sum(3 + value.shape[1] for _, value in items)
    if size > frames.MAX_STANDARD:
        head = bytes([frames.PREAMBLE, frames.MASTER, frames.MTDATA2, frames.EXTENDED, size >> 8, size & 0xFF])
    else:
        head = bytes([frames.PREAMBLE, frames.MASTER, frames.MTDATA2, size])
    rows = np.empty((n, len(head) + size + 1), np.uint8)
    rows[:, : len(head)] = np.frombuffer(head, np.uint8)
    at = len(head)
    for identifier, value in items:
        width = value.shape[1]
        rows[:, at : at + 3] = (identifier >> 8, identifier & 0xFF, width)
        rows[:, at + 3 : at + 3 + width] = value
        at += 3 + width
    rows[:, -1] = -rows[:, 1:-1].sum(axis=1, dtype=np.int64) & 0xFF
    flat, step = rows.tobytes(), rows.shape[1]
    return [flat[i : i + step] for i in range(0, len(flat), step)]
