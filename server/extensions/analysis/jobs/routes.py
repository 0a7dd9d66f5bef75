"""Routes of analyses: figures of signals, of a recording or of a live device, as JSON or Arrow."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Any

from fastapi import Request
from fastapi.responses import Response
from pydantic import BaseModel, Field

from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.recordings.columns.store import Base, ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.server.api.dependencies import CLIENT_GONE, TheServices, user_of, while_connected
from imuscope.server.api.errors import bytes_of, responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.devices.decode.protocol_set import sensors_of
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.signal_request import requested_signals
from imuscope.server.extensions.analysis.jobs.jobs import (
    ARROW,
    AnalysisJob,
    FiguresJob,
    PairsJob,
    PairsSide,
    RecordedSource,
    Requested,
    SampleSource,
    copied,
    read_columns,
)
from imuscope.server.extensions.analysis.jobs.service import AnalysisService
from imuscope.server.extensions.analysis.noise.data_sheet import Product
from imuscope.server.extensions.analysis.noise.registry import AnalysisOption, analyses, analysis_named
from imuscope.server.extensions.analysis.signals.pairs import Pairing
from imuscope.server.extensions.analysis.signals.signals import live_samples
from imuscope.server.library.recording_detail import channels_of, products_of, segments_of
from imuscope.server.services.services import Services

router = lazy_router(prefix="/api/analysis", tags=["analysis"])

MAX_SIGNALS = 64
MAX_TIME = 9e9  # unix s
AHEAD_S = 60.0  # the device's clock may be ahead of this host's
GetSource = Callable[[], Awaitable[SampleSource]]


class OptionInfo(BaseModel):
    """An option of an analysis: a number, or one of `choices`."""

    name: str
    default: float | str
    low: float
    high: float
    unit: str
    doc: str
    choices: list[str] = Field(description="words of which a request gives one; empty if the option is a number")


class AnalysisInfo(BaseModel):
    """An analysis that can be requested."""

    name: str
    title: str
    words: str
    options: list[OptionInfo]
    formats: list[str] = Field(description="texts for other programs that a request can have in place of JSON")


class AnalysisRequest(BaseModel):
    """Signals, range and options of an analysis."""

    source: str = Field(description="id of a live device or of a recording")
    signals: list[str] = Field(
        min_length=1,
        max_length=MAX_SIGNALS,
        description="`CHANNEL.COLUMN`, `CHANNEL` for all columns, or an expression; `DEVICE/…` or `MESSAGE/…` if "
        "several have it",
    )
    device: str = Field("", description="whose signals are meant where several devices have a channel of that name")
    t0: float | None = Field(None, description="unix seconds; null for the beginning")
    t1: float | None = Field(None, description="unix seconds; null for the end")
    base: Base = "device"
    options: dict[str, Any] = Field(default_factory=dict, description="of the analysis; see `GET /api/analysis`")
    format: str = Field(
        "json",
        max_length=40,
        description="`json`; `arrow`: a table with one row per signal; or one of the analysis",
    )


class SignalFigures(BaseModel):
    """Figures of one signal; null where there is none."""

    signal: str
    device: str
    units: dict[str, str] = Field(description="for the figures that have a unit")
    figures: dict[str, Any] = Field(
        description="by name: a number, a text, a list of figures or an object of figures; `notes` are sentences"
    )


class PairsSignal(BaseModel):
    """One axis of a plot of pairs."""

    signal: str = Field(description="`CHANNEL.COLUMN` or an expression; `DEVICE/…` or `MESSAGE/…` if several have it")
    part: int = Field(0, ge=0, le=MAX_SIGNALS, description="which one, if that names several, from 0")


class PairsRequest(BaseModel):
    """A request for pairs of two signals."""

    source: str = Field(description="id of a live device or of a recording")
    x: PairsSignal
    y: PairsSignal
    t0: float | None = Field(None, description="unix seconds; null for the beginning")
    t1: float | None = Field(None, description="unix seconds; null for the end")
    base: Base = "device"
    pairing: Pairing = Field(
        "interpolated", description="value of the signal with fewer samples at the times of the other"
    )
    points: int = Field(
        6000,
        ge=60,
        le=200_000,
        description="with more pairs than this, of each interval the first, the last and the extremes of x and y",
    )


class PairsInfo(BaseModel):
    """Pairs of two signals; times are seconds after `t0`."""

    n: int = Field(description="number of pairs, also of those left out")
    t0: float = Field(description="unix seconds of the first pair")
    time: list[float]
    x: list[float]
    y: list[float]
    starts: list[int] = Field(description="indices of pairs that no line may come to: after a gap, or a wrapped angle")
    x_unit: str
    y_unit: str
    leader: str = Field(description="the signal whose times these are; empty if both signals have the same times")


@router.get("")
async def list_analyses(services: TheServices) -> list[AnalysisInfo]:
    """Analyses with their options."""
    services.parts.get(AnalysisService).prepare()
    return [
        AnalysisInfo(
            name=one.name,
            title=one.title,
            words=one.words,
            options=[_option(option) for option in one.options],
            formats=list(one.formats),
        )
        for one in analyses()
    ]


def _option(option: AnalysisOption) -> OptionInfo:
    default = option.choices[int(option.default)] if option.choices else option.default
    return OptionInfo(
        name=option.name,
        default=default,
        low=option.low,
        high=option.high,
        unit=option.unit,
        doc=option.doc,
        choices=list(option.choices),
    )


@router.post("/pairs", response_model=None, responses={200: {"model": PairsInfo}, **responses(404, 409, 422)})
async def pairs(body: PairsRequest, request: Request, services: TheServices) -> Response:
    """Pairs of two signals at the same moments, for a plot of one over the other."""
    requests = [
        AnalysisRequest.model_validate(
            {**body.model_dump(include={"source", "t0", "t1", "base"}), "signals": [one.signal]}
        )
        for one in (body.x, body.y)
    ]
    (x, from_x), (y, from_y) = [await requested_of(one, services) for one in requests]

    async def job() -> PairsJob:
        sides = (PairsSide(x, await from_x(), body.x.part), PairsSide(y, await from_y(), body.y.part))
        return PairsJob(*sides, body.pairing, body.points)

    return await response_of(job, request, services)


@router.post(
    "/{name}",
    response_model=None,
    responses={200: {"model": list[SignalFigures], **bytes_of(ARROW)[200]}, **responses(404, 409, 422)},
)
async def analyse(name: str, body: AnalysisRequest, request: Request, services: TheServices) -> Response:
    """Analyse signals of a recording, or of a live device as far as memory holds them.

    It ends with the connection: closing it cancels the analysis.
    """
    analysis = analysis_named(name)
    if body.format not in ("json", "arrow", *analysis.formats):
        known = ", ".join(("json", "arrow", *analysis.formats))
        raise DomainError("bad-value", f"format {body.format!r} is not allowed.", f"Give one of: {known}.")
    settings = analysis.settings(body.options)
    requested, source = await requested_of(body, services, companions=analysis.companions)

    async def job() -> FiguresJob:
        return FiguresJob(name, settings, body.format, requested, await source())

    return await response_of(job, request, services)


async def response_of(job: Callable[[], Awaitable[AnalysisJob]], request: Request, services: Services) -> Response:
    """The response of a job, which is cancelled when the client leaves."""
    content = await while_connected(request, services.parts.get(AnalysisService).content(user_of(request), job))
    if content is None:
        return Response(status_code=CLIENT_GONE)
    return Response(content.body, headers={"cache-control": "no-store", "content-type": content.media})


async def requested_of(
    body: AnalysisRequest, services: Services, *, companions: bool = False
) -> tuple[Requested, GetSource]:
    """Signals of a request, and a function that gives the source of their samples when its turn has come."""
    telemetry = services.telemetry
    own = telemetry.store.of_device(body.source)
    if own:
        t0, t1 = time_range(body.t0, body.t1, telemetry.bus.now() + AHEAD_S)
        others = [one.info for one in telemetry.store.all if one.info.device != body.source]
        requested = requested_signals(
            own.values(),
            body.signals,
            zero_phase=False,
            product=_products(services),
            others=others,
            companions=companions,
        )

        async def copy() -> SampleSource:
            columns = [one for one in read_columns(requested) if telemetry.store.get(one.info.id) is not None]
            read = live_samples(telemetry.store, columns, t0, t1, body.base)
            return await asyncio.to_thread(copied, read, columns)

        return requested, copy
    store = await recording_of(body.source, services)
    t0, t1 = time_range(body.t0, body.t1, MAX_TIME)
    requested = requested_signals(
        channels_of(store).values(),
        body.signals,
        zero_phase=True,
        product=products_of(store),
        device=body.device,
        companions=companions,
        segments=segments_of(store),
    )

    async def place() -> SampleSource:
        return RecordedSource(store.folder, t0, t1, body.base)

    return requested, place


def _products(services: Services) -> Product:
    """Name of a live device's product, and the properties of its sensors, by its id."""
    devices = services.telemetry.bus.devices.latest

    def product(device: str) -> tuple[str, SensorProperties]:
        info = devices.get(device)
        return ("", SensorProperties()) if info is None else (info.product, sensors_of(info.protocol, info.product))

    return product


async def recording_of(source: str, services: Services) -> ColumnStore:
    """The columns of a recording named as a source.

    Raises:
        DomainError: "not-found", "cannot-open".
    """
    try:
        return await services.columns.opened(source)
    except (KeyError, FileNotFoundError):
        hint = "Give the id of a device with samples, or of a recording."
        raise DomainError("not-found", f"Source {source:.80} not found.", hint) from None
    except RecordingError as error:
        raise DomainError("cannot-open", error.message, error.hint) from None


def time_range(begin: float | None, stop: float | None, end: float) -> tuple[float, float]:
    """A requested range, unix s; None for the beginning or the `end`.

    Raises:
        DomainError: "bad-span".
    """
    t0, t1 = 0.0 if begin is None else begin, end if stop is None else stop
    if not (abs(t0) <= MAX_TIME and abs(t1) <= MAX_TIME and t0 <= t1) or math.isnan(t0 + t1):
        raise DomainError("bad-span", f"From {t0:g} to {t1:g} is not a valid time range.", "Unix seconds, t0 ≤ t1.")
    return t0, t1
