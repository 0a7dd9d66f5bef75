"""Undescribed payloads, kept as bytes beside the columns of an opened recording for export.

    payloads.bin   payload after payload, as received
    columns        for each kind of payload a channel with two columns: offset in that file, and size

A column store holds numbers of one width; payloads of one kind may differ in length from frame to frame.
"""

import mmap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.recordings.columns.rows import ExactRows
from imuscope.recordings.columns.store import ChannelLayout

NAME = "payloads.bin"
SHAPE = ChannelLayout(("u8", "u4"), (False, False))
BYTES = "bytes"
"""The dtype of such a column in an export."""


class PayloadsWriter:
    """Writes the file while a recording is decoded.

    Args:
        folder: the store being made.
    """

    def __init__(self, folder: Path) -> None:
        self._file = (folder / NAME).open("wb", buffering=1 << 16)
        self._at = 0

    def put(self, payloads: NDArray[np.uint8]) -> list[NDArray[Any]]:
        """Append (n, k) bytes; returns the two columns of their rows."""
        count, size = payloads.shape
        self._file.write(np.ascontiguousarray(payloads).data)
        begins = np.uint64(self._at) + np.arange(count, dtype=np.uint64) * np.uint64(size)
        self._at += count * size
        return [begins, np.full(count, size, np.uint32)]

    def flush(self) -> None:
        self._file.flush()

    def close(self) -> None:
        self._file.close()


def payloads_of(folder: Path, rows: ExactRows) -> ExactRows:
    """The rows of such a channel with the payloads as one column.

    Args:
        folder: the store.

    Raises:
        OSError: it has no payloads.
        ValueError: the file is shorter than its rows say.
    """
    begins, sizes = rows.columns
    payloads = np.empty(len(rows), object)
    if len(rows) and not sizes.any():
        payloads[:] = [b""] * len(rows)
    elif len(rows):
        with (folder / NAME).open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as bytes_:
            if int((begins + sizes).max()) > len(bytes_):
                raise ValueError(f"{NAME} in {folder.name} is too short")
            payloads[:] = _pieces(bytes_, begins.tolist(), sizes.tolist())
    return ExactRows(rows.arrival_ns, rows.time_ns, [payloads])


def _pieces(data: mmap.mmap, begins: Sequence[int], sizes: Sequence[int]) -> list[bytes]:
    return [data[begin : begin + size] for begin, size in zip(begins, sizes, strict=True)]
