"""Devices: which there are, open one, close one, try again now, read its bytes in another way."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Request, Response
from pydantic import BaseModel, ConfigDict, Field, SecretStr

from server import wire
from server.api.errors import ApiError, responses
from server.devices.decode_options import DecodeOptions, ReadingError, changed, parse_source_options
from server.devices.decode_options import reading as read_as
from server.devices.session import Session
from server.devices.sessions import Sessions
from server.links.base import LinkError
from server.links.source_url import SourceUrl

router = APIRouter(prefix="/api/devices", tags=["devices"])

SETTINGS_HINT = "What a source can be told is listed at /openapi.json, AddDevice."


class DecodeOptionsBody(BaseModel):
    """How the bytes of a source are to be read."""

    model_config = ConfigDict(extra="forbid")

    protocol: str = Field("", max_length=40, description="name of the protocol; empty to recognise it")
    key: SecretStr = Field(
        SecretStr(""), max_length=1000, description="for Secure frames of IDTP, hex; never told again"
    )
    min_mode: Literal["", "lite", "safety", "secure"] = Field(
        "", description="weakest mode of IDTP that is accepted; empty: secure with a key, else lite"
    )
    unverified: bool = Field(False, description="without a key, show Secure frames, marked as unverified")
    time_unit: Literal["", "ns", "us", "ms", "s"] = Field(
        "", description="unit of the timestamps of IDTP; empty: microseconds, unless their arrival says otherwise"
    )
    rotation: Literal["", "enu_from_body", "body_from_enu"] = Field(
        "", description="which way the quaternion of an IDTP device turns; empty: body to ENU"
    )
    schema_text: str = Field(
        "", alias="schema", max_length=100_000, description="TOML that describes a vendor's own payload types of IDTP"
    )

    def reading(self) -> DecodeOptions:
        """The same, checked. ApiError where something cannot be used."""
        try:
            key = self.key.get_secret_value()
            return read_as(
                self.protocol,
                key,
                self.min_mode,
                self.unverified,
                self.schema_text,
                time_unit=self.time_unit,
                rotation=self.rotation,
            )
        except ReadingError as error:
            raise bad_setting(error) from None


class AddDevice(DecodeOptionsBody):
    """A source to open."""

    source: str = Field(min_length=1, max_length=1000, description="as on the command line", examples=["/dev/ttyUSB0"])


def bad_setting(error: ReadingError) -> ApiError:
    return ApiError(400, "bad-setting", f"{str(error)[:1].upper()}{str(error)[1:]}.", SETTINGS_HINT)


def check_protocol(name: str, request: Request) -> None:
    """ApiError where there is no such protocol."""
    protocols: dict[str, str] = request.app.state.protocols()
    if name and name not in protocols:
        raise ApiError(400, "bad-protocol", f"There is no protocol {name!r}.", f"There are: {', '.join(protocols)}.")


def check_file(source: str, folders: Sequence[Path]) -> None:
    """ApiError for a file outside of these: who may control devices may not read what else this server's user may."""
    try:
        parsed = SourceUrl.parse(source)
    except LinkError:
        return  # said when it is opened
    if parsed.kind != "file":
        return
    check_path(Path(parsed.place), folders)


def check_path(path: Path, folders: Sequence[Path]) -> None:
    """ApiError for a file outside of these folders, wherever links lead."""
    path = path.resolve()
    if not any(path.is_relative_to(folder.resolve()) for folder in folders):
        hint = "Put it into the library, or name its folder in source_folders of the configuration file."
        raise ApiError(
            403, "file-not-allowed", "Files are opened from the library and from folders that are named.", hint
        )


def sessions_of(request: Request) -> Sessions:
    sessions: Sessions = request.app.state.sessions
    return sessions


def session_of(device: str, sessions: Annotated[Sessions, Depends(sessions_of)]) -> Session:
    try:
        return sessions.get(device)
    except KeyError:
        raise ApiError(
            404, "not-found", f"There is no device {device:.40}.", "It may have been removed; choose one of the list."
        ) from None


AllSessions = Annotated[Sessions, Depends(sessions_of)]
OneSession = Annotated[Session, Depends(session_of)]


@router.get("")
async def list_devices(sessions: AllSessions) -> list[wire.DeviceInfo]:
    """Every device with its link and state."""
    return sessions.infos


@router.post("", status_code=201, responses=responses(400, 409, 422))
async def add_device(body: AddDevice, request: Request, sessions: AllSessions) -> wire.DeviceInfo:
    """Open a source. The answer comes at once; how it goes on is told over the WebSocket."""
    reading = body.reading()
    try:
        named = parse_source_options(body.source, reading)[1].protocol
    except ReadingError as error:
        raise bad_setting(error) from None
    check_protocol(named, request)
    await asyncio.to_thread(check_file, parse_source_options(body.source, reading)[0], request.app.state.source_folders)
    return sessions.add_all(body.source, reading)[0].info


@router.delete("/{device}", status_code=204, responses=responses(404, 409, 422))
async def remove_device(session: OneSession, sessions: AllSessions, request: Request) -> Response:
    """Close a device and forget it. One whose settings are on trial stays until they are kept or have gone back."""
    for desk in request.app.state.desks.on_link_of(session.info.id):
        if desk.trial is not None and desk.trial.state in ("applying", "asking", "reverting"):
            hint = "Keep the settings or let them go back first."
            raise ApiError(409, "not-now", f"The settings of {desk.session.info.name} are on trial.", hint)
    await sessions.remove(session.info.id)
    return Response(status_code=204)


@router.post("/{device}/retry", responses=responses(404, 422))
async def retry_device(session: OneSession) -> wire.DeviceInfo:
    """Try the link now instead of at `next_try`; play an ended file again."""
    session.retry()
    return session.info


@router.post("/{device}/reading", responses=responses(400, 404, 422))
async def read_device(body: DecodeOptionsBody, request: Request, session: OneSession) -> wire.DeviceInfo:
    """Read what comes from now on in another way: what is given here changes, the rest stays, and so does the device.
    A `schema` is added to the descriptions that there are."""
    check_protocol(body.protocol, request)
    await session.read_as(changed(session.reading, body.reading(), body.model_fields_set))
    return session.info


class Rearm(BaseModel):
    """Whose sequence may begin anew."""

    model_config = ConfigDict(extra="forbid")

    sender: str = Field(
        "",
        pattern=r"^[0-9]{0,5}$",
        description="as the stream names it (an IDTP device id); empty: every one of the link",
    )


@router.post("/{device}/rearm", responses=responses(404, 422, 507))
async def rearm_device(body: Rearm, session: OneSession) -> wire.DeviceInfo:
    """Accept whatever sequence number a Secure device sends next. Only who has restarted it can know that this is
    right: until its next frame comes, captured ones would be taken for new."""
    try:
        session.rearm(body.sender)
    except ValueError as error:
        hint = "Name a device of this stream by its number, or leave it out for all of them."
        raise ApiError(422, "bad-request", f"Nothing was re-armed: {error}.", hint) from None
    except OSError as error:
        hint = "The device is re-armed until the server ends; free some space to have it kept."
        raise ApiError(507, "disk", f"The re-arming cannot be kept: {error.strerror or error}.", hint) from None
    return session.info
