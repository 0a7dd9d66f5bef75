"""What is in this file, and how is it read? A format is one row: what its name and its first bytes say, and its reader.

    .mcap              a recording of ours; of others, where their messages are plain numbers (recordings/tabular.py)
    .mtb               frames of an Xsens device, one after the other
    .raw .dat       logs of Inertial Sense devices (recordings/inertial_sense_logs.py); all parts of a split log are one
    .csv               a table with a time column (recordings/tabular.py)
    everything else    bytes as they came from a port, of any protocol

A capture has no times of arrival. They are made from the device's own clock, as if the line had been quick (Pace):
`timed` is False then, and the page says so. It is dated by the UTC in it, or by its head or name; where none of them
says anything it ends when the file was last written.

Source: of each format, see its module.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from protocols.registry import PROTOCOLS, detect, permissive_decoder
from recordings import inertial_sense_logs
from recordings.capture_timing import CaptureTiming
from recordings.mcap_reader import MAGIC, FileDamage, McapReader
from recordings.mcap_writer import READABLE, RecordingError
from recordings.sources import ChunkBlock, McapSource, Source, SourceDevice
from recordings.tabular import CsvSource, MessageSource

GUESS_BYTES = 1 << 16
GUESS_SCORE = 0.5
DATE_BYTES = 1 << 22  # of a log whose name says when it began: in so many a device with a receiver has told the date
SUFFIXES = (".mcap", ".mtb", ".raw", ".dat", ".bin", ".log", ".txt", ".csv", ".hex", ".ubx", ".nmea", ".idtp", ".isb")
DEVICE = "1"


class CaptureSource:
    """Bytes of one device, without times: a capture, an .mtb, a .raw log and its further parts.

    Args:
        files: one after the other.
        protocol: "" to recognise it.
    """

    timed = False
    guessed = False  # whether its times are, for want of a clock in it; known when its parts are read

    def __init__(self, files: list[Path], format: str, protocol: str = "", about: Mapping[str, str] = {}) -> None:
        self.path = files[0]
        self.format = format
        self.about: Mapping[str, str] = {}
        self._files = files
        self._size = sum(file.stat().st_size for file in files)
        self.protocol = protocol or self._recognise()
        self.devices = {DEVICE: SourceDevice(DEVICE, self.protocol, {"source": self.path.name, **about})}
        self._damage: list[FileDamage] = []

    @property
    def damage(self) -> list[FileDamage]:
        return self._damage

    def _recognise(self) -> str:
        with self.path.open("rb") as file:
            guesses = detect(file.read(GUESS_BYTES))
        return guesses[0].protocol if guesses and guesses[0].score >= GUESS_SCORE else ""

    def _bytes(self) -> BinaryIO:
        return _Joined(self._files)  # type: ignore[return-value]  # Pace reads, no more

    def stream(self) -> BinaryIO:
        """Its bytes from the beginning, to be read and closed."""
        return self._bytes()

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        start = self._started()
        done = 0
        for pieces in paced(self._bytes(), self.protocol).blocks():
            done += len(pieces.data)
            yield ChunkBlock(
                DEVICE, "rx", pieces.data, pieces.ends, pieces.due_ns + start, done / max(self._size, done)
            )

    def _started(self) -> int:
        """When the capture began: by the UTC in its samples; by its name, or its head; or so long before it was last
        written as its clock says."""
        name = inertial_sense_logs.log_name(self.path)
        with closing(self._bytes()) as file:
            pace = paced(file, self.protocol)
            seen = 0
            for pieces in pace.blocks():
                seen += len(pieces.data)
                if pace.is_dated or (name is not None and seen > DATE_BYTES):
                    break
        if pace.started_ns is not None:
            return pace.started_ns
        if name is not None:
            return name.started_ns
        self.guessed = pace.blind
        return pace.dated_ns or max(0, self._files[-1].stat().st_mtime_ns - pace.lasted_ns)

    def said(self) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """Nothing was kept beside the bytes."""
        return iter(())


class IndexedSource(CaptureSource):
    """A raw log with an index beside it: that knows when its bytes came, to the millisecond.

    Where the index is in another time than the device (a log that was written faster than it was measured) it is not
    used: `fits` compares the two.
    """

    timed = True

    def _started(self) -> int:
        """The index is in the logger's time, as the name is."""
        name = inertial_sense_logs.log_name(self.path)
        return name.started_ns if name is not None else super()._started()

    @property
    def fits(self) -> bool:
        """Does the index last about as long as the device's own clock says?"""
        pieces = list(paced(self._bytes(), self.protocol).blocks())
        clock_ms = (int(pieces[-1].due_ns[-1]) - int(pieces[0].due_ns[0])) / 1e6 if pieces else 0.0
        indexes = [inertial_sense_logs.read_index(file) for file in self._files]
        if any(index is None for index in indexes):
            return False
        last = max(int(index[1][-1]) for index in indexes if index is not None)
        return 0.8 * clock_ms <= last + 100 and last <= 1.25 * clock_ms + 100

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        start = self._started()
        done = 0
        for file in self._files:
            data = file.read_bytes()
            index = inertial_sense_logs.read_index(file)
            assert index is not None
            offsets, ms = index
            inside = (offsets > 0) & (offsets < len(data))
            ends = np.append(offsets[inside], len(data))
            times = start + np.append(ms[inside], ms[-1]) * 1_000_000
            done += len(data)
            yield ChunkBlock(DEVICE, "rx", data, ends, times, done / max(self._size, 1))


