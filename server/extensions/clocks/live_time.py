"""Time of a live device: the clocks of the bytes in memory, and sentences on how they arrive.

LinkMemory ──> write_memory ──> bytes.npz: data, ends, times ──> MemorySource ──> decode like a recording
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.schema.plural import counted
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.sources import ChunkBlock, FileDamage, SourceDevice
from imuscope.recordings.tables.clocks.steps import duration_text
from imuscope.server.devices.link.byte_memory import ByteRun
from imuscope.server.extensions.clocks.figures import FileClock, MessageClocks, clocks_of

BYTES, RESULT = "bytes.npz", "time.json"  # in the folder of a measurement
PART_CHUNKS = 1 << 14


def write_memory(path: Path, runs: Sequence[ByteRun], preamble: bytes) -> bool:
    """Write the received bytes; False if there are none.

    Args:
        preamble: bytes that a decoder needs first.
    """
    received = [run for run in runs if run.direction == "rx" and len(run.ends)]
    if not received:
        return False
    offsets = np.cumsum([len(preamble), *(len(run.data) for run in received[:-1])])
    ends = [run.ends + offset for run, offset in zip(received, offsets, strict=True)]
    data = np.frombuffer(b"".join((preamble, *(run.data for run in received))), np.uint8)
    times = np.concatenate([run.arrival_ns for run in received])
    np.savez(path, data=data, ends=np.concatenate(ends).astype(np.int64), times=times)
    return True


class MemorySource:
    """A Source (recordings/sources.py) of the bytes of one link.

    Args:
        device: its id, protocol and metadata.
    """

    format = "memory"
    timed = True
    header: Mapping[str, str] = {}

    def __init__(self, path: Path, device: SourceDevice) -> None:
        self.path = path
        self.devices = {device.id: device}
        self.damage: list[FileDamage] = []
        with np.load(path) as file:
            self._data, self.ends, self.times = file["data"], file["ends"], file["times"]

    @property
    def sizes(self) -> Ints:
        """Bytes of each chunk."""
        sizes: Ints = np.diff(self.ends, prepend=0)
        return sizes

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        [device] = self.devices
        for first in range(0, len(self.ends), PART_CHUNKS):
            past = min(first + PART_CHUNKS, len(self.ends))
            begin = int(self.ends[first - 1]) if first else 0
            data = self._data[begin : int(self.ends[past - 1])].tobytes()
            ends, times = self.ends[first:past] - begin, self.times[first:past]
            yield ChunkBlock(device, "rx", data, ends, times, past / len(self.ends))

    def metadata(self) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """Nothing beside the bytes."""
        yield from ()


MIN_BURST_SHARE = 0.02  # share of samples, from which bursts are reported


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
        if arrival is not None and arrival.bursts >= MIN_BURST_SHARE:
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
