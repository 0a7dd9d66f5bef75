"""Bytes of a live link in a file, as a source that is decoded like a recording.

LinkMemory ──> write_memory ──> bytes.npz: data, ends, times ──> MemorySource ──> decode
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.recordings.sources import ChunkBlock, FileDamage, SourceDevice
from imuscope.server.devices.link.byte_memory import ByteRun

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
        """All of them."""
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
