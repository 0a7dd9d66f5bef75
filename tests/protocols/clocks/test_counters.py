"""Unwrapped counters, and the losses they show."""

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from imuscope.protocols.clocks.counters import SequenceCounter, TickUnwrapper
from tests.support.each_row import each_row

MS = 1e6
EPOCH_NS = 1_767_225_600 * 10**9
DAY, FULL = 864_000_000, 2**32
Times = NDArray[np.int64]


# -- unwrapping --------------------------------------------------------------------------------------------------------


@each_row("wrap", [DAY, FULL])
@each_row("chunk", [1, 7, 1000])
def test_the_modulus_is_learned_where_the_clock_wraps(wrap: int, chunk: int) -> None:
    clock = TickUnwrapper(FULL, auto=(DAY,), tick_ns=100_000)
    raw = np.arange(wrap - 10_000, wrap + 10_000, 25) % wrap
    out = np.concatenate([clock.ticks(raw[at : at + chunk]) for at in range(0, len(raw), chunk)])
    assert set(np.diff(out).tolist()) == {25}
    assert out[0] == wrap - 10_000
    assert clock.wrap == wrap
    assert clock.steps == []


def test_a_product_decides_the_modulus() -> None:
    clock = TickUnwrapper(FULL, auto=(DAY,), tick_ns=100_000)
    clock.set_wrap(DAY)
    assert clock.ticks(np.array([DAY - 100, 0, 100])).tolist() == [DAY - 100, DAY, DAY + 100]


def test_a_row_from_before_the_wrap_keeps_its_time() -> None:
    clock = TickUnwrapper(FULL, tick_ns=100_000)
    out = clock.ticks(np.array([FULL - 200, FULL - 100, 0, FULL - 25_000, 100]))
    assert (out - FULL).tolist() == [-200, -100, 0, -25_000, 100]
    assert clock.steps == []


def test_old_rows_of_the_capture_are_neither_wrap_nor_reset(captures: Path) -> None:
    """mti_100hz_49s.bin: a GNSS solution every quarter of a second carries a time 2.5 s older than its neighbours'."""
    from imuscope.protocols.events import ClockStep, SampleGap, batches
    from imuscope.protocols.xbus.decoder import XbusDecoder

    decoder = XbusDecoder()
    decoder.feed((captures / "xbus" / "mti_100hz_49s.bin").read_bytes(), 0)
    events = decoder.drain(stalled=True)
    assert not [event for event in events if isinstance(event, SampleGap | ClockStep)]
    for batch in batches(events):
        if batch.time_ns is None:  # a GNSS solution without a fix: its clock is arbitrary
            assert "GnssPvtData" in batch.columns
            continue
        assert (batch.time_ns == batch.columns["SampleTimeFine"].astype(np.int64) * 100_000).all()


@each_row("chunk", [1, 5, 100])
def test_a_restart_is_one_reset(chunk: int) -> None:
    clock = TickUnwrapper(FULL, tick_ns=100_000)
    raw = np.concatenate([np.arange(300_000, 305_000, 25), np.arange(40, 5000, 25)])
    steps, out = [], []
    for at in range(0, len(raw), chunk):
        out.append(clock.ticks(raw[at : at + chunk]))
        steps += [(at + row, kind, by) for row, kind, by in clock.steps]
    assert (np.concatenate(out) == raw).all()
    assert [kind for _, kind, _ in steps] == ["reset"]
    assert 200 <= steps[0][0] < 210  # known within eight rows
    assert -305_000 < steps[0][2] < -304_000


def test_arrival_times_distinguish_jumps_from_outages() -> None:
    outage, jump = TickUnwrapper(FULL, tick_ns=100_000), TickUnwrapper(FULL, tick_ns=100_000)
    raw = np.array([0, 100, 200, 600_200, 600_300])
    late = np.array([0, 10, 20, 60_020, 60_030]) * 10**6 + EPOCH_NS
    assert outage.ticks(raw, late).tolist() == raw.tolist()
    assert outage.steps == []
    assert jump.ticks(raw, np.arange(5) * 10**7 + EPOCH_NS).tolist() == raw.tolist()
    assert jump.steps == [(3, "jump", 599_900)]


@given(st.lists(st.integers(0, FULL - 1), max_size=60), st.lists(st.integers(1, 9), max_size=30))
def test_any_ticks_unwrap_to_themselves_modulo_the_wrap(raw: list[int], cuts: list[int]) -> None:
    clock = TickUnwrapper(FULL, tick_ns=100_000)
    values = np.array(raw, np.uint32)
    at = 0
    for size in [*cuts, len(raw)]:
        part = values[at : at + size]
        assert ((clock.ticks(part) - part) % FULL == 0).all()
        at += size


@given(st.lists(st.integers(0, 2000), min_size=1, max_size=80), st.integers(0, FULL - 1), st.integers(1, 20))
def test_ticks_that_only_advance_are_followed_over_any_wrap(advance: list[int], first: int, chunk: int) -> None:
    clock = TickUnwrapper(FULL, tick_ns=100_000)
    true = first + np.cumsum(advance)
    out = np.concatenate([clock.ticks(true[at : at + chunk] % FULL) for at in range(0, len(true), chunk)])
    assert (np.diff(out) == np.diff(true)).all()


# -- counting ----------------------------------------------------------------------------------------------------------


def test_lost_frames_are_counted_over_the_wrap() -> None:
    counter = SequenceCounter(65536)
    assert counter.missing(np.array([65533, 65534, 1, 2, 6])).tolist() == [0, 0, 2, 0, 3]
    assert counter.missing(np.array([7, 9])).tolist() == [0, 1]


def test_a_restart_loses_nothing() -> None:
    counter = SequenceCounter(65536)
    assert counter.missing(np.array([40_000, 40_001, 0, 1, 2])).tolist() == [0] * 5
    assert counter.restarts == [2]
    assert counter.missing(np.array([3, 50_000])).tolist() == [0, 0]
    assert counter.restarts == [1]


def test_a_row_seen_again_loses_nothing() -> None:
    assert SequenceCounter(65536).missing(np.array([10, 11, 11, 12, 11, 13])).tolist() == [0] * 6


def test_only_the_next_number_follows() -> None:
    counter = SequenceCounter(65536)
    assert not counter.follows(65534)  # nothing is known yet
    counter.missing(np.array([65534]))
    assert [counter.follows(n) for n in (65535, 0, 0, 2, 1)] == [True, True, False, False, True]
    assert counter.missing(np.array([3, 4])).tolist() == [1, 0]


@given(st.sets(st.integers(0, 999)), st.integers(0, 65535), st.integers(1, 50))
def test_missing_numbers_add_up(lost: set[int], first: int, chunk: int) -> None:
    rows = np.array([n for n in range(1001) if n not in lost or n in (0, 1000)])
    gaps = np.diff(rows) - 1
    if gaps.max() >= 256:
        return
    counter = SequenceCounter(65536)
    numbers = (rows + first) % 65536
    out = np.concatenate([counter.missing(numbers[at : at + chunk]) for at in range(0, len(numbers), chunk)])
    assert (out[1:] == gaps).all()
    assert out[0] == 0
