"""Mapping from device time to host time.

    parts of a drain ──> in stream order ──> fits the mapping? ── yes ──> ClockModel (clock_model.py) ──> host time
    (rows of a message,                          │ no
     device time, arrival)                       └──> a candidate mapping; three rows in a row confirm it

## Steps of the device clock

A clock that jumps ahead makes frames arrive before they were sent by the mapping so far, which has no other cause. One
that jumps back or restarts makes a message go back against its own last time, late by as much: messages may be older
than others (a GNSS solution among IMU samples), but each keeps its own order. Such rows open a candidate mapping of
their own; three in a row confirm it, one good row discards it. `discontinuities` lists where mappings began.

The threshold depends on how well the line is known: 50 ms in the first seconds, a few ± later.

## Monotonic host time

For each message the published host times never decrease, whatever its clock and the link did: a mapping never rewrites
published times, a new one begins where the last one ended, and remaining cases (a lone wrong time) repeat the last
published time.

Rules for editing: one row costs about 15 µs in `map_to_host`; count the numpy calls.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.clocks.chunk_boundaries import ChunkBoundaries
from imuscope.protocols.clocks.clock_model import ClockModel
from imuscope.protocols.clocks.delay_stats import MIN_DELAYS, DelaySpread, DelayStatistics
from imuscope.protocols.clocks.kernels import decreases, delays_of
from imuscope.protocols.clocks.unix_time import NO_TIME

LATE_NS = 10e9
CONFIRM_ROWS = 3
FAR_NS = 0.5e9  # a row this far from a candidate belongs to yet another clock
BLOCK_ROWS = 512  # rows processed together; one point of the envelope each
MAX_SOURCES = 256  # messages whose order is remembered
FIRST_NS = -(1 << 62)  # before any device time


@dataclass(slots=True)
class TimedRows:
    """Rows of one message.

    Args:
        device: (n,) int64, unwrapped device time, ns.
        arrival: (n,) int64, host time of arrival, ns since the Unix epoch.
        offset: (n,) int64, start of each frame in the stream; None if there is one part only.
        size: bytes of each frame on the wire.
        source: number of the message, which keeps its own order.
    """

    device: Array
    arrival: Array
    offset: Array | None = None
    size: int = 0
    source: int = 0

    def __post_init__(self) -> None:
        self.device = np.ascontiguousarray(self.device, np.int64)  # for the compiled loops
        self.arrival = np.ascontiguousarray(self.arrival, np.int64)
        if self.offset is not None:
            self.offset = np.ascontiguousarray(self.offset, np.int64)

    def rows(self, which: slice) -> "TimedRows":
        """A slice of them."""
        offset = None if self.offset is None else self.offset[which]
        return TimedRows(self.device[which], self.arrival[which], offset, self.size, self.source)


@dataclass(slots=True)
class _Rows:
    """The rows of all parts in stream order. `size` and `source`: of all rows if there is one part."""

    device: Array
    arrival: Array
    offset: Array | None
    size: Array | int
    source: Array | int

    def __len__(self) -> int:
        return len(self.device)

    def rows(self, which: slice) -> "_Rows":
        """A slice of them."""
        offset = None if self.offset is None else self.offset[which]
        size = self.size if isinstance(self.size, int) else self.size[which]
        source = self.source if isinstance(self.source, int) else self.source[which]
        return _Rows(self.device[which], self.arrival[which], offset, size, source)


class ClockSync:
    """Device time → host time, learned from arrivals.

    Args:
        byte_time_ns: duration of one byte on the wire (10 bits at 115200 Bd: 86 806 ns); 0 if irrelevant.
        holds_ns: how long an adapter is known to hold bytes back; 0: unknown, or no adapter.
        unknown_ns: unknowable part of the delay; part of ±.
        pieces: of the stream that the rows' offsets refer to; maintained by the caller. None: unknown.

    Attributes:
        restarts: how often the mapping was restarted, without the first start.
        discontinuities: unix s of the starts of mappings during the last `map_to_host` or `add`.
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
        self.discontinuities: list[float] = []
        self.holds_ns = holds_ns
        self._unknown_ns = unknown_ns
        self._now: ClockModel | None = None
        self._before: ClockModel | None = None  # the mapping before the last restart, for rows of the same chunk
        self._candidate: ClockModel | None = None
        self._candidate_rows = 0
        self._last: dict[int, int] = {}  # source → its last device time
        self._published: dict[int, int] = {}  # source → its last published host time
        self._counts: dict[int, int] = {}  # source → rows
        self._running: dict[int, int] = {}  # the same, row by row within a drain
        self._is_cautious = False  # the rows of this drain need checking one by one
        self._main = 0  # the source with most rows: its delays describe the link

    # -- input ---------------------------------------------------------------------------------------------------------

    def map_to_host(self, parts: Sequence[TimedRows]) -> list[Ints]:
        """Learn from the rows of a drain and map them.

        Returns:
            Host time of the rows of each non-empty part, unix ns; it never decreases within a source.
        """
        self.discontinuities = []
        parts = [part for part in parts if len(part.device)] if not all(len(part.device) for part in parts) else parts
        if not parts:
            return []
        self._running, self._is_cautious = self._last.copy(), False
        back = False
        for part in parts:
            back |= self._goes_back(part)
        if len(parts) == 1:
            (part,) = parts
            host_times = [self._add(_Rows(part.device, part.arrival, part.offset, part.size, part.source), back=back)]
        else:
            host_times = self._map_all(parts, back=back)
        if self._candidate_rows:
            self._last = self._running  # rows that are not explained yet do not count as last
        else:
            for part in parts:
                self._last[part.source] = int(part.device[-1])
        return [self._monotonic(part.source, one) for part, one in zip(parts, host_times, strict=True)]

    def _map_all(self, parts: Sequence[TimedRows], *, back: bool) -> list[Ints]:
        """Process the rows of several messages, in stream order."""
        counts = [len(part.device) for part in parts]
        offset = np.concatenate([part.offset for part in parts])
        order = np.argsort(offset, kind="stable")
        size = np.repeat([part.size for part in parts], counts)
        source = np.repeat([part.source for part in parts], counts)
        device = np.concatenate([part.device for part in parts])
        arrival = np.concatenate([part.arrival for part in parts])
        host = np.empty(len(order), np.int64)
        rows = _Rows(device[order], arrival[order], offset[order], size[order], source[order])
        host[order] = self._add(rows, back=back)
        ends = np.cumsum(counts).tolist()
        return [host[end - count : end] for end, count in zip(ends, counts, strict=True)]

    def add(self, device_ns: Array, arrival_ns: Array, size: int = 0, source: int = 0) -> Ints:
        """`map_to_host` of rows of one message; see TimedRows."""
        host_times = self.map_to_host([TimedRows(device_ns, arrival_ns, None, size, source)])
        return host_times[0] if host_times else np.zeros(0, np.int64)

    def host(self, device_ns: Array) -> Ints:
        """Host time of device times by the current mapping, (n,) unix ns. NO_TIME before the first row."""
        if self._now is None:
            return np.full(len(device_ns), NO_TIME)
        other = self._before
        if other is None or len(device_ns) == 0:
            return self._now.host(device_ns)
        mine = self._now.distance(device_ns) <= other.distance(device_ns)
        if mine.all():
            return self._now.host(device_ns)
        return np.where(mine, self._now.host(device_ns), other.host(device_ns))

    def _add(self, rows: _Rows, *, back: bool) -> Ints:
        """Learn and map, a block at a time, with the knowledge at that point."""
        if len(rows) <= BLOCK_ROWS:
            return self._block(rows, back=back)
        starts = range(0, len(rows), BLOCK_ROWS)
        return np.concatenate([self._block(rows.rows(slice(at, at + BLOCK_ROWS)), back=back) for at in starts])

    def _block(self, rows: _Rows, *, back: bool) -> Ints:
        device = rows.device
        sent, waited = self._sent(rows)
        now = self._now
        if now is None:
            first = int(np.argmin(sent - device))  # the least late: of any other, this one would seem to be early
            now = self._now = self._mapping(int(device[first]), int(sent[first]))
            self.restarts += 1
        x, delay = np.empty(len(device)), np.empty(len(device))
        which = delays_of(device, sent, now.origin, now.host_origin, now.slope, now.intercept, x, delay)
        if back or delay[which[0]] < -now.step_ns:
            return self._row_by_row(rows, sent, waited)
        if self._candidate_rows:
            self._forget()
        self._update(now, x, delay, waited, rows, which)
        if self._before is not None and now.newest > LATE_NS:
            self._before = None
        return self.host(device)

    def _sent(self, rows: _Rows) -> tuple[Array, Array]:
        """Latest possible start of transmission of each frame, unix ns, and the extra wait of its last bytes, ns."""
        if not self.byte_time_ns:
            return rows.arrival, np.zeros(len(rows))
        size, byte_ns = rows.size, self.byte_time_ns
        whole = int(size * byte_ns) if isinstance(size, int) else (size * byte_ns).astype(np.int64)
        last: Array = rows.arrival - whole
        if self._pieces is None or rows.offset is None:
            return last, np.zeros(len(rows))
        sent = self._pieces.sent(rows.offset, rows.size, last, self.byte_time_ns)
        return sent, (last - sent).astype(np.float64)

    def _update(
        self, now: ClockModel, x: Array, delay: Array, waited: Array, rows: _Rows, which: tuple[int, int, int]
    ) -> None:
        """Update the model with rows that all fit it; the delays of the main message describe the link."""
        arrival = int(rows.arrival[-1])
        if isinstance(rows.source, int):
            size = float(rows.size) if isinstance(rows.size, int) else float(rows.size[-1])
            now.update(x, delay, arrival, size, waited, judged=rows.source == self._main, rows=which)
            return
        now.update(x, delay, arrival, judged=False, rows=which)
        mine = np.flatnonzero(rows.source == self._main)
        if len(mine):
            size = float(rows.size if isinstance(rows.size, int) else rows.size[mine[0]])
            now.late.add(x[mine], delay[mine], size, arrival, waited[mine])

    def _goes_back(self, part: TimedRows) -> bool:
        """Whether the time of a message goes back against its own last time."""
        source, device = part.source, part.device
        if len(self._last) > MAX_SOURCES:
            for known in (self._last, self._published, self._counts):
                known.clear()
        count = self._counts[source] = self._counts.get(source, 0) + len(device)
        if count > self._counts.get(self._main, 0):
            self._main = source
        if decreases(device):
            return True
        return int(device[0]) < self._last.get(source, FIRST_NS)

    def _monotonic(self, source: int, host: Ints) -> Ints:
        """Limit mapped times so that no later time of the same message is earlier."""
        latest = self._published.get(source, NO_TIME)
        if len(host) and host[0] < latest:
            host = np.maximum(host, latest)
        if len(host) > 1 and self._is_cautious:
            host = np.maximum.accumulate(host)
        if len(host):
            self._published[source] = int(host[-1])
        return host

    # -- steps

    def _row_by_row(self, rows: _Rows, sent: Array, waited: Array) -> Ints:
        """Check rows one by one when some do not fit the mapping."""
        self._is_cautious = True
        n = len(rows)
        sources = np.broadcast_to(rows.source, n).tolist()
        sizes = np.broadcast_to(rows.size, n).tolist()
        out = np.empty(n, np.int64)
        each = zip(rows.device.tolist(), sent.tolist(), rows.arrival.tolist(), sources, sizes, strict=True)
        for row, (d, s, a, source, size) in enumerate(each):
            now = self._now
            assert now is not None
            x = float(d - now.origin)
            delay = float(s - now.host_origin) - x - now.slope * x - now.intercept
            back = d < self._running.get(source, FIRST_NS)
            if delay < -now.step_ns or (back and delay > now.step_ns):
                of = self._check_outliers(d, s, a)
            else:
                self._forget()
                wait = waited[row : row + 1]
                now.update(np.array([x]), np.array([delay]), a, size, wait, judged=source == self._main)
                self._running[source] = d
                of = now
            out[row] = of.host(np.array([d]))[0]
        return out

    def _check_outliers(self, device: int, sent: int, arrival: int) -> ClockModel:
        """Handle a row that the mapping cannot explain: start or confirm another mapping, which is returned."""
        new = self._candidate
        if new is not None:
            x = float(device - new.origin)
            delay = float(sent - new.host_origin) - x - new.intercept
            if delay < -FAR_NS:
                new = None  # not even its predecessor explains it
            elif delay < FAR_NS:
                new.update(np.array([x]), np.array([delay]), arrival)
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
        """A mapping that begins with this row, without running backwards in host time."""
        new = self._mapping(device, sent)
        new.update(np.zeros(1), np.zeros(1), arrival)
        if self._now is not None:
            new.begin_at(max(0.0, self._now.last_host() - float(sent)))
        return new

    def _switch(self, new: ClockModel) -> None:
        self.restarts += 1
        self.discontinuities.append(new.first_host() / 1e9)
        if self._now is not None:
            new.late.stalls.extend(self._now.late.stalls)
        self._now, self._before = new, self._now
        self._last.clear()
        self._running.clear()
        self._forget()

    def _forget(self) -> None:
        """Drop the candidate mapping."""
        self._candidate, self._candidate_rows = None, 0

    # -- results -------------------------------------------------------------------------------------------------------

    @property
    def drift_ppm(self) -> float:
        """Rate of the device's clock against the host's, parts per million; 0 during the first seconds."""
        return -self._now.slope / (1 + self._now.slope) * 1e6 if self._now else 0.0

    @property
    def drift_bound_ppm(self) -> float:
        """± of `drift_ppm`, if the delays of frames do not grow or shrink all along."""
        return self._now.drift_bound() * 1e6 if self._now else float("inf")

    @property
    def knows_drift(self) -> bool:
        """Whether the clock has been observed for long enough to know its drift: some ten seconds since it started."""
        return self._now is not None and self._now.knows_drift

    @property
    def uncertainty_ns(self) -> float:
        """± of the mapping. Infinite before the first row."""
        return self._now.uncertainty() if self._now else float("inf")

    @property
    def presumes(self) -> str:
        """Condition under which ± holds, which arrivals cannot show; "" if everything unknown is part of it."""
        if self._unknown_ns:
            return "if the network does not delay all frames alike"
        return "" if self.holds_ns or not self._now else "if not all frames are delayed alike"

    @property
    def rows(self) -> int:
        """Number of delays in the model."""
        return self._now.late.rows if self._now else 0

    @property
    def spread(self) -> DelaySpread:
        """Spread of the delays in the last seconds."""
        return self._now.spread if self._now else DelaySpread()

    @property
    def stalls(self) -> list[tuple[int, float]]:
        """(arrival in unix ns, delay in ns) of the latest stalls, after which frames arrived all at once."""
        return list(self._now.late.stalls) if self._now else []

    @property
    def late_ns(self) -> float:
        """Delay of the newest frame against the mapping, ns; 0 while there are too few."""
        return max(0.0, self._now.late.newest) if self._now and self._now.late.rows >= MIN_DELAYS else 0.0

    def jitter_ns(self, p: float = 99) -> float:
        """The `p`-th percentile of the delays of the last seconds: arrival against the mapping."""
        return self._now.jitter(p) if self._now else 0.0
