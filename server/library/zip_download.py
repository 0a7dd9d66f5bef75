"""Download form of an export: the file itself, or a zip of several files or of a folder."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Sequence
from pathlib import Path


def one_file(files: Sequence[Path], folder: Path, stem: str) -> Path:
    """The file, or a zip into which several files or folders are moved."""
    if len(files) == 1 and files[0].is_file():
        return files[0]
    path = folder / f"{stem}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for file in files:
            for inner in sorted(file.rglob("*")) if file.is_dir() else [file]:
                is_compressed = inner.suffix == ".parquet"  # has its own compression
                way = zipfile.ZIP_STORED if is_compressed else zipfile.ZIP_DEFLATED
                archive.write(inner, inner.relative_to(file.parent), way)
            shutil.rmtree(file) if file.is_dir() else file.unlink()
    return path
