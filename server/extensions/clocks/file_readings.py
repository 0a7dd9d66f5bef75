"""Routes of the choices on how a recording is read, and of the first rows of a table under given options."""

import asyncio
from dataclasses import dataclass
from typing import Annotated, Literal

from fastapi import Request
from pydantic import BaseModel, Field

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.library.entry import LibraryEntry
from imuscope.recordings.library.previewed_table import TablePreview, TableQuestion
from imuscope.recordings.library.recording_probe import TABLE_FORMATS
from imuscope.recordings.sidecar import stored_reading
from imuscope.recordings.tables.options import (
    FASTEST_HZ,
    MAX_HEADING_CHARS,
    MOST_COLUMNS,
    SLOWEST_HZ,
    FileReading,
    TableOptions,
)
from imuscope.server.api.dependencies import TheServices, user_of, while_connected
from imuscope.server.api.errors import recording_errors, responses, unknown_recording
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.api.recordings import OneEntry, still_recording
from imuscope.server.errors import DomainError
from imuscope.server.services.services import Services

router = lazy_router(prefix="/api/recordings", tags=["recordings"])

MOST_PACKED = 20_000_000  # bytes of an archive that is unpacked to look for a question
Heading = Annotated[str, Field(max_length=MAX_HEADING_CHARS)]


class FileReadingBody(BaseModel, extra="forbid"):
    """Choices on how a recording is read; "" and 0 where the file decides.

    Those of tables are the options of the command line, and `clock` that of devices and messages.
    """

    time_column: Heading = Field("", description='heading or number of the column of times; "none" counts the rows')
    unit: Literal["", "s", "ms", "us", "ns"] = Field("", description="of the times")
    date_order: Literal["", "dmy", "mdy"] = Field("", description="of dates like 01/02/2026")
    rate: float = Field(0.0, ge=0, le=FASTEST_HZ, description="samples per second; 0 if it is not needed")
    packet_stamp: Literal["", "first", "last"] = Field("", description="sample of a packet that has its time")
    columns: dict[Heading, Heading] = Field(
        default_factory=dict,
        max_length=MOST_COLUMNS,
        description='heading or number of a column → its name with the unit; "" leaves it out',
    )
    clock: Literal["", "device", "arrival"] = Field("", description="time axis of devices and messages")

    def reading(self) -> FileReading:
        """The choices."""
        rate = self.rate if self.rate >= SLOWEST_HZ else 0.0
        order, stamp = self.date_order or None, self.packet_stamp
        table = TableOptions(self.time_column.strip(), self.unit, order, rate, self.columns, stamp)
        return FileReading(table, self.clock)


@dataclass(frozen=True, slots=True)
class ReadingState:
    """Choices on how a recording is read, and the open question of its table.

    Args:
        reading: the choices kept with it.
        is_chosen: whether there are any.
        is_table: whether the options of tables apply.
        about: open question: "time", "unit", "order", "rate"; "" if it can be read, or is none.
        problem: the question in words; "" without one.
    """

    reading: FileReadingBody
    is_chosen: bool
    is_table: bool
    about: Literal["", "time", "unit", "order", "rate"] = ""
    problem: str = ""


def body_of(reading: FileReading | None) -> FileReadingBody:
    """The choices as a body."""
    table, clock = (reading.table, reading.clock) if reading is not None else (TableOptions(), "")
    unit = "us" if table.unit == "µs" else table.unit
    values = {"time_column": table.time_column, "unit": unit, "date_order": table.date_order or "", "rate": table.rate}
    values |= {"packet_stamp": table.packet_stamp}
    return FileReadingBody.model_validate({**values, "columns": dict(table.columns), "clock": clock})


def is_table(store: ColumnStore) -> bool:
    """Whether an opened recording is a table."""
    return "axis" in (store.manifest.get("time") or {})


@router.get("/{recording}/reading", responses=responses(404, 422))
async def get_reading(services: TheServices, entry: OneEntry) -> ReadingState:
    """Choices on how a recording is read, and the open question of its table."""
    return await _state(services, entry)