class DatSource(CaptureSource):
    """A .dat log: its records as the packets that brought them."""

    def _bytes(self) -> BinaryIO:
        self._damage.clear()
        return _Generated(self._packets())  # type: ignore[return-value]

    def _packets(self) -> Iterator[bytes]:
        for file in self._files:
            yield from inertial_sense_logs.packets(file.read_bytes(), self._damage)


def is_dat(head: bytes) -> bool:
    """Do these bytes, the first of a file, begin a .dat log of Inertial Sense, whatever the file is called?"""
    return head.startswith(inertial_sense_logs.MARKER)


def paced(file: BinaryIO, protocol: str) -> CaptureTiming:
    """The bytes of a capture with their times; "" where nobody knows what they are."""
    if not protocol:
        return CaptureTiming(file, None)
    row = PROTOCOLS[protocol]
    return CaptureTiming(file, permissive_decoder(protocol), utc=row.utc, dated=row.dated)


def open_file(path: Path, protocol: str = "") -> Source:
    """A file of any format that can be read.

    Args:
        protocol: of a capture; "" to recognise it.
    Raises:
        RecordingError: it is not there, may not be read, is empty, or nothing that is known.
    """
    try:
        with path.open("rb") as file:
            head = file.read(len(MAGIC) + 8)
    except IsADirectoryError:
        raise RecordingError(f"{path.name} is a folder.", "Give a file in it.") from None
    except OSError as error:
        raise RecordingError(f"{path.name}: {(error.strerror or 'cannot be read').lower()}.", READABLE) from None
    if not head:
        raise RecordingError(f"{path.name} is empty.", "Give a recording with something in it.")
    if head.startswith(MAGIC):
        return _mcap(path)
    suffix = ".dat" if is_dat(head) else path.suffix.lower()
    maker = _LOGS.get(suffix)
    if maker is not None:
        return maker(path, protocol)
    source = CaptureSource([path], "bin", protocol)
    if not source.protocol:
        hint = "Supported: .mcap, .mtb, .raw, .dat, .csv, and captures, whose protocol --protocol can name."
        raise RecordingError(f"{path.name} is not a format imuscope knows.", hint)
    return source


def _mcap(path: Path) -> Source:
    """A recording, or where it has no bytes of a device, the numbers in it."""
    with McapReader(path) as recording:
        if recording.is_ours:
            return McapSource(path)
        if not recording.chunks:
            next(iter(recording.blocks()), None)  # the first records name the channels
        if any(topic.name.startswith("rx/") and topic.encoding != "json" for topic in recording.topics.values()):
            return McapSource(path)
    return MessageSource(path)


def _csv(path: Path, protocol: str) -> Source:
    return CaptureSource([path], "bin", protocol) if protocol else CsvSource(path)


def _mtb(path: Path, protocol: str) -> Source:
    return CaptureSource([path], "mtb", protocol or "xbus")


def _raw(path: Path, protocol: str) -> Source:
    files = inertial_sense_logs.parts_of(path)
    name = inertial_sense_logs.log_name(path)
    about = {"serial_number": name.serial_number} if name is not None else {}
    if name is not None:
        indexed = IndexedSource(files, "raw", protocol, about)
        if indexed.fits:
            return indexed
    return CaptureSource(files, "raw", protocol, about)


def _dat(path: Path, protocol: str) -> Source:
    with path.open("rb") as file:
        if not is_dat(file.read(len(inertial_sense_logs.MARKER))):
            return CaptureSource([path], "bin", protocol)
    name = inertial_sense_logs.log_name(path)
    about = {"serial_number": name.serial_number} if name is not None else {}
    return DatSource(inertial_sense_logs.parts_of(path), "dat", protocol or "isb", about)


_LOGS: Mapping[str, Callable[[Path, str], Source]] = {".mtb": _mtb, ".raw": _raw, ".dat": _dat, ".csv": _csv}


class _Joined:
    """Files read as one."""

    def __init__(self, files: list[Path]) -> None:
        self._files = list(files)
        self._open: BinaryIO | None = None

    def read(self, size: int) -> bytes:
        while True:
            if self._open is None:
                if not self._files:
                    return b""
                self._open = self._files.pop(0).open("rb")
            data = self._open.read(size)
            if data:
                return data
            self.close()

    def close(self) -> None:
        """The file that is open, if one is."""
        if self._open is not None:
            self._open.close()
            self._open = None


class _Generated:
    """Bytes that are made as they are read."""

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self._pieces = pieces
        self._held = b""

    def read(self, size: int) -> bytes:
        while not self._held:
            piece = next(self._pieces, None)
            if piece is None:
                return b""
            self._held = piece
        data, self._held = self._held[:size], self._held[size:]
        return data

    def close(self) -> None:
        """Make no more of them."""
        self._pieces = iter(())
