"""Recordings made by imuscope, as sources."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.recordings.errors import check_format_version
from imuscope.recordings.mcap.messages import MessageBlocks, preamble, recorded_device
from imuscope.recordings.mcap.reader import CHANNEL_ID, DATA, LENGTH, TIME, McapReader, MessageBlock
from imuscope.recordings.mcap.writer import DEVICE, FORMAT, RECORDING
from imuscope.recordings.sources import ChunkBlock, FileDamage, SourceDevice
from imuscope.recordings.system.tolerant_json import loads


class McapSource:
    """A recording made by imuscope."""

    format = "mcap"
    timed = True

    def __init__(self, path: Path) -> None:
        self.path = path
        self._recording = McapReader(path)
        self._metadata: list[tuple[str, int, Mapping[str, Any]]] = []
        if not self._recording.chunks:  # its metadata is spread over the file; the first records have the names
            next(iter(self._recording.blocks()), None)
        self.header: Mapping[str, str] = self._recording.meta(RECORDING)
        if why := check_format_version(path.name, self.header.get("format"), FORMAT):
            raise why
        self.devices: dict[str, SourceDevice] = {}
        self._learn()

    @property
    def damage(self) -> list[FileDamage]:
        return self._recording.damage

    @property
    def indexed(self) -> list[int]:
        """End of each block of the file, ns; empty without an index."""
        return [index.message_end_time for index in self._recording.chunks]

    def _learn(self) -> None:
        for name, values in self._recording.metadata:
            if name.startswith(DEVICE):
                device = name.removeprefix(DEVICE)
                self.devices[device] = SourceDevice(device, values.get("protocol", ""), values)

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        recording = self._recording
        recording.damage.clear()
        self._metadata.clear()
        of_messages = MessageBlocks(recording, recorded_device)
        for block in recording.blocks(start_ns, stop_ns):
            for number in np.unique(block.table[CHANNEL_ID]).tolist():
                topic = recording.topics.get(number)
                if topic is None:
                    continue
                rows = block.of(number)
                way, _, device = topic.topic.partition("/")
                if topic.encoding == "json" and not recorded_device(topic):
                    self._collect(topic.topic, block, rows)
                if way not in ("rx", "tx") or topic.encoding == "json" or recorded_device(topic):
                    continue
                data, ends = block.joined(rows)
                yield ChunkBlock(device, way, data, ends, rows[TIME], block.done / max(recording.size, 1))  # type: ignore[arg-type]
            for device, data, ends, times in of_messages.of(block):
                yield ChunkBlock(device, "rx", data, ends, times, block.done / max(recording.size, 1))
        self._learn()

    def preamble(self, device: str) -> bytes:
        """Definitions of the channels of a device that sends messages; complete after `parts`."""
        return preamble(self._recording, recorded_device, device)

    def metadata(self) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        yield from self._metadata

    def _collect(self, topic: str, block: MessageBlock, rows: Ints) -> None:
        for time, at, size in zip(rows[TIME].tolist(), rows[DATA].tolist(), rows[LENGTH].tolist(), strict=True):
            try:
                body = loads(bytes(block.data[at : at + size]))
            except (ValueError, RecursionError):
                continue
            if isinstance(body, dict):
                self._metadata.append((topic, time, body))
