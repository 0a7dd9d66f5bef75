"""Routes of the packet view: the frame that made a sample, byte by byte, and its neighbours."""

import asyncio
from typing import Annotated, Literal

from fastapi import Query, Request, Response

from imuscope.recordings.columns.store import Base
from imuscope.server.api.dependencies import CLIENT_GONE, TheServices, user_of, while_connected
from imuscope.server.api.devices import OneSession
from imuscope.server.api.errors import recording_errors, responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.api.recording_data import columns_of
from imuscope.server.errors import DomainError
from imuscope.server.library.packets import (
    PacketView,
    SampleArrival,
    available,
    live_bytes,
    live_moment,
    packets_around,
    recorded_moment,
    required_family,
)

router = lazy_router(tags=["packets"])

NO_NAMES: tuple[str, ...] = ()

Time = Annotated[float, Query(ge=0, le=9e9, description="unix seconds")]
TheBase = Annotated[Base, Query(description="clock of `time`: the device's, or that of arrival")]
OfChannel = Annotated[int | None, Query(description="channel of the sample at that time; without it, any frame")]
Rank = Annotated[int, Query(ge=0, le=1 << 20, description="without a channel: which of those that arrived together")]
OfKind = Annotated[
    Literal["", "frame", "reject", "foreign", "sent"], Query(description="without a channel: only such a one")
]
Beside = Annotated[int, Query(ge=0, le=100, description="neighbours on each side")]


@router.get("/api/devices/{device}/frames", responses=responses(404, 422))
async def live_frames(
    session: OneSession,
    services: TheServices,
    time: Time,
    base: TheBase = "arrival",
    channel: OfChannel = None,
    rank: Rank = 0,
    kind: OfKind = "",
    beside: Beside = 8,
) -> PacketView:
    """The frame that made a sample of a live device, and its neighbours, as far as its bytes are in memory: each frame
    as `imuscope inspect` lists it, with the meaning of each byte.
    """
    device = session.info.id
    link = services.sessions.memory_of(device)
    span = link.span if link is not None else None
    if link is None or span is None:
        raise DomainError(
            "not-found", f"No bytes of device {device} are in memory.", "They are kept unless bytes_mb is 0."
        )
    moment, names = SampleArrival(round(time * 1e9), rank), NO_NAMES
    if channel is not None:
        stored = services.telemetry.store.get(channel)
        sample = live_moment(stored, time, base) if stored is not None else None
        moment, names = _sample(sample, channel), (stored.info.message, stored.info.name) if stored is not None else ()
    if not span[0] - 1_000_000_000 <= moment.arrival_ns <= span[1] + 1_000_000_000:
        words = f"The bytes from then are no longer in memory, which reaches back {(span[1] - span[0]) / 1e9:.0f} s."
        raise DomainError("not-found", words, "bytes_mb in the configuration makes it longer; a recording has all.")
    family = required_family(session.info.protocol)
    settings = session.decode_options.settings(family.name)
    read = live_bytes(link, session.access.link.preamble)
    view = await asyncio.to_thread(
        packets_around,
        *(device, family, settings, read, moment),
        names=names,
        kind=kind or None,
        beside=beside,
        newest_ns=span[1],
    )
    return available(view)


@router.get("/api/recordings/{recording}/frames", response_model=PacketView, responses=responses(404, 422))
async def recorded_frames(
    request: Request,
    recording: str,
    services: TheServices,
    time: Time,
    device: Annotated[str, Query(description="needed without a channel, if the recording has several")] = "",
    base: TheBase = "arrival",
    channel: OfChannel = None,
    rank: Rank = 0,
    kind: OfKind = "",
    beside: Beside = 8,
) -> Response:
    """The frame that made a sample of a recording, and its neighbours, as for a live device."""
    moment, names = SampleArrival(round(time * 1e9), rank), NO_NAMES
    if channel is not None:
        store = await columns_of(recording, services)
        info = next((one for one in store.manifest["channels"] if one["id"] == channel), None)
        sample = await asyncio.to_thread(recorded_moment, store, channel, time, base) if info is not None else None
        moment = _sample(sample, channel)
        if info is not None:
            device, names = str(info["device"]), (str(info["message"]), str(info["name"]))
    with recording_errors(recording):
        path = services.catalogue.library.known_path(recording)
        work = services.catalogue.files.json(
            "imuscope.server.library.recorded_packets:packets_in_file",
            *(path, device, moment, services.reading, names, kind or None, beside),
            user=user_of(request),
        )
        body = await while_connected(request, work)
    return Response(body, CLIENT_GONE if body is None else 200, media_type="application/json")


def _sample(sample: SampleArrival | None, channel: int) -> SampleArrival:
    if sample is None:
        raise DomainError(
            "not-found", f"Channel {channel} has no sample at that time.", "Choose a time within its plot."
        )
    return sample
