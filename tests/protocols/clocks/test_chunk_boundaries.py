"""A frame that spans chunks has the arrival time of its first bytes."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.clocks.chunk_boundaries import ChunkBoundaries
from imuscope.protocols.clocks.clock_sync import ClockSync
from tests.protocols.clocks.timing_model import MS, PACKET, ModelDevice, Way, errors, mapped, settled, stream
from tests.support.each_row import each_row

BYTE_NS = 1000.0


@given(
    st.lists(st.tuples(st.integers(1, 30), st.integers(0, 50_000)), min_size=1, max_size=120),
    st.lists(st.integers(1, 60), min_size=1, max_size=60),
    st.integers(0, 5),
    st.booleans(),
)
def test_it_equals_the_byte_by_byte_result(
    chunks: list[tuple[int, int]], sizes: list[int], forgotten: int, at_once: bool
) -> None:
    """The oracle: each byte has an arrival; a frame began no later than any end of a piece inside it allows."""
    ends = np.cumsum([size for size, _ in chunks])
    came = np.cumsum([after for _, after in chunks]) + 10**18
    pieces = ChunkBoundaries()
    if at_once:
        pieces.add_many(ends[:2], came[:2])
    for end, arrival in zip(ends[2 * at_once :].tolist(), came[2 * at_once :].tolist(), strict=True):
        pieces.add(end, arrival)
    begins = np.cumsum([0, *sizes])
    whole = [i for i, size in enumerate(sizes) if begins[i] + size <= ends[-1]][forgotten:]
    if not whole:
        return
    pieces.forget(int(begins[whole[0]]))
    offset, size = begins[whole], np.array(sizes)[whole]
    arrival_of = np.repeat(came, [size for size, _ in chunks])
    latest = arrival_of[offset + size - 1] - (size * BYTE_NS).astype(np.int64)
    expected = []
    for at, count, last in zip(offset.tolist(), size.tolist(), latest.tolist(), strict=True):
        first = next((k for k in range(count - 1) if at + k + 1 in ends), None)
        early = last if first is None else int(arrival_of[at + first]) - round((first + 1) * BYTE_NS)
        expected.append(min(last, early))
    assert pieces.sent(offset, size, latest, BYTE_NS).tolist() == expected


def test_unneeded_chunks_are_dropped() -> None:
    pieces = ChunkBoundaries()
    for k in range(1, 1000):
        pieces.add(10 * k, k)
        pieces.forget(10 * k - 5)
        assert len(pieces) <= 2
    assert ChunkBoundaries().sent(np.array([0]), 10, np.array([5]), BYTE_NS).tolist() == [5]


@each_row(("baud", "rate", "size"), [(921_600, 50, 220), (460_800, 40, 100), (115_200, 20, 150)])
def test_a_tail_that_always_waits_for_the_timer_adds_no_offset(baud: int, rate: int, size: int) -> None:
    """The last bytes of every frame are delayed by the same 16 ms, which is unknown; the first packet, full at once,
    gives the true time.
    """
    assert 1000 / rate > 16
    assert size % PACKET
    way = Way(baud, timer_ms=16)
    source = stream(ModelDevice(((rate, size),), ppm=40), way, 25, seed=1)
    late = settled(source)
    report = mapped(source)
    assert np.ptp(errors(source, report)[late]) < 0.1 * MS
    assert np.abs(errors(source, report)[late]).max() < 0.2 * MS
    assert report.clock.spread.bursts, "and what the adapter does is seen"
    blind = mapped(source, ClockSync(source.byte_ns))
    assert np.abs(errors(source, blind)[late]).min() > 13 * MS
