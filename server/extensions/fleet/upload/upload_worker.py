"""`python -m imuscope.server.extensions.fleet.upload.upload_worker`: upload one recording in a subprocess, for
uploads.py.

The request comes on standard input, one JSON object: path, store, rate (bytes/s; 0 for no limit), robot, options (of
decoding), folder (for temporary files; its content is removed). The output are JSON lines: {"progress": 0..1}, then
{"stored": {recording, object, checksum, is_first}} or {"failed", "words"}. What failed is the "file", which another
attempt does not change, or the "store".

With `recording` in the request, nothing is uploaded: {"confirmed": true} if the store has that recording of this file,
read again and compared by its checksum, and false with "words" if it has not.
"""

import errno
import shutil
import tempfile
from pathlib import Path
from typing import Any

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.system.parent_death import report_to_parent
from imuscope.recordings.system.resource_limits import TooLong, bounded_by
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.extensions.fleet.store.fetch import NotInStoreError, verify
from imuscope.server.extensions.fleet.store.recording_digest import recording_id
from imuscope.server.extensions.fleet.store.store import AGAIN, StoreError, limited, location
from imuscope.server.extensions.fleet.upload.upload import upload
from imuscope.server.system.worker_process import begin, progress_reports


def main() -> int:
    """Upload the recording that standard input requests. Returns 0, or 1 after a reported error."""
    request = begin(15)  # everything that a user waits for comes first, too
    path = Path(request["path"])
    bounded_by(path)
    try:
        if "recording" in request:
            _confirm(path, request)
            return 0
        _use_folder(Path(request["folder"]))
        with limited(location(request["store"]), request["rate"]) as store:
            made = upload(path, store, request["robot"], DecodeOptions("", request["options"]), progress_reports())
    except StoreError as error:
        return _fail("store", error.message, error.hint)
    except RecordingError as error:
        is_disk = isinstance(error.__context__, OSError)  # of this robot: nothing is wrong with the recording
        return _fail("store" if is_disk else "file", error.message, error.hint)
    except MemoryError:
        return _fail("file", "Decoding it exceeds the memory limit", "The file may be damaged.")
    except TooLong:
        return _fail("file", "Decoding it exceeds the time limit", "The file may be damaged.")
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            words = f"The disk of this robot is full: the upload of {path.name} needs room for temporary files"
            return _fail("store", words, f"Free some space. {AGAIN}")
        cause = (error.strerror or "the disk failed").lower()
        return _fail("store", f"{path.name} cannot be read, or temporary files cannot be written: {cause}", "")
    report_to_parent(
        stored={"recording": made.recording, "object": made.key, "checksum": made.checksum, "is_first": made.is_first}
    )
    return 0


def _confirm(path: Path, request: dict[str, Any]) -> None:
    if recording_id(path, open_file(path), request["robot"]) != request["recording"]:
        report_to_parent(confirmed=False, words="the file has changed since its upload.")
        return
    try:
        with limited(location(request["store"]), request["rate"]) as store:
            is_same = verify(store, request["recording"]) == request["checksum"]
    except NotInStoreError as error:
        report_to_parent(confirmed=False, words=f"{error.message}.")
        return
    report_to_parent(confirmed=is_same, words="" if is_same else "the store has another checksum.")


def _use_folder(folder: Path) -> None:
    """Make temporary files here, without those of an upload that was killed."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    tempfile.tempdir = str(folder)


def _fail(what: str, message: str, hint: str) -> int:
    hint = hint.replace(AGAIN, "Uploaded parts are kept; the rest is tried again.")
    report_to_parent(failed=what, words=f"{message.rstrip('.')}. {hint}".strip())
    return 1


if __name__ == "__main__":
    raise SystemExit(main())
