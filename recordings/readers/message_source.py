"""MCAP files of other programs whose messages hold numbers: JSON, protobuf, ROS 1 and 2.

All readable channels together are one device, whose messages are decoded like those of a live source. Messages that
cannot be read are left out and reported.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from imuscope.protocols.messages.decoder import reader_of
from imuscope.protocols.messages.family import NAME
from imuscope.protocols.messages.records import MessageChannel
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.mcap.messages import MessageBlocks, preamble
from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.sources import ChunkBlock, FileDamage, SourceDevice, remark
from imuscope.recordings.system.tolerant_json import loads

DEVICE = "1"


class MessageFile:
    """A file of messages that are one device; see recordings/sources.py, Source."""

    format = "table"
    timed = True
    segments: Sequence[float] = ()  # begins of segments of the clock that the file names, unix s; known after `parts`

    def __init__(self, path: Path) -> None:
        self.path = path
        self.header: Mapping[str, str] = {}
        about = {"source": path.name, "name": path.stem, "link": "file"}
        self.devices = {DEVICE: SourceDevice(DEVICE, NAME, about)}
        self.damage: list[FileDamage] = []

    @property
    def indexed(self) -> list[int]:
        return []

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        """All messages, or at least those between two times."""
        raise NotImplementedError

    def preamble(self, device: str) -> bytes:
        """Definitions of the channels of a device; complete after `parts`."""
        raise NotImplementedError

    def metadata(self) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """Metadata stored beside the messages: none."""
        return iter(())


class MessageSource(MessageFile):
    """An MCAP file of another program.

    Raises:
        RecordingError: none of its messages can be read.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._readable: dict[tuple[str, str, str, bytes], bool] = {}
        self._recording = McapReader(path)
        if not self._recording.chunks:
            next(iter(self._recording.blocks()), None)
        topics = list(self._recording.topics.values())
        if not any(map(self._device_of, topics)):
            kinds = ", ".join(sorted({topic.encoding for topic in topics})) or "nothing"
            hint = "JSON is read, and protobuf and ROS messages whose schema is in the file."
            raise RecordingError(f"{path.name} holds no bytes of a device, and its messages are {kinds}.", hint)

    @property
    def indexed(self) -> list[int]:
        return [index.message_end_time for index in self._recording.chunks]

    def _device_of(self, topic: MessageChannel) -> str:
        kind = (topic.encoding, topic.schema, topic.schema_encoding, topic.schema_data)
        if kind not in self._readable:
            self._readable[kind] = reader_of(topic) is not None
        return DEVICE if self._readable[kind] else ""

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        recording = self._recording
        recording.damage.clear()
        blocks = MessageBlocks(recording, self._device_of)
        for block in recording.blocks(start_ns, stop_ns):
            for device, data, ends, times in blocks.of(block):
                yield ChunkBlock(device, "rx", data, ends, times, block.done / max(recording.size, 1))
        left_out = {_left_out(topic) for topic in recording.topics.values() if not self._device_of(topic)}
        self.damage[:] = [*recording.damage, *(remark(words) for words in sorted(left_out))]
        self.segments = segments_in(recording.meta("export").get("segments", ""))

    def preamble(self, device: str) -> bytes:
        return preamble(self._recording, self._device_of, device)


def segments_in(text: str) -> list[float]:
    """Begins of the segments of all devices, of a text that an export has: a list by device, as JSON."""
    try:
        return sorted({float(begin) for begins in loads(text.encode()).values() for begin in begins})
    except (ValueError, TypeError, AttributeError, RecursionError):
        return []


def _left_out(topic: MessageChannel) -> str:
    return f"{topic.topic} is {topic.encoding or 'of no encoding'}, which is not read."
