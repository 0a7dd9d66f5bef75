"""A recording out of a store: its object into a file, compared with the checksum of its row."""

import hashlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import pyarrow.compute as pc

from imuscope.server.extensions.fleet.store.delta_dataset import dataset_of
from imuscope.server.extensions.fleet.store.delta_tables import open_table
from imuscope.server.extensions.fleet.store.store import StoreError, StoreLocation, storage_errors
from imuscope.server.extensions.fleet.store.tables import RECORDINGS

PIECE_BYTES = 1 << 20


class NotInStoreError(StoreError):
    """A recording that the store does not have."""


def fetch(store: StoreLocation, recording: str, path: Path) -> int:
    """Write the object of a recording to a file; its size.

    Raises:
        NotInStoreError: the store does not have it.
        StoreError: the store cannot be read, or the file does not match its checksum.
        OSError: the file cannot be written.
    """
    key, size, checksum = _row(store, recording)
    free = shutil.disk_usage(path.parent).free
    if free < size:
        raise StoreError(
            f"recording {recording} takes {size / 1e6:.1f} MB, and {free / 1e6:.1f} MB are free", "Free some space."
        )
    digest = hashlib.sha256()
    with path.open("wb") as file:
        for piece in _pieces(store, key):
            digest.update(piece)
            file.write(piece)
    if digest.hexdigest() != checksum:
        raise StoreError(
            f"{store.url}/{key} has another checksum than the uploaded file",
            "Upload the original file again.",
        )
    return size


def verify(store: StoreLocation, recording: str) -> str:
    """Read the object of a recording and compare it with the checksum of its row, which is returned.

    Raises:
        NotInStoreError: the store does not have the recording, or not its object as it was uploaded.
        StoreError: the store cannot be read.
    """
    key, _, checksum = _row(store, recording)
    digest = hashlib.sha256()
    try:
        for piece in _pieces(store, key):
            digest.update(piece)
    except StoreError:
        if _is_missing(store, key):
            raise NotInStoreError(f"{store.url}/{key} is missing", "Upload the original file again.") from None
        raise
    if digest.hexdigest() != checksum:
        words = f"{store.url}/{key} has another checksum than the uploaded file"
        raise NotInStoreError(words, "Upload the original file again.")
    return checksum


def _is_missing(store: StoreLocation, key: str) -> bool:
    from obstore import head

    with storage_errors(store):
        try:
            head(store.objects(), key)
        except FileNotFoundError:
            return True
    return False


def _pieces(store: StoreLocation, key: str) -> Iterator[bytes]:
    from obstore import get

    objects = store.objects()
    with storage_errors(store):
        for piece in get(objects, key).stream(min_chunk_size=PIECE_BYTES):
            yield bytes(piece)


def _row(store: StoreLocation, recording: str) -> tuple[str, int, str]:
    table = open_table(store, RECORDINGS.name)
    rows = []
    if table is not None:
        with storage_errors(store):
            dataset = dataset_of(store, table, RECORDINGS)
            columns = ["object", "bytes", "checksum"]
            rows = dataset.to_table(columns=columns, filter=pc.field("recording") == recording).to_pylist()
    if not rows:
        raise NotInStoreError(f"{store.url} has no recording {recording:.80}", "Take its identifier from `recordings`.")
    return rows[0]["object"], rows[0]["bytes"], rows[0]["checksum"]
