"""Frames of one sample: which frames of a stream are a sample group.

    SampleTime PacketCounter Quaternion Acceleration │ SampleTime PacketCounter Quaternion │ …

A group begins at SampleTime, at a PacketCounter or UtcTime that others stand before, at a message that it has already,
and after a pause. Each frame is decided from those before it alone.
"""

from __future__ import annotations

from imuscope.protocols.arrays import Ints
from imuscope.protocols.native.kernels import INT, INTS, compiled

MASK, LAST, COUNT = range(3)
"""Of the state: messages of the open group as bits, arrival of its newest frame, groups begun so far."""
STATES = 3
PAUSE_NS = 50_000_000
"""Within a group: some 15 frames on a bus of 125 kbit/s that others use as well take 30 ms."""


@compiled(INT, INTS, INTS, INT, INTS, INTS)
def group_frames(ranks: Ints, arrivals: Ints, heads: int, state: Ints, out: Ints) -> int:
    """Number the groups of frames, continuing from the state.

    Args:
        ranks: (n,) place of each frame's message in the order in which a device sends them.
        arrivals: (n,) ns.
        heads: ranks, as bits, of the messages that stand first in a group.
        out: (n,), written: number of the group of each frame.

    Returns:
        the number of the open group.
    """
    for k in range(len(ranks)):
        bit = 1 << ranks[k]
        mask = state[MASK]
        passed = arrivals[k] - state[LAST]
        begins = mask & bit != 0 or mask == 0 or passed > PAUSE_NS or passed < -PAUSE_NS
        if heads & bit != 0 and mask >= bit:
            begins = True
        if begins:
            state[COUNT] += 1
            state[MASK] = 0
        state[MASK] |= bit
        state[LAST] = arrivals[k]
        out[k] = state[COUNT]
    return int(state[COUNT])
