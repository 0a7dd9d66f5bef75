"""Routes of shared ports: which shares there are, who is at them, add and end them."""

from typing import Annotated, Literal

from fastapi import Path, Query
from pydantic import BaseModel, Field

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.devices import OneSession
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.devices.link.session import Session
from imuscope.server.extensions.shares.client_changes import SettingsChange
from imuscope.server.extensions.shares.port_shares import PortShares, client_name, speaker_name
from imuscope.server.extensions.shares.shared_port_link import SharedPortLink
from imuscope.server.services.services import Services

router = lazy_router(prefix="/api/devices/{device}/shares", tags=["shares"])


class AddShareRequest(BaseModel, extra="forbid"):
    """Address at which the port of a device is shared."""

    address: str = Field(
        min_length=1,
        max_length=1000,
        description="`/run/imuscope/imu0`, `tcp://127.0.0.1:4001` or `udp://127.0.0.1:4002`; with `?mode=read` no "
        "client may write through it",
    )


class ShareClient(BaseModel):
    """A program that is connected to a share, with its counts of bytes."""

    number: int
    peer: str = Field(description="address, or path of the terminal")
    name: str = Field(description="its program, where that is visible to this server; else as `peer`")
    may_write: bool
    waits: bool = Field(description="what it sends waits until another is finished")
    sent: int = Field(description="bytes to it")
    received: int = Field(description="bytes from it")
    refused: int = Field(
        description="bytes from it that the device did not get: it may only read, or the device was not free in time"
    )
    limited: bool = Field(description="it sends more than the line carries, and is held back")
    dropped_bytes: int = Field(description="lost because it did not read in time")
    dropped_frames: int = Field(description="of those, whole frames")


class PortShare(BaseModel):
    """A shared address, its state, and its connected clients."""

    name: str
    kind: Literal["pty", "tcp", "udp"]
    read_only: bool
    clients: list[ShareClient]


class SharedPort(BaseModel):
    """The shares of the port of a device."""

    why_not: str = Field(description="why the port cannot be shared; empty if it can")
    folder: str = Field(description="folder in which a terminal can be created from the page; empty if there is none")
    holder: int = Field(description="process that holds the port; 0 for this server")
    speaker: str = Field(description="who talks to the device now: a client, `imuscope`, or empty")
    configuring: bool = Field(description="the speaker configures the device: imuscope waits with what it sends")
    changes: list[SettingsChange] = Field(description="what clients changed last, newest first")
    shares: list[PortShare]


def _shared_port(services: Services, session: Session) -> SharedPort:
    state, shares, why_not = services.parts.get(PortShares).state(session)
    clients, link = state.get("clients", ()), session.access.link
    return SharedPort(
        why_not=why_not,
        folder=services.parts.get(PortShares).folder,
        holder=link.holder_pid if isinstance(link, SharedPortLink) and link.is_connected else 0,
        speaker=speaker_name(link),
        configuring=state.get("configuring") is not None,
        changes=list(services.parts.get(PortShares).changes_of(session)),
        shares=[
            PortShare(
                name=share.text,
                kind=share.kind,
                read_only=share.read_only,
                clients=[
                    ShareClient.model_validate({**one, "waits": one["paused"], "name": client_name(link, one)})
                    for one in clients
                    if one["share"] == share.text
                ],
            )
            for share in shares
        ],
    )


@router.get("", responses=responses(404, 422))
async def get_shares(services: TheServices, session: OneSession) -> SharedPort:
    """The shares with their clients."""
    return _shared_port(services, session)


@router.post("", status_code=201, responses=responses(403, 404, 409, 422, 502))
async def add_share(body: AddShareRequest, services: TheServices, session: OneSession) -> SharedPort:
    """Share the port. For the first share the link is opened again, by a process that stays when this server ends."""
    await services.parts.get(PortShares).add(session, body.address)
    return _shared_port(services, session)


@router.delete("", responses=responses(404, 409, 422, 502))
async def delete_share(
    services: TheServices, session: OneSession, name: Annotated[str, Query(description="name of the share")]
) -> SharedPort:
    """End a share and disconnect its clients."""
    await services.parts.get(PortShares).remove(session, name)
    return _shared_port(services, session)


class TakeOverRequest(BaseModel):
    """Consent to end what a program does."""

    confirmed: bool = Field(False, description="the person has read which program is interrupted")


@router.post("/take-over", responses=responses(404, 409, 422, 502))
async def take_over(body: TakeOverRequest, services: TheServices, session: OneSession) -> SharedPort:
    """End a configuration that a program has begun and not finished, so that others may talk to the device. 409 names
    the program until it is `confirmed`.
    """
    await services.parts.get(PortShares).take_over(session, confirmed=body.confirmed)
    return _shared_port(services, session)


@router.delete("/clients/{number}", responses=responses(404, 409, 422, 502))
async def disconnect_client(
    services: TheServices, session: OneSession, number: Annotated[int, Path(ge=1)]
) -> SharedPort:
    """Disconnect a client; it may connect again."""
    await services.parts.get(PortShares).drop(session, number)
    return _shared_port(services, session)
