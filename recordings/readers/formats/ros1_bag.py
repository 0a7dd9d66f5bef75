"""ROS 1 bags.

    #ROSBAG V2.0\n  record record ···
    record          [length u32][header][length u32][data]
    header          [length u32]name=value [length u32]name=value ···
    op 5 chunk      data is records, compressed: none, bz2, lz4
    op 7 connection topic, type and definition;  op 2 message: conn, time (s u32, ns u32)
    op 3, 4, 6      heads and indexes, which are not used: a bag that was cut has none

A record that is damaged is skipped up to the next chunk.

Source: ROS wiki, "Bags/Format/2.0".
"""

import io
import struct
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from imuscope.recordings.readers.formats.bag_kernels import alike_messages
from imuscope.recordings.readers.formats.bag_source import BagPiece, BagSource, piece_of
from imuscope.recordings.readers.formats.decompressing import inflated
from imuscope.recordings.readers.registry import FileReader, OpenRequest, register_reader
from imuscope.recordings.sources import FileDamage
from imuscope.recordings.system.regular_file import open_regular

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, CHUNK, CONNECTION = 2, 5, 7
LONGEST_HEADER, LONGEST_DATA = 1 << 16, 1 << 28
CHUNK_MARK = b"\x04\x00\x00\x00op=\x05"
SEARCH_BYTES = 1 << 20
BEFORE_MARK = 96  # bytes of a chunk's header before its op
MOST_DAMAGE = 100
MESSAGES_PER_STEP = 1 << 14  # of a chunk that are taken together
_LENGTH = struct.Struct("<I")


@dataclass(frozen=True, slots=True)
class _MessageHeader:
    """Layout of the header of messages: a writer has the same for all. Arguments as for `alike_messages`."""

    header: NDArray[np.uint8]
    is_constant: NDArray[np.uint8]
    number_at: int
    time_at: int

    @classmethod
    def of(cls, content: bytes, at: int) -> "_MessageHeader":
        size = 4 + int(_LENGTH.unpack_from(content, at)[0])
        header = np.frombuffer(content, np.uint8, size, at)
        is_constant = np.ones(size, np.uint8)
        text = content[at : at + size]
        places = [text.index(name) + len(name) for name in (b"conn=", b"time=")]
        for place, count in zip(places, (4, 8), strict=True):
            is_constant[place : place + count] = 0
        return cls(header, is_constant, *places)


class Ros1Bag(BagSource):
    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._alike: _MessageHeader | None = None
        for _ in self.pieces(None, None):
            if self.topics.channels:
                break
        self.damage.clear()
        self.check()

    def pieces(self, start_ns: int | None, stop_ns: int | None) -> Iterator[BagPiece]:
        size = max(self.path.stat().st_size, 1)
        with open_regular(self.path) as file:
            at = len(MAGIC)
            loose: list[tuple[int, int, bytes]] = []  # messages outside of chunks
            while True:
                file.seek(at)
                try:
                    record = _record(file, size)
                    if record is not None and record[2] > size:
                        self._note(at, "The file was cut")
                except ValueError as error:
                    self._note(at, str(error))
                    at = _next_chunk(file, at + 1)
                    if at < 0:
                        break
                    continue
                if record is None:
                    break
                fields, data, end = record
                if end > size:
                    begin = end - len(data) - (end - size)
                    at = _next_chunk(file, begin)
                    end, data = (at, data[: at - begin]) if at >= 0 else (size, data)
                at = end
                operation = _byte(fields)
                if operation == CHUNK:
                    yield from self._pieces_of(fields, data, at, at / size)
                elif operation in (CONNECTION, MESSAGE):
                    try:
                        loose += self._messages(fields, data)
                    except ValueError as error:
                        self._note(at, str(error))
                    if len(loose) >= 1024:
                        yield piece_of(at / size, *zip(*loose, strict=True))
                        loose = []
            if loose:
                yield piece_of(1.0, *zip(*loose, strict=True))

    def _pieces_of(self, fields: dict[bytes, bytes], data: bytes, at: int, done: float) -> Iterator[BagPiece]:
        compression = fields.get(b"compression", b"none").decode(errors="replace")
        try:
            if compression not in ("none", "bz2", "lz4"):
                raise ValueError(f"its compression {compression!r:.20} is unknown")
            most = min(_u32(fields, b"size"), LONGEST_DATA)
            content, why = inflated(data, compression, most) if compression != "none" else (data, "")
        except ValueError as error:
            self._note(at - len(data), f"A chunk cannot be read: {error}")
            return
        if why:
            self._note(at - len(data), f"A part of a chunk cannot be read: {why}")
        inner = io.BytesIO(content)
        place = 0
        try:
            while True:
                if self._alike is not None:
                    place = yield from self._alike_pieces(self._alike, content, place, done)
                inner.seek(place)
                record = _record(inner, len(content))
                if record is None:
                    break
                if message := self._messages(record[0], record[1]):
                    yield piece_of(done, *zip(*message, strict=True))
                if _byte(record[0]) == MESSAGE and self._alike is None:
                    self._alike = _MessageHeader.of(content, place)
                place = record[2]
        except ValueError as error:
            self._note(at - len(data), f"A chunk is damaged: {error}")

    @staticmethod
    def _alike_pieces(alike: _MessageHeader, content: bytes, at: int, done: float) -> Generator[BagPiece, None, int]:
        """Messages whose headers are laid out as that of the first; returns the place after them."""
        layout = alike.header, alike.is_constant, alike.number_at, alike.time_at
        while True:
            table = np.empty((4, MESSAGES_PER_STEP), np.int64)
            count, at = alike_messages(np.frombuffer(content, np.uint8), at, *layout, table)
            if count:
                yield BagPiece(content, np.ascontiguousarray(table[:, :count]), done)
            if count < MESSAGES_PER_STEP:
                return at

    def _messages(self, fields: dict[bytes, bytes], data: bytes) -> list[tuple[int, int, bytes]]:
        """The message of a record, or none: a connection is learned."""
        operation = _byte(fields)
        if operation == MESSAGE:
            time = fields.get(b"time", b"")
            if len(time) != 8:
                raise ValueError("a message without time")
            second, nano = struct.unpack("<II", time)
            return [(_u32(fields, b"conn"), second * 1_000_000_000 + nano, data)]
        if operation == CONNECTION:
            about = _fields(data)
            topic = about.get(b"topic") or fields.get(b"topic", b"")
            kind = about.get(b"type", b"").decode(errors="replace")
            package, _, name = kind.partition("/")
            text = about.get(b"message_definition", b"").decode(errors="replace")
            self.topics.add(
                _u32(fields, b"conn"),
                topic.decode(errors="replace"),
                f"{package}/msg/{name}",
                ("ros1", "ros1msg"),
                text,
            )
        return []

    def _note(self, at: int, words: str) -> None:
        if len(self.damage) < MOST_DAMAGE:
            self.damage.append(FileDamage(at, f"{words[:1].upper()}{words[1:]}."))


