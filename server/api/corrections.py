"""Corrections for a device's receiver: which stream is forwarded, and how it goes."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from pydantic import BaseModel, ConfigDict, Field

from protocols.registry import PROTOCOLS
from server.api.configure import OneDesk
from server.api.devices import check_path
from server.api.errors import ApiError, responses
from server.configuration.api_models import Corrections
from server.configuration.correction_manager import CorrectionManager
from server.configuration.correction_stream import file_of
from server.configuration.ntrip import CorrectionError

router = APIRouter(prefix="/api/devices/{device}", tags=["corrections"])


class SetCorrections(BaseModel):
    """A stream to forward."""

    model_config = ConfigDict(extra="forbid")

    source: str = Field(
        min_length=1,
        max_length=1000,
        description="RTCM 3 from ntrip://user:password@host:2101/MOUNT, tcp://host:port, or a file: of the library, or "
        "of a folder that source_folders names",
    )


def desk_of(request: Request) -> CorrectionManager:
    desk: CorrectionManager = request.app.state.corrections
    return desk


TheDesk = Annotated[CorrectionManager, Depends(desk_of)]


@router.get("/corrections", responses=responses(404, 422))
async def get_corrections(receiver: OneDesk, desk: TheDesk) -> Corrections:
    """The stream that is forwarded; an empty source where there is none. The password is never told."""
    return desk.state(receiver.session)


@router.put("/corrections", responses=responses(400, 404, 409, 422))
async def put_corrections(desk: TheDesk, receiver: OneDesk, body: SetCorrections, request: Request) -> Corrections:
    """Forward this stream, in place of the one before."""
    session = receiver.session
    if not desk.takes(session):
        title = PROTOCOLS[session.info.protocol].title if session.info.protocol in PROTOCOLS else "This device"
        hint = "An MTi-680G takes them, and any Inertial Sense device."
        raise ApiError(409, "no-receiver", f"{title} {session.info.product} takes no corrections.", hint)
    try:
        file = file_of(body.source)
        if file is not None:
            await asyncio.to_thread(check_path, file, request.app.state.source_folders)
        await desk.begin(session, body.source, receiver.log.streamed)
    except CorrectionError as error:
        raise ApiError(400, "bad-source", error.message, error.hint) from None
    return desk.state(session)


@router.delete("/corrections", responses=responses(404, 422))
async def delete_corrections(receiver: OneDesk, desk: TheDesk) -> Corrections:
    """Stop; what was counted is told a last time."""
    return await desk.end(receiver.session)
