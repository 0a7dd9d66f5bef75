"""Compressed data from outside, within limits: it may claim any size and may be a bomb.

pyarrow brings all compressions that files of recordings have, as streams.
"""

import os
import shutil
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.sources import FileDamage, Source, add_outer_damage
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.system.temporary_folder import TemporaryFolder

S = TypeVar("S", bound=Source)

MAX_UNPACKED_BYTES = 4 << 30  # bytes of all files in an archive
FREE_SHARE = 2  # of the free disk, 1/FREE_SHARE may be used
LARGEST_RATIO, RATIO_FROM = 200, 64 << 20  # beyond that many bytes, more of each compressed byte is a bomb
PIECE_BYTES, SMALL_PIECE_BYTES = 1 << 16, 1 << 8  # of a piece that is damaged at its end nothing is read
CODECS = {".gz": "gzip", ".zst": "zstd", ".zstd": "zstd", ".lz4": "lz4", ".bz2": "bz2"}


def is_bomb(size: int, packed: int) -> bool:
    """Whether so many bytes cannot sensibly come out of so many packed ones."""
    return size > RATIO_FROM and size > LARGEST_RATIO * packed


def inflated(data: bytes, codec: str, most: int) -> tuple[bytes, str]:
    """The content of compressed data, and a remark on damage of the rest, "" for none.

    Args:
        codec: "zstd", "lz4", "bz2", "gzip".
        most: bytes that it may have; the rest is left out.

    Raises:
        ValueError: there is no content, because the data is damaged.
    """
    import pyarrow as pa

    most = min(most, max(RATIO_FROM // 4, LARGEST_RATIO * len(data)))
    content = bytearray()
    try:
        with pa.CompressedInputStream(pa.BufferReader(data), codec) as stream:
            while len(content) <= most and (piece := stream.read(min(PIECE_BYTES, most + 1 - len(content)))):
                content += piece
    except (OSError, pa.ArrowException) as error:
        words = f"not {codec}: {str(error).splitlines()[0]:.100}"
        if not content:
            raise ValueError(words) from None
        return bytes(content[:most]), words
    return bytes(content[:most]), f"it is longer than {most} bytes" if len(content) > most else ""


class UnpackedFolder:
    """A temporary folder for the files of an archive; gone with the source that reads them.

    `damage` lists the damage of the archive.

    Args:
        archive: for messages, and the date of its files.
    """

    def __init__(self, archive: Path) -> None:
        self._archive = archive
        self.damage: list[FileDamage] = []
        self._folder = TemporaryFolder()
        self.path = self._folder.path
        self._size = archive.stat().st_size
        self._written = 0
        self._most = min(MAX_UNPACKED_BYTES, shutil.disk_usage(self.path).free // FREE_SHARE)

    def remove(self) -> None:
        self._folder.remove()

    def source(self, make: Callable[[], S]) -> S:
        """The source that `make` opens in the folder, which is removed with it, or when the program ends."""
        try:
            source = make()
        except BaseException:
            self.remove()
            raise
        weakref.finalize(source, self.remove)
        add_outer_damage(source, self.damage)
        return source

    def rewrite(self, name: str, content: BinaryIO | Any, words: str) -> Path:
        """Write a damaged file again, as far as it can be read; returns its path.

        Args:
            words: on the damage.
        """
        out = self.path / name
        out.unlink(missing_ok=True)
        self._written = 0
        try:
            self.write(name, content, SMALL_PIECE_BYTES)
        except OSError:
            self.damage.append(FileDamage(-1, f"{self._archive.name} is damaged or was cut: {words}."))
        stamp = self._archive.stat().st_mtime
        os.utime(out, (stamp, stamp))
        return out

    def check(self, size: int) -> None:
        """Check that so many further bytes are within the limits.

        Raises:
            RecordingError: they are not.
        """
        total = self._written + size
        if total > self._most:
            words = f"The content of {self._archive.name} is larger than {self._most >> 20} MB."
            raise RecordingError(words, "Unpack it, and give a file of it.")
        if is_bomb(total, self._size):
            words = f"{self._archive.name} becomes more than {LARGEST_RATIO} times as large: it may be made to harm."
            raise RecordingError(words, "If it is sound, unpack it, and give a file of it.")

    def write(self, name: str, content: BinaryIO | Any, size: int = PIECE_BYTES) -> Path:
        """Write a file from a stream; returns its path.

        Args:
            name: of the file, without a folder.
            size: bytes read at once.

        Raises:
            RecordingError: it exceeds the limits.
            OSError: the disk failed, or the content is damaged.
        """
        out = self.path / name
        with out.open("xb") as file:
            while piece := content.read(size):
                self.check(len(piece))
                self._written += len(piece)
                file.write(piece)
        stamp = self._archive.stat().st_mtime
        os.utime(out, (stamp, stamp))
        return out


def decompressed(path: Path, folder: UnpackedFolder, name: str, codec: str) -> Path:
    """A compressed file written into a folder; returns its path. A truncated file is written as far as it goes.

    Raises:
        RecordingError: it is damaged from its beginning on, or exceeds the limits.
    """
    import pyarrow as pa

    try:
        with open_regular(path) as file, pa.CompressedInputStream(pa.PythonFile(file), codec) as stream:
            return folder.write(name, stream)
    except (OSError, pa.ArrowException) as error:
        words = str(error).splitlines()[0].rstrip(".")
        with open_regular(path) as file, pa.CompressedInputStream(pa.PythonFile(file), codec) as stream:
            out = folder.rewrite(name, stream, f"{words:.100}")
        if out.stat().st_size:
            return out
        raise RecordingError(f"{path.name} cannot be unpacked: {words:.100}.", "It is damaged.") from None
