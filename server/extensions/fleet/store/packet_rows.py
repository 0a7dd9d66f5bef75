"""Rows of packets: which samples of a message's channels came in the same packet.

A packet has fields that others of its message do not have: a magnetometer at a quarter of the rate, a pressure once a
second. Each field is a channel, with a sample for each packet that has it:

    packet           0  1  2  3  4  5  6  7
    Acceleration     0  1  2  3  4  5  6  7     row of its samples
    MagneticField    0           4
    BaroPressure           2           6

Samples are of one packet if arrival and time are the same. Packets that arrived at once, of a device without a clock,
have both in common; their samples are distinguished by their order alone, so which of them had an optional field is not
known, and the first one is taken.

Rows are found window by window, so that memory does not grow with the recording. A window ends before the least of the
last arrivals that its channels have in it: all samples of its packets are then within it. Arrivals that go back, after
a step of the host's clock, are taken as one window.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.store import ColumnStore

Rows = NDArray[np.intp]

WINDOW_SAMPLES = 1 << 17  # samples of a channel at once


@dataclass(frozen=True, slots=True)
class PacketWindow:
    """Packets, and the samples in them.

    Args:
        time: (n,) float64, unix s, non-decreasing.
        order: (n,) number of a packet among those of its arrival and time, from 0.
        samples: for each channel the first sample and one past the last, and the row of each of them.
    """

    time: Floats
    order: NDArray[np.int64]
    samples: dict[int, tuple[int, int, Rows]]


def packet_windows(
    store: ColumnStore, tracks: Sequence[Sequence[int]], size: int = WINDOW_SAMPLES
) -> Iterator[PacketWindow]:
    """The packets of a message, in order.

    Args:
        tracks: channels; those of one track are never in the same packet.
        size: samples of a channel in a window.
    """
    channels = [channel for track in tracks for channel in track]
    if not all(_is_ascending(store, channel) for channel in channels):
        size = max(store.rows(channel) for channel in channels)
    at = dict.fromkeys(channels, 0)
    newest = -np.inf
    while left := [channel for channel in channels if at[channel] < store.rows(channel)]:
        ranges: dict[int, tuple[int, int]] = {}
        wider = size
        while not any(lo < hi for lo, hi in ranges.values()):  # so many arrived at once
            ranges = _ranges(store, left, at, wider)
            wider *= 2
        window = _window(store, [[one for one in track if one in ranges] for track in tracks], ranges, newest)
        newest = float(window.time[-1])
        at.update({channel: hi for channel, (_, hi) in ranges.items()})
        yield window


def _is_ascending(store: ColumnStore, channel: int) -> bool:
    last = -np.inf
    for lo in range(0, store.rows(channel), WINDOW_SAMPLES):
        arrival = store.clock(channel, lo, lo + WINDOW_SAMPLES, "arrival")
        if arrival[0] < last or (np.diff(arrival) < 0).any():
            return False
        last = arrival[-1]
    return True


def _ranges(store: ColumnStore, channels: list[int], at: dict[int, int], size: int) -> dict[int, tuple[int, int]]:
    """First sample and one past the last of each channel that arrived before the end of a window."""
    arrivals = {channel: store.clock(channel, at[channel], at[channel] + size, "arrival") for channel in channels}
    cut = [part[-1] for channel, part in arrivals.items() if at[channel] + size < store.rows(channel)]
    ends = {
        channel: int(np.searchsorted(part, min(cut), "left")) if cut else len(part)
        for channel, part in arrivals.items()
    }
    return {channel: (at[channel], at[channel] + end) for channel, end in ends.items()}


def _window(
    store: ColumnStore, tracks: list[list[int]], ranges: dict[int, tuple[int, int]], newest: float
) -> PacketWindow:
    clocks: list[tuple[Floats, Floats]] = []  # most channels have those of another one
    clock_of: list[int] = []
    for track in tracks:
        parts = [
            np.concatenate([store.clock(one, *ranges[one], name) for one in track] or [np.empty(0)])
            for name in ("arrival", "time")
        ]
        index = next((n for n, known in enumerate(clocks) if _are_same(known, parts)), len(clocks))
        if index == len(clocks):
            clocks.append((parts[0], parts[1]))
        clock_of.append(index)
    time, order, rows = _joined(clocks)
    samples = {}
    for track, which in zip(tracks, clock_of, strict=True):
        first = 0
        for channel in track:
            lo, hi = ranges[channel]
            samples[channel] = lo, hi, rows[which][first : first + hi - lo]
            first += hi - lo
    return PacketWindow(np.maximum.accumulate(np.maximum(time, newest)), order, samples)


def _are_same(known: Sequence[Floats], parts: Sequence[Floats]) -> bool:
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(known, parts, strict=True))


def _joined(clocks: Sequence[tuple[Floats, Floats]]) -> tuple[Floats, NDArray[np.int64], list[Rows]]:
    """Time of each packet, its number among those of its clocks, and for each clock the packets of its samples."""
    arrival = np.concatenate([one[0] for one in clocks])
    stated = np.concatenate([one[1] for one in clocks])
    time = np.where(np.isnan(stated), arrival, stated)
    source = np.repeat(np.arange(len(clocks)), [len(one[0]) for one in clocks])
    by_source = np.lexsort((time, arrival, source))  # stable: samples of the same clocks keep their order
    order = np.empty(len(time), np.int64)
    order[by_source] = _count_repeats(source[by_source], arrival[by_source], time[by_source])
    by_packet = np.lexsort((order, time, arrival))
    is_first = _differs(arrival[by_packet], time[by_packet], order[by_packet])
    row = np.empty(len(time), np.intp)
    row[by_packet] = np.cumsum(is_first) - 1
    firsts = by_packet[is_first]
    return time[firsts], order[firsts], np.split(row, np.cumsum([len(one[0]) for one in clocks])[:-1])


def _differs(*columns: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether a row differs from the one before."""
    out = np.ones(len(columns[0]), bool)
    out[1:] = np.any([column[1:] != column[:-1] for column in columns], axis=0)
    return out


def _count_repeats(*columns: NDArray[Any]) -> NDArray[np.int64]:
    """Number of rows right before that are the same."""
    places = np.arange(len(columns[0]))
    return places - np.maximum.accumulate(np.where(_differs(*columns), places, 0))
