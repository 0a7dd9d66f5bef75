"""Corrections for a device's receiver: the forwarded stream and its state."""

from __future__ import annotations

import asyncio

from pydantic import BaseModel, ConfigDict, Field

from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.api.configure import OneController
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.devices import check_path
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.configuration.api_models import Corrections
from imuscope.server.errors import DomainError
from imuscope.server.extensions.corrections.manager import CorrectionManager
from imuscope.server.extensions.corrections.ntrip import CorrectionError
from imuscope.server.extensions.corrections.stream import file_of

router = lazy_router(prefix="/api/devices/{device}", tags=["corrections"])


class CorrectionsRequest(BaseModel):
    """A stream to forward."""

    model_config = ConfigDict(extra="forbid")

    source: str = Field(
        min_length=1,
        max_length=1000,
        description="RTCM 3 from ntrip://user:password@host:2101/MOUNT, tcp://host:port, or a file: of the library, or "
        "of a folder that source_folders names",
    )


@router.get("/corrections", responses=responses(404, 422))
async def get_corrections(receiver: OneController, services: TheServices) -> Corrections:
    """The stream that is forwarded; an empty source if there is none. The password is never returned."""
    return services.parts.get(CorrectionManager).state(receiver.member)


@router.put("/corrections", responses=responses(400, 404, 409, 422))
async def put_corrections(receiver: OneController, body: CorrectionsRequest, services: TheServices) -> Corrections:
    """Forward this stream in place of the previous one."""
    member = receiver.member
    if not services.parts.get(CorrectionManager).accepts(member):
        title = PROTOCOLS[member.info.protocol].title if member.info.protocol in PROTOCOLS else "This device"
        hints = [
            family.configuration.corrections.hint
            for family in PROTOCOLS.values()
            if family.configuration.corrections is not None
        ]
        hint = f"Devices that accept them: {', '.join(hint for hint in hints if hint)}."
        raise DomainError("no-receiver", f"{title} {member.info.product} does not accept corrections.", hint)
    try:
        file = file_of(body.source)
        if file is not None:
            await asyncio.to_thread(check_path, file, services.source_folders)
        await services.parts.get(CorrectionManager).begin(member, body.source, receiver.log.streamed)
    except CorrectionError as error:
        raise DomainError("bad-source", error.message, error.hint) from None
    return services.parts.get(CorrectionManager).state(member)


@router.delete("/corrections", responses=responses(404, 422))
async def delete_corrections(receiver: OneController, services: TheServices) -> Corrections:
    """Stop forwarding; returns the final counters."""
    return await services.parts.get(CorrectionManager).end(receiver.member)
