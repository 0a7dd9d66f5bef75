"""Messages of a bag of ROS as a source: the stream of protocols/messages/, in blocks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from imuscope.protocols.messages.decoder import MOST_CHANNELS, reader_of
from imuscope.protocols.messages.records import (
    LONGEST,
    MESSAGE,
    MESSAGE_FIXED,
    MESSAGE_HEAD,
    MessageChannel,
    definition,
)
from imuscope.recordings.mcap_reader import FileDamage
from imuscope.recordings.mcap_writer import RecordingError
from imuscope.recordings.message_source import DEVICE, MessageFile
from imuscope.recordings.sources import ChunkBlock

BLOCK_BYTES = 4 << 20
LATEST_NS = 1 << 62  # a time beyond that is damage


@dataclass(slots=True)
class BagPiece:
    """Messages that were read together.

    Args:
        messages: (channel, arrival ns, data) of each.
        done: share of the file read, 0..1.
    """

    messages: list[tuple[int, int, bytes]]
    done: float


@dataclass(slots=True)
class BagTopics:
    """Topics of a bag by the number that the bag has for them.

    Attributes:
        left_out: reasons for topics that cannot be read.
    """

    channels: dict[int, MessageChannel] = field(default_factory=dict)
    left_out: dict[str, None] = field(default_factory=dict)
    _numbers: set[int] = field(default_factory=set)

    def add(self, number: int, topic: str, kind: str, encoding: tuple[str, str], text: str, why: str = "") -> None:
        """Add a topic.

        Args:
            kind: name of its type.
            encoding: of its messages and of its definition.
            text: the definition; "" if it is not known.
            why: the reason for a definition that is not known.
        """
        if number in self._numbers:
            return
        self._numbers.add(number)
        if len(self.channels) >= MOST_CHANNELS:
            self.left_out[f"Topics beyond {MOST_CHANNELS} are left out."] = None
            return
        channel = MessageChannel(len(self.channels) + 1, topic, encoding[0], kind, encoding[1], text.encode())
        if text and reader_of(channel) is not None:
            self.channels[number] = channel
        else:
            self.left_out[f"{topic} is left out: {why or f'{kind} cannot be read'}."] = None


class BagSource(MessageFile):
    """A bag. Subclasses read it.

    Raises:
        RecordingError: none of its messages can be read.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.topics = BagTopics()

    def pieces(self, start_ns: int | None, stop_ns: int | None) -> Iterator[BagPiece]:
        """Messages in the order of the bag; `topics` has those of a piece when it is yielded."""
        raise NotImplementedError

    def check(self) -> None:
        """Check that a topic can be read.

        Raises:
            RecordingError: none can.
        """
        if not self.topics.channels:
            why = " ".join(list(self.topics.left_out)[:3]) or "It has no topics."
            raise RecordingError(f"{self.path.name} has no messages that can be read.", why)

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        self.damage.clear()
        defined: set[int] = set()
        records: list[bytes] = []
        ends: list[int] = []
        times: list[int] = []
        size = odd = 0
        pack = MESSAGE_HEAD.pack
        channels: Mapping[int, MessageChannel] = self.topics.channels
        for piece in self.pieces(start_ns, stop_ns):
            for number, time_ns, data in piece.messages:
                channel = channels.get(number)
                if channel is None:
                    continue
                if not 0 <= time_ns < LATEST_NS or len(data) >= LONGEST:
                    odd += 1
                    continue
                record = pack(MESSAGE, MESSAGE_FIXED + len(data), channel.id, 0, 0, 0) + data
                if number not in defined:
                    defined.add(number)
                    record = definition(channel) + record
                records.append(record)
                size += len(record)
                ends.append(size)
                times.append(time_ns)
                if size >= BLOCK_BYTES:
                    yield _block(records, ends, times, piece.done)
                    size = 0
        if records:
            yield _block(records, ends, times, 1.0)
        if odd:
            self.damage.append(FileDamage(-1, f"Messages with an impossible time or size are left out: {odd}."))
        self.damage += [FileDamage(-1, words) for words in self.topics.left_out]

    def preamble(self, device: str) -> bytes:
        return b"".join(map(definition, self.topics.channels.values()))


def _block(records: list[bytes], ends: list[int], times: list[int], done: float) -> ChunkBlock:
    """A block of these records; the lists are empty afterwards."""
    block = ChunkBlock(
        DEVICE, "rx", b"".join(records), np.array(ends, np.int64), np.array(times, np.int64), min(done, 1.0)
    )
    for one in (records, ends, times):
        one.clear()
    return block
