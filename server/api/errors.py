"""One shape for every error of the HTTP API, from a wrong path to an internal error: {kind, message, hint}."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from imuscope.recordings.errors import RecordingError
from imuscope.server.errors import DomainError, status_of

log = logging.getLogger("imuscope.api")


class ProblemBody(BaseModel):
    """The shape of every error."""

    kind: str = Field(description="one word for programs", examples=["not-found"])
    message: str = Field(description="one sentence for the user")
    hint: str = Field(description="what to do next; may be empty")


def unknown_recording(recording: str) -> DomainError:
    hint = "It may have been deleted; choose one of the list."
    return DomainError("not-found", f"Recording {recording:.80} not found.", hint)


@contextmanager
def recording_errors(recording: str, kind: str = "cannot-open") -> Iterator[None]:
    """Raise what reading or changing a recording raises as DomainError: "not-found", or this kind."""
    try:
        yield
    except (KeyError, FileNotFoundError):
        raise unknown_recording(recording) from None
    except RecordingError as error:
        raise DomainError(kind, error.message, error.hint) from None


def check_length(text: str | None, most: int, what: str) -> None:
    """Raise DomainError for a text that is too long."""
    if text is not None and len(text) > most:
        words = f"{what} has {len(text)} characters; the maximum is {most}."
        raise DomainError("bad-request", words, "Make it shorter.")


KINDS = {404: "not-found", 405: "not-allowed", 413: "too-large", 415: "not-json"}


def problem(status: int, kind: str, message: str, hint: str = "", headers: Any = None) -> JSONResponse:
    """An error response."""
    body = ProblemBody(kind=kind, message=_sendable(message), hint=_sendable(hint))
    return JSONResponse(body.model_dump(), status, headers={"cache-control": "no-store", **(headers or {})})


def _sendable(text: str) -> str:
    """Replace unpaired surrogates, which JSON can spell but UTF-8 cannot encode, so that quoting them cannot fail."""
    return text.encode("utf-8", "replace").decode()


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """OpenAPI entries of these statuses, all with the one shape.

    The shape is referred to by name: for a model FastAPI makes a validator for each status of each route, which delays
    the first request of a server by a second. `description.install` adds the shape.
    """
    content = {"application/json": {"schema": {"$ref": f"#/components/schemas/{ProblemBody.__name__}"}}}
    return {status: {"content": content} for status in statuses}


def bytes_of(*kinds: str) -> dict[int | str, dict[str, Any]]:
    """OpenAPI entry of a response that is a file, or samples, of one of these media types."""
    return {200: {"content": {kind: {"schema": {"type": "string", "format": "binary"}} for kind in kinds}}}


def _place(loc: tuple[int | str, ...]) -> str:
    """Location of a problem in a request: changes.OutputConfiguration.outputs."""
    return ".".join(f"{part!s:.40}" for part in loc[1:5]) or "body"


def install(app: FastAPI) -> None:
    """Answer every error of the application in the one shape."""

    @app.exception_handler(DomainError)
    async def _(_: Request, error: DomainError) -> Response:
        return problem(status_of(error.kind), error.kind, error.message, error.hint)

    @app.exception_handler(HTTPException)
    async def _(request: Request, error: HTTPException) -> Response:
        if error.status_code == 400:  # FastAPI's status for JSON that cannot be parsed, such as endless digits
            return problem(422, "bad-request", "The body cannot be read.", "The shapes are listed at /openapi.json.")
        kind = KINDS.get(error.status_code, "error")
        message = {
            404: f"Nothing found at {request.url.path:.200}.",
            405: f"{request.method} is not possible at {request.url.path:.200}.",
        }.get(error.status_code, str(error.detail))
        hint = "The routes are listed at /openapi.json." if error.status_code in (404, 405) else ""
        return problem(error.status_code, kind, message, hint, error.headers)

    @app.exception_handler(RequestValidationError)
    async def _(_: Request, error: RequestValidationError) -> Response:
        problems = error.errors()
        parts = [f"{_place(one['loc'])}: {one['msg']:.120}" for one in problems[:4]]
        return problem(422, "bad-request", "; ".join(parts) + ".", "The shapes are listed at /openapi.json.")

    @app.exception_handler(Exception)
    async def _(request: Request, error: Exception) -> Response:
        log.exception("%s %s failed", request.method, request.url.path, exc_info=error)
        with suppress(AttributeError):
            error.is_logged = True  # type: ignore[attr-defined] # uvicorn, which it is raised to, need not do it again
        return problem(
            500, "fault", "Internal error in imuscope; no change is known to have been made.", "The log has details."
        )
