"""What an export hands out: its file, or of several files one zip."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path


def one_file(files: Sequence[Path], folder: Path, stem: str) -> Path:
    """The file; of several a zip, into which they move."""
    if len(files) == 1:
        return files[0]
    path = folder / f"{stem}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for file in files:
            kept = file.suffix == ".parquet"  # compressed already
            archive.write(file, file.name, zipfile.ZIP_STORED if kept else zipfile.ZIP_DEFLATED)
            file.unlink()
    return path
