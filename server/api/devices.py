"""Routes of devices: list, open, close, retry, change the decode options."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Response
from pydantic import BaseModel, ConfigDict, Field, SecretStr

from server import wire
from server.api.dependencies import TheServices
from server.api.errors import responses, unknown_device
from server.devices.decode_options import DecodeOptions, ReadingError, changed, parse_source_options
from server.devices.decode_options import reading as read_as
from server.devices.session import Session
from server.errors import DomainError
from server.links.base import LinkError
from server.links.source_url import SourceUrl
from server.services import Services

router = APIRouter(prefix="/api/devices", tags=["devices"])

SETTINGS_HINT = "The options of a source are listed at /openapi.json, AddDevice."


class DecodeOptionsBody(BaseModel):
    """Decode options of a source."""

    model_config = ConfigDict(extra="forbid")

    protocol: str = Field("", max_length=40, description="name of the protocol; empty to detect it")
    key: SecretStr = Field(SecretStr(""), max_length=1000, description="for Secure frames, hex; never returned")
    min_mode: Literal["", "lite", "safety", "secure"] = Field(
        "", description="weakest frame mode that is accepted; empty: secure with a key, else lite"
    )
    unverified: bool = Field(False, description="without a key, show Secure frames, marked as unverified")
    time_unit: Literal["", "ns", "us", "ms", "s"] = Field(
        "",
        description="unit of timestamps that do not state it; empty: microseconds, unless arrival times contradict it",
    )
    rotation: Literal["", "enu_from_body", "body_from_enu"] = Field(
        "", description="direction of a quaternion where the device does not state it; empty: body to ENU"
    )
    schema_text: str = Field(
        "", alias="schema", max_length=100_000, description="TOML that describes a vendor's own payload types"
    )

    def reading(self) -> DecodeOptions:
        """The checked options.

        Raises:
            DomainError: an option is invalid.
        """
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


def bad_setting(error: ReadingError) -> DomainError:
    return DomainError("bad-setting", f"{str(error)[:1].upper()}{str(error)[1:]}.", SETTINGS_HINT)


def check_protocol(name: str, services: Services) -> None:
    """Raise DomainError for an unknown protocol."""
    protocols = services.protocols()
    if name and name not in protocols:
        raise DomainError("bad-protocol", f"Unknown protocol {name!r}.", f"Available: {', '.join(protocols)}.")


def check_file(source: str, folders: Sequence[Path]) -> None:
    """Raise DomainError for a file outside of these folders: a control token must not give access to every file that
    the server can read.
    """
    try:
        parsed = SourceUrl.parse(source)
    except LinkError:
        return  # reported when it is opened
    if parsed.kind != "file":
        return
    check_path(Path(parsed.place), folders)


def check_path(path: Path, folders: Sequence[Path]) -> None:
    """Raise DomainError for a file outside of these folders, with symbolic links resolved."""
    path = path.resolve()
    if not any(path.is_relative_to(folder.resolve()) for folder in folders):
        hint = "Put it into the library, or name its folder in source_folders of the configuration file."
        raise DomainError(
            "file-not-allowed", "Files are opened only from the library and from the configured folders.", hint
        )


def session_of(device: str, services: TheServices) -> Session:
    try:
        return services.sessions.get(device)
    except KeyError:
        raise unknown_device(device) from None


OneSession = Annotated[Session, Depends(session_of)]


@router.get("")
async def list_devices(services: TheServices) -> list[wire.DeviceInfo]:
    """Every device with its link and state."""
    return services.sessions.infos


@router.post("", status_code=201, responses=responses(400, 409, 422))
async def add_device(body: AddDevice, services: TheServices) -> wire.DeviceInfo:
    """Open a source. Answers at once; the progress is sent over the WebSocket."""
    reading = body.reading()
    try:
        named = parse_source_options(body.source, reading)[1].protocol
    except ReadingError as error:
        raise bad_setting(error) from None
    check_protocol(named, services)
    await asyncio.to_thread(check_file, parse_source_options(body.source, reading)[0], services.source_folders)
    return services.sessions.add_all(body.source, reading)[0].info


@router.delete("/{device}", status_code=204, responses=responses(404, 409, 422))
async def remove_device(session: OneSession, services: TheServices) -> Response:
    """Close a device and forget it. A device with a pending rollback stays until the change is confirmed or rolled
    back.
    """
    for controller in services.controllers.on_link_of(session.info.id):
        if controller.pending_rollback is not None and controller.pending_rollback.state in (
            "applying",
            "pending",
            "rolling-back",
        ):
            hint = "Confirm the settings or roll them back first."
            raise DomainError(
                "not-now", f"The settings of {controller.session.info.name} are temporary until confirmed.", hint
            )
    await services.sessions.remove(session.info.id)
    return Response(status_code=204)


@router.post("/{device}/retry", responses=responses(404, 422))
async def retry_device(session: OneSession) -> wire.DeviceInfo:
    """Try the link now instead of at `next_attempt`; play an ended file again."""
    session.retry()
    return session.info


@router.post("/{device}/decode-options", responses=responses(400, 404, 422))
async def read_device(body: DecodeOptionsBody, services: TheServices, session: OneSession) -> wire.DeviceInfo:
    """Decode what is received from now on with other options: the given options change, the others and the device
    stay. A `schema` is added to the existing descriptions.
    """
    check_protocol(body.protocol, services)
    await session.read_as(changed(session.reading, body.reading(), body.model_fields_set))
    return session.info


class Rearm(BaseModel):
    """Device whose sequence may restart."""

    model_config = ConfigDict(extra="forbid")

    sender: str = Field(
        "",
        pattern=r"^[0-9]{0,5}$",
        description="the id of the device in the stream; empty: every device of the link",
    )


@router.post("/{device}/rearm", responses=responses(404, 422, 507))
async def rearm_device(body: Rearm, session: OneSession) -> wire.DeviceInfo:
    """Accept any sequence number that a Secure device sends next. Use it only after restarting the device: until its
    next frame arrives, replayed old frames would be accepted as new.
    """
    try:
        session.rearm(body.sender)
    except ValueError as error:
        hint = "Name a device of this stream by its number, or leave it out for all of them."
        raise DomainError("bad-request", f"Nothing was re-armed: {error}.", hint) from None
    except OSError as error:
        hint = "The device is re-armed until the server ends; free some disk space to store it."
        raise DomainError("disk", f"The re-arming cannot be stored: {error.strerror or error}.", hint) from None
    return session.info
