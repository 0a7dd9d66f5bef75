"""A closed recording is rewritten: in chunks, compressed and indexed (recordings/chunked.py), so that it is small and
any moment of it is found at once.

The records of a message are copied as they stand; only where they lie changes. So packing runs at the speed of the
compression, in little memory. The new file is written beside the old one, read again, and takes the other's name only
when it is on disk and holds the same messages, byte for byte. A file that somebody writes is left alone, and so is one
that is damaged anywhere but at its torn end: what stands behind a damage must not be thrown away.
"""

from __future__ import annotations

import contextlib
import json
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

from protocols.framing import Ints
from recordings import file_lock
from recordings.bounds import TooLong, bounded, bounded_by
from recordings.chunked import HEAD, ChunkedFile, chunk_bytes, cut
from recordings.mcap_reader import CHANNEL_ID, DATA, LENGTH, McapChannel, McapReader
from recordings.mcap_records import message
from recordings.mcap_writer import RecordingError, disk_error
from recordings.parent_death import die_with_parent

MEMORY = 1 << 30  # bytes, of which it takes a tenth: of a recording it holds a chunk at a time
ASIDE = ".packing"  # a file that is being written beside the other


def compact(
    path: Path, *, edit: Mapping[str, str] | None = None, progress: Callable[[float], None] | None = None
) -> None:
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
        with path.open("rb") as held, McapReader(path) as source, aside.open("w+b") as out:
            if not file_lock.share(held.fileno()):
                raise RecordingError(
                    f"{path.name} is being recorded.", "It can be packed when the recording has ended."
                )
            file_lock.share(out.fileno())
            write_compacted(source, out, edit=edit, progress=progress)
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
        raise disk_error(error, path) from None
    except BaseException:  # also when somebody has enough of waiting
        aside.unlink(missing_ok=True)
        raise


def _nothing_lost(source: McapReader) -> None:
    """What was torn off is gone; what stands behind a damage is not, and must not be thrown away."""
    for damage in source.damage:
        if source.chunks or not damage.torn:
            raise RecordingError(
                f"{source.path.name} is damaged and stays as it is: {damage.words}", "All that is whole opens."
            )


def _same(source: McapReader, made: Path) -> None:
    """Raise RecordingError unless the new file holds what the source holds, and the source what it says it holds."""
    wanted = _fingerprint(source)
    told = source.statistics
    count = sum(wanted[0].values())
    if told is not None and told.message_count != count:
        words = f"{source.path.name} stays as it is: {count} of its {told.message_count} messages were found."
        raise RecordingError(words, "All that is whole opens.")
    with McapReader(made) as copy:
        found = _fingerprint(copy)
        if copy.damage or found != wanted:
            words = f"{source.path.name} stays as it is: its packed copy does not hold the same."
            raise RecordingError(words, "Report this: it is a defect of imuscope, or of the disk.")


def _fingerprint(recording: McapReader) -> tuple[dict[int, int], int]:
    """How many messages each channel has, and a checksum over all of them as they stand."""
    counts: Counter[int] = Counter()
    checksum = 0
    for block in recording.blocks():
        rows = block.table
        channels, found = np.unique(rows[CHANNEL_ID], return_counts=True)
        counts.update(dict(zip(channels.tolist(), found.tolist(), strict=True)))
        for start, stop in _runs(rows):
            first, last = int(rows[DATA, start]) - HEAD, int(rows[DATA, stop - 1] + rows[LENGTH, stop - 1])
            checksum = zlib.crc32(block.data[first:last], checksum)
    return dict(counts), checksum


def _runs(rows: Ints) -> Iterator[tuple[int, int]]:
    """(first, past the last) of messages that lie one after the other."""
    apart = np.flatnonzero(rows[DATA, 1:] - HEAD != rows[DATA, :-1] + rows[LENGTH, :-1]) + 1
    yield from pairwise([0, *apart.tolist(), rows.shape[1]])


def is_uncompacted(path: Path) -> bool:
    """Whether this is a finished recording of ours that is not packed yet."""
    if file_lock.is_written(path):
        return False
    try:
        with McapReader(path) as recording:
            return recording.is_ours and not recording.chunks and next(iter(recording.blocks()), None) is not None
    except RecordingError:
        return False


def write_compacted(
    source: McapReader,
    out: BinaryIO,
    *,
    edit: Mapping[str, str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Write `source`, chunked and indexed, to `out`: a download is this, too."""
    target = ChunkedFile(out)
    largest = chunk_bytes(source.size)
    for block in source.blocks():
        target.tell(source.topics)
        for start, stop in cut(block.table[LENGTH] + HEAD, largest):
            target.chunk(block.data, block.table[:, start:stop])
        if progress is not None:
            progress(block.done / max(source.size, 1))
    target.tell(source.topics)
    kept = {name: values for name, values in source.metadata}  # noqa: C416 - the last of each name holds
    if edit is not None:
        kept["edit"] = dict(edit)
    target.end(kept)


def write_recording(
    topics: Mapping[int, McapChannel],
    pieces: Iterable[tuple[int, bytes, Ints, Ints]],
    metadata: Mapping[str, Mapping[str, str]],
    size: int,
    out: BinaryIO,
) -> None:
    """Write a recording of what comes from elsewhere, chunked and indexed.

    Args:
        topics: the channels, by id.
        pieces: (channel, data, where each message ends in it, when each was logged in ns), in order.
        metadata: by name.
        size: of all data, bytes, about.
    """
    target = ChunkedFile(out)
    target.tell(topics)
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


def _sync_folder(folder: Path) -> None:
    """The new name is on disk, too."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def main() -> int:
    """`python -m recordings.compaction FILE …`: pack each, with what priority is left over by others.

    Each is told of in a line of JSON: path, packed, and the message of what went wrong. One that takes more memory or
    time than it may have is the last.
    """
    die_with_parent()
    with contextlib.suppress(OSError, AttributeError):
        os.nice(10)
    bounded(MEMORY)
    for name in sys.argv[1:]:
        has_room, message, is_over = False, "", False
        try:
            bounded_by(Path(name))
            has_room = _has_room(Path(name))
            if has_room:
                compact(Path(name))
        except RecordingError as error:
            message = f"{error} {error.hint}".rstrip()
        except (MemoryError, TooLong) as error:
            what, is_over = "memory" if isinstance(error, MemoryError) else "time", True
            message = f"It stays as it is: packing it takes more {what} than it may have."
        print(json.dumps({"path": name, "packed": has_room and not message, "message": message}), flush=True)
        if is_over:
            return 1
    return 0


def _has_room(path: Path) -> bool:
    """The packed file stands beside the other for a moment; it is smaller, and nobody knows how much."""
    try:
        return shutil.disk_usage(path.parent).free > path.stat().st_size
    except OSError:
        return False


if __name__ == "__main__":
    raise SystemExit(main())
