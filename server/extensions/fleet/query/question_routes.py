"""Routes of questions about the store of recordings, in SQL (docs/fleet.md)."""

import asyncio
import re
from contextlib import AsyncExitStack
from typing import Literal

from fastapi import Request
from fastapi.responses import Response, StreamingResponse
from pydantic import BaseModel, Field
from starlette.types import Receive, Scope, Send

from imuscope.recordings.errors import RecordingError
from imuscope.server.api.dependencies import CLIENT_GONE, TheServices, user_of, while_connected
from imuscope.server.api.errors import bytes_of, responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.query.prepared_queries import QUESTIONS
from imuscope.server.extensions.fleet.query.query_service import QueryService, QuestionRequest, RunningQuery

router = lazy_router(prefix="/api/query", tags=["query"])

MAX_SQL = 100_000
MAX_ROWS = 200_000
MEDIA = {
    "json": "application/json",
    "arrow": "application/vnd.apache.arrow.stream",
    "csv": "text/csv; charset=utf-8",
    "parquet": "application/vnd.apache.parquet",
}
FILES = [MEDIA[name] for name in ("arrow", "csv", "parquet")]
RECORDING = re.compile(r"[0-9a-f]{24}")


class AnswerColumn(BaseModel):
    """Name and type of a column in the result."""

    name: str
    kind: Literal["integer", "number", "text", "time", "date", "boolean", "other"] = Field(
        description="times are ISO 8601 in UTC; integers beyond 2⁵³ are text"
    )


class QueryAnswer(BaseModel):
    """An answer as JSON. A value that is missing or not finite is null."""

    columns: list[AnswerColumn]
    rows: list[list[object]]
    more: bool = Field(description="whether there are more rows than these")
    seconds: float = Field(description="time that the question took, without waiting")


class QueryBody(BaseModel):
    """A question: SQL, or the name of a prepared question."""

    sql: str = Field("", max_length=MAX_SQL, description="one statement that reads, as DuckDB has it")
    question: str = Field("", max_length=80, description="name of a prepared question, in place of `sql`")
    format: Literal["json", "arrow", "csv", "parquet"] = Field(
        "json", description="`arrow`: an IPC stream; all but `json` have all rows"
    )
    rows: int = Field(10_000, ge=1, le=MAX_ROWS, description="most rows of an answer as JSON")
    timeout_s: float | None = Field(None, gt=0, description="longest time, s; at most that of the server")
    memory_mb: int | None = Field(None, ge=64, description="most memory, MB; at most that of the server")
    id: str = Field("", max_length=80, description="a name by which `GET /api/query` lists this question")


class QuestionState(BaseModel):
    """A question of this client that waits or runs."""

    id: str
    is_running: bool
    before: int = Field(description="number of waiting questions that are answered before this one")


class QueryState(BaseModel):
    """The store, and the questions about it."""

    store: str = Field(description="URL or folder; empty if this server has no store")
    at_once: int = Field(description="number of questions that are answered at once")
    running: int
    waiting: int
    timeout_s: float = Field(description="longest time of a question, s")
    memory_mb: int = Field(description="most memory of a question, MB")
    questions: list[QuestionState] = Field(description="those of this client")


class PreparedQuestionInfo(BaseModel):
    """SQL that is offered by name, with its description."""

    name: str
    title: str
    sql: str


class TableColumnInfo(BaseModel):
    """Name, type and meaning of a column of the store."""

    name: str
    type: str
    doc: str


class TableInfo(BaseModel):
    """A table that queries can use, with its columns."""

    name: str
    doc: str
    columns: list[TableColumnInfo]


class SignalWord(BaseModel):
    """A signal that occurs in the store, for completion in the editor."""

    name: str
    unit: str


class SqlFunction(BaseModel):
    """An SQL function that queries may call, for completion in the editor."""

    name: str
    form: str
    doc: str


class QueryWords(BaseModel):
    """Names that a question may use."""

    tables: list[TableInfo]
    signals: list[SignalWord]
    functions: list[SqlFunction]


@router.get("")
async def get_query_state(request: Request, services: TheServices) -> QueryState:
    """The store of this server, its limits, and the questions of this client that wait or run."""
    service = services.parts.get(QueryService)
    queue, settings = service.queue, service.settings
    return QueryState(
        store=settings.url,
        at_once=queue.at_once,
        running=queue.running,
        waiting=queue.waiting,
        timeout_s=settings.query_s,
        memory_mb=settings.query_mb,
        questions=[_state(service, one) for one in service.running_of(user_of(request))],
    )


