"""Routes of analyses: figures of signals, of a recording or of a live device, as JSON or Arrow."""

from __future__ import annotations

import asyncio
import math
from itertools import chain
from typing import Any

import numpy as np
from fastapi import APIRouter
from fastapi.responses import Response
from pydantic import BaseModel, Field

from protocols.plural import counted
from protocols.sensor_properties import SensorProperties
from recordings.column_store import Base, ColumnStore
from recordings.mcap_writer import RecordingError
from server.analysis.data_sheet import Product
from server.analysis.pairs import Pairing, paired, shortened, thinned
from server.analysis.registry import AnalysisOption, FiguresOfSignal, analyses, analysis_named
from server.analysis.report import arrow_of, figures_of, in_parallel
from server.analysis.signal_request import ExpressionSignal, requested_signals
from server.analysis.signals import ReadSamples, Signal, SignalColumn, live_samples, recorded_samples
from server.api.dependencies import TheServices
from server.api.errors import bytes_of, responses
from server.devices.protocol_set import sensors_of
from server.errors import DomainError
from server.library.recording_detail import channels_of, products_of
from server.services import Services

router = APIRouter(prefix="/api/analysis", tags=["analysis"])

MAX_SIGNALS = 64
MAX_TIME = 9e9  # unix s
TEXT = "text/plain; charset=utf-8"
ARROW = "application/vnd.apache.arrow.stream"
AHEAD_S = 60.0  # the device's clock may be ahead of this host's


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
    """A request for an analysis."""

    source: str = Field(description="id of a live device or of a recording")
    signals: list[str] = Field(
        min_length=1,
        max_length=MAX_SIGNALS,
        description="`CHANNEL.COLUMN`, `CHANNEL` for all columns, or an expression; `DEVICE/…` if there are several",
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
    """A signal of a pair."""

    signal: str = Field(description="`CHANNEL.COLUMN` or an expression; `DEVICE/…` if there are several")
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
async def list_analyses() -> list[AnalysisInfo]:
    """Analyses with their options."""
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


@router.post("/pairs", responses=responses(404, 422))
async def pairs(body: PairsRequest, services: TheServices) -> PairsInfo:
    """Pairs of two signals at the same moments, for a plot of one over the other."""
    asked = [
        AnalysisRequest.model_validate(
            {**body.model_dump(include={"source", "t0", "t1", "base"}), "signals": [one.signal]}
        )
        for one in (body.x, body.y)
    ]
    (x, read_x), (y, read_y) = [await requested_of(one, services) for one in asked]

    def work() -> PairsInfo:
        own_x, own_y = _part(x, read_x, body.x.part), _part(y, read_y, body.y.part)
        whole = paired(own_x, own_y, body.pairing)
        few = thinned(whole, body.points)
        t0 = float(few.time[0]) if len(few.time) else 0.0
        return PairsInfo(
            n=len(whole.time),
            t0=t0,
            time=np.round(few.time - t0, 6).tolist(),
            x=shortened(few.x),
            y=shortened(few.y),
            starts=np.flatnonzero(few.starts).tolist(),
            x_unit=own_x.unit,
            y_unit=own_y.unit,
            leader=few.leader,
        )

    return await asyncio.to_thread(work)


def _part(requested: list[SignalColumn | ExpressionSignal], read: ReadSamples, part: int) -> Signal:
    """That one of the requested signals."""
    found = list(chain.from_iterable(one.signals(read) for one in requested))
    if part >= len(found):
        hint = f"Give a part from 0 to {len(found) - 1}."
        raise DomainError("bad-value", f"part {part} is not allowed: it names {counted(len(found), 'signal')}.", hint)
    return found[part]


@router.post(
    "/{name}",
    response_model=None,
    responses={200: {"model": list[SignalFigures], **bytes_of(ARROW)[200]}, **responses(404, 422)},
)
async def analyse(name: str, body: AnalysisRequest, services: TheServices) -> Response | list[SignalFigures]:
    """Analyse signals of a recording, or of a live device as far as memory holds them."""
    analysis = analysis_named(name)
    if body.format not in ("json", "arrow", *analysis.formats):
        known = ", ".join(("json", "arrow", *analysis.formats))
        raise DomainError("bad-value", f"format {body.format!r} is not allowed.", f"Give one of: {known}.")
    settings = analysis.settings(body.options)
    requested, read = await requested_of(body, services)

    def work(one: SignalColumn | ExpressionSignal) -> list[SignalFigures]:
        found = []
        for signal in one.signals(read):
            figures, units = figures_of(analysis, signal, settings)
            found.append(SignalFigures(signal=signal.name, device=one.device, units=units, figures=figures))
            own_units[signal.name] = signal.unit
        return found

    own_units: dict[str, str] = {}

    found = list(chain(*await asyncio.to_thread(in_parallel, work, requested)))
    if body.format == "json":
        return found
    if body.format != "arrow":
        signals = [FiguresOfSignal(one.signal, own_units[one.signal], one.figures) for one in found]
        return Response(analysis.text(body.format, signals), media_type=TEXT)
    table = await asyncio.to_thread(arrow_of, [one.model_dump() for one in found])
    return Response(table, media_type=ARROW, headers={"cache-control": "no-store"})


async def requested_of(
    body: AnalysisRequest, services: Services
) -> tuple[list[SignalColumn | ExpressionSignal], ReadSamples]:
    """The signals of a request, and what reads the samples of a column in a thread."""
    telemetry = services.telemetry
    own = telemetry.store.of_device(body.source)
    if own:
        t0, t1 = time_range(body.t0, body.t1, telemetry.bus.now() + AHEAD_S)
        others = [one.info for one in telemetry.store.all if one.info.device != body.source]
        requested = requested_signals(
            own.values(), body.signals, zero_phase=False, product=_products(services), others=others
        )
        columns = [column for one in requested for column in one.columns]
        columns += [one.temperature for one in columns if one.temperature is not None]
        return requested, live_samples(telemetry.store, columns, t0, t1, body.base)
    store = await recording_of(body.source, services)
    t0, t1 = time_range(body.t0, body.t1, MAX_TIME)
    requested = requested_signals(
        channels_of(store).values(), body.signals, zero_phase=True, product=products_of(store), device=body.device
    )
    return requested, lambda column: recorded_samples(store, column, t0, t1, body.base)


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
