"""Decoding of chunks by any decoder, and columns of what it found."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from imuscope.protocols.events import Batch, Event


def run(device: Any, seconds: float, *, begin: float = 0, tick_ns: int = 10_000_000) -> bytes:
    """Everything that a simulated device sends in some seconds."""
    times = range(int(begin * 1e9), int((begin + seconds) * 1e9) + 1, tick_ns)
    return b"".join(device.advance(now) for now in times)


def decode_chunks(decoder: Any, chunks: Iterable[tuple[int, bytes]], *, stalled: bool = True) -> list[Event]:
    """All events of chunks.

    Args:
        chunks: (arrival ns, bytes), each drained after it was fed.
        stalled: drain in the end what an incomplete frame held back.
    """
    events: list[Event] = []
    for arrival_ns, data in chunks:
        decoder.feed(data, arrival_ns)
        events += decoder.drain()
    return events + (decoder.drain(stalled=True) if stalled else [])


def column(events: Iterable[Event], name: str, message: str | int | None = None) -> np.ndarray[Any, Any]:
    """One column of all batches that have it, in stream order.

    Args:
        message: name or number; None for any.
    """
    results = [
        event
        for event in events
        if isinstance(event, Batch)
        and name in event.columns
        and (message is None or message in (event.message.id, event.message.name))
    ]
    values = np.concatenate([batch.columns[name] for batch in results])
    return values[np.argsort(np.concatenate([batch.offset for batch in results]), kind="stable")]
