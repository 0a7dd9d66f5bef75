"""Fast reading of a recording: an index of its messages, and its metadata.

A recording of an hour has hundreds of thousands of chunks; one Python object for each would take longer than decoding
their bytes. So a compiled loop finds the records and writes a table, a block of records at a time: a block is an MCAP
chunk or, in a file that is being recorded or was truncated, a few thousand of its records.

    file     [magic][header][channel][message][message]···[message][mess        torn: the last record is incomplete
    block                    ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
    table    one column a message: channel, time, start of its data, number of bytes

Damage never raises: `McapReader.damage` lists where the file is invalid and why. Everything before is returned, and so
are intact records after it: reading resumes where several records follow each other again. A chunk whose checksum fails
is skipped and reported; data after it is read.

Source: MCAP specification, "Records".
"""

import contextlib
import io
import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.records import Channel, ChunkIndex, Metadata, Schema, Statistics

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.messages.records import MessageChannel
from imuscope.recordings.errors import READABLE, RecordingError
from imuscope.recordings.mcap.kernels import AT_END, FULL, messages_from, resume
from imuscope.recordings.mcap.records import MAGIC
from imuscope.recordings.mcap.writer import PROFILE
from imuscope.recordings.sources import FileDamage
from imuscope.recordings.system.regular_file import open_regular

HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(9, 16)
PRIVATE = 0x80  # and above: record types reserved for applications
ENDINGS = (DATA_END, FOOTER)  # with a fixed length; any other is damage
CHANNEL_ID, TIME, DATA, LENGTH = range(4)  # rows of a block's table
LARGEST_CHUNK = 64 << 20  # bytes; a larger one is damage. Writers make chunks of 1 to 4 MB
_RECORD_HEAD = 9  # opcode, length
_SCANNED_RECORDS = 1 << 15
_LONGEST_RECORD = 64 << 20  # bytes, of a record that is not a chunk; a longer one is damage


@dataclass(frozen=True, slots=True)
class MessageBlock:
    """Consecutive messages.

    Args:
        data: the bytes that `table` points into.
        table: (4, n) int64: CHANNEL_ID, TIME (ns), DATA (offset in `data`), LENGTH; in file order.
        done: bytes of the file up to here, for progress.
    """

    data: memoryview
    table: Ints
    done: int

    def of(self, channel: int) -> Ints:
        """The columns of one channel."""
        return np.ascontiguousarray(self.table[:, self.table[CHANNEL_ID] == channel])

    def joined(self, rows: Ints) -> tuple[bytes, Ints]:
        """The concatenated data of these messages, and the end of each: (n,) int64."""
        starts, sizes = rows[DATA].tolist(), rows[LENGTH]
        pieces = [self.data[at : at + size] for at, size in zip(starts, sizes.tolist(), strict=True)]
        return b"".join(pieces), np.cumsum(sizes)


