"""The built page's files, in memory."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "page"


@dataclass(frozen=True, slots=True)
class Asset:
    """A file in memory, as it is sent."""

    stamp: tuple[int, int]  # mtime ns and size of the file when it was read
    data: bytes
    etag: str


class Files:
    """The files of a folder, read at the first request and again when they change."""

    def __init__(self, folder: Path = FOLDER) -> None:
        self._folder = folder
        self._assets: dict[str, Asset] = {}

    def get(self, name: str) -> Asset | None:
        """A file by its path in the folder; None if it does not exist."""
        path = self._folder / name
        try:
            if not path.resolve().is_relative_to(self._folder.resolve()) or not path.is_file():
                return None
            stat = path.stat()
            stamp = (stat.st_mtime_ns, stat.st_size)
            known = self._assets.get(name)
            if known is None or known.stamp != stamp:
                data = path.read_bytes()
                known = self._assets[name] = Asset(stamp, data, f'"{hashlib.sha256(data).hexdigest()[:24]}"')
        except (OSError, ValueError):  # a name with a NUL byte, or a file removed since
            return None
        return known
