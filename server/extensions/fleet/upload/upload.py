"""A recording into a store, exactly once.

    1  the recording, as an object                     robots/ROBOT/DATE/RECORDING.mcap
    2  rows of devices, settings, events, losses, …    a commit each; a table without rows is made, too
    3  the row of `recordings`                         with it the recording counts

An upload that is cut off at any moment is finished by the next one of the same file: existing parts are recognised by
the identifier of the recording, which follows from its content. An object is there whole or not at all.
"""

import hashlib
import re
import unicodedata
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from imuscope.recordings import sidecar
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.probe import probe
from imuscope.recordings.library.recording_probe import RecordingProbe
from imuscope.recordings.system import atomic_write, file_lock
from imuscope.recordings.system.temporary_folder import TemporaryFolder
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.extensions.fleet.store.delta_dataset import dataset_of
from imuscope.server.extensions.fleet.store.delta_tables import (
    append_once,
    as_schema,
    create_table,
    has_rows,
    open_table,
)
from imuscope.server.extensions.fleet.store.metadata import RecordingKey, StoredFile, arrow_rows, small_tables, start_of
from imuscope.server.extensions.fleet.store.minute_statistics import minute_rows
from imuscope.server.extensions.fleet.store.recording_digest import as_recording, checksum_of, is_mcap, recording_id
from imuscope.server.extensions.fleet.store.samples import sample_reader, sample_rows, sample_schema
from imuscope.server.extensions.fleet.store.store import StoreError, StoreLocation, storage_errors
from imuscope.server.extensions.fleet.store.tables import MINUTES, RECORDINGS, SAMPLES, TABLES
from imuscope.server.extensions.fleet.tunnel.bandwidth_proxy import LineRate
from imuscope.server.library.decode import decode

LONGEST_NAME = 100
PART_BYTES = 16 << 20
LEAST_PART_BYTES = 5 << 20  # of S3: a part that fails is sent again
PACED_BYTES = 64 << 10
_FORBIDDEN = re.compile(r"[/\\?#%*:|\"<>{}^`\[\]~]")
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Uploaded:
    """An upload.

    Args:
        key: of the object.
        is_new: whether anything had to be done.
        checksum: of the object, SHA-256, hexadecimal.
        is_first: whether title, tags, notes and markers went along; otherwise the store has those of an earlier upload.
    """

    recording: str
    key: str
    is_new: bool
    checksum: str
    is_first: bool


def checked_robot(name: str) -> str:
    """The name of a robot, if it can name a folder in every store.

    Raises:
        StoreError: it cannot.
    """
    text = unicodedata.normalize("NFC", name).strip()
    if not text or len(text) > LONGEST_NAME or not text.isprintable() or _FORBIDDEN.search(text) or text[0] in ".-":
        hint = (
            f"Use 1 to {LONGEST_NAME} letters, digits, spaces, points, hyphens and underscores; not / \\ : or the like."
        )
        raise StoreError(f"--robot {name!r:.120} is not a valid name", hint)
    return text


def upload(
    path: Path, store: StoreLocation, robot: str, reading: DecodeOptions, progress: Progress = lambda share: None
) -> Uploaded:
    """Upload a file of any format that can be read.

    Args:
        reading: decode options; without a protocol it is detected.
        progress: called with 0..1.

    Raises:
        RecordingError, OSError: the file cannot be read.
        StoreError: the name of the robot is not valid, or the store cannot be used.
    """
    robot = checked_robot(robot)
    if file_lock.is_written(path):
        raise RecordingError(f"{path.name} is being recorded.", "Stop the recording first.")
    source = open_file(path, reading.protocol, reading.table)
    recording = recording_id(path, source, robot)
    known = _object_of(store, recording)
    if known is not None and _is_there(store, *known):
        return Uploaded(recording, known[0], False, known[2], False)
    with TemporaryFolder() as folder:
        columns = decode(source, folder / "columns", all_protocols(), reading, lambda share: progress(share / 2))
        about = probe(path) or RecordingProbe(source.format)
        about.edits = sidecar.read(path).over(about.edits)
        key = RecordingKey(start_of(columns).date(), robot, recording)
        made = as_recording(source, columns, folder, about.edits.title or about.title or path.name, about.edits)
        key_of_object = known[0] if known is not None else f"robots/{robot}/{key.date}/{recording}.mcap"
        size, checksum = _put(store, made, key_of_object, None if known is None else known[2])
        progress(0.7)
        if known is None:
            file = StoredFile(key_of_object, size, checksum, path.name, "mcap" if is_mcap(source) else source.format)
            _append_rows(store, columns, about, key, file)
    progress(1.0)
    return Uploaded(recording, key_of_object, True, checksum, known is None)


