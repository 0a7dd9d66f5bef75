"""A closed recording is rewritten: chunks of about a megabyte, compressed and indexed, so that it is small and any
moment of it is found at once.

The records of a message are copied as they stand; only where they lie changes. So packing runs at the speed of the
compression, in little memory. The new file is written beside the old one, read again, and takes the other's name only
when it is on disk and holds the same messages, byte for byte. A file that somebody writes is left alone, and so is one
that is damaged anywhere but at its torn end: what stands behind a damage must not be thrown away.

    magic, header
    [chunk: schemas, channels, messages][one message index a channel]   …again and again
    metadata                                                            what was told last of each name
    data end
    summary: schemas, channels, statistics, chunk indexes, metadata indexes, summary offsets
    footer, magic

Source: MCAP specification, "Chunk", "Message Index", "Summary Section".
"""

from __future__ import annotations

import contextlib
import os
import struct
import sys
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from protocols.framing import Ints
from recordings import file_lock
from recordings.blocks import CHANNEL_ID, DATA, LENGTH, MESSAGE_INDEX, TIME, Recording, Topic
from recordings.container import PROFILE, RecordingError, problem
from recordings.orphans import end_with_parent
from recordings.records import MAGIC, bytes_of, ending, message

CHUNK_BYTES = 1 << 20
ASIDE = ".packing"  # a file that is being written beside the other
_HEAD = 9 + 22  # of a message record, before its data
_LEVEL = 3


