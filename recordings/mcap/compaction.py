"""Compaction of a closed recording into chunks, compressed and indexed (recordings/mcap/chunked.py): small and quick to
seek.

The records of messages are copied unchanged; only their place changes. So compaction runs at the speed of the
compression, in little memory. The new file is written beside the old one, read back, and replaces it only when it is on
disk and holds the same messages, byte for byte. A file that is being written is left alone, and so is one that is
damaged anywhere but at its torn end: data after the damage must not be lost.
"""

import os
import shutil
import sys
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.messages.records import MessageChannel
from imuscope.recordings.errors import RecordingError, disk_error
from imuscope.recordings.mcap.chunked import HEAD, ChunkedFile, chunk_bytes, cut
from imuscope.recordings.mcap.own_recordings import TEMPORARY_SUFFIX
from imuscope.recordings.mcap.reader import CHANNEL_ID, DATA, LENGTH, McapReader
from imuscope.recordings.mcap.records import message
from imuscope.recordings.system import atomic_write, file_lock
from imuscope.recordings.system.parent_death import die_with_parent, report_to_parent
from imuscope.recordings.system.priority import lower_priority
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.system.resource_limits import TooLong, bounded, bounded_by

MAX_MEMORY_BYTES = 1 << 30  # bytes, of which it takes a tenth: it holds one chunk of a recording at a time


