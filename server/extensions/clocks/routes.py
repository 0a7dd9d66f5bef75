"""Route of the clocks of an opened recording."""

from __future__ import annotations

from dataclasses import dataclass

from fastapi import APIRouter

from imuscope.recordings.sidecar import stored_reading
from imuscope.server.api.errors import responses
from imuscope.server.api.recording_data import OneStore
from imuscope.server.api.recordings import OneEntry
from imuscope.server.extensions.clocks.figures import MessageClocks, clocks_of
from imuscope.server.extensions.clocks.file_readings import FileReadingBody, body_of, is_table

router = APIRouter(tags=["recordings"])


@dataclass(frozen=True, slots=True)
class FileTime:
    """Time of a recording: its clocks, and which of them is the time axis.

    Args:
        start, end: unix s of the first and the last sample; null without samples.
        sentences: the axis of a file that imuscope did not record, why it is that, and the assumptions.
        sure: "stated" by the file or a user, "known" from the form, "inferred" from the numbers, "assumed"; "" of a
            device's bytes.
        messages: the clocks of each message.
        reading: the choices kept with it, by which its clocks can be chosen; is_chosen: whether there are any.
        is_table: whether the options of tables apply.
    """

    start: float | None
    end: float | None
    sentences: list[str]
    sure: str
    messages: list[MessageClocks]
    reading: FileReadingBody
    is_chosen: bool
    is_table: bool


@router.get("/api/recordings/{recording}/clocks", responses=responses(404, 409, 422))
def list_clocks(store: OneStore, entry: OneEntry) -> FileTime:
    """Every clock of an opened recording: unit, epoch, resolution, drift and jitter against the axis, steps."""
    manifest = store.manifest
    described = manifest.get("time") or {}
    axis = [event["text"] for event in manifest["events"] if event["kind"] == "clock" and event["level"] == "info"]
    return FileTime(
        manifest["started"],
        manifest["ended"],
        list(described.get("sentences") or axis),
        described.get("sure", ""),
        clocks_of(store),
        body_of(reading := stored_reading(entry.path)),
        bool(reading),
        is_table(store),
    )
