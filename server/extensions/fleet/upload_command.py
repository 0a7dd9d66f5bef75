"""`imuscope upload FILE --store URL --robot NAME`: a recording into a store."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from imuscope.recordings.mcap_writer import RecordingError
from imuscope.server.commands.decode import Bar
from imuscope.server.devices.decode_options import DecodeOptions
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.store import MISSING, StoreError, location


class UploadError(Exception):
    """An error that the user can correct, in one line."""


@dataclass(frozen=True, slots=True)
class UploadRequest:
    """Request for an upload.

    Args:
        store: URL or path.
        robot: name of the robot.
    """

    store: str
    robot: str


def upload_file(path: Path, name: str, reading: DecodeOptions, request: UploadRequest, notes: TextIO) -> str:
    """Upload a file.

    Args:
        name: of the file, as given.
        notes: stream for the progress bar.

    Returns:
        a line that says where it is.

    Raises:
        UploadError: it cannot be read, or the store cannot be used.
    """
    bar = Bar(notes)
    try:
        store = location(request.store)
        from imuscope.server.extensions.fleet.upload import upload

        made = upload(path, store, request.robot, reading, bar.show)
    except ModuleNotFoundError as error:
        if error.name not in ("deltalake", "obstore", "duckdb"):
            raise
        raise UploadError(MISSING) from None
    except (StoreError, RecordingError, DomainError) as error:
        raise UploadError(f"{error.message.rstrip('.')}. {error.hint}".strip()) from None
    except OSError as error:
        raise UploadError(f"{name}: {(error.strerror or 'it cannot be read').lower()}") from None
    finally:
        bar.clear()
    words = "uploaded" if made.is_new else "was uploaded before"
    return f"{name} {words}: {store.url.rstrip('/')}/{made.key}"