@router.post("/{recording}/reading/preview", responses=responses(404, 422))
async def preview_reading(
    request: Request, body: FileReadingBody, services: TheServices, entry: OneEntry
) -> TablePreview:
    """The first rows of a table as they will be read with these choices alone."""
    work = _preview(services, entry, body.reading().table, user_of(request))
    preview = await while_connected(request, work)
    if preview is None:
        raise _no_table(entry)
    return preview


@router.put("/{recording}/reading", responses=responses(404, 409, 422, 507))
async def choose_reading(body: FileReadingBody, services: TheServices, entry: OneEntry) -> ReadingState:
    """Choose how a recording is read. It is kept with it; a table's choices apply to later ones with its heading."""
    if services.catalogue.is_recording(entry):
        raise still_recording(entry.id)
    reading = body.reading()
    heading: list[str] = []
    if reading.table != TableOptions():
        preview = await _preview(services, entry, reading.table)
        if preview is None:
            raise _no_table(entry)
        if preview.about:
            raise DomainError("cannot-open", preview.problem, preview.hint)
        heading = preview.heading
    return await _choose(services, entry, reading, heading)


@router.delete("/{recording}/reading", responses=responses(404, 409, 422, 507))
async def forget_reading(services: TheServices, entry: OneEntry) -> ReadingState:
    """Read a recording as the file itself says, and forget the choices for its heading."""
    if services.catalogue.is_recording(entry):
        raise still_recording(entry.id)
    try:
        preview = await _preview(services, entry, TableOptions())
    except DomainError:  # it cannot be opened at all
        preview = None
    return await _choose(services, entry, FileReading(), preview.heading if preview is not None else [])


async def _choose(services: TheServices, entry: LibraryEntry, reading: FileReading, heading: list[str]) -> ReadingState:
    catalogue = services.catalogue
    with recording_errors(entry.id, "disk"):
        tables = await asyncio.to_thread(catalogue.library.unchosen_tables) if reading and heading else []
        others = await catalogue.headings(tables)
        changed = await asyncio.to_thread(catalogue.library.choose, entry.id, reading, heading, others)
    services.catalogue.changed()
    return await _state(services, changed)


async def _state(services: TheServices, entry: LibraryEntry) -> ReadingState:
    reading = stored_reading(entry.path)
    try:
        store = services.columns.cached(entry.id)
    except (KeyError, OSError):
        raise unknown_recording(entry.id) from None
    if store is not None:
        return ReadingState(body_of(reading), bool(reading), is_table(store))
    is_large = entry.size > MOST_PACKED and entry.probe.format not in TABLE_FORMATS
    if is_large or not entry.probe.may_be_table:
        return ReadingState(body_of(reading), bool(reading), False)
    question = await _question(services, entry)
    if question is None:
        return ReadingState(body_of(reading), bool(reading), True)
    return ReadingState(body_of(reading), bool(reading), True, question.about, question.message)


async def _question(services: Services, entry: LibraryEntry) -> TableQuestion | None:
    function = "imuscope.recordings.library.table_preview:question_of"
    try:
        return await services.catalogue.files.call(function, entry.path, returns=TableQuestion | None)
    except (RecordingError, OSError):
        return None  # opening it says why


async def _preview(
    services: Services, entry: LibraryEntry, options: TableOptions, user: str = ""
) -> TablePreview | None:
    if not entry.probe.may_be_table:
        return None
    function = "imuscope.recordings.library.table_preview:preview_of"
    try:
        files = services.catalogue.files
        return await files.call(function, entry.path, options, returns=TablePreview | None, user=user)
    except RecordingError as error:
        raise DomainError("cannot-open", error.message, error.hint) from None
    except OSError as error:
        words = f"The recording cannot be read: {(error.strerror or 'the disk failed').lower()}."
        raise DomainError("cannot-open", words, "Check that its file still exists.") from None


def _no_table(entry: LibraryEntry) -> DomainError:
    hint = "Only the columns of tables can be chosen."
    return DomainError("bad-request", f"{entry.title:.80} is not a table.", hint)
