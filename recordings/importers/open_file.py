"""Importers: recognise a file and read it. Each format is a row: file name, first bytes and reader.

    .mcap              a recording of imuscope; of other programs if their messages hold numbers
                       (recordings/readers/message_source.py)
    .mtb .raw .dat …   logs of the vendors' programs (recordings/readers/vendor_logs.py); a split log is one recording
    .csv .tsv          a table with a time column (recordings/tables/); of any other name if it has rows of numbers
    .bag .db3 .zip …   files of other programs, by their first bytes (recordings/readers/)
    everything else    bytes as received from a port, of any protocol

A capture has no arrival times. They are derived from the device's own clock, assuming a fast line (CaptureTiming):
`timed` is False then, and the page reports it. It is dated by its UTC, its head or its name; without any of them it
ends when the file was last written.

Source: for each format, see its module.
"""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from imuscope.protocols.family.info import Damage, LogFormat, ProtocolInfo
from imuscope.protocols.registry.families import PROTOCOLS, detect, permissive_decoder
from imuscope.recordings import sidecar
from imuscope.recordings.capture_timing import CaptureTiming
from imuscope.recordings.errors import READABLE, RecordingError
from imuscope.recordings.importers.damaged_capture import (
    checked,
    damaged_frames,
    damaged_sentences,
    has_unchecked_sentences,
    without_comments,
)
from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.mcap.records import MAGIC
from imuscope.recordings.mcap.source import McapSource
from imuscope.recordings.optional_packages import installation_of, lacks
from imuscope.recordings.readers import vendor_logs
from imuscope.recordings.readers.file_suffixes import TABLES
from imuscope.recordings.readers.folders import METADATA, SENSOR_DATA, is_bag_folder, packet_folder, sensor_folders
from imuscope.recordings.readers.known_files import is_plain_text, known_file, seeming
from imuscope.recordings.readers.message_source import MessageSource
from imuscope.recordings.readers.registry import (
    HEAD_BYTES,
    FileReader,
    OpenRequest,
    marked_reader,
    reader_suffixes,
    suffix_reader,
)
from imuscope.recordings.sources import ChunkBlock, FileDamage, Source, SourceDevice, remark
from imuscope.recordings.system.regular_file import open_regular, read_regular, readable_name
from imuscope.recordings.tables.clocks.axis import LAST_CHANGE, NAME, period_start
from imuscope.recordings.tables.dates import dated_name
from imuscope.recordings.tables.format import has_rows
from imuscope.recordings.tables.options import TableOptions, over
from imuscope.recordings.tables.table_source import CsvSource

GUESS_BYTES = 1 << 16
GUESS_SCORE = 0.4  # of a file: 0.5 is a stream of NMEA or UBX alone, and a head in words stands above some
WEAK_SCORE = 0.2  # of a file that is nothing else: a terminal wrote its own times into the lines
DATE_BYTES = 1 << 22  # of a log whose name has its start: within these a device with a receiver has sent the date
DEVICE = "1"


