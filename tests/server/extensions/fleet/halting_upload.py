"""`imuscope upload` that halts at a place of its work, and tells so, to be killed there.

python -m tests.server.extensions.fleet.halting_upload PLACE upload FILE …
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pyarrow as pa
import pytest

from imuscope.server.cli import main as imuscope
from imuscope.server.extensions.fleet.store import delta_tables
from imuscope.server.extensions.fleet.store.tables import SETTINGS, TABLES
from imuscope.server.extensions.fleet.upload import upload as uploading

HALTED = "halted"
PLACES = ("object", "table", "rows", *TABLES)
"""The object is written, not checked; a table is made, and empty; half of the rows are written. In the order of an
upload: right before the rows of a table, of `samples` when only the object is there; settings, of which there are none,
when their table is made.
"""


def halt(*_: object) -> None:
    print(HALTED, flush=True)
    while True:
        signal.pause()


def half(rows: Any) -> Any:
    """Rows of which only the first batch comes."""

    def batches() -> Iterator[pa.RecordBatch]:
        yield next(iter(rows))
        halt()

    return pa.RecordBatchReader.from_batches(rows.schema, batches())


def main() -> int:
    """Run the command; returns its exit status, if it does not halt."""
    place, *words = sys.argv[1:]
    create, append = delta_tables._create, delta_tables._append

    def halting_create(*source: Any) -> Any:
        made = create(*source)
        if place == "table" or (place == source[1].name == SETTINGS.name):
            halt()
        return made

    def halting_append(table: Any, kind: Any, recording: str, rows: Any) -> None:
        if place == kind.name:
            halt()
        append(table, kind, recording, half(rows) if place == "rows" else rows)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(delta_tables, "_create", halting_create)
        patch.setattr(delta_tables, "_append", halting_append)
        if place == "object":
            patch.setattr(uploading, "atomic_write", SimpleNamespace(sync=halt))
        return imuscope(words)


if __name__ == "__main__":
    sys.exit(main())