def _append_rows(
    store: StoreLocation, columns: ColumnStore, about: RecordingProbe, key: RecordingKey, file: StoredFile
) -> None:
    groups = sample_rows(columns)
    if not groups:
        create_table(store, SAMPLES)
    else:
        append_once(
            store,
            SAMPLES,
            key.recording,
            partial(sample_schema, groups),
            lambda schema: sample_reader(columns, groups, key, schema),
        )
    minutes = arrow_rows(MINUTES, key, list(minute_rows(columns)))
    for name, rows in {MINUTES.name: minutes, **small_tables(columns, about, key, file)}.items():
        if not rows.num_rows:
            create_table(store, TABLES[name])
        else:
            append_once(store, TABLES[name], key.recording, partial(_columns_of, name), partial(as_schema, rows))


def _columns_of(name: str, _known: pa.Schema | None) -> pa.Schema:
    return TABLES[name].schema


def _object_of(store: StoreLocation, recording: str) -> tuple[str, int, str] | None:
    """Key, size and checksum of the object of a recording that was uploaded completely; None if it was not."""
    if not has_rows(store, RECORDINGS.name, recording):
        return None
    table = open_table(store, RECORDINGS.name)
    assert table is not None
    with storage_errors(store):
        rows = dataset_of(store, table, RECORDINGS).to_table(
            columns=["object", "bytes", "checksum"], filter=pc.field("recording") == recording
        )
    row = rows.to_pylist()
    return (row[0]["object"], row[0]["bytes"], row[0]["checksum"]) if row else None


def _is_there(store: StoreLocation, key: str, size: int, checksum: str) -> bool:
    """Whether an object is in the store with that size; in a folder, also with that content."""
    from obstore import head

    objects = store.objects()
    with storage_errors(store):
        try:
            if head(objects, key)["size"] != size:
                return False
        except FileNotFoundError:
            return False
        return store.folder is None or checksum_of(store.folder / key) == checksum


def _put(store: StoreLocation, path: Path, key: str, expected: str | None) -> tuple[int, str]:
    """Put a file into the store under a key, unless it is there; its size and checksum.

    Args:
        expected: checksum of the object that was there before, if it has to be the same.
    """
    from obstore import get, put

    size, checksum = path.stat().st_size, checksum_of(path)
    if expected is not None and checksum != expected:
        hint = "Upload the original file, from which it was uploaded first."
        raise StoreError(f"{store.url}/{key} is missing, and {path.name} is not byte for byte the same", hint)
    if _is_there(store, key, size, checksum):
        return size, checksum
    objects = store.objects()
    with storage_errors(store):
        if store.folder is not None and store.rate:
            put(objects, key, _paced(path, store.rate), chunk_size=PACED_BYTES, max_concurrency=1)
        elif store.rate:
            put(objects, key, path, chunk_size=LEAST_PART_BYTES, max_concurrency=1)
        else:
            put(objects, key, path, chunk_size=PART_BYTES, max_concurrency=4)
        if store.folder is not None:
            atomic_write.sync(store.folder / key)
        digest = hashlib.sha256()
        for piece in get(objects, key).stream(min_chunk_size=1 << 20):
            digest.update(piece)
    if digest.hexdigest() != checksum:
        hint = "Check the memory and the network, and start the same command again."
        raise StoreError(f"{store.url}/{key} differs from the sent file", hint)
    return size, checksum


def _paced(path: Path, rate: float) -> Iterator[bytes]:
    """Content of a file in pieces, at a rate: a folder may be on a disk of the network."""
    pace = LineRate(rate)
    with path.open("rb") as file:
        while piece := file.read(PACED_BYTES):
            pace.wait(len(piece))
            yield piece
