"""Time of a live device: the clocks of the bytes in memory, and sentences on how they arrive."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.schema.plural import counted
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.tables.clocks.steps import duration_text
from imuscope.server.extensions.clocks.figures import FileClock, MessageClocks, clocks_of
from imuscope.server.extensions.clocks.memory_source import MemorySource

BURSTY = 0.02  # share of samples, from which bursts are reported


@dataclass(frozen=True, slots=True)
class LiveTime:
    """Time of a live device, over its bytes in memory.

    Args:
        start, end: arrival of the first and the last chunk, unix s.
        sentences: how the bytes and the samples arrive.
        messages: the clocks of each message of the link.
    """

    start: float
    end: float
    sentences: list[str]
    messages: list[MessageClocks]


def live_time(source: MemorySource, store: ColumnStore) -> LiveTime:
    """Time of a link, from its decoded bytes."""
    messages = clocks_of(store)
    start, end = int(source.times[0]) / 1e9, int(source.times[-1]) / 1e9
    return LiveTime(start, end, [*_chunk_sentences(source), *burst_sentences(messages)], messages)


def _chunk_sentences(source: MemorySource) -> Iterator[str]:
    pauses = np.diff(source.times) / 1e9
    if not len(pauses):
        return
    size, pause, longest = float(np.median(source.sizes)), float(np.median(pauses)), float(pauses.max())
    yield (
        f"The bytes came in {len(source.ends)} pieces: usually {size:.0f} bytes each {_short(pause)}, "
        f"with a longest pause of {_short(longest)}."
    )


def burst_sentences(messages: Sequence[MessageClocks]) -> Iterator[str]:
    """A sentence on each message whose samples arrive in bursts."""
    for message in messages:
        arrival = next((clock for clock in message.clocks if clock.name == "arrival"), None)
        if arrival is not None and arrival.bursts >= BURSTY:
            yield _burst_sentence(message.message, arrival)


def _burst_sentence(message: str, arrival: FileClock) -> str:
    count = counted(round(arrival.burst_samples), "sample", "samples")
    words = (
        f"{message}: {100 * arrival.bursts:.0f} % of the samples arrive at once with the one before, {count} a burst"
    )
    late = f"; the arrival scatters by {_short(arrival.jitter_s)}" if arrival.jitter_s else ""
    return f"{words}{late}."


def _short(seconds: float) -> str:
    return duration_text(float(f"{seconds:.3g}"))
