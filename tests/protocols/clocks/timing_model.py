"""Timing model: arrival of a frame whose device, line, adapter and host are known to the nanosecond.

A simulator for tests of the clock mapping: it knows the truth, which no real link tells.

    device ──────────> line ───────────────> adapter ───────────> host
    sample at `true`,  bytes × 10 ÷ baud;    hands over at 62     reads a little later;
    stamped by its     frames queue behind   bytes or when its    now and then much later
    own clock          each other            timer runs out

Truth is the end of the frame on the wire: `true` is that of a frame which meets nothing on its way, less the time that
its own bytes take (which the mapping subtracts as well, so that frames of any size fall on one line).

Source: FTDI, AN232B-04 "Data Throughput, Latency and Handshaking", sections 3.2 and 3.3: 62 bytes of payload in a
packet of 64; the latency timer starts anew with each packet.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.protocols.clocks.chunk_boundaries import ChunkBoundaries
from imuscope.protocols.clocks.clock_sync import ClockSync, TimedRows

Times = NDArray[np.int64]

EPOCH_NS = 1_700_000_000 * 10**9
US, MS, S = 1e3, 1e6, 1e9
PACKET = 62  # bytes that an FTDI adapter hands over at once


@dataclass(frozen=True)
class ModelDevice:
    """Sampling of the simulated device.

    Args:
        messages: (samples/s, bytes of the frame) of each.
        ppm: by which its clock runs faster than the host's.
        tick_ns: of its clock: 100 µs in an MTi, 1 µs in IDTP.
        jitter_us: mean time from the time stamp to the first byte.
        first_ns: its clock at the start.
    """

    messages: Sequence[tuple[float, int]] = ((100, 88),)
    ppm: float = 0.0
    tick_ns: int = 1000
    jitter_us: float = 20.0
    first_ns: int = 7 * 10**9


@dataclass(frozen=True)
class Way:
    """What lies between device and host.

    Args:
        baud: of the line; 0: bytes take no time.
        timer_ms: of the adapter; 0: there is none.
        timer_ppm: how slow the adapter's own clock is.
        wake_us: mean time until the host reads.
        network_ms: mean of what a network adds.
        stalls: (begin, end) in s: the host reads nothing in between.
        loss: share of frames that do not arrive.
    """

    baud: int = 115_200
    timer_ms: float = 0.0
    timer_ppm: float = 17.0
    wake_us: float = 40.0
    network_ms: float = 0.0
    stalls: Sequence[tuple[float, float]] = ()
    loss: float = 0.0

    @property
    def byte_ns(self) -> float:
        return 10 * S / self.baud if self.baud else 0.0


@dataclass(frozen=True)
class ModelStream:
    """Frames in the order of the stream; `true` in ns after the epoch of the test, `arrival` in unix ns.

    `ends`, `came`: where what the host read at once ended in the stream, and when it did, unix ns.
    """

    true: Floats
    device: Times
    arrival: Times
    size: Times
    byte_ns: float
    ends: Times
    came: Times

    def __len__(self) -> int:
        return len(self.true)

    def pieces(self) -> ChunkBoundaries:
        """Their properties as known to a session."""
        pieces = ChunkBoundaries()
        pieces.add_many(self.ends, self.came)
        return pieces


def stream(device: ModelDevice, way: Way, seconds: float, seed: int = 0) -> ModelStream:
    """Output of a device during a time."""
    random = np.random.default_rng(seed)
    true, size = [], []
    for rate, frame in device.messages:
        count = int(rate * seconds)
        true.append((np.arange(count) / rate + random.uniform(0, 0.5) / rate) * S / (1 + device.ppm * 1e-6))
        size.append(np.full(count, frame))
    order = np.argsort(np.concatenate(true), kind="stable")
    truth, sizes = np.concatenate(true)[order], np.concatenate(size)[order]
    stamp = device.first_ns + truth * (1 + device.ppm * 1e-6)
    stamps = (stamp // device.tick_ns * device.tick_ns).astype(np.int64)
    ready = np.maximum.accumulate(truth + random.exponential(device.jitter_us * US, len(truth)))
    end = _on_the_line(ready, sizes * way.byte_ns)
    places = np.cumsum(sizes)
    packets, ends = end, places
    if way.timer_ms:
        packets, ends = _through_the_adapter(end, sizes, way, random.uniform(0, way.timer_ms))
    came = (EPOCH_NS + _to_the_host(packets, way, random)).astype(np.int64)
    arrivals = came[np.searchsorted(ends, places)]
    stored = random.random(len(truth)) >= way.loss
    ends = np.interp(ends, np.append(0, places), np.append(0, np.cumsum(sizes * stored))).round().astype(np.int64)
    return ModelStream(truth[stored], stamps[stored], arrivals[stored], sizes[stored], way.byte_ns, ends, came)


def _on_the_line(ready: Floats, takes: Floats) -> Floats:
    """Time of the last byte of each frame on the line; frames are sent one after the other."""
    before = np.concatenate([[0.0], np.cumsum(takes)[:-1]])
    return np.asarray(np.maximum.accumulate(ready - before) + before + takes)


def _through_the_adapter(end: Floats, size: Times, way: Way, phase_ms: float) -> tuple[Floats, Times]:
    """Time at which each packet leaves, and the number of bytes of the stream sent with it."""
    timer, byte = way.timer_ms * MS * (1 + way.timer_ppm * 1e-6), way.byte_ns
    packets, ends = [], []
    last = phase_ms * MS - timer  # when the timer was started
    held, gone = 0, 0  # bytes in the adapter; those that have left it
    for finish, count in zip(end.tolist(), size.tolist(), strict=True):
        begin, left = finish - count * byte, count
        while True:
            if held == 0:
                last += max(0.0, (begin + byte - last) // timer) * timer
            expires = last + timer
            room = PACKET - held
            full = begin + room * byte
            if left >= room and full <= expires:
                packet_end, batch = full, room
            else:
                batch = min(left, max(0, int((expires - begin) / byte))) if byte else left
                if batch == left and begin + left * byte <= expires:
                    held += left
                    break
                packet_end = expires
            begin, left = begin + batch * byte, left - batch
            gone += held + batch
            packets.append(packet_end)
            ends.append(gone)
            held, last = 0, packet_end
            if left == 0:
                break
    if held:
        packets.append(last + timer)
        ends.append(gone + held)
    return np.array(packets), np.array(ends, np.int64)


def _to_the_host(packets: Floats, way: Way, random: np.random.Generator) -> Floats:
    """Time at which the reading thread has the bytes."""
    packets = packets + random.exponential(way.wake_us * US, len(packets))
    if way.network_ms:
        packets += 0.3 * MS + random.exponential(way.network_ms * MS, len(packets))
    packets = np.maximum.accumulate(packets)
    for begin, over in way.stalls:
        packets = np.where((packets >= begin * S) & (packets < over * S), over * S, packets)
    return np.asarray(np.maximum.accumulate(packets))


def stepped(source: ModelStream, at_s: float, by_s: float) -> ModelStream:
    """The device's clock moves by so much at that time."""
    device = source.device + np.where(source.true >= at_s * S, round(by_s * S), 0)
    return replace(source, device=device)


