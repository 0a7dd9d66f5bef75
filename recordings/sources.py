"""What a file holds, whatever its format: stretches of bytes of one device, with the time at which each chunk arrived.

    part    data     [chunk][chunk][chunk]···
            ends     after each chunk
            times    when each arrived, ns

A part is as large as reading it at once is good for (up to some megabytes), so that an hour of chunks is a few hundred
parts. `Source` is one file, or the files that one recording was split into.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from protocols.framing import Ints
from recordings.mcap_reader import CHANNEL_ID, DATA, LENGTH, TIME, FileDamage, McapReader, MessageBlock
from recordings.mcap_writer import DEVICE, RECORDING, check_format_version
from recordings.tolerant_json import loads


@dataclass(frozen=True, slots=True)
class ChunkBlock:
    """Chunks of one device that lie together.

    Args:
        data: the chunks, one after the other.
        ends: (n,) int64, where each ends in `data`, ascending.
        times: (n,) int64, when each arrived (or was sent), ns since the Unix epoch.
        done: how far into the file this reaches, 0..1.
    """

    device: str
    way: Literal["rx", "tx"]
    data: bytes
    ends: Ints
    times: Ints
    done: float


@dataclass(slots=True)
class SourceDevice:
    """What a file tells of a device before any byte is decoded; `protocol` "" where it does not."""

    id: str
    protocol: str = ""
    about: Mapping[str, str] = field(default_factory=dict)


class Source(Protocol):
    """A file that can be opened.

    Attributes:
        format: "mcap", "mtb", "raw", "dat", "bin".
        devices: those that are known beforehand; others may turn up in parts.
        timed: whether the times of its chunks are true; else they were made from the device's own clock.
        damage: what could not be read, known when the parts have been read.
    """

    format: str
    path: Path
    timed: bool
    devices: dict[str, SourceDevice]
    about: Mapping[str, str]

    @property
    def damage(self) -> list[FileDamage]: ...

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        """All of them, or at least those with chunks between two times."""
        ...

    def said(self) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """(channel, time ns, body) of what was kept beside the bytes: events, notes, snapshots. After `parts`."""


class McapSource:
    """A recording of ours."""

    format = "mcap"
    timed = True

    def __init__(self, path: Path) -> None:
        self.path = path
        self._recording = McapReader(path)
        self._said: list[tuple[str, int, Mapping[str, Any]]] = []
        if not self._recording.chunks:  # its metadata are spread over the file; the first records have the names
            next(iter(self._recording.blocks()), None)
        self.about: Mapping[str, str] = self._recording.meta(RECORDING)
        if why := check_format_version(path.name, self.about.get("format")):
            raise why
        self.devices: dict[str, SourceDevice] = {}
        self._learn()

    @property
    def damage(self) -> list[FileDamage]:
        return self._recording.damage

    @property
    def indexed(self) -> list[int]:
        """When each block of the file ends, ns; empty where it has no index."""
        return [index.message_end_time for index in self._recording.chunks]

    def _learn(self) -> None:
        for name, values in self._recording.metadata:
            if name.startswith(DEVICE):
                device = name.removeprefix(DEVICE)
                self.devices[device] = SourceDevice(device, values.get("protocol", ""), values)

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        recording = self._recording
        recording.damage.clear()
        self._said.clear()
        for block in recording.blocks(start_ns, stop_ns):
            for number in np.unique(block.table[CHANNEL_ID]).tolist():
                topic = recording.topics.get(number)
                if topic is None:
                    continue
                rows = block.of(number)
                way, _, device = topic.name.partition("/")
                if topic.encoding == "json":
                    self._hear(topic.name, block, rows)
                if way not in ("rx", "tx") or topic.encoding == "json":
                    continue
                data, ends = block.joined(rows)
                yield ChunkBlock(device, way, data, ends, rows[TIME], block.done / max(recording.size, 1))  # type: ignore[arg-type]
        self._learn()

    def said(self) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        yield from self._said

    def _hear(self, topic: str, block: MessageBlock, rows: Ints) -> None:
        for time, at, size in zip(rows[TIME].tolist(), rows[DATA].tolist(), rows[LENGTH].tolist(), strict=True):
            try:
                body = loads(bytes(block.data[at : at + size]))
            except (ValueError, RecursionError):
                continue
            if isinstance(body, dict):
                self._said.append((topic, time, body))
