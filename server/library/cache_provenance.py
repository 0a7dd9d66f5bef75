"""The recording that a store of columns was made of, and how it was read, so that the store can go with it."""

import json
import os
from pathlib import Path
from typing import Any

from imuscope.recordings.sidecar import stored_reading
from imuscope.recordings.tables.options import FileReading

CHANGED = "The recording changed while it was opened.", "Open it again."
SOURCE = "source.json"  # in a store: {"path", "size", "modified_ns"} of its recording, "reading" if any is chosen


def write_source(store: Path, path: Path, stamp: os.stat_result, reading: FileReading | None = None) -> None:
    """Note in a store which file it was made of and how it was read, as these were before."""
    source = {"path": str(path), "size": stamp.st_size, "modified_ns": stamp.st_mtime_ns, **_choices(reading)}
    (store / SOURCE).write_text(json.dumps(source))


def is_stale(store: Path) -> bool:
    """Whether the recording of a store is gone, has changed or is read otherwise now; one that does not say which it
    was made of is stored.
    """
    try:
        source = json.loads((store / SOURCE).read_text())
        path = Path(source["path"])
        stamp = path.stat()
        has_changed = (stamp.st_size, stamp.st_mtime_ns) != (source["size"], source["modified_ns"])
        return has_changed or source.get("reading", {}) != _choices(stored_reading(path)).get("reading", {})
    except FileNotFoundError as error:
        return not str(error.filename).endswith(SOURCE)
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _choices(reading: FileReading | None) -> dict[str, Any]:
    return {"reading": reading.as_json()} if reading else {}
