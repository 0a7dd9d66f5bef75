"""Routes of shared ports: which shares there are, who is at them, add and end them."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query
from pydantic import BaseModel, ConfigDict, Field

from server.api.dependencies import TheServices
from server.api.devices import OneSession
from server.api.errors import responses
from server.configuration.port_shares import speaker_name
from server.devices.session import Session
from server.services import Services

router = APIRouter(prefix="/api/devices/{device}/shares", tags=["shares"])


class AddShareRequest(BaseModel):
    """A share to offer."""

    model_config = ConfigDict(extra="forbid")

    address: str = Field(
        min_length=1,
        max_length=1000,
        description="`/run/imuscope/imu0`, `tcp://127.0.0.1:4001` or `udp://127.0.0.1:4002`; with `?mode=read` nobody "
        "may write through it",
    )


class ShareClient(BaseModel):
    """A client of a share."""

    number: int
    peer: str = Field(description="address, or path of the terminal")
    may_write: bool
    waits: bool = Field(description="what it sends waits until another is finished")
    sent: int = Field(description="bytes to it")
    received: int = Field(description="bytes from it")
    refused: int = Field(description="bytes from it that the device did not get, because it may only read")
    dropped_bytes: int = Field(description="lost because it did not read in time")
    dropped_frames: int = Field(description="of those, whole frames")


class PortShare(BaseModel):
    """A share and its clients."""

    name: str
    kind: Literal["pty", "tcp", "udp"]
    read_only: bool
    clients: list[ShareClient]


class SharedPort(BaseModel):
    """The shares of the port of a device."""

    why_not: str = Field(description="why the port cannot be shared; empty if it can")
    folder: str = Field(description="folder in which a terminal can be created from the page; empty if there is none")
    speaker: str = Field(description="who talks to the device now: a client, `imuscope`, or empty")
    shares: list[PortShare]


def _shared_port(services: Services, session: Session) -> SharedPort:
    state, shares, why_not = services.shares.state(session)
    clients = state.get("clients", ())
    return SharedPort(
        why_not=why_not,
        folder=services.shares.folder,
        speaker=speaker_name(state),
        shares=[
            PortShare(
                name=share.text,
                kind=share.kind,
                read_only=share.read_only,
                clients=[
                    ShareClient.model_validate({**one, "waits": one["paused"]})
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
    await services.shares.add(session, body.address)
    return _shared_port(services, session)


@router.delete("", responses=responses(404, 409, 422, 502))
async def delete_share(
    services: TheServices, session: OneSession, name: Annotated[str, Query(description="name of the share")]
) -> SharedPort:
    """End a share and disconnect its clients."""
    await services.shares.remove(session, name)
    return _shared_port(services, session)


@router.delete("/clients/{number}", responses=responses(404, 409, 422, 502))
async def disconnect_client(
    services: TheServices, session: OneSession, number: Annotated[int, Path(ge=1)]
) -> SharedPort:
    """Disconnect a client; it may connect again."""
    await services.shares.drop(session, number)
    return _shared_port(services, session)
