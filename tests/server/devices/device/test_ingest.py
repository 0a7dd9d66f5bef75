"""Host times of one batch, the usual case, are those of the way for any number of batches, bit for bit."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.clocks.chunk_boundaries import ChunkBoundaries
from imuscope.protocols.clocks.clock_sync import ClockSync
from imuscope.protocols.events import Batch, ClockStep
from imuscope.server.devices.device.ingest import Ingest, LinkTiming
from tests.support.fakes import MESSAGE

SIZE, PERIOD_NS, BYTE_NS = 60, 2_500_000, 5_000


def intake(speed: float) -> Ingest:
    """An intake of which only the clock is used."""
    made = object.__new__(Ingest)
    made._line = LinkTiming(BYTE_NS, kind="serial", speed=speed)
    made._clock_set_ns, made._breaks = 0, []
    made.clock = ClockSync(BYTE_NS, pieces=ChunkBoundaries())
    return made


@given(
    turns=st.lists(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 10**7)), min_size=1, max_size=6), max_size=8),
    jump=st.sampled_from([0, 0, -(10**9), 10**10]),
    speed=st.sampled_from([1.0, 2.0]),
)
def test_one_batch_is_mapped_as_several_are(turns: list[list[tuple[int, int]]], jump: int, speed: float) -> None:
    one, several = intake(speed), intake(speed)
    device, arrival, offset = 10**12, 17 * 10**17, 0
    for number, turn in enumerate(turns):
        times, arrivals, offsets = [], [], []
        for skipped, late in turn:
            device += PERIOD_NS * (1 + skipped) + (jump if number == 4 else 0)
            arrival += PERIOD_NS * (1 + skipped)
            offset += SIZE
            times.append(device)
            arrivals.append(arrival + late)
            offsets.append(offset)
            for each in (one, several):
                assert each.clock._pieces is not None
                each.clock._pieces.add(offset + SIZE, arrival + late)
        rows = [np.array(values, np.int64) for values in (np.maximum.accumulate(arrivals), offsets, times)]
        batch = Batch(MESSAGE, "", *rows, {}, size=SIZE)
        (result,) = one._host_times([batch], [])
        (expected,) = several._host_times([batch], [ClockStep(0, "reset", 0, 0)])  # reported, without a change of times
        assert result.tobytes() == expected.tobytes()
    assert one._breaks == several._breaks
