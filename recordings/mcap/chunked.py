"""An MCAP file in chunks, compressed and indexed: small, and quick to seek.

    magic, header
    [chunk: schemas, channels, messages][one message index a channel]   … repeated
    metadata                                                            the last of each name
    data end
    summary: schemas, channels, statistics, chunk indexes, metadata indexes, summary offsets
    footer, magic

Message records are passed in their final form (recordings/mcap/records.py), many at once; only their place is decided
here. So it runs at the speed of the compression, in little memory.

Source: MCAP specification, "Chunk", "Message Index", "Summary Section".
"""

import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Header, McapRecord, Metadata, MetadataIndex

from imuscope.protocols.arrays import Ints
from imuscope.protocols.messages.records import MessageChannel
from imuscope.recordings.mcap.reader import CHANNEL_ID, DATA, LENGTH, MESSAGE_INDEX, TIME
from imuscope.recordings.mcap.records import MAGIC, MESSAGE_HEAD, FileContents, bytes_of, ending
from imuscope.recordings.mcap.writer import PROFILE

HEAD = MESSAGE_HEAD.size  # of a message record, before its data
MIN_CHUNK_BYTES, MAX_CHUNK_BYTES = 1 << 14, 1 << 20  # bytes of a chunk before compression
CHUNKS_PER_FILE = 32  # of a file: at most this share is lost with a truncated or damaged chunk
_COMPRESSION_LEVEL = 3


def chunk_bytes(size: int) -> int:
    """Chunk size for a file of that size: small for a short one, because a damaged or truncated chunk is lost whole;
    for a long one as large as is efficient to read and compress.
    """
    return min(max(size // CHUNKS_PER_FILE, MIN_CHUNK_BYTES), MAX_CHUNK_BYTES)


def cut(sizes: Ints, largest: int) -> Iterator[tuple[int, int]]:
    """(first, past the last) of the messages of each chunk.

    Args:
        sizes: (n,) of their records, bytes.
        largest: bytes of a chunk; one message may be larger.
    """
    ends = np.cumsum(sizes)
    start, begun = 0, 0
    while start < len(ends):
        stop = max(int(np.searchsorted(ends, begun + largest, "right")), start + 1)
        yield start, stop
        start, begun = stop, int(ends[stop - 1])


class ChunkedFile:
    """A file being written.

    Args:
        profile: of its header.
    """

    def __init__(self, out: BinaryIO, profile: str = PROFILE) -> None:
        self._out = out
        self._at = 0
        self._contents = FileContents[int]()
        self._new: list[McapRecord] = []  # for the next chunk
        self._indexes: list[ChunkIndex] = []
        self._zstd = zstandard.ZstdCompressor(level=_COMPRESSION_LEVEL)
        self._put(MAGIC + bytes_of(Header(profile, "imuscope")))

    def _put(self, data: bytes) -> int:
        at = self._at
        self._out.write(data)
        self._at += len(data)
        return at

    def write_channels(self, topics: Mapping[int, MessageChannel]) -> None:
        """Write those of these channels that are new."""
        for topic in topics.values():
            if topic.id not in self._contents.channels:
                schema = (topic.schema, topic.schema_encoding, topic.schema_data) if topic.schema else None
                self._new += self._contents.add(topic.id, topic.topic, topic.encoding, schema, topic.metadata, topic.id)

    def chunk(self, data: memoryview, rows: Ints) -> None:
        """Write one chunk of these messages, and its indexes."""
        head = b"".join(bytes_of(record) for record in self._new)
        self._new.clear()
        sizes = rows[LENGTH] + HEAD
        offsets = len(head) + np.cumsum(sizes) - sizes
        starts, ends = (rows[DATA] - HEAD).tolist(), (rows[DATA] + rows[LENGTH]).tolist()
        if ends[-1] - starts[0] == int(sizes.sum()):  # they are consecutive
            body = head + bytes(data[starts[0] : ends[-1]])
        else:
            body = head + b"".join(data[start:end] for start, end in zip(starts, ends, strict=True))
        small = self._zstd.compress(body)
        first, last = int(rows[TIME].min()), int(rows[TIME].max())
        fixed = struct.pack("<QQQI", first, last, len(body), zlib.crc32(body))
        record = fixed + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(small)) + small
        at = self._put(struct.pack("<BQ", Opcode.CHUNK, len(record)) + record)
        index = ChunkIndex(
            message_start_time=first,
            message_end_time=last,
            chunk_start_offset=at,
            chunk_length=self._at - at,
            message_index_offsets={},
            message_index_length=0,
            compression="zstd",
            compressed_size=len(small),
            uncompressed_size=len(body),
        )
        begin = self._at
        for channel in np.unique(rows[CHANNEL_ID]).tolist():
            selected = rows[CHANNEL_ID] == channel
            pairs = np.column_stack((rows[TIME][selected], offsets[selected])).astype("<u8").tobytes()
            body = struct.pack("<HI", channel, len(pairs)) + pairs
            index.message_index_offsets[channel] = self._put(struct.pack("<BQ", MESSAGE_INDEX, len(body)) + body)
            self._contents.count(channel, int(selected.sum()), first, last)
        index.message_index_length = self._at - begin
        self._indexes.append(index)

    def end(self, metadata: Mapping[str, Mapping[str, str]]) -> None:
        """Write metadata, data end, summary, footer."""
        indexes = []
        for name, values in metadata.items():
            record = bytes_of(Metadata(name=name, metadata=dict(values)))
            indexes.append(MetadataIndex(offset=self._put(record), length=len(record), name=name))
        self._put(ending(self._at, self._contents.summary(indexes, self._indexes)))