class McapReader:
    """One MCAP file, of any program. Cheap to create: it reads on demand.

    Args:
        path: of the file.

    Raises:
        RecordingError: it cannot be read, or is not an MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with open_regular(path) as file:
                self.size = file.seek(0, 2)
                file.seek(0)
                if file.read(len(MAGIC)) != MAGIC:
                    raise RecordingError(f"{path.name} is not an MCAP file.", "Its first bytes are not those of MCAP.")
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise RecordingError(f"{path.name}: {(error.strerror or 'cannot be read').lower()}.", READABLE) from None
        self.topics: dict[int, MessageChannel] = {}
        self._metadata: dict[tuple[str, frozenset[tuple[str, str]]], dict[str, str]] = {}  # in order of last occurrence
        self._pointed_at: set[int] = set()  # offsets of metadata listed in the index
        self.damage: list[FileDamage] = []
        self.whole = False  # its end is present
        self.statistics: Statistics | None = None  # counts and times, if its end has them
        self._schemas: dict[int, Schema] = {}
        self.chunks = self._summary()

    def close(self) -> None:
        """Release the file; blocks in use keep it open until they are released."""
        with contextlib.suppress(BufferError):
            self._map.close()

    def __enter__(self) -> "McapReader":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- reading -------------------------------------------------------------------------------------------------------

    def blocks(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[MessageBlock]:
        """The messages, block by block in the order of the file.

        Args:
            start_ns, stop_ns: blocks entirely outside are skipped if there is an index; returned blocks may still
                contain messages outside.
        """
        if not self.chunks:
            yield from self._walk(memoryview(self._map), len(MAGIC))
            return
        for index in self.chunks:
            before = start_ns is not None and index.message_end_time < start_ns
            after = stop_ns is not None and index.message_start_time >= stop_ns
            if not before and not after:
                if self._is_cut_now(index.chunk_start_offset):
                    return
                yield from self._chunk(index.chunk_start_offset, index.chunk_start_offset + index.chunk_length)

    @property
    def is_ours(self) -> bool:
        """Whether imuscope recorded the file, by its header."""
        try:
            return self._map[len(MAGIC)] == HEADER and _stream(self._map[17:300]).read_prefixed_string() == PROFILE
        except (UnicodeDecodeError, IndexError, EndOfFile):
            return False

    def meta(self, name: str) -> dict[str, str]:
        """The last metadata of that name; empty if absent. In a file without an end, complete only after `blocks`."""
        return next((values for (key, _), values in reversed(self._metadata.items()) if key == name), {})

    @property
    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """Names and values, each pair once, at its last occurrence."""
        return [(name, values) for (name, _), values in self._metadata.items()]

    def topic(self, name: str) -> MessageChannel | None:
        return next((topic for topic in self.topics.values() if topic.topic == name), None)

    # -- records -------------------------------------------------------------------------------------------------------

    def _summary(self) -> list[ChunkIndex]:
        """Read chunk indexes, channels and metadata from the summary at the end, if present."""
        footer = self.size - len(MAGIC) - _RECORD_HEAD - 20
        if footer < len(MAGIC) or self._map[-len(MAGIC) :] != MAGIC or self._map[footer] != FOOTER:
            return []
        self.whole = True
        start, _, checksum = struct.unpack_from("<QQI", self._map, footer + _RECORD_HEAD)
        if not len(MAGIC) <= start < footer:
            return []
        if checksum and zlib.crc32(self._map[start : footer + _RECORD_HEAD + 16]) != checksum:
            self.damage.append(
                FileDamage(start, "The index at the end is damaged; the file is read from its beginning.")
            )
            return []
        try:
            return self._indexed(start, footer)
        except (struct.error, ValueError, EndOfFile):  # errors of the record reader on garbled data
            self.damage.append(
                FileDamage(start, "The index at the end is damaged; the file is read from its beginning.")
            )
            return []

    def _indexed(self, at: int, end: int) -> list[ChunkIndex]:
        """Read the records of the summary; returns the chunk indexes that lie within the file."""
        chunks: list[ChunkIndex] = []
        while at < end:
            opcode, length = struct.unpack_from("<BQ", self._map, at)
            body = self._map[at + _RECORD_HEAD : at + _RECORD_HEAD + length]
            if opcode == CHUNK_INDEX:
                chunks.append(ChunkIndex.read(_stream(body)))
                if chunks[-1].chunk_start_offset + chunks[-1].chunk_length > self.size:
                    raise ValueError("a chunk outside the file")
            elif opcode == METADATA_INDEX:
                (where,) = struct.unpack_from("<Q", body)
                if where not in self._pointed_at:  # many index entries may point at one large record
                    self._pointed_at.add(where)
                    self._read_record(METADATA, where)
            else:
                self._learn(opcode, body)
            at += _RECORD_HEAD + length
        return chunks

    def _read_record(self, opcode: int, at: int) -> None:
        if at + _RECORD_HEAD <= self.size and self._map[at] == opcode:
            (length,) = struct.unpack_from("<Q", self._map, at + 1)
            self._learn(opcode, self._map[at + _RECORD_HEAD : at + _RECORD_HEAD + length])

    def _walk(self, data: memoryview, at: int, done: int | None = None) -> Iterator[MessageBlock]:
        """Walk the records of a file without an index, or of a chunk (`done` is then its end)."""
        array = np.frombuffer(data, np.uint8)
        end = len(array)
        table = np.empty((4, _SCANNED_RECORDS), np.int64)
        while at < end:
            if done is None and self._is_cut_now(at):
                return
            n, at, opcode, length = messages_from(array, at, table)
            if n:
                yield MessageBlock(data, table[:, :n], at if done is None else done)
                table = np.empty((4, _SCANNED_RECORDS), np.int64)
            if opcode in (AT_END, FULL):
                continue
            if (opcode, length) in ((DATA_END, 4), (FOOTER, 20)) and done is None:
                return
            whole = at + _RECORD_HEAD + length
            if opcode <= 0 or DATA_END < opcode < PRIVATE or whole > end or (done is None and opcode in ENDINGS):
                if done is not None:
                    self.damage.append(_cut(done))
                    return
                behind = resume(array, at + 1, self._channel_ids())
                if behind < 0:
                    self.damage.append(_torn(at, bytes(data[at : at + _RECORD_HEAD]), array[at:]))
                    return
                self.damage.append(_skipped(at, behind))
                at = behind
                continue
            if opcode == CHUNK and done is None:
                yield from self._chunk(at, whole)
            else:
                self._learn(opcode, bytes(data[at + _RECORD_HEAD : whole]))
            at = whole

    def _is_cut_now(self, at: int) -> bool:
        """Whether another program has made the file shorter, as `cp` over it does: reading on would end the process."""
        if self._map.size() >= self.size:
            return False
        self.damage.append(FileDamage(at, "The file was made shorter while it was read."))
        return True

    def _channel_ids(self) -> Bytes:
        known = np.zeros(1 << 16, np.uint8)
        known[[number for number in self.topics if number < len(known)]] = 1
        return known

    def _chunk(self, at: int, end: int) -> Iterator[MessageBlock]:
        data = self._unpacked(at, end)
        if data is not None:
            yield from self._walk(memoryview(data), 0, end)

    def _unpacked(self, at: int, end: int) -> bytes | None:
        try:
            head = struct.unpack_from("<QQQI", self._map, at + _RECORD_HEAD)
            size, checksum = head[2], head[3]
            where = at + _RECORD_HEAD + 28
            (named,) = struct.unpack_from("<I", self._map, where)
            packing = self._map[where + 4 : where + 4 + named].decode()
            where += 4 + named
            (packed,) = struct.unpack_from("<Q", self._map, where)
            body = self._map[where + 8 : min(where + 8 + packed, end)]
            if size > LARGEST_CHUNK:
                raise ValueError(f"it claims {size} bytes")
            data = _unpack(packing, body, size)
            if len(data) != size or (checksum and zlib.crc32(data) != checksum):
                raise ValueError("its checksum is wrong")
        except (ValueError, struct.error, zstandard.ZstdError, RuntimeError) as error:
            words = f"The chunk at byte {at:,} cannot be read: {error}.".replace(",", " ")
            self.damage.append(FileDamage(at, words))
            return None
        return data

    def _learn(self, opcode: int, body: bytes) -> None:
        """Store a schema, channel or metadata record; a garbled one is ignored."""
        try:
            if opcode == SCHEMA:
                schema = Schema.read(_stream(body))
                self._schemas[schema.id] = schema
            elif opcode == CHANNEL:
                channel = Channel.read(_stream(body))
                of = self._schemas.get(channel.schema_id)
                described = (of.name, of.encoding, of.data) if of else ("", "", b"")
                self.topics[channel.id] = MessageChannel(
                    channel.id, channel.topic, channel.message_encoding, *described, channel.metadata
                )
            elif opcode == STATISTICS:
                self.statistics = Statistics.read(_stream(body))
            elif opcode == METADATA:
                metadata = Metadata.read(_stream(body))
                key = (metadata.name, frozenset(metadata.metadata.items()))
                self._metadata.pop(key, None)  # repeated: now it is the last
                self._metadata[key] = metadata.metadata
        except Exception as error:  # errors of the record reader on garbled data
            self.damage.append(FileDamage(-1, f"A record of kind {opcode} cannot be read: {type(error).__name__}."))


def _unpack(packing: str, body: bytes, size: int) -> bytes:
    match packing:
        case "":
            return body
        case "zstd":
            claimed = zstandard.get_frame_parameters(body).content_size  # unchecked, any size would be trusted
            if claimed not in (size, zstandard.CONTENTSIZE_UNKNOWN):
                raise ValueError("it unpacks to another size than it claims")
            return zstandard.ZstdDecompressor().decompress(body, max_output_size=size)
        case "lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(body, max_length=size))
    raise ValueError(f"its compression {packing!r} is not known")


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(body))


def _torn(at: int, head: bytes, rest: Bytes) -> FileDamage:
    """The file ends in an incomplete record, in zeros, or in data that no record follows."""
    length = struct.unpack_from("<Q", head, 1)[0] if len(head) == _RECORD_HEAD else 0
    is_record = head[0] <= DATA_END and len(rest) < _RECORD_HEAD + length and length <= _LONGEST_RECORD
    torn = not rest.any() or (head[0] > 0 and (is_record or len(rest) < _RECORD_HEAD))
    words = f"The file is whole up to byte {at:,}; the rest is missing or damaged.".replace(",", " ")
    return FileDamage(at, words, torn)


def _skipped(at: int, behind: int) -> FileDamage:
    words = f"{behind - at:,} bytes at byte {at:,} are damaged and were left out.".replace(",", " ")
    return FileDamage(at, words)


def _cut(end: int) -> FileDamage:
    return FileDamage(end, f"The chunk before byte {end:,} does not end with a whole record.".replace(",", " "))
