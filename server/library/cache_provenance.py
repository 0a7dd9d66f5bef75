"""The recording that a store of columns was made of, so that the store can go with it."""

from __future__ import annotations

import json
import os
from pathlib import Path

SOURCE = "source.json"  # in a store: {"path", "size", "modified_ns"} of its recording


def write_source(store: Path, path: Path, stamp: os.stat_result) -> None:
    """Note in a store which file it was made of, as that was before it was read."""
    source = {"path": str(path), "size": stamp.st_size, "modified_ns": stamp.st_mtime_ns}
    (store / SOURCE).write_text(json.dumps(source))


def is_stale(store: Path) -> bool:
    """Whether the recording of a store is gone or has changed; one that does not say which it was made of is kept."""
    try:
        source = json.loads((store / SOURCE).read_text())
        stamp = Path(source["path"]).stat()
        return (stamp.st_size, stamp.st_mtime_ns) != (source["size"], source["modified_ns"])
    except FileNotFoundError as error:
        return not str(error.filename).endswith(SOURCE)
    except (OSError, ValueError, KeyError, TypeError):
        return False
