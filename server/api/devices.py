"""Devices: which there are, open one, close one, try again now."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Request, Response
from pydantic import BaseModel, ConfigDict, Field, SecretStr

from server import wire
from server.api.errors import ApiError, responses
from server.reading import ReadingError, taken_from
from server.reading import reading as read_as
from server.session import Session
from server.sessions import Sessions

router = APIRouter(prefix="/api/devices", tags=["devices"])

SETTINGS_HINT = "What a source can be told is listed at /openapi.json, AddDevice."


class AddDevice(BaseModel):
    """A source to open."""

    model_config = ConfigDict(extra="forbid")

    source: str = Field(min_length=1, max_length=1000, description="as on the command line", examples=["/dev/ttyUSB0"])
    protocol: str = Field("", max_length=40, description="name of the protocol; empty to recognise it")
    key: SecretStr = Field(
        SecretStr(""), max_length=1000, description="for Secure frames of IDTP, hex; never told again"
    )
    min_mode: Literal["", "lite", "safety", "secure"] = Field(
        "", description="weakest mode of IDTP that is accepted; empty: secure with a key, else lite"
    )
    unverified: bool = Field(False, description="without a key, show Secure frames, marked as unverified")
    schema_text: str = Field(
        "", alias="schema", max_length=100_000, description="TOML that describes a vendor's own payload types of IDTP"
    )


def sessions_of(request: Request) -> Sessions:
    sessions: Sessions = request.app.state.sessions
    return sessions


def session_of(device: str, sessions: Annotated[Sessions, Depends(sessions_of)]) -> Session:
    try:
        return sessions.get(device)
    except KeyError:
        raise ApiError(404, "not-found", f"There is no device {device:.40}.", "GET /api/devices lists them.") from None


AllSessions = Annotated[Sessions, Depends(sessions_of)]
OneSession = Annotated[Session, Depends(session_of)]


@router.get("")
async def list_devices(sessions: AllSessions) -> list[wire.DeviceInfo]:
    """Every device with its link and state."""
    return sessions.infos


@router.post("", status_code=201, responses=responses(400, 409, 422))
async def add_device(body: AddDevice, request: Request, sessions: AllSessions) -> wire.DeviceInfo:
    """Open a source. The answer comes at once; how it goes on is told over the WebSocket."""
    try:
        reading = read_as(body.protocol, body.key.get_secret_value(), body.min_mode, body.unverified, body.schema_text)
        named = taken_from(body.source, reading)[1].protocol
    except ReadingError as error:
        raise ApiError(400, "bad-setting", f"{str(error)[:1].upper()}{str(error)[1:]}.", SETTINGS_HINT) from None
    protocols: dict[str, str] = request.app.state.protocols()
    if named and named not in protocols:
        raise ApiError(400, "bad-protocol", f"There is no protocol {named!r}.", f"There are: {', '.join(protocols)}.")
    return sessions.add(body.source, reading).info


@router.delete("/{device}", status_code=204, responses=responses(404, 422))
async def remove_device(session: OneSession, sessions: AllSessions) -> Response:
    """Close a device and forget it."""
    await sessions.remove(session.info.id)
    return Response(status_code=204)


@router.post("/{device}/retry", responses=responses(404, 422))
async def retry_device(session: OneSession) -> wire.DeviceInfo:
    """Try the link now instead of at `next_try`; play an ended file again."""
    session.retry()
    return session.info