class CaptureSource:
    """Bytes of one device, without times: a capture, or a log and its further parts.

    Args:
        files: in order.
        protocol: "" to recognise it.
        score: least one, to recognise it.
    """

    timed = False
    guessed = False  # whether its times are, without a clock in it; known when its parts are read
    clock_steps: Sequence[tuple[float, float]] = ()  # of GNSS times: unix s after it, s; known after its parts are read
    by_gnss = False  # whether they are those in the messages of a GNSS receiver; known then as well
    gnss_kind = ""  # "day" or "week" if these have no date
    dated_by = ""  # what the date comes from, if not the UTC of the device; known then as well

    def __init__(
        self,
        files: list[Path],
        format_name: str,
        protocol: str = "",
        about: Mapping[str, str] = {},
        score: float = GUESS_SCORE,
    ) -> None:
        self.path = files[0]
        self.format = format_name
        self.header: Mapping[str, str] = {}
        self._files = files
        self._size = sum(file.stat().st_size for file in files)
        self.damage: list[FileDamage] = []
        self.protocol = protocol or self._recognise(score)
        self.devices = {DEVICE: SourceDevice(DEVICE, self.protocol, {"source": self.path.name, **about})}

    def _recognise(self, score: float) -> str:
        guesses = detect(_first_bytes(self.path))
        return guesses[0].protocol if guesses and guesses[0].score >= score else ""

    def _bytes(self) -> BinaryIO:
        return _Generated(_blocks(self._files))  # type: ignore[return-value]  # only read

    @property
    def files(self) -> list[Path]:
        """Its files, in order."""
        return list(self._files)

    def stream(self) -> BinaryIO:
        """Its bytes from the start, to be read and closed by the caller."""
        return self._bytes()

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        start = self._started()
        done = 0
        pace = paced(self._bytes(), self.protocol)
        for pieces in pace.blocks():
            done += len(pieces.data)
            yield ChunkBlock(
                DEVICE, "rx", pieces.data, pieces.ends, pieces.due_ns + start, done / max(self._size, done)
            )
        self.clock_steps = [((start + due) / 1e9, by / 1e9) for due, by in pace.gnss_steps]

    def _started(self) -> int:
        """Start of the capture: by the UTC in its samples, its name or its head; else by its clock's duration before
        the last write to the file.
        """
        name = vendor_logs.log_name(self.path)
        with closing(self._bytes()) as file:
            pace = paced(file, self.protocol)
            count = 0
            for pieces in pace.blocks():
                count += len(pieces.data)
                if pace.is_dated or (name is not None and count > DATE_BYTES):
                    break
        self.by_gnss, self.guessed = pace.by_gnss, False
        self.gnss_kind = self.dated_by = ""
        if pace.started_ns is not None:
            return pace.started_ns
        self.dated_by = NAME
        if name is not None:
            return name.started_ns
        self.guessed = pace.blind
        if pace.dated_ns:
            self.dated_by = "the head of the file"
            return pace.dated_ns
        named, written = dated_name(self.path.name), self._files[-1].stat().st_mtime_ns
        known = round(named * 1e9) if named is not None else max(0, written - pace.lasted_ns)
        self.dated_by = NAME if named is not None else LAST_CHANGE
        if not pace.by_gnss:
            return known
        self.gnss_kind, first = pace.gnss_kind, pace.gnss_within_ns
        begin = period_start(pace.gnss_kind, first / 1e9, (named or written / 1e9), written / 1e9)
        return round(begin) * 1_000_000_000 + first

    def metadata(self) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """Metadata stored beside the bytes: none."""
        return iter(())


class SentenceSource(CaptureSource):
    """Sentences of NMEA without checksums, which are added."""

    def _recognise(self, score: float) -> str:
        with closing(self._bytes()) as file:
            guesses = detect(without_comments(file.read(GUESS_BYTES)))
        return guesses[0].protocol if guesses and guesses[0].score >= score else ""

    def _bytes(self) -> BinaryIO:
        self.damage[:] = [remark("Its sentences have no checksums: damage in them cannot be found.")]
        return _Generated(checked(_blocks(self._files)))  # type: ignore[return-value]


class IndexedSource(CaptureSource):
    """A raw log with an index beside it, which gives arrival times to the millisecond.

    The index is not used if its time differs from the device's (a log that was written faster than it was measured):
    `fits` compares the two.
    """

    timed = True

    def __init__(self, files: list[Path], log: LogFormat, protocol: str, about: Mapping[str, str]) -> None:
        super().__init__(files, log.name, protocol, about)
        self._log = log

    def _started(self) -> int:
        """The start by the index, which uses the logger's time, as the name does."""
        name = vendor_logs.log_name(self.path)
        if name is None:
            return super()._started()
        self.dated_by = NAME
        return name.started_ns

    @property
    def fits(self) -> bool:
        """Whether the duration of the index is about that of the device's own clock."""
        pieces = list(paced(self._bytes(), self.protocol).blocks())
        clock_ms = (int(pieces[-1].due_ns[-1]) - int(pieces[0].due_ns[0])) / 1e6 if pieces else 0.0
        indexes = [vendor_logs.read_index(file, self._log) for file in self._files]
        if any(index is None for index in indexes):
            return False
        last = max(int(index[1][-1]) for index in indexes if index is not None)
        return 0.8 * clock_ms <= last + 100 and last <= 1.25 * clock_ms + 100

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        start = self._started()
        done = 0
        for file in self._files:
            data = read_regular(file)
            index = vendor_logs.read_index(file, self._log)
            assert index is not None
            offsets, ms = index
            inside = (offsets > 0) & (offsets < len(data))
            ends = np.append(offsets[inside], len(data))
            times = start + np.append(ms[inside], ms[-1]) * 1_000_000
            done += len(data)
            yield ChunkBlock(DEVICE, "rx", data, ends, times, done / max(self._size, 1))


