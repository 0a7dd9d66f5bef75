"""Common beat of periodic work, so that one wake-up of the event loop serves all of it.

    beats      |    |    |    |    |    |    |    |        multiples of an interval, by the loop's clock
    sessions   x    x    x    x    x    x    x    x        5 Hz without viewers, else 10 Hz
    decoding   x    x    x    x    x    x    x    x        5 Hz without viewers
    date       x                                           1 Hz

On a small computer a wake-up costs more than most of this work, and a turn of decoding as much as fifty samples in it.
"""

import asyncio
import math

UNWATCHED_S = 0.2  # between two turns without viewers: nothing is needed sooner
EARLY_SHARE = 0.1  # of an interval: a timer may be early by the resolution of the clock, and is not repeated then


def next_beat(now: float, interval: float) -> float:
    """The next multiple of an interval, by the loop's clock, s."""
    return (math.floor(now / interval + EARLY_SHARE) + 1) * interval


async def beat(interval: float) -> None:
    """Wait for the next beat."""
    now = asyncio.get_running_loop().time()
    await asyncio.sleep(next_beat(now, interval) - now)
