"""Routes of devices: list, open, close, retry, change the decode options."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from fastapi import Depends, Response
from pydantic import BaseModel, Field, SecretStr, create_model

from imuscope.protocols.family.decode_options import DecodeOption
from imuscope.server import wire
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.devices.decode.decode_options import (
    DecodeOptionError,
    DecodeOptions,
    changed,
    checked_options,
    declared_options,
    parse_source_options,
    source_options,
)
from imuscope.server.devices.link.session import Session
from imuscope.server.errors import DomainError, unknown_device
from imuscope.server.links.base import LinkError
from imuscope.server.links.source_url import SourceUrl
from imuscope.server.services.services import Services

SETTINGS_HINT = "The options of a source are listed at /openapi.json, AddDeviceRequest."
PREFIX = "option_"  # of the fields in Python, because BaseModel has a member named schema
MAX_CHARS: dict[str, int] = {"text": 1000, "secret": 1000, "file": 100_000}


def bad_setting(error: DecodeOptionError) -> DomainError:
    return DomainError("bad-setting", f"{str(error)[:1].upper()}{str(error)[1:]}.", SETTINGS_HINT)


class _ProtocolBody(BaseModel, extra="forbid"):
    """Decode options of a source."""

    protocol: str = Field("", max_length=40, description="name of the protocol; empty to detect it")

    def reading(self) -> DecodeOptions:
        """The checked options.

        Raises:
            DomainError: an option is invalid.
        """
        values = {name: getattr(self, PREFIX + name) for name in declared_options() if hasattr(self, PREFIX + name)}
        try:
            return checked_options(self.protocol, {name: _text(value) for name, value in values.items()})
        except DecodeOptionError as error:
            raise bad_setting(error) from None

    @property
    def option_names(self) -> set[str]:
        return {name.removeprefix(PREFIX) for name in self.model_fields_set} & {"protocol", *declared_options()}


def _text(value: str | bool | SecretStr) -> str:
    if isinstance(value, bool):
        return "1" if value else ""
    return value.get_secret_value() if isinstance(value, SecretStr) else value


def _field(option: DecodeOption) -> tuple[Any, Any]:
    """Type and properties of the field of an option."""
    limit = MAX_CHARS.get(option.kind)
    match option.kind:
        case "flag":
            return bool, Field(False, alias=option.name, description=option.help)
        case "choice":
            values: Any = Literal["", *option.values]
            return values, Field("", alias=option.name, description=option.help)
        case "secret":
            words = f"{option.help}; never returned"
            return SecretStr, Field(SecretStr(""), alias=option.name, max_length=limit, description=words)
        case _:
            return str, Field("", alias=option.name, max_length=limit, description=option.help)


if TYPE_CHECKING:

    class DecodeOptionsBody(_ProtocolBody): ...

else:
    DecodeOptionsBody = create_model(
        "DecodeOptionsBody",
        __base__=_ProtocolBody,
        __doc__=_ProtocolBody.__doc__,
        __module__=__name__,
        **{PREFIX + option.name: _field(option) for option in source_options()},
    )


router = lazy_router(prefix="/api/devices", tags=["devices"])


class AddDeviceRequest(DecodeOptionsBody):
    """A source to open."""

    source: str = Field(min_length=1, max_length=1000, description="as on the command line", examples=["/dev/ttyUSB0"])


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
async def add_device(body: AddDeviceRequest, services: TheServices) -> wire.DeviceInfo:
    """Open a source. Answers at once; the progress is sent over the WebSocket."""
    reading = await asyncio.to_thread(body.reading)
    try:
        named = parse_source_options(body.source, reading)[1].protocol
    except DecodeOptionError as error:
        raise bad_setting(error) from None
    check_protocol(named, services)
    await asyncio.to_thread(check_file, parse_source_options(body.source, reading)[0], services.source_folders)
    return (await services.sessions.add_all(body.source, reading))[0].info


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
                "not-now", f"The settings of {controller.member.info.name} are temporary until confirmed.", hint
            )
    try:
        await services.sessions.remove(session.info.id)
    except KeyError:  # by another request
        raise unknown_device(session.info.id) from None
    return Response(status_code=204)


@router.post("/{device}/retry", responses=responses(404, 422))
async def retry_device(session: OneSession) -> wire.DeviceInfo:
    """Try the link now instead of at `next_attempt`; play an ended file again."""
    session.retry()
    return session.info


@router.post("/{device}/decode-options", responses=responses(400, 404, 422))
async def read_device(body: DecodeOptionsBody, services: TheServices, session: OneSession) -> wire.DeviceInfo:
    """Decode future bytes with other options: the given options change, the others and the device
    stay. A `schema` is added to the existing descriptions.
    """
    check_protocol(body.protocol, services)
    reading = await asyncio.to_thread(body.reading)  # a schema of 64 kB takes longer than the loop may be held
    await session.read_as(changed(session.decode_options, reading, body.option_names))
    return session.info


class NameDeviceRequest(BaseModel, extra="forbid"):
    """A name of one's own for a device."""

    name: str = Field(max_length=1000, description="empty: none any more", examples=["left wheel"])


@router.put("/{device}/name", responses=responses(404, 409, 422, 507))
async def name_device(device: str, body: NameDeviceRequest, services: TheServices) -> wire.DeviceInfo:
    """Name a sensor. The name is kept with its serial number, so it follows the sensor to other ports and runs; nothing
    is written to the device.
    """
    try:
        named = services.controllers.get(device).member
    except KeyError:
        raise unknown_device(device) from None
    services.sessions.names.rename(named.info.key, body.name)
    return named.info


class RearmDeviceRequest(BaseModel, extra="forbid"):
    """Device whose sequence may restart."""

    sender: str = Field(
        "",
        pattern=r"^[0-9]{0,5}$",
        description="the id of the device in the stream; empty: every device of the link",
    )


@router.post("/{device}/rearm", responses=responses(404, 422, 507))
async def rearm_device(body: RearmDeviceRequest, session: OneSession) -> wire.DeviceInfo:
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