class PacketSource(CaptureSource):
    """A log that does not hold the port's bytes: its records as the packets that carried them."""

    def __init__(
        self,
        files: list[Path],
        log: LogFormat,
        packets: Callable[[bytes, Damage], Iterator[bytes]],
        protocol: str,
        about: Mapping[str, str],
    ) -> None:
        super().__init__(files, log.name, protocol, about)
        self._packets_of = packets

    def _bytes(self) -> BinaryIO:
        self.damage.clear()
        return _Generated(self._packets())  # type: ignore[return-value]

    def _packets(self) -> Generator[bytes, None, None]:
        for file in self._files:
            yield from self._packets_of(read_regular(file), self._note_damage)

    def _note_damage(self, offset: int, words: str) -> None:
        self.damage.append(FileDamage(offset, words))


def paced(file: BinaryIO, protocol: str) -> CaptureTiming:
    """The bytes of a capture with their times; protocol "" if unknown."""
    if not protocol:
        return CaptureTiming(file, None)
    row = PROTOCOLS[protocol]
    return CaptureTiming(file, permissive_decoder(protocol), utc=row.stream.utc, dated=row.stream.dated)


def _open_packed(path: Path, protocol: str, table: TableOptions) -> Source:
    return open_file(path, protocol, table, is_packed=True)


def open_file(
    path: Path,
    protocol: str = "",
    table: TableOptions | None = None,
    *,
    is_packed: bool = False,
    is_complete: bool = False,
) -> Source:
    """A file of any format that can be read; a ROS 2 bag may be a folder.

    Args:
        protocol: of a capture; "" to recognise it.
        table: options of a table; those stored with the file complete them.
        is_packed: whether it comes out of an archive.
        is_complete: whether `table` has all options, so that none stored with the file is used.

    Raises:
        RecordingError: it is missing, unreadable, empty, or of an unknown format.
    """
    if (name := readable_name(path)) != path.name:
        raise RecordingError(f"{name} has a name that is not UTF-8.", "Give the file another name.")
    try:
        with open_regular(path) as file:
            head = file.read(HEAD_BYTES)
    except IsADirectoryError:
        return _folder(path, table or TableOptions())
    except OSError as error:
        raise RecordingError(f"{path.name}: {(error.strerror or 'cannot be read').lower()}.", READABLE) from None
    if not head:
        raise RecordingError(f"{path.name} is empty.", "Give a recording with something in it.")
    if head.startswith(MAGIC):
        return _mcap(path)
    table = table or TableOptions()
    if not is_packed and not is_complete:
        table = over(table, sidecar.chosen_reading(path, head).table)
    request, suffix = OpenRequest(path, _open_packed, protocol, table, is_packed), path.suffix.lower()
    if (reader := marked_reader(head)) is not None:
        return _read(reader, request)
    log_format = vendor_logs.marked_format(head)
    if log_format is None:
        reader, log_format = suffix_reader(suffix), vendor_logs.suffix_format(suffix)
        if (reader or log_format) and not protocol and _is_no_table(path, head):
            raise _unknown(path, head)  # the first bytes say more than the suffix
    if reader is not None:
        return _read(reader, request)
    if log_format is not None:
        log = _log(path, *log_format, protocol)
        return log if log.protocol or not is_table(path) else _table(request)
    if suffix in TABLES:
        if not protocol and _is_no_table(path, head):
            raise _unknown(path, head)
        if not protocol and _first_bytes(path).startswith(b"$"):
            capture = CaptureSource([path], "bin")
            return capture if capture.protocol else _sentences(path) or _table(request)
        return CaptureSource([path], "bin", protocol) if protocol else _table(request)
    source = CaptureSource([path], "bin", protocol)
    if not source.protocol:
        if (sentences := _sentences(path)) is not None:
            return sentences
        if not _is_no_table(path, head) and is_table(path):
            return _table(request)
        source = CaptureSource([path], "bin", score=WEAK_SCORE)
        if not source.protocol or known_file(head) is not None:
            raise _unknown(path, head)
    return source


def _sentences(path: Path) -> CaptureSource | None:
    """A file of sentences without checksums; None for any other.

    Raises:
        RecordingError: their checksums are wrong.
    """
    data = _first_bytes(path)
    if not data.startswith(b"$"):
        return None
    if has_unchecked_sentences(data):
        source = SentenceSource([path], "bin")
        return source if source.protocol else None
    if words := damaged_sentences(data):
        raise _damaged(path, words)
    return None


def _first_bytes(path: Path) -> bytes:
    with open_regular(path) as file:
        return without_comments(file.read(GUESS_BYTES))


