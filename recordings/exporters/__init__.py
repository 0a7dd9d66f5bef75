"""In which formats can a recording be handed on? One row each; a format is one file here.

    csv          csv_tables.py      a file per message, full precision, units in the header
    csv-aligned  csv_aligned.py    one file, a line for each sample of the fastest channel
    parquet      parquet.py    a file per message, units in the fields' metadata
    mcap         mcap_decoded.py  decoded values as JSON with schemas, for other viewers
    rrd          rerun.py      for the Rerun viewer: see recordings/rrd
    mtb raw bytes  raw_bytes.py the bytes of one device as they came

A writer gets a ExportRequest, a path and a `step` that is told the progress; it returns the files that it wrote. It
holds some thousand rows at a time, whatever the length. `export` runs one so that nothing is left where it does not
come to its end: what is written has another name until all of it is whole.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from recordings.exporters import raw_bytes, rerun
from recordings.exporters.request import ExportError, ExportRequest, ExportStep
from recordings.mcap_writer import RecordingError, disk_error

__all__ = ["FORMATS", "ExportError", "ExportRequest", "Format", "by_suffix", "export"]

Write = Callable[[ExportRequest, Path, ExportStep], list[Path]]


@dataclass(frozen=True, slots=True)
class Format:
    """One format.

    Args:
        title: for a person.
        suffix: of its files.
        write: see above.
        needs_source: whether it is made of the file's bytes rather than of columns.
    """

    title: str
    suffix: str
    write: Write
    needs_source: bool = False


def _by(module: str) -> Write:
    """The writer of a module that needs Arrow: imported when it is asked for, so that a server starts sooner."""

    def write(wish: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
        made: list[Path] = import_module(f"{__name__}.{module}").write(wish, out, step)
        return made

    return write


FORMATS: Mapping[str, Format] = {
    "csv": Format("CSV", ".csv", _by("csv_tables")),
    "csv-aligned": Format("CSV, aligned", ".csv", _by("csv_aligned")),
    "parquet": Format("Parquet", ".parquet", _by("parquet")),
    "mcap": Format("MCAP, decoded", ".mcap", _by("mcap_decoded")),
    "rrd": Format("Rerun", ".rrd", rerun.write),
    "mtb": Format("MT Manager", ".mtb", raw_bytes.write_mtb, needs_source=True),
    "raw": Format("Inertial Sense log", ".raw", raw_bytes.write_raw, needs_source=True),
    "bytes": Format("Original bytes", ".bin", raw_bytes.write_bytes, needs_source=True),
}


def by_suffix(suffix: str) -> str | None:
    """The format that a file's suffix chooses."""
    return next((name for name, one in FORMATS.items() if one.suffix == suffix.lower()), None)


def export(format: str, wish: ExportRequest, out: Path, step: ExportStep = lambda share: None) -> list[Path]:
    """Write what is wished for.

    Args:
        out: path of the file; formats of several files call them after its stem.
        step: told the progress, 0..1; an exception that it raises ends the export.
    Returns:
        the files, whole.
    Raises:
        ExportError, RecordingError: it cannot be done; nothing is left behind.
    """
    if not wish.infos and not wish.payloads and not FORMATS[format].needs_source:
        raise ExportError("There is nothing in this stretch to export.", "Choose a longer one, or other channels.")
    aside = out.parent / f".{secrets.token_hex(6)}.export"
    try:
        aside.mkdir(parents=True)
        made = FORMATS[format].write(wish, aside / out.name, step)
        for path in made:
            os.replace(path, out.with_name(path.name))
    except OSError as error:
        raise _told(error, out) from None
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    return [out.with_name(path.name) for path in made]


def _told(error: OSError, out: Path) -> RecordingError:
    said = disk_error(error, out)
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return RecordingError(said.message, "Free some space, or export a shorter stretch.")
    return said
