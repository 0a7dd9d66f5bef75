"""Exporters: recordings as files of other programs.

    formats/       one file per format, which registers it: registry.py
    csv_tables.py, csv_aligned.py, parquet.py, mcap_decoded.py, raw_bytes.py    writers that take longer to import

A writer holds some thousand rows at a time, whatever the length. `export` writes under temporary names and renames the
files when all are complete, so that an aborted export leaves nothing behind.
"""

import errno
import secrets
import shutil
from pathlib import Path

from imuscope.recordings.errors import RecordingError, disk_error
from imuscope.recordings.exporters.registry import EXPORTERS, ExportFormat
from imuscope.recordings.exporters.request import ExportError, ExportRequest, ExportStep
from imuscope.recordings.optional_packages import installation_of, lacks
from imuscope.recordings.system import atomic_write

__all__ = ["FORMATS", "PROBLEMS", "ExportError", "ExportFormat", "ExportRequest", "by_suffix", "export"]

FORMATS, PROBLEMS = EXPORTERS.all(), EXPORTERS.load()


def by_suffix(name: str) -> str | None:
    """The format that the end of a file's name selects: the first of those with the longest suffix."""
    matches = [one for one in FORMATS.values() if name.lower().endswith(one.suffix)]
    return max(matches, key=lambda one: len(one.suffix)).name if matches else None


def export(export_format: str, request: ExportRequest, out: Path, step: ExportStep = lambda share: None) -> list[Path]:
    """Write the requested export.

    Args:
        out: path of the file; formats of several files use its stem in their names, or make a folder of it.
        step: called with the progress, 0..1; an exception it raises ends the export.

    Returns:
        the files, complete; or the folder.

    Raises:
        ExportError, RecordingError: not possible; nothing is left behind.
    """
    if not request.infos and not request.payloads and not FORMATS[export_format].needs_source:
        raise ExportError("This range contains nothing to export.", "Choose a longer range, or other channels.")
    if lacks(*FORMATS[export_format].modules):
        raise ExportError(
            f"{FORMATS[export_format].title} files need packages that are not installed.",
            f"Add them: {installation_of(FORMATS[export_format].extra)}.",
        )
    if request.columns.units != "shown" and not FORMATS[export_format].takes_units:
        raise ExportError(f"{FORMATS[export_format].title} files have units of their own.", "Leave out the units.")
    if out.is_dir():
        raise ExportError(f"{out.name} is a folder that exists.", "Give another name, or remove it first.")
    temporary = out.parent / f".{secrets.token_hex(6)}.export"
    try:
        temporary.mkdir(parents=True)
        made = FORMATS[export_format].write(request, temporary / out.name, step)
        for path in made:
            atomic_write.replace(path, out.with_name(path.name), durable=False)
    except OSError as error:
        raise _export_error(error, out) from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return [out.with_name(path.name) for path in made]


def _export_error(error: OSError, out: Path) -> RecordingError:
    file = error.filename if isinstance(error.filename, str) else out  # one that it reads, perhaps
    error_text = disk_error(error, Path(file))
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return RecordingError(error_text.message, "Free some space, or export a shorter stretch.")
    return error_text