def reset(source: ModelStream, at_s: float, away_s: float = 0.4) -> ModelStream:
    """The device starts again: silent for a while, then its clock counts from zero."""
    entries = (source.true < at_s * S) | (source.true >= (at_s + away_s) * S)
    after = source.true[entries] >= at_s * S
    device = source.device[entries]
    if after.any():
        device = device - np.where(after, device[after.argmax()] - 100_000, 0)
    places = np.append(0, np.cumsum(source.size))
    ends = np.interp(source.ends, places, np.append(0, np.cumsum(source.size * entries))).round().astype(np.int64)
    arrival, size = source.arrival[entries], source.size[entries]
    return ModelStream(source.true[entries], device, arrival, size, source.byte_ns, ends, source.came)


# -- what a clock makes of it ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ModelMapping:
    """Per row, as first published: host time and ±, in ns; and the number of mapping restarts until then."""

    host: Floats
    bound: Floats
    restarts: Times
    clock: ClockSync


def mapped(source: ModelStream, clock: ClockSync | None = None, *, drain_ms: float = 100) -> ModelMapping:
    """Feed a clock as a session does, with the arrived rows of each message.

    Ten times a second, as without viewers; the interval makes no significant difference, which a separate test
    checks.
    """
    clock = clock or ClockSync(source.byte_ns, pieces=source.pieces())
    ends = np.flatnonzero(np.diff(source.arrival // int(drain_ms * MS))) + 1
    host, bound, restarts = np.empty(len(source)), np.empty(len(source)), np.empty(len(source), np.int64)
    offset = np.cumsum(source.size) - source.size
    for first, last in zip([0, *ends.tolist()], [*ends.tolist(), len(source)], strict=True):
        parts, rows = [], []
        for size in np.unique(source.size[first:last]).tolist():
            which = first + np.flatnonzero(source.size[first:last] == size)
            rows.append(which)
            parts.append(TimedRows(source.device[which], source.arrival[which], offset[which], size, size))
        for which, times in zip(rows, clock.map_to_host(parts), strict=True):
            host[which] = times - EPOCH_NS
        bound[first:last], restarts[first:last] = clock.uncertainty_ns, clock.restarts
    return ModelMapping(host, bound, restarts, clock)


def errors(source: ModelStream, report: ModelMapping) -> Floats:
    """Mapped time against truth, ns."""
    return np.asarray(report.host - source.true)


def settled(source: ModelStream, since_s: float = 10.0, begins: Sequence[float] = (0.0,)) -> NDArray[np.bool_]:
    """Rows that come that long after each beginning (a start, a jump, a reset), and before the next."""
    keep = np.zeros(len(source), bool)
    for begin, over in zip(begins, [*begins[1:], np.inf], strict=True):
        keep |= (source.true >= (begin + since_s) * S) & (source.true < over * S)
    return keep