def pack(path: Path, *, edit: Mapping[str, str] | None = None, progress: Callable[[float], None] | None = None) -> None:
    """Rewrite a recording in place.

    Args:
        path: of an MCAP file, torn or whole.
        edit: metadata "edit" to write into it.
        progress: called with 0..1.
    Raises:
        RecordingError: the disk failed, somebody writes the file, it is damaged in its middle, or the copy is not the
            same; the file is as it was.
    """
    # Each process has its own: one whose server was killed may still be at work when the next server begins anew.
    aside = path.with_name(f".{path.name}.{os.getpid()}{ASIDE}")
    try:
        with path.open("rb") as held, Recording(path) as source, aside.open("w+b") as out:
            if not file_lock.share(held.fileno()):
                raise RecordingError(
                    f"{path.name} is being recorded.", "It can be packed when the recording has ended."
                )
            file_lock.share(out.fileno())
            packed(source, out, edit=edit, progress=progress)
            _nothing_lost(source)
            out.flush()
            os.fsync(out.fileno())
            _same(source, aside)
            stamp = path.stat()
            if not os.path.samestat(stamp, os.fstat(held.fileno())):
                raise RecordingError(
                    f"{path.name} was replaced while it was packed.", "It is packed at the next start."
                )
            os.utime(aside, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
            os.replace(aside, path)
        _sync_folder(path.parent)
    except OSError as error:
        aside.unlink(missing_ok=True)
        raise problem(error, path) from None
    except BaseException:  # also when somebody has enough of waiting
        aside.unlink(missing_ok=True)
        raise


def _nothing_lost(source: Recording) -> None:
    """What was torn off is gone; what stands behind a damage is not, and must not be thrown away."""
    for damage in source.damage:
        if source.chunks or not damage.torn:
            raise RecordingError(
                f"{source.path.name} is damaged and stays as it is: {damage.words}", "All that is whole opens."
            )


def _same(source: Recording, made: Path) -> None:
    """Raise RecordingError unless the new file holds what the source holds, and the source what it says it holds."""
    wanted = _fingerprint(source)
    told = source.statistics
    count = sum(wanted[0].values())
    if told is not None and told.message_count != count:
        words = f"{source.path.name} stays as it is: {count} of its {told.message_count} messages were found."
        raise RecordingError(words, "All that is whole opens.")
    with Recording(made) as copy:
        found = _fingerprint(copy)
        if copy.damage or found != wanted:
            words = f"{source.path.name} stays as it is: its packed copy does not hold the same."
            raise RecordingError(words, "Report this: it is a defect of imuscope, or of the disk.")


def _fingerprint(recording: Recording) -> tuple[dict[int, int], int]:
    """How many messages each channel has, and a checksum over all of them as they stand."""
    counts: Counter[int] = Counter()
    checksum = 0
    for block in recording.blocks():
        rows = block.table
        channels, found = np.unique(rows[CHANNEL_ID], return_counts=True)
        counts.update(dict(zip(channels.tolist(), found.tolist(), strict=True)))
        for start, stop in _runs(rows):
            first, last = int(rows[DATA, start]) - _HEAD, int(rows[DATA, stop - 1] + rows[LENGTH, stop - 1])
            checksum = zlib.crc32(block.data[first:last], checksum)
    return dict(counts), checksum


def _runs(rows: Ints) -> Iterator[tuple[int, int]]:
    """(first, past the last) of messages that lie one after the other."""
    apart = np.flatnonzero(rows[DATA, 1:] - _HEAD != rows[DATA, :-1] + rows[LENGTH, :-1]) + 1
    yield from pairwise([0, *apart.tolist(), rows.shape[1]])


def is_loose(path: Path) -> bool:
    """Whether this is a finished recording of ours that is not packed yet."""
    if file_lock.is_written(path):
        return False
    try:
        with Recording(path) as recording:
            return recording.is_ours and not recording.chunks and next(iter(recording.blocks()), None) is not None
    except RecordingError:
        return False


def packed(
    source: Recording,
    out: BinaryIO,
    *,
    edit: Mapping[str, str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Write `source`, chunked and indexed, to `out`: a download is this, too."""
    target = _Target(out)
    for block in source.blocks():
        target.learn(source)
        rows = block.table
        ends = np.cumsum(rows[LENGTH] + _HEAD)
        cuts = np.searchsorted(ends, np.arange(CHUNK_BYTES, int(ends[-1]) + CHUNK_BYTES, CHUNK_BYTES), "right")
        start = 0
        for stop in np.unique(np.append(np.minimum(cuts + 1, len(ends)), len(ends))).tolist():
            if stop > start:
                target.chunk(block.data, rows[:, start:stop])
                start = stop
        if progress is not None:
            progress(block.done / max(source.size, 1))
    target.learn(source)
    kept = {name: values for name, values in source.metadata}  # noqa: C416 - the last of each name holds
    if edit is not None:
        kept["edit"] = dict(edit)
    target.end(kept)


def wrapped(
    topics: Mapping[int, Topic],
    pieces: Iterable[tuple[int, bytes, Ints, Ints]],
    metadata: Mapping[str, Mapping[str, str]],
    out: BinaryIO,
) -> None:
    """Write a recording of what comes from elsewhere, chunked and indexed.

    Args:
        topics: the channels, by id.
        pieces: (channel, data, where each message ends in it, when each was logged in ns), in order.
        metadata: by name.
    """
    target = _Target(out)
    target.tell(topics)
    for channel, data, ends, times in pieces:
        starts = np.concatenate(([0], ends[:-1]))
        first = 0
        while first < len(ends):
            past = max(int(np.searchsorted(ends, int(starts[first]) + CHUNK_BYTES, "right")), first + 1)
            cuts = zip(starts[first:past].tolist(), ends[first:past].tolist(), times[first:past].tolist(), strict=True)
            body = b"".join(message(channel, time, data[start:end]) for start, end, time in cuts)
            sizes = ends[first:past] - starts[first:past]
            at = np.cumsum(sizes + _HEAD) - sizes
            rows = np.stack((np.full(past - first, channel), times[first:past], at, sizes)).astype(np.int64)
            target.chunk(memoryview(body), rows)
            first = past
    target.end(metadata)


class _Target:
    """The file that is written."""

    def __init__(self, out: BinaryIO) -> None:
        self._out = out
        self._at = 0
        self._schemas: dict[str, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._new: list[McapRecord] = []  # told within the next chunk
        self._indexes: list[ChunkIndex] = []
        self._counts: dict[int, int] = {}
        self._first, self._last = 0, 0
        self._zstd = zstandard.ZstdCompressor(level=_LEVEL)
        self._put(MAGIC + bytes_of(Header(PROFILE, "imuscope")))

    def _put(self, data: bytes) -> int:
        at = self._at
        self._out.write(data)
        self._at += len(data)
        return at

    def learn(self, source: Recording) -> None:
        """Channels that the source has told of since the last time."""
        self.tell(source.topics)

    def tell(self, topics: Mapping[int, Topic]) -> None:
        """Those of these channels that are new."""
        for topic in topics.values():
            if topic.id in self._channels:
                continue
            number = 0
            if topic.schema:
                schema = self._schemas.get(topic.schema)
                if schema is None:
                    number = len(self._schemas) + 1
                    schema = Schema(
                        id=number, data=topic.schema_data, encoding=topic.schema_encoding, name=topic.schema
                    )
                    self._schemas[topic.schema] = schema
                    self._new.append(schema)
                number = schema.id
            channel = Channel(
                id=topic.id, topic=topic.name, message_encoding=topic.encoding, metadata={}, schema_id=number
            )
            self._channels[topic.id] = channel
            self._new.append(channel)

    def chunk(self, data: memoryview, rows: Ints) -> None:
        """One chunk of these messages, and its indexes."""
        head = b"".join(bytes_of(record) for record in self._new)
        self._new.clear()
        sizes = rows[LENGTH] + _HEAD
        offsets = len(head) + np.cumsum(sizes) - sizes
        starts, ends = (rows[DATA] - _HEAD).tolist(), (rows[DATA] + rows[LENGTH]).tolist()
        if ends[-1] - starts[0] == int(sizes.sum()):  # they lie one after the other
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
            mine = rows[CHANNEL_ID] == channel
            pairs = np.column_stack((rows[TIME][mine], offsets[mine])).astype("<u8").tobytes()
            told = struct.pack("<HI", channel, len(pairs)) + pairs
            index.message_index_offsets[channel] = self._put(struct.pack("<BQ", MESSAGE_INDEX, len(told)) + told)
            self._counts[channel] = self._counts.get(channel, 0) + int(mine.sum())
        index.message_index_length = self._at - begin
        self._first = min(self._first, first) if self._indexes else first
        self._last = max(self._last, last)
        self._indexes.append(index)

    def end(self, metadata: Mapping[str, Mapping[str, str]]) -> None:
        """Metadata, data end, summary, footer."""
        told = []
        for name, values in metadata.items():
            record = bytes_of(Metadata(name=name, metadata=dict(values)))
            told.append(MetadataIndex(offset=self._put(record), length=len(record), name=name))
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._indexes),
            message_count=sum(self._counts.values()),
            metadata_count=len(told),
            message_start_time=self._first,
            message_end_time=self._last,
            schema_count=len(self._schemas),
        )
        groups: list[tuple[int, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, list(self._indexes)),
            (Opcode.METADATA_INDEX, list(told)),
        ]
        self._put(ending(self._at, groups))


def _sync_folder(folder: Path) -> None:
    """The new name is on disk, too."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def main() -> int:
    """`python -m recordings.packing FILE …`: pack each, with what priority is left over by others."""
    end_with_parent()
    with contextlib.suppress(OSError, AttributeError):
        os.nice(10)
    for name in sys.argv[1:]:
        try:
            pack(Path(name))
        except RecordingError as error:
            print(f"{error} {error.hint}".rstrip(), file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