def compact(
    path: Path, *, edit: Mapping[str, str] | None = None, progress: Callable[[float], None] | None = None
) -> None:
    """Rewrite a recording in place.

    Args:
        path: of an MCAP file, torn or whole.
        edit: metadata "edit" to write into it.
        progress: called with 0..1.

    Raises:
        RecordingError: the disk failed, the file is being written, it is damaged in its middle, or the copy differs;
            the file is unchanged.
    """
    # One per process: that of a killed server may still be working when the next server starts.
    temporary = path.with_name(f".{path.name}.{os.getpid()}{TEMPORARY_SUFFIX}")
    try:
        with open_regular(path) as held, McapReader(path) as source, temporary.open("w+b") as out:
            os.fchmod(out.fileno(), os.fstat(held.fileno()).st_mode & 0o777)
            if not file_lock.share(held.fileno()):
                raise RecordingError(
                    f"{path.name} is being recorded.", "It can be packed when the recording has ended."
                )
            file_lock.share(out.fileno())
            write_compacted(source, out, edit=edit, progress=progress)
            _nothing_lost(source)
            out.flush()
            os.fsync(out.fileno())
            _same(source, temporary)
            stamp = path.stat()
            if not os.path.samestat(stamp, os.fstat(held.fileno())):
                raise RecordingError(
                    f"{path.name} was replaced while it was packed.", "It is packed at the next start."
                )
            os.utime(temporary, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
            atomic_write.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise disk_error(error, path) from None
    except BaseException:  # also on cancellation
        temporary.unlink(missing_ok=True)
        raise


def _nothing_lost(source: McapReader) -> None:
    """Check that nothing readable would be lost: a torn tail is lost anyway, data after a damaged part is not."""
    for damage in source.damage:
        if source.chunks or not damage.torn:
            raise RecordingError(
                f"{source.path.name} is damaged and stays as it is: {damage.words}", "All that is whole opens."
            )


def _same(source: McapReader, made: Path) -> None:
    """Raise RecordingError unless the new file holds all messages of the source, and the source all that it counts."""
    expected = _fingerprint(source)
    statistics = source.statistics
    count = sum(expected[0].values())
    if statistics is not None and statistics.message_count != count:
        words = f"{source.path.name} stays as it is: {count} of its {statistics.message_count} messages were found."
        raise RecordingError(words, "All that is whole opens.")
    with McapReader(made) as copy:
        fingerprint = _fingerprint(copy)
        if copy.damage or fingerprint != expected:
            words = f"{source.path.name} stays as it is: its packed copy does not hold the same."
            raise RecordingError(words, "Report this: it is a defect of imuscope, or of the disk.")


def _fingerprint(recording: McapReader) -> tuple[dict[int, int], int]:
    """Message count of each channel, and a checksum over all messages."""
    counts: Counter[int] = Counter()
    checksum = 0
    for block in recording.blocks():
        rows = block.table
        channels, numbers = np.unique(rows[CHANNEL_ID], return_counts=True)
        counts.update(dict(zip(channels.tolist(), numbers.tolist(), strict=True)))
        for start, stop in _runs(rows):
            first, last = int(rows[DATA, start]) - HEAD, int(rows[DATA, stop - 1] + rows[LENGTH, stop - 1])
            checksum = zlib.crc32(block.data[first:last], checksum)
    return dict(counts), checksum


def _runs(rows: Ints) -> Iterator[tuple[int, int]]:
    """(first, past the last) of runs of consecutive messages."""
    apart = np.flatnonzero(rows[DATA, 1:] - HEAD != rows[DATA, :-1] + rows[LENGTH, :-1]) + 1
    yield from pairwise([0, *apart.tolist(), rows.shape[1]])


def write_compacted(
    source: McapReader,
    out: BinaryIO,
    *,
    edit: Mapping[str, str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Write `source`, chunked and indexed, to `out`; also used for downloads."""
    target = ChunkedFile(out)
    largest = chunk_bytes(source.size)
    for block in source.blocks():
        target.write_channels(source.topics)
        for start, stop in cut(block.table[LENGTH] + HEAD, largest):
            target.chunk(block.data, block.table[:, start:stop])
        if progress is not None:
            progress(block.done / max(source.size, 1))
    target.write_channels(source.topics)
    metadata = {name: values for name, values in source.metadata}  # noqa: C416 - the last of each name holds
    if edit is not None:
        metadata["edit"] = dict(edit)
    target.end(metadata)


def write_recording(
    topics: Mapping[int, MessageChannel],
    pieces: Iterable[tuple[int, bytes, Ints, Ints]],
    metadata: Mapping[str, Mapping[str, str]],
    size: int,
    out: BinaryIO,
) -> None:
    """Write data of other origin as a recording, chunked and indexed.

    Args:
        topics: the channels, by id.
        pieces: (channel, data, where each message ends in it, when each was logged in ns), in order.
        pieces: (channel, data, end of each message in it, log time of each in ns), in order.
        metadata: by name.
        size: of all data, bytes, roughly.
    """
    target = ChunkedFile(out)
    target.write_channels(topics)
    for channel, data, ends, times in pieces:
        starts = np.concatenate(([0], ends[:-1]))
        for first, past in cut(ends - starts + HEAD, chunk_bytes(size)):
            cuts = zip(starts[first:past].tolist(), ends[first:past].tolist(), times[first:past].tolist(), strict=True)
            body = b"".join(message(channel, time, data[start:end]) for start, end, time in cuts)
            sizes = ends[first:past] - starts[first:past]
            at = np.cumsum(sizes + HEAD) - sizes
            rows = np.stack((np.full(past - first, channel), times[first:past], at, sizes)).astype(np.int64)
            target.chunk(memoryview(body), rows)
    target.end(metadata)


def main() -> int:
    """`python -m imuscope.recordings.mcap.compaction FILE …`: compact each, at low priority.

    Reports each as a line of JSON: path, packed, and the error message. One that exceeds its memory or time ends the
    process.
    """
    die_with_parent()
    lower_priority(10)
    bounded(MAX_MEMORY_BYTES)
    for name in sys.argv[1:]:
        has_room, message, is_over = False, "", False
        try:
            bounded_by(Path(name), is_last=name == sys.argv[-1])
            has_room = _has_room(Path(name))
            if has_room:
                compact(Path(name))
        except RecordingError as error:
            message = f"{error} {error.hint}".rstrip()
        except (MemoryError, TooLong) as error:
            what, is_over = "memory" if isinstance(error, MemoryError) else "time", True
            message = f"It stays as it is: packing it takes more {what} than it may have."
        report_to_parent(path=name, packed=has_room and not message, message=message)
        if is_over:
            return 1
    return 0


def _has_room(path: Path) -> bool:
    """Whether the disk has room for a copy: the compacted file is smaller, but by an unknown amount."""
    try:
        return shutil.disk_usage(path.parent).free > path.stat().st_size
    except OSError:
        return False


if __name__ == "__main__":
    raise SystemExit(main())
