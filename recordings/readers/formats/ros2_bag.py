"""ROS 2 bags: SQLite files (.db3), and folders with metadata.yaml, of SQLite or MCAP files, split or compressed.

    topics                id, name, type, serialization_format
    messages              topic_id, timestamp ns, data (CDR; a zstd frame if messages are compressed)
    message_definitions   topic_type, encoding, encoded_message_definition; since Iron

The definitions of an older bag are those of `rosbags`, which has the common types.

Source: rosbag2_storage_sqlite3 and rosbag2_storage (docs.ros.org), "metadata.yaml", versions 1 to 9.
"""

import functools
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.mcap.records import MAGIC
from imuscope.recordings.readers.folders import METADATA
from imuscope.recordings.readers.formats.bag_kernels import SIZE, START
from imuscope.recordings.readers.formats.bag_source import BLOCK_BYTES, BagPiece, BagSource, piece_of
from imuscope.recordings.readers.formats.decompressing import CODECS, UnpackedFolder, decompressed, inflated
from imuscope.recordings.readers.message_source import MessageFile, MessageSource, segments_in
from imuscope.recordings.readers.registry import FileReader, register_reader
from imuscope.recordings.sources import ChunkBlock, FileDamage, damage_of
from imuscope.recordings.system.bounded_yaml import load
from imuscope.recordings.system.regular_file import open_regular

LONGEST_METADATA = 16 << 20
LONGEST_MESSAGE = 1 << 27
MOST_FILES = 10_000
ROWS_PER_STEP = 500  # taken at once, without the large messages among them
LARGE_MESSAGE_BYTES = 1 << 14
MOST_TABLES = 10_000
INTERRUPT_STEPS = 100_000  # of SQLite, some milliseconds: then Python runs, which may end it with a signal
DATA = f"CASE WHEN length(data) >= {LARGE_MESSAGE_BYTES} THEN -rowid ELSE data END"
LARGE_DATA = f"SELECT data FROM messages WHERE rowid = ? AND length(data) >= {LARGE_MESSAGE_BYTES}"
ZSTD = b"\x28\xb5\x2f\xfd"
# by what SQLite says about a damaged file, and by the length that a damaged row claims
SENSELESS = (sqlite3.Error, UnicodeDecodeError, MemoryError)
SQLITE = b"SQLite format 3\0"


