"""Download form of an export: the file itself, or a zip of several files."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path


def one_file(files: Sequence[Path], folder: Path, stem: str) -> Path:
    """The file, or a zip into which several files are moved."""
    if len(files) == 1:
        return files[0]
    path = folder / f"{stem}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for file in files:
            is_compressed = file.suffix == ".parquet"  # has its own compression
            archive.write(file, file.name, zipfile.ZIP_STORED if is_compressed else zipfile.ZIP_DEFLATED)
            file.unlink()
    return path
