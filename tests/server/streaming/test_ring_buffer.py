"""The ring keeps the newest samples, exactly, in bounded memory."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.streaming.ring_buffer import RingBuffer
from imuscope.server.wire.codec import decode_samples

DTYPES = ["f4", "f4", "u1", "i8", "u2"]


def rows(start: int, n: int) -> list[np.ndarray]:
    """Samples numbered from `start`, which each column shows in its own way."""
    k = np.arange(start, start + n)
    return [k * 0.01, k * 0.01 + 5, k.astype("f4"), -k.astype("f4"), (k % 251).astype("u1"), k * 2**33, k.astype("u2")]


@given(st.lists(st.integers(1, 300), min_size=1, max_size=12), st.data())
def test_stored_samples_are_returned(sizes: list[int], data: st.DataObject) -> None:
    ring = RingBuffer(DTYPES)
    for size in sizes:
        ring.append(rows(ring.total, size))
    assert ring.total == sum(sizes)
    for expected, got in zip(rows(0, ring.total), ring.read(), strict=True):
        np.testing.assert_array_equal(expected, got)
    some = data.draw(st.sets(st.sampled_from(range(len(DTYPES)))))
    first = data.draw(st.integers(0, ring.total + 1))
    whole = ring.read(first)
    for expected, got in zip([whole[at] for at in sorted(some)], ring.read(first, some), strict=True):
        np.testing.assert_array_equal(expected, got)
        assert expected.dtype == got.dtype
    start = data.draw(st.integers(0, ring.total))
    stop = data.draw(st.integers(start, ring.total))
    at = start
    for n, frame in ring.frames(3, start, stop, 1.0) if start < stop else ():
        (result,) = decode_samples(frame, {3: DTYPES})
        assert (result.sequence, result.n, result.history) == (at, n, False)
        for expected, got in zip(rows(at, n), result.columns, strict=True):
            np.testing.assert_array_equal(expected, got)
        at += n
    assert at == stop


@given(st.integers(1, 5000), st.integers(0, 5000), st.integers(0, 8))
def test_history_is_contiguous_backwards(total: int, start: int, dropped: int) -> None:
    """Each frame ends where the one before it began, until the oldest sample that is kept."""
    ring = RingBuffer(DTYPES)
    ring.append(rows(0, total))
    for _ in range(dropped):
        ring.drop_oldest()
    stop = total
    while (result := ring.history_frame(1, start, stop, 1.0)) is not None:
        began, arrival, frame = result
        (samples,) = decode_samples(frame, {1: DTYPES})
        assert samples.history
        assert began == samples.sequence
        assert began + samples.n == stop
        assert arrival == samples.columns[0][0] == began * 0.01
        stop = began
    assert stop == max(min(start, total), ring.first)


def test_memory_is_bounded_by_time() -> None:
    ring = RingBuffer(DTYPES)
    for _ in range(400):
        ring.append(rows(ring.total, 500))
        ring.drop_before(ring.total * 0.01 - 60)
        assert ring.nbytes < 6000 * ring.sample_bytes * 3
    assert len(ring) >= 6000
    assert ring.nbytes == sum(block.nbytes for block in ring._blocks)


def test_the_newest_block_always_stays() -> None:
    ring = RingBuffer(["f4"])
    ring.append([np.zeros(3)] * 3)
    ring.drop_oldest()
    ring.drop_before(1e18)
    assert len(ring) == 3


@given(st.integers(1, 2000), st.floats(-1, 25))
def test_sequence_at(total: int, arrival: float) -> None:
    ring = RingBuffer(DTYPES)
    ring.append(rows(0, total))
    assert ring.sequence_at(arrival) == int(np.searchsorted(np.arange(total) * 0.01, arrival))