class Ros2Database(BagSource):
    """One SQLite file of a bag.

    Args:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._unreadable = 0
        try:
            with closing(_connected(path)) as database:
                tables = _tables(database)
                if not {"topics", "messages"} <= tables:
                    known = ", ".join(sorted(tables)[:5]) or "no tables"
                    raise RecordingError(
                        f"{path.name} is a SQLite database, but not a ROS 2 bag: it has {known}.",
                        "Export the table of samples as CSV.",
                    )
                self._learn(database, has_definitions="message_definitions" in tables)
        except SENSELESS as error:
            raise RecordingError(f"{path.name} is a damaged SQLite database: {error}.", "Record it again.") from None
        self.check()

    def _learn(self, database: sqlite3.Connection, *, has_definitions: bool) -> None:
        texts: dict[str, tuple[str, str]] = {}
        if has_definitions:
            rows = database.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
            texts = {str(kind): (str(encoding), str(text)) for kind, encoding, text in rows if text}
        for number, name, kind, encoding in database.execute("SELECT id, name, type, serialization_format FROM topics"):
            if not isinstance(number, int):
                self.topics.left_out[f"{name!s:.100} is left out: its row in the table of topics is damaged."] = None
                continue
            if encoding != "cdr":
                self.topics.add(number, str(name), str(kind), ("", ""), "", f"its encoding is {encoding!s:.40}")
                continue
            form, text = texts.get(str(kind), ("", ""))
            if form != "ros2msg":
                text = _definition(str(kind), text if form == "ros2idl" else "")
            why = f"the bag does not define its type, {kind!s:.100}" if not text else ""
            self.topics.add(number, str(name), str(kind), ("cdr", "ros2msg"), text, why)

    def pieces(self, start_ns: int | None, stop_ns: int | None) -> Iterator[BagPiece]:
        span = () if start_ns is None and stop_ns is None else (start_ns or -(1 << 63), stop_ns or (1 << 63) - 1)
        within = "WHERE timestamp BETWEEN ? AND ? " if span else ""  # the index of times would cost sorting
        count = self._unreadable = 0
        try:
            with closing(_connected(self.path)) as database:
                (most,) = database.execute("SELECT max(rowid) FROM messages").fetchone()
                cursor = database.execute(
                    f"SELECT topic_id, timestamp, {DATA} FROM messages {within}ORDER BY rowid",
                    span,
                )
                while rows := cursor.fetchmany(ROWS_PER_STEP):
                    count += len(rows)
                    done = count / max(most or 1, 1)
                    piece = _plain_piece(done, *zip(*rows, strict=True))
                    yield from (piece,) if piece is not None else self._odd_pieces(database, rows, done)
        except SENSELESS as error:
            words = str(error) or "a row takes too much memory"
            self.damage.append(FileDamage(-1, f"The database is damaged, the rest of it is missing: {words:.200}."))
        if self._unreadable:
            self.damage.append(FileDamage(-1, f"Messages that cannot be unpacked are left out: {self._unreadable}."))

    def _odd_pieces(self, database: sqlite3.Connection, rows: Sequence[Any], done: float) -> Iterator[BagPiece]:
        """Pieces of rows of which some are compressed, are large, which are read one by one, or cannot be read."""
        usable: list[tuple[int, int, bytes]] = []
        size = 0
        for number, time, data in rows:
            if isinstance(data, int):
                if number not in self.topics.channels:
                    continue
                (data,) = database.execute(LARGE_DATA, (-data,)).fetchone() or (None,)  # none: a number in its place
            if (unpacked := _unpacked(number, time, data)) is None:
                self._unreadable += 1
                continue
            usable.append(unpacked)
            size += len(unpacked[2])
            if size >= BLOCK_BYTES:
                yield piece_of(done, *zip(*usable, strict=True))
                usable, size = [], 0
        if usable:
            yield piece_of(done, *zip(*usable, strict=True))


def _plain_piece(done: float, numbers: Sequence[Any], times: Sequence[Any], data: Sequence[Any]) -> BagPiece | None:
    """A piece of rows that can be taken as they are; None if any cannot, or may be compressed."""
    columns = np.array(numbers), np.array(times)
    if any(one.dtype != np.int64 for one in columns):
        return None
    try:
        piece = piece_of(done, *columns, data)
    except TypeError:  # not all are bytes
        return None
    starts = piece.table[START][piece.table[SIZE] > 0]
    return None if (np.frombuffer(piece.data, np.uint8)[starts] == ZSTD[0]).any() else piece


def _unpacked(number: object, time: object, data: object) -> tuple[int, int, bytes] | None:
    """A row of a message with its data unpacked; None if it cannot be read."""
    if not (isinstance(time, int) and isinstance(data, bytes) and isinstance(number, int)):
        return None
    if data.startswith(ZSTD):
        try:
            data, why = inflated(data, "zstd", LONGEST_MESSAGE)
        except ValueError:
            return None
        if why:
            return None
    return number, time, data


class SplitBag(MessageFile):
    """Several files of one bag, one after the other."""

    def __init__(self, folder: Path, files: list[Path], missing: list[str], segments: Sequence[float] = ()) -> None:
        super().__init__(folder)
        self._files = files
        self._missing = missing
        self._named = segments
        self._preamble = self._opened(0).preamble

    def _opened(self, number: int) -> MessageFile:
        return _opened_file(self._files[number])

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        damage = [FileDamage(-1, f"{name} of the bag is missing.") for name in self._missing]
        count = len(self._files)
        for number in range(count):
            try:
                source = self._opened(number)
                for part in source.parts(start_ns, stop_ns):
                    done = (number + part.done) / count
                    yield ChunkBlock(part.device, part.direction, part.data, part.ends, part.times, done)
            except RecordingError as error:
                damage.append(FileDamage(-1, error.message))
                continue
            known = {one.words for one in damage}
            damage += [one for one in damage_of(source) if one.words not in known]
            self._preamble = source.preamble
        self.damage[:] = damage
        self.segments = self._named

    def preamble(self, device: str) -> bytes:
        return self._preamble(device)


def open_bag_folder(folder: Path) -> MessageFile:
    """A bag as a folder.

    Raises:
        RecordingError: its metadata cannot be read, or none of its files.
    """
    listed, segments = _listed_files(folder)
    files = [one for name in listed if (one := _present(folder, name)) is not None]
    missing = [name for name in listed if _present(folder, name) is None]
    if not files:
        raise RecordingError(
            f"{folder.name}: none of the files that {METADATA} lists is there.", "Copy the whole folder of the bag."
        )
    return SplitBag(folder, files, missing, segments)


def _listed_files(folder: Path) -> tuple[list[str], list[float]]:
    """Names of the files that a bag consists of, and the segments of the clock that our own export names."""
    hint = "Give one of the files in it."
    try:
        with open_regular(folder / METADATA) as file:
            text = file.read(LONGEST_METADATA).decode(errors="replace")
        about: Any = load(text, LONGEST_METADATA)
        about = about["rosbag2_bagfile_information"]
        names = about.get("relative_file_paths") or [one["path"] for one in about.get("files", [])]
        listed = [Path(str(name)).name for name in names[:MOST_FILES]]
    except OSError as error:
        raise RecordingError(f"{folder.name}/{METADATA}: {(error.strerror or 'unreadable').lower()}.", hint) from None
    except (KeyError, TypeError, AttributeError, ValueError, RecursionError):
        raise RecordingError(f"{folder.name}/{METADATA} does not describe a ROS 2 bag.", hint) from None
    if not listed:
        raise RecordingError(f"{folder.name}/{METADATA} lists no files.", hint)
    custom = about.get("custom_data")
    return listed, segments_in(str(custom.get("imuscope.segments", ""))) if isinstance(custom, dict) else []


def _present(folder: Path, name: str) -> Path | None:
    """A file of a bag; or the same file unpacked."""
    paths = [folder / name, folder / Path(name).stem] if Path(name).suffix in CODECS else [folder / name]
    return next((path for path in paths if path.is_file()), None)


def _opened_file(path: Path) -> MessageFile:
    with open_regular(path) as file:
        head = file.read(len(SQLITE))
    if head.startswith(ZSTD):
        unpacked = UnpackedFolder(path)
        return unpacked.source(lambda: _opened_file(decompressed(path, unpacked, path.stem, "zstd")))
    if head.startswith(MAGIC):
        return MessageSource(path)
    return Ros2Database(path)


def _connected(path: Path) -> sqlite3.Connection:
    """The database, open for reading only."""
    database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        database.text_factory = lambda text: text.decode(errors="replace")
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_MESSAGE)
        database.execute("PRAGMA trusted_schema=OFF")
        database.set_progress_handler(lambda: 0, INTERRUPT_STEPS)
    except BaseException:
        database.close()
        raise
    return database


def _tables(database: sqlite3.Connection) -> set[str]:
    """Names of the tables whose rows are stored: a view, a virtual table or a generated column can be endless."""
    rows = database.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'").fetchmany(MOST_TABLES)
    stored = {str(name) for name, sql in rows if not str(sql).upper().startswith("CREATE VIRTUAL")}
    columns = "SELECT count(*) FROM pragma_table_xinfo(?) WHERE hidden <> 0"
    return {name for name in stored if database.execute(columns, (name,)).fetchone() == (0,)}


@functools.cache
def _types() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.LATEST)


def _definition(kind: str, idl: str) -> str:
    """Definition of a type as text; "" if it is not known."""
    from rosbags.typesys import Stores, get_types_from_idl, get_typestore

    try:
        store = _types()
        if idl:
            store = get_typestore(Stores.EMPTY)
            store.register(get_types_from_idl(idl))
        return str(store.generate_msgdef(kind, ros_version=2)[0])
    except Exception:  # whatever a parser raises for a text from outside
        return ""


register_reader(
    FileReader("ros2-bag", "ROS 2 bag", (".db3",), lambda request: Ros2Database(request.path), {0: (SQLITE,)}, order=20)
)