def _damaged(path: Path, frames: str) -> RecordingError:
    words = f"{path.name} begins with {frames}, all with a bad checksum."
    return RecordingError(words, "Something changed its bytes, such as a transfer as text. Copy or record it again.")


def _is_no_table(path: Path, head: bytes) -> bool:
    """Whether the first bytes of a file are those of an unsupported format."""
    known = known_file(head)
    return known is not None and not (known.may_be_table and is_table(path))


def is_table(path: Path) -> bool:
    """Whether a text file of unknown format is a table, or several in one."""
    from imuscope.recordings.readers.formats.typed_rows import has_typed_rows

    return has_typed_rows(path) or has_rows(path)


def _table(request: OpenRequest) -> Source:
    from imuscope.recordings.readers.formats.typed_rows import has_typed_rows, open_typed_rows

    return open_typed_rows(request) if has_typed_rows(request.path) else CsvSource(request.path, request.table)


def _unknown(path: Path, head: bytes) -> RecordingError:
    """Refusal of a file of unknown format: what it seems to be, and what can be done."""
    known = known_file(head, path.suffix.lower())
    if known is not None:
        return RecordingError(f"{path.name} is {known.name}, which imuscope does not read.", known.remedy)
    with open_regular(path) as file:
        data = file.read(GUESS_BYTES)
    if frames := damaged_sentences(data) if is_plain_text(data) else damaged_frames(data):
        return _damaged(path, frames)
    kinds = ", ".join((".mcap", *vendor_logs.log_suffixes(), ".csv", *reader_suffixes()))
    hint = f"{seeming(data)} Supported: {kinds}, and captures, whose protocol --protocol can name."
    return RecordingError(f"{path.name} is not a format imuscope knows.", hint)


def _folder(path: Path, table: TableOptions) -> Source:
    """A ROS 2 bag, an EuRoC folder, or the packets of an OXTS receiver."""
    if (packets := packet_folder(path)) is not None:
        from imuscope.recordings.readers.formats.oxts import open_oxts_folder

        return open_oxts_folder(packets, table)
    if sensor_folders(path):
        from imuscope.recordings.readers.formats.euroc import open_euroc_folder

        return open_euroc_folder(path, table)
    from imuscope.recordings.readers.formats.ros2_bag import open_bag_folder

    if not is_bag_folder(path):
        kinds = f"A ROS 2 bag, with {METADATA}, an EuRoC folder, with imu0/{SENSOR_DATA}, and a drive of KITTI"
        hint = f"Give a file in it. {kinds}, with oxts, can be opened."
        raise RecordingError(f"{path.name} is a folder.", hint)
    return open_bag_folder(path)


def _read(reader: FileReader, request: OpenRequest) -> Source:
    name = request.path.name
    if reader.is_container and request.is_packed:
        raise RecordingError(f"{name} is an archive in an archive.", "Unpack it, and give a file of it.")
    if lacks(*reader.modules):
        raise RecordingError(f"{name}: {reader.title} files are not supported here.", installation_of(reader.extra))
    return reader.read(request)


def _mcap(path: Path) -> Source:
    """A recording, or if it has no bytes of a device, the numbers in it."""
    with McapReader(path) as recording:
        if recording.is_ours:
            return McapSource(path)
        if not recording.chunks:
            next(iter(recording.blocks()), None)  # the first records name the channels
        if any(topic.topic.startswith("rx/") and topic.encoding != "json" for topic in recording.topics.values()):
            return McapSource(path)
    return MessageSource(path)


def _log(path: Path, family: ProtocolInfo, log: LogFormat, protocol: str) -> CaptureSource:
    files = vendor_logs.parts_of(path)
    name = vendor_logs.log_name(path)
    about = {"serial_number": name.serial_number} if name is not None else {}
    protocol = protocol or (family.name if log.certain else "")
    if log.packets is not None:
        return PacketSource(files, log, log.packets, protocol, about)
    if log.read_index is not None and name is not None:
        indexed = IndexedSource(files, log, protocol, about)
        if indexed.fits:
            return indexed
    return CaptureSource(files, log.name, protocol, about)


def _blocks(files: Sequence[Path]) -> Generator[bytes, None, None]:
    for file in files:
        with open_regular(file) as opened:
            while data := opened.read(GUESS_BYTES):
                yield data


class _Generated:
    """Bytes generated as they are read."""

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
        """Close the file that is read, if any."""
        if isinstance(self._pieces, Generator):
            self._pieces.close()
