"""Messages of a bag of ROS as a source: the stream of protocols/messages/, in blocks."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.messages.decoder import MOST_CHANNELS, reader_of
from imuscope.protocols.messages.records import (
    MAX_RECORD,
    MESSAGE_HEAD,
    MessageChannel,
    definition,
)
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats.bag_kernels import NUMBER, SIZE, TIME, copy_records
from imuscope.recordings.readers.message_source import DEVICE, MessageFile
from imuscope.recordings.sources import ChunkBlock, FileDamage, remark

BLOCK_BYTES = 4 << 20
LATEST_NS = 1 << 62  # a time beyond that is damage


@dataclass(slots=True)
class BagPiece:
    """Messages that were read together.

    Args:
        data: has their bytes.
        table: NUMBER, TIME, START and SIZE of each message (bag_kernels.py).
        share: of the file that was read, 0..1.
    """

    data: bytes
    table: Ints
    share: float


def piece_of(
    share: float, numbers: Sequence[int] | Ints, times: Sequence[int] | Ints, data: Sequence[bytes]
) -> BagPiece:
    """A piece of single messages: number of the topic, arrival in ns and bytes of each."""
    sizes = np.fromiter(map(len, data), np.int64, len(data))
    table = np.stack([np.array(numbers, np.int64), np.array(times, np.int64), np.cumsum(sizes) - sizes, sizes])
    return BagPiece(b"".join(data), table, share)


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
        block = _Block(self.topics.channels)
        known = np.array(sorted(self.topics.channels), np.int64)
        odd = 0
        for piece in self.pieces(start_ns, stop_ns):
            table = piece.table
            is_known = known[np.minimum(np.searchsorted(known, table[NUMBER]), len(known) - 1)] == table[NUMBER]
            usable = is_known & (table[TIME] >= 0) & (table[TIME] < LATEST_NS) & (table[SIZE] < MAX_RECORD)
            odd += int(np.count_nonzero(is_known & ~usable))
            chosen = table if usable.all() else np.ascontiguousarray(table[:, usable])
            block.add(BagPiece(piece.data, chosen, piece.share))
            if block.size >= BLOCK_BYTES:
                yield block.take(piece.share)
        if block.size:
            yield block.take(1.0)
        if odd:
            self.damage.append(FileDamage(-1, f"Messages with an impossible time or size are left out: {odd}."))
        self.damage += map(remark, self.topics.left_out)

    def preamble(self, device: str) -> bytes:
        return b"".join(map(definition, self.topics.channels.values()))


class _Block:
    """Messages gathered for a block of the stream.

    Args:
        channels: of the stream, by the number that the bag has for them.
    """

    def __init__(self, channels: Mapping[int, MessageChannel]) -> None:
        self._channels = channels
        self._defined: set[int] = set()
        self._pieces: list[BagPiece] = []
        self.size = 0

    def add(self, piece: BagPiece) -> None:
        if piece.table.shape[1]:
            self._pieces.append(piece)
            self.size += int(piece.table[SIZE].sum()) + MESSAGE_HEAD.size * piece.table.shape[1]

    def take(self, done: float) -> ChunkBlock:
        """The block, with the definitions of channels that are new in it before its first message."""
        pieces, self._pieces = self._pieces, []
        known = np.array(sorted(self._channels), np.int64)
        places = [np.searchsorted(known, one.table[NUMBER]) for one in pieces]
        present = sum(np.bincount(place, minlength=len(known)) for place in places) > 0
        new = [number for number in known[present].tolist() if number not in self._defined]
        self._defined.update(new)
        head = b"".join(definition(self._channels[number]) for number in new)
        out = np.empty(len(head) + self.size, np.uint8)
        out[: len(head)] = np.frombuffer(head, np.uint8)
        at, self.size = len(head), 0
        ids = np.array([self._channels[number].id for number in known.tolist()], np.int64)
        for one, place in zip(pieces, places, strict=True):
            at = copy_records(np.frombuffer(one.data, np.uint8), one.table, ids[place], out, at)
        sizes, times = (np.concatenate([one.table[row] for one in pieces]) for row in (SIZE, TIME))
        ends = len(head) + np.cumsum(sizes + MESSAGE_HEAD.size)
        return ChunkBlock(DEVICE, "rx", out.tobytes(), ends, times, min(done, 1.0))