def _record(file: BinaryIO, size: int) -> tuple[dict[bytes, bytes], bytes, int] | None:
    """Header, data and end of the next record; None at the end of the file. A chunk may end beyond it.

    Raises:
        ValueError: it is damaged, or the file was cut in it.
    """
    begin = file.tell()
    word = file.read(4)
    if not word:
        return None
    length = _LENGTH.unpack(word)[0] if len(word) == 4 else LONGEST_HEADER
    if length >= LONGEST_HEADER:
        raise ValueError(f"no record at byte {begin}")
    header = file.read(length + 4)
    if len(header) < length + 4:
        raise ValueError("the file was cut")
    (count,) = _LENGTH.unpack_from(header, length)
    fields, end = _fields(header[:length]), begin + 8 + length + count
    if count >= LONGEST_DATA or (end > size and _byte(fields) != CHUNK):
        raise ValueError(f"the record at byte {begin} is longer than the file")
    return fields, file.read(count), end


def _fields(header: bytes) -> dict[bytes, bytes]:
    """Fields of a header; ValueError if it is not one."""
    fields = {}
    at = 0
    while at < len(header):
        if at + 4 > len(header):
            raise ValueError("a header ends within a field")
        (length,) = _LENGTH.unpack_from(header, at)
        end = at + 4 + length
        name, equals, value = header[at + 4 : end].partition(b"=")
        if end > len(header) or not equals:
            raise ValueError("a header has a field without a name")
        fields[name] = value
        at = end
    return fields


def _byte(fields: dict[bytes, bytes]) -> int:
    return (fields.get(b"op") or b"\0")[0]


def _u32(fields: dict[bytes, bytes], name: bytes) -> int:
    value = fields.get(name, b"")
    if len(value) != 4:
        raise ValueError(f"a header without {name.decode()}")
    return int(_LENGTH.unpack(value)[0])


def _next_chunk(file: BinaryIO, at: int) -> int:
    """Begin of the next chunk record from a place on; -1 without one."""
    file.seek(at)
    held = b""
    while data := file.read(SEARCH_BYTES):
        held += data
        mark_at = held.find(CHUNK_MARK)
        while mark_at >= 0:
            for begin in range(max(0, mark_at - BEFORE_MARK), mark_at - 3):
                (length,) = _LENGTH.unpack_from(held, begin)
                if mark_at - begin + len(CHUNK_MARK) <= length + 4 <= len(held) - begin and length < LONGEST_HEADER:
                    try:
                        fields = _fields(held[begin + 4 : begin + 4 + length])
                    except ValueError:
                        continue
                    if b"compression" in fields:
                        return at + begin
            mark_at = held.find(CHUNK_MARK, mark_at + 1)
        keep = min(len(held), 2 * BEFORE_MARK)
        at += len(held) - keep
        held = held[-keep:]
    return -1


def _open(request: OpenRequest) -> Ros1Bag:
    return Ros1Bag(request.path)


register_reader(FileReader("ros1-bag", "ROS 1 bag", (".bag",), _open, {0: (b"#ROSBAG V2.0",)}, order=10))