def _state(service: QueryService, one: RunningQuery) -> QuestionState:
    return QuestionState(id=one.id, is_running=one.turn.is_running, before=service.queue.before(one.turn))


@router.get("/questions")
async def list_questions() -> list[PreparedQuestionInfo]:
    """Prepared questions with their SQL."""
    return [PreparedQuestionInfo(name=name, title=one.title, sql=one.sql) for name, one in QUESTIONS.items()]


@router.get("/tables", responses=responses(409, 502))
async def list_tables(services: TheServices) -> QueryWords:
    """Tables with their columns, signals, and functions of SQL: what an editor completes."""
    return QueryWords.model_validate(await services.parts.get(QueryService).words())


@router.post(
    "",
    response_model=None,
    responses={
        200: {"model": QueryAnswer, **bytes_of(*FILES)[200]},
        **responses(404, 409, 422, 502),
    },
)
async def query(body: QueryBody, request: Request, services: TheServices) -> Response:
    """Ask the store a question. The answer ends with the connection: closing it cancels the question."""
    service = services.parts.get(QueryService)
    question = _question(body, service)
    stack = AsyncExitStack()
    answer = service.answer(user_of(request), question)
    pieces = await while_connected(request, stack.enter_async_context(answer))
    if pieces is None:
        return Response(status_code=CLIENT_GONE)
    headers = {"cache-control": "no-store"}
    if body.format != "json":
        headers["content-disposition"] = f'attachment; filename="answer.{body.format}"'
    return _ClosingResponse(pieces, stack, media_type=MEDIA[body.format], headers=headers)


class FetchedRecording(BaseModel):
    """A recording of the store in the library of this server."""

    id: str = Field(description="its id in the library")
    is_new: bool = Field(description="whether it was fetched now")


@router.post("/recordings/{recording}/fetch", responses=responses(404, 409, 422, 502, 507))
async def fetch_recording(recording: str, services: TheServices) -> FetchedRecording:
    """Fetch a recording of the store into the library, unless it is there, and compare its checksum."""
    library = services.catalogue.library
    name = f"{recording}.mcap"
    if not RECORDING.fullmatch(recording):
        hint = "Take it from the column `recording`."
        raise DomainError("bad-request", f"{recording!r:.80} is not the identifier of a recording.", hint)
    service = services.parts.get(QueryService)
    async with service.fetches:  # also while it is looked for: another request may be fetching it
        try:
            known = await services.catalogue.entry(recording)
        except KeyError:
            pass
        else:
            return FetchedRecording(id=known.id, is_new=False)
        try:
            path = await asyncio.to_thread(library.incoming, name)
            try:
                await service.fetch(recording, path)
                entry = await services.catalogue.add_upload(path)
            finally:
                await asyncio.to_thread(library.refuse, path)
        except RecordingError as error:
            raise DomainError("disk", error.message, error.hint) from None
    services.catalogue.changed()
    return FetchedRecording(id=entry.id, is_new=True)


def _question(body: QueryBody, service: QueryService) -> QuestionRequest:
    if bool(body.sql.strip()) == bool(body.question):
        raise DomainError(
            "bad-request", "Give sql or question: one of the two.", "`question` is the name of a prepared one."
        )
    if body.question and body.question not in QUESTIONS:
        known = ", ".join(QUESTIONS)
        raise DomainError("not-found", f"Question {body.question!r:.80} not found.", f"Prepared questions: {known}.")
    settings = service.settings
    return QuestionRequest(
        sql=body.sql or QUESTIONS[body.question].sql,
        format=body.format,
        rows=body.rows,
        memory_mb=min(body.memory_mb or settings.query_mb, settings.query_mb),
        timeout_s=min(body.timeout_s or settings.query_s, settings.query_s),
        id=body.id,
    )


class _ClosingResponse(StreamingResponse):
    """Streaming response that cancels its query when the client disconnects."""

    def __init__(self, pieces: object, stack: AsyncExitStack, **more: object) -> None:
        super().__init__(pieces, **more)  # type: ignore[arg-type]
        self._stack = stack

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            await self._stack.aclose()
