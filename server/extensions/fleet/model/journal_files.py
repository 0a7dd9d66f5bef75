"""Files of a journal: reports with events, appended by one thread, read again after a restart.

    fleet-journal/0000000007.reports
      ┌──────┬─────┬──────────────────┬──────┬─────┬────────┬─
      │length│CRC32│run: boot, before │length│CRC32│ report │ …       4 bytes each, big-endian; MessagePack
      └──────┴─────┴──────────────────┴──────┴─────┴────────┴─

A run names the robot's start that the reports after it are of, and the number `before` them in earlier files. A file is
read up to the first piece that is not whole, which is where a power cut ended it, and is never written to again: each
start of the robot begins a new one. Reports that are in two files, because files were joined, count once.

A status is not written: the next run has its own. So a robot to which nothing happens writes nothing.
"""

import contextlib
import logging
import os
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from imuscope.recordings.system import atomic_write
from imuscope.server.extensions.fleet.model.reports import MAX_REPORT, Boot, Count, ReportError, decode_report

log = logging.getLogger("imuscope.fleet")

SUFFIX = ".reports"
FILES_PER_LIMIT = 8  # a file has this share of the limit, so that little is lost with the oldest
JOIN_ABOVE = 32  # files: a robot that is started often begins many
_head = struct.Struct(">II")


class _RunMark(msgspec.Struct, frozen=True):
    run: Boot
    before: Count = 0


_marks = msgspec.msgpack.Decoder(_RunMark)


@dataclass(slots=True)
class StoredRun:
    """Reports of a run that were read.

    Args:
        before: reports up to this number are not kept.
    """

    boot: str
    before: int
    reports: list[tuple[int, bytes]] = field(default_factory=list)

    @property
    def last(self) -> int:
        return self.reports[-1][0] if self.reports else self.before


@dataclass(slots=True)
class _File:
    path: Path
    size: int
    lasts: dict[str, int]  # by run: number of its last report here


class JournalFiles:
    """The folder. To be used in one thread.

    Args:
        limit: bytes of all files; above it the oldest are removed.
    """

    def __init__(self, folder: Path, limit: int) -> None:
        self._folder, self._limit = folder, limit
        self._files: list[_File] = []
        self._next = 1
        self._handle: int | None = None
        self._run = ""

    def load(self) -> list[StoredRun]:
        """Read the stored reports, oldest run first. Damaged ones are left out and logged."""
        runs: dict[str, StoredRun] = {}
        for path in self._paths():
            self._next = int(path.stem) + 1
            try:
                data = path.read_bytes()
            except OSError as error:
                log.warning("%s cannot be read: %s.", path, error.strerror)
                continue
            file = _File(path, len(data), {})
            try:
                self._add(data, runs, file)
            except (ReportError, msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                log.warning("%s is damaged; reports after the damage are left out.", path)
            self._files.append(file)
        if len(self._files) > JOIN_ABOVE:
            self._join(runs.values())
        return [run for run in runs.values() if run.reports]

    def _paths(self) -> list[Path]:
        try:
            paths = list(self._folder.iterdir())
        except OSError:
            return []
        return sorted(path for path in paths if path.suffix == SUFFIX and path.stem.isascii() and path.stem.isdigit())

    def _add(self, data: bytes, runs: dict[str, StoredRun], file: _File) -> None:
        run: StoredRun | None = None
        for piece in _pieces(data):
            if run is None or piece.startswith(b"\x82\xa3run"):
                mark = _marks.decode(piece)
                run = runs.setdefault(mark.run, StoredRun(mark.run, mark.before))
                continue
            number = decode_report(piece).number
            file.lasts[run.boot] = max(number, file.lasts.get(run.boot, 0))
            if number > run.last:
                run.reports.append((number, piece))

    def _join(self, runs: Iterable[StoredRun]) -> None:
        """Write all that was read into the place of the newest file. Killed between, both count as one."""
        pieces: list[bytes] = []
        lasts: dict[str, int] = {}
        for run in runs:
            pieces += [_mark(run.boot, run.before), *(_piece(data) for _, data in run.reports)]
            lasts[run.boot] = run.last
        joined, path = b"".join(pieces), self._files[-1].path
        try:
            atomic_write.write_atomic(path, joined)
        except OSError as error:
            log.warning("The files of %s cannot be joined: %s.", self._folder, error.strerror)
            return
        for file in self._files[:-1]:
            with contextlib.suppress(OSError):
                file.path.unlink()
        self._files = [_File(path, len(joined), lasts)]

    def append(self, boot: str, reports: Iterable[tuple[int, bytes]], before: int) -> None:
        """Write reports of a run, oldest first. Only `sync` makes them survive a power cut.

        Args:
            before: number of the report before, of this run.

        Raises:
            OSError: such as a full disk; they have to be passed again.
        """
        pieces, last = bytearray(), before
        for number, data in reports:
            pieces += _piece(data)
            last = number
        try:
            if self._handle is None or self._run != boot:
                self._begin(boot, before)
            assert self._handle is not None
            _write(self._handle, bytes(pieces))
        except OSError:
            self.close()  # it may end in half a piece
            raise
        file = self._files[-1]
        file.size += len(pieces)
        file.lasts[boot] = last
        if file.size >= self._limit // FILES_PER_LIMIT:
            self.sync()
            self.close()
        while len(self._files) > 1 and sum(one.size for one in self._files) > self._limit:
            self._remove(self._files[0])

    def sync(self) -> None:
        """Make the written data survive a power cut.

        Raises:
            OSError: the disk failed.
        """
        if self._handle is not None:
            os.fsync(self._handle)

    def remove(self, is_kept: Callable[[str, int], bool]) -> None:
        """Remove files whose runs are all kept elsewhere up to their last number here."""
        for file in self._files[: None if self._handle is None else -1]:
            if all(is_kept(boot, last) for boot, last in file.lasts.items()):
                self._remove(file)

    def close(self) -> None:
        """End the file that is written to."""
        if self._handle is not None:
            with contextlib.suppress(OSError):
                os.close(self._handle)
        self._handle = None

    def _begin(self, boot: str, before: int) -> None:
        self.close()
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / f"{self._next:010}{SUFFIX}"
        self._handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        self._next += 1
        self._run = boot
        mark = _mark(boot, before)
        self._files.append(_File(path, len(mark), {}))
        _write(self._handle, mark)

    def _remove(self, file: _File) -> None:
        with contextlib.suppress(OSError):
            file.path.unlink()
        self._files.remove(file)


def _piece(data: bytes) -> bytes:
    return _head.pack(len(data), zlib.crc32(data)) + data


def _mark(boot: str, before: int) -> bytes:
    return _piece(msgspec.msgpack.encode(_RunMark(boot, before)))


def _pieces(data: bytes) -> Iterator[bytes]:
    """Whole pieces up to the end.

    Raises:
        ReportError: the rest is not whole.
    """
    at = 0
    while at < len(data):
        if at + _head.size > len(data):
            raise ReportError("The file ends in a piece.")
        length, checksum = _head.unpack_from(data, at)
        piece = data[at + _head.size : at + _head.size + length]
        if length > MAX_REPORT or len(piece) < length or zlib.crc32(piece) != checksum:
            raise ReportError("A piece is not whole.")
        yield piece
        at += _head.size + length


def _write(handle: int, data: bytes) -> None:
    while data:
        data = data[os.write(handle, data) :]
