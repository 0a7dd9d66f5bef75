"""Which rows belong to one uninterrupted stretch of a device's clock, and when were they on the host's?

    parts of a drain ──> in the order of the stream ──> fits the mapping? ── yes ──> ClockModel (clock_model.py) ──>
    host time
    (rows of a message,                                       │ no
     device time, arrival)                                    └──> a candidate mapping; three rows in a row confirm it

## Steps of the device clock

A clock that jumps ahead makes frames arrive before they were sent by the mapping so far, which nothing else can. One
that jumps back or restarts makes a message go back against its own last time, late by as much: messages may be older
than others (a GNSS solution among IMU samples), but each keeps its own order. Such rows open a candidate mapping of
their own; three in a row make it the mapping, one good row discards it. `breaks` tells where a mapping began.

How far off is too far depends on how well the line is known: 50 ms in the first seconds, a few ± later.

## Never backwards

Of each message the host times told never decrease, whatever its clock and the link did: a mapping never rewrites what
it has told, a new one begins where the last one ended, and what is left (a lone wrong time) waits for the time told
before.

Rules for editing: one row costs about 15 µs in `times`; count the numpy calls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.chunk_boundaries import ChunkBoundaries
from protocols.clock_model import ClockModel
from protocols.delay_stats import DelaySpread, DelayStatistics

Array = NDArray[Any]
Floats = NDArray[np.float64]

LATE_NS = 10e9
CONFIRM_ROWS = 3
FAR_NS = 0.5e9  # a row that is so far from a candidate belongs to yet another clock
BLOCK = 512  # rows looked at together; one point of the envelope each
SOURCES = 256  # messages whose order is remembered
FIRST = -(1 << 62)  # before any device time


@dataclass(slots=True)
class TimedRows:
    """Rows of one message.

    Args:
        device: (n,) int64, unwrapped device time, ns.
        arrival: (n,) int64, host time of arrival, ns since the Unix epoch.
        offset: (n,) int64, where each frame began in the stream; None where there is one part only.
        size: bytes of each frame on the wire.
        source: which message: it keeps its own order.
    """

    device: Array
    arrival: Array
    offset: Array | None = None
    size: int = 0
    source: int = 0

    def rows(self, which: slice) -> TimedRows:
        """Some of them."""
        offset = None if self.offset is None else self.offset[which]
        return TimedRows(self.device[which], self.arrival[which], offset, self.size, self.source)


@dataclass(frozen=True, slots=True)
class _Rows:
    """The rows of all parts in the order of the stream. `size` and `source`: of all rows where there is one part."""

    device: Array
    arrival: Array
    offset: Array | None
    size: Array | int
    source: Array | int

    def __len__(self) -> int:
        return len(self.device)

    def rows(self, which: slice) -> _Rows:
        """Some of them."""
        offset = None if self.offset is None else self.offset[which]
        size = self.size if isinstance(self.size, int) else self.size[which]
        source = self.source if isinstance(self.source, int) else self.source[which]
        return _Rows(self.device[which], self.arrival[which], offset, size, source)


class ClockSync:
    """Device time → host time, learned from arrivals.

    Args:
        byte_time_ns: how long one byte takes on the wire (10 bits at 115200 Bd: 86 806 ns); 0 where it does not matter.
        holds_ns: for how long an adapter is known to keep bytes back; 0: not known, or there is none.
        unknown_ns: what nobody can know of the way here; part of ±.
        pieces: of the stream that the offsets of the rows are of; kept up by who feeds it. None: not known.
    Attributes:
        restarts: how often the mapping was begun anew; the first time does not count.
        breaks: unix s at which mappings began that did so during the last `times` or `add`.
    """

    def __init__(
        self,
        byte_time_ns: float = 0,
        *,
        holds_ns: float = 0,
        unknown_ns: float = 0,
        pieces: ChunkBoundaries | None = None,
    ) -> None:
        self._pieces = pieces
        self.byte_time_ns = byte_time_ns
        self.restarts = -1
        self.breaks: list[float] = []
        self.holds_ns = holds_ns
        self._unknown_ns = unknown_ns
        self._now: ClockModel | None = None
        self._before: ClockModel | None = None  # the mapping before the last restart, for rows of the same chunk
        self._candidate: ClockModel | None = None
        self._candidate_rows = 0
        self._last: dict[int, int] = {}  # source → its last device time
        self._told: dict[int, float] = {}  # source → the last host time told
        self._counts: dict[int, int] = {}  # source → rows
        self._running: dict[int, int] = {}  # the same, row by row within a drain
        self._careful = False  # the rows of this drain had to be looked at one by one
        self._main = 0  # the source with most rows: its delays tell about the link

    def restart(self) -> None:
        """Forget the mapping: the next row added begins a new one. For a new link; steps of the clock need no call."""
        self._before, self._now = self._now, None
        self._last.clear()
        self._forget()

    # -- rows in

    def times(self, parts: Sequence[TimedRows]) -> list[Floats]:
        """Learn from the rows of a drain and map them.

        Returns:
            Host time of the rows of each part that has any, unix s; it never decreases within a source.
        """
        self.breaks = []
        parts = [part for part in parts if len(part.device)] if not all(len(part.device) for part in parts) else parts
        if not parts:
            return []
        self._running, self._careful = self._last.copy(), False
        back = False
        for part in parts:
            back |= self._goes_back(part)
        if len(parts) == 1:
            (part,) = parts
            told = [self._take(_Rows(part.device, part.arrival, part.offset, part.size, part.source), back=back)]
        else:
            told = self._take_all(parts, back=back)
        if self._candidate_rows:
            self._last = self._running  # rows that nothing explains yet are nobody's last
        else:
            for part in parts:
                self._last[part.source] = int(part.device[-1])
        return [self._never_back(part.source, one) for part, one in zip(parts, told, strict=True)]

    def _take_all(self, parts: Sequence[TimedRows], *, back: bool) -> list[Floats]:
        """The rows of several messages, in the order of the stream."""
        counts = [len(part.device) for part in parts]
        offset = np.concatenate([part.offset for part in parts])
        order = np.argsort(offset, kind="stable")
        size = np.repeat([part.size for part in parts], counts)
        source = np.repeat([part.source for part in parts], counts)
        device = np.concatenate([part.device for part in parts])
        arrival = np.concatenate([part.arrival for part in parts])
        host = np.empty(len(order))
        rows = _Rows(device[order], arrival[order], offset[order], size[order], source[order])
        host[order] = self._take(rows, back=back)
        ends = np.cumsum(counts).tolist()
        return [host[end - count : end] for end, count in zip(ends, counts, strict=True)]

    def add(self, device_ns: Array, arrival_ns: Array, size: int = 0, source: int = 0) -> Floats:
        """`times` of rows of one message; see TimedRows."""
        told = self.times([TimedRows(device_ns, arrival_ns, None, size, source)])
        return told[0] if told else np.zeros(0)

    def host(self, device_ns: Array) -> Floats:
        """Host time of device times as it is known now, (n,) float64 unix s. NaN before the first row."""
        if self._now is None:
            return np.full(len(device_ns), np.nan)
        other = self._before
        if other is None or len(device_ns) == 0:
            return self._now.host(device_ns)
        mine = self._now.distance(device_ns) <= other.distance(device_ns)
        if mine.all():
            return self._now.host(device_ns)
        return np.where(mine, self._now.host(device_ns), other.host(device_ns))

    def _take(self, rows: _Rows, *, back: bool) -> Floats:
        """Learn, and map; a block at a time, by what is known then."""
        if len(rows) <= BLOCK:
            return self._block(rows, back=back)
        starts = range(0, len(rows), BLOCK)
        return np.concatenate([self._block(rows.rows(slice(at, at + BLOCK)), back=back) for at in starts])

    def _block(self, rows: _Rows, *, back: bool) -> Floats:
        device = rows.device
        sent, waited = self._sent(rows)
        now = self._now
        if now is None:
            now = self._now = self._mapping(int(device[-1]), int(sent[-1]))
            self.restarts += 1
        x = (device - now.origin).astype(np.float64)
        delay = (sent - now.host_origin).astype(np.float64)
        delay -= x
        delay -= now.slope * x
        delay -= now.intercept
        if back or float(delay.min()) < -now.step_ns:
            return self._row_by_row(rows, sent, waited)
        if self._candidate_rows:
            self._forget()
        self._learn(now, x, delay, waited, rows)
        if self._before is not None and now.newest > LATE_NS:
            self._before = None
        return self.host(device)

    def _sent(self, rows: _Rows) -> tuple[Array, Array]:
        """When the frames began on the line at the latest, unix ns; how much longer their last bytes waited, ns."""
        if not self.byte_time_ns:
            return rows.arrival, np.zeros(len(rows))
        last = rows.arrival - np.asarray(rows.size * self.byte_time_ns).astype(np.int64)
        if self._pieces is None or rows.offset is None:
            return last, np.zeros(len(rows))
        sent = self._pieces.sent(rows.offset, rows.size, last, self.byte_time_ns)
        return sent, (last - sent).astype(np.float64)

    def _learn(self, now: ClockModel, x: Array, delay: Array, waited: Array, rows: _Rows) -> None:
        """All rows are of this mapping; the delays of the main message tell about the link."""
        arrival = int(rows.arrival[-1])
        if isinstance(rows.source, int):
            size = float(rows.size) if isinstance(rows.size, int) else float(rows.size[-1])
            now.learn(x, delay, arrival, size, waited, judged=rows.source == self._main)
            return
        now.learn(x, delay, arrival, judged=False)
        mine = np.flatnonzero(rows.source == self._main)
        if len(mine):
            size = float(rows.size if isinstance(rows.size, int) else rows.size[mine[0]])
            now.late.add(x[mine], delay[mine], size, arrival, waited[mine])

    def _goes_back(self, part: TimedRows) -> bool:
        """Does a message go back against its own last time?"""
        source, device = part.source, part.device
        if len(self._last) > SOURCES:
            for known in (self._last, self._told, self._counts):
                known.clear()
        count = self._counts[source] = self._counts.get(source, 0) + len(device)
        if count > self._counts.get(self._main, 0):
            self._main = source
        if len(device) > 1 and bool((device[1:] < device[:-1]).any()):
            return True
        return int(device[0]) < self._last.get(source, FIRST)

    def _never_back(self, source: int, host: Floats) -> Floats:
        """What was told of a message stays ahead of nothing that is told later."""
        told = self._told.get(source, -np.inf)
        if len(host) and host[0] < told:
            host = np.maximum(host, told)
        if len(host) > 1 and self._careful:
            host = np.maximum.accumulate(host)
        if len(host):
            self._told[source] = float(host[-1])
        return host

    # -- steps

    def _row_by_row(self, rows: _Rows, sent: Array, waited: Array) -> Floats:
        """The careful way, for rows of which some do not fit the mapping."""
        self._careful = True
        n = len(rows)
        sources = np.broadcast_to(rows.source, n).tolist()
        sizes = np.broadcast_to(rows.size, n).tolist()
        out = np.empty(n)
        each = zip(rows.device.tolist(), sent.tolist(), rows.arrival.tolist(), sources, sizes, strict=True)
        for row, (d, s, a, source, size) in enumerate(each):
            now = self._now
            assert now is not None
            x = float(d - now.origin)
            delay = float(s - now.host_origin) - x - now.slope * x - now.intercept
            back = d < self._running.get(source, FIRST)
            if delay < -now.step_ns or (back and delay > now.step_ns):
                of = self._suspect(d, s, a)
            else:
                self._forget()
                wait = waited[row : row + 1]
                now.learn(np.array([x]), np.array([delay]), a, size, wait, judged=source == self._main)
                self._running[source] = d
                of = now
            out[row] = of.host(np.array([d]))[0]
        return out

    def _suspect(self, device: int, sent: int, arrival: int) -> ClockModel:
        """A row that the mapping cannot explain: it begins, or confirms, another, which is returned."""
        new = self._candidate
        if new is not None:
            x = float(device - new.origin)
            delay = float(sent - new.host_origin) - x - new.intercept
            if delay < -FAR_NS:
                new = None  # not even its predecessor explains it
            elif delay < FAR_NS:
                new.learn(np.array([x]), np.array([delay]), arrival)
                self._candidate_rows += 1
        if new is None:
            new, self._candidate_rows = self._following(device, sent, arrival), 1
        self._candidate = new
        if self._candidate_rows >= CONFIRM_ROWS:
            self._switch(new)
        return new

    def _mapping(self, device: int, sent: int) -> ClockModel:
        return ClockModel(device, sent, DelayStatistics(self.holds_ns, self.byte_time_ns), self._unknown_ns)

    def _following(self, device: int, sent: int, arrival: int) -> ClockModel:
        """A mapping that begins with this row. Host time does not run backwards there."""
        new = self._mapping(device, sent)
        new.learn(np.zeros(1), np.zeros(1), arrival)
        if self._now is not None:
            new.begin_at(max(0.0, self._now.last_host() - float(sent)))
        return new

    def _switch(self, new: ClockModel) -> None:
        """Another mapping from now on."""
        self.restarts += 1
        self.breaks.append(new.first_host() / 1e9)
        if self._now is not None:
            new.late.stalls.extend(self._now.late.stalls)
        self._now, self._before = new, self._now
        self._last.clear()
        self._running.clear()
        self._forget()

    def _forget(self) -> None:
        """No doubt about the mapping."""
        self._candidate, self._candidate_rows = None, 0

    # -- what is known

    @property
    def drift_ppm(self) -> float:
        """How much faster the device's clock runs than the host's, parts per million; 0 until seconds have passed."""
        return -self._now.slope / (1 + self._now.slope) * 1e6 if self._now else 0.0

    @property
    def uncertainty_ns(self) -> float:
        """± of the mapping. Infinite before the first row."""
        return self._now.uncertainty() if self._now else float("inf")

    @property
    def rows(self) -> int:
        """How many delays the mapping has seen."""
        return self._now.late.rows if self._now else 0

    @property
    def spread(self) -> DelaySpread:
        """How late frames came in the last seconds."""
        return self._now.spread if self._now else DelaySpread()

    @property
    def stalls(self) -> list[tuple[int, float]]:
        """(arrival in unix ns, how late in ns) of the last times that frames came late all at once."""
        return list(self._now.late.stalls) if self._now else []

    def jitter_ns(self, p: float = 99) -> float:
        """The `p`-th percentile of the delays of the last seconds: arrival against the mapping."""
        return self._now.jitter(p) if self._now else 0.0
