"""What does an error look like? Everywhere the same: {kind, message, hint}, from a wrong path to a fault of ours."""

from __future__ import annotations

import logging
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, Field
from starlette.exceptions import HTTPException

from server.configuration.device_controller import ControlError
from server.error_kinds import status_of
from server.links.base import LinkError

log = logging.getLogger("imuscope.api")


class ProblemBody(BaseModel):
    """The one shape of errors."""

    kind: str = Field(description="one word for programs", examples=["not-found"])
    message: str = Field(description="one sentence for a person")
    hint: str = Field(description="what to do next; may be empty")


class ApiError(Exception):
    """An error that a route answers with."""

    def __init__(self, status: int, kind: str, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.status = status
        self.body = ProblemBody(kind=kind, message=message, hint=hint)


KINDS = {404: "not-found", 405: "not-allowed", 413: "too-large", 415: "not-json"}


def problem(status: int, kind: str, message: str, hint: str = "", headers: Any = None) -> JSONResponse:
    """An error response."""
    body = ProblemBody(kind=kind, message=_sendable(message), hint=_sendable(hint))
    return JSONResponse(body.model_dump(), status, headers={"cache-control": "no-store", **(headers or {})})


def _sendable(text: str) -> str:
    """Half a character (JSON can name one) cannot be sent: what quotes it must not fail on it."""
    return text.encode("utf-8", "replace").decode()


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """For OpenAPI: these statuses have the one shape."""
    return {status: {"model": ProblemBody} for status in statuses}


def bytes_of(*kinds: str) -> dict[int | str, dict[str, Any]]:
    """For OpenAPI: what is answered is a file, or samples, of one of these media types."""
    return {200: {"content": {kind: {"schema": {"type": "string", "format": "binary"}} for kind in kinds}}}


def _place(loc: tuple[int | str, ...]) -> str:
    """Where in a request: changes.OutputConfiguration.outputs."""
    return ".".join(f"{part!s:.40}" for part in loc[1:5]) or "body"


def install(app: FastAPI) -> None:
    """Have every error of the application answered in the one shape."""

    @app.exception_handler(ApiError)
    async def _(_: Request, error: ApiError) -> Response:
        return problem(error.status, error.body.kind, error.body.message, error.body.hint)

    @app.exception_handler(LinkError)
    async def _(_: Request, error: LinkError) -> Response:
        return problem(status_of(error.kind), error.kind, error.message, error.hint)

    @app.exception_handler(ControlError)
    async def _(_: Request, error: ControlError) -> Response:
        return problem(status_of(error.kind), error.kind, error.message, error.hint)

    @app.exception_handler(HTTPException)
    async def _(request: Request, error: HTTPException) -> Response:
        if (
            error.status_code == 400
        ):  # FastAPI's word for a body that is JSON and yet cannot be read: digits without end
            return problem(422, "bad-request", "The body cannot be read.", "The shapes are listed at /openapi.json.")
        kind = KINDS.get(error.status_code, "error")
        message = {
            404: f"There is nothing at {request.url.path:.200}.",
            405: f"{request.method} is not possible at {request.url.path:.200}.",
        }.get(error.status_code, str(error.detail))
        hint = "The routes are listed at /openapi.json." if error.status_code in (404, 405) else ""
        return problem(error.status_code, kind, message, hint, error.headers)

    @app.exception_handler(RequestValidationError)
    async def _(_: Request, error: RequestValidationError) -> Response:
        found = error.errors()
        parts = [f"{_place(one['loc'])}: {one['msg']:.120}" for one in found[:4]]
        return problem(422, "bad-request", "; ".join(parts) + ".", "The shapes are listed at /openapi.json.")

    @app.exception_handler(Exception)
    async def _(request: Request, error: Exception) -> Response:
        log.exception("%s %s failed", request.method, request.url.path, exc_info=error)
        return problem(
            500, "fault", "A fault in imuscope; nothing was changed that it knows of.", "The log has details."
        )
