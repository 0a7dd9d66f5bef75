"""Routes of calibrations: a running one of a live device, and one of a stretch of a recording or of memory."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import Query, Request
from fastapi.responses import Response
from pydantic import BaseModel, Field

from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.recordings.columns.store import Base
from imuscope.server.api.dependencies import CLIENT_GONE, TheServices, user_of, while_connected
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.devices.decode.protocol_set import sensors_of
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.jobs.jobs import RecordedSource, SampleSource, copied
from imuscope.server.extensions.analysis.jobs.routes import AHEAD_S, MAX_TIME, recording_of, time_range
from imuscope.server.extensions.analysis.jobs.service import AnalysisService
from imuscope.server.extensions.analysis.signals.signals import SignalColumn, live_samples
from imuscope.server.extensions.analysis.signals.triads import Triad
from imuscope.server.extensions.calibration.export import FORMATS, exported
from imuscope.server.extensions.calibration.kinds import (
    HINT,
    METHODS,
    CalibrationInputs,
    CalibrationMethod,
    CalibrationOptions,
    is_table,
    method_for,
)
from imuscope.server.extensions.calibration.mounting import VerticalAxis
from imuscope.server.extensions.calibration.report import CalibrationKind, CalibrationReport
from imuscope.server.extensions.calibration.session import CalibrationSessions, SessionState
from imuscope.server.extensions.calibration.stretch import CalibrationJob
from imuscope.server.library.recording_detail import channels_of
from imuscope.server.services.services import Services
from imuscope.server.wire import ChannelInfo

router = lazy_router(prefix="/api", tags=["calibration"])

ExportFormat = Literal["json", "yaml", "csv", "c"]
assert set(FORMATS) == set(ExportFormat.__args__)  # type: ignore[attr-defined]
TEXTS = {kind.media_type.partition(";")[0]: {"schema": {"type": "string"}} for kind in FORMATS.values()}


class AvailableCalibration(BaseModel):
    """A calibration, and whether the device shows what it needs."""

    kind: CalibrationKind
    title: str
    problem: str = Field(description='why it is not possible now; "" if it is')
    hint: str


class CalibrationWrite(BaseModel):
    """The setting of the device that takes the result; sent with `POST /api/devices/{device}/apply` like any change."""

    setting: str
    title: str
    note: str = Field(description="sentence on its effect")
    values: dict[str, Any] | None = Field(description="of the setting; null while `problem` says why not")
    problem: str
    hint: str


class CalibrationState(BaseModel):
    """Calibrations of a live device, and the one under way."""

    available: list[AvailableCalibration]
    is_running: bool = Field(description="false before one is started, and once it has ended")
    report: CalibrationReport | None = Field(description="of the last one started; null if there is none")
    write: CalibrationWrite | None = Field(
        description="how the device takes the result; null without a result, or if it takes none"
    )


class CalibrationOptionsBody(BaseModel, extra="forbid"):
    """Calibration inputs that no device can report."""

    field: float = Field(
        0.0, ge=0, le=1e6, description="strength of the magnetic field there, in the unit of the signal; 0: unknown"
    )
    gravity: float = Field(0.0, ge=0, le=20, description="m/s² there; 0: unknown (accelerometer)")
    square: bool = Field(False, description="the housing is square and rests on a level table (accelerometer)")
    vertical: Literal["up", "down"] | None = Field(
        None, description="where z of the vehicle points; null: as the device has it (mounting)"
    )

    def options(self, usual: VerticalAxis = "up") -> CalibrationOptions:
        """As the calibrations read them."""
        return CalibrationOptions(self.field, self.gravity, self.square, self.vertical or usual)


class StartCalibrationRequest(CalibrationOptionsBody):
    """Kind and options of a live calibration."""

    kind: CalibrationKind


class CalibrationRequest(CalibrationOptionsBody):
    """A calibration of a stretch of samples."""

    source: str = Field(description="id of a live device or of a recording")
    device: str = Field("", description="of a recording with several devices: which one")
    t0: float | None = Field(None, description="unix seconds; null for the beginning")
    t1: float | None = Field(None, description="unix seconds; null for the end")
    base: Base = "device"
    format: Literal["report", "json", "yaml", "csv", "c"] = Field(
        "report", description="`report`, or a text for other programs"
    )


# -- live --------------------------------------------------------------------------------------------------------------


@router.get("/devices/{device}/calibration", responses=responses(404, 422))
async def get_calibration(device: str, services: TheServices) -> CalibrationState:
    """Calibrations that a live device allows, and the one under way with its progress or result.

    All clients see the same one; it is evaluated on request, at most three times a second.
    """
    inputs = services.parts.get(CalibrationSessions).inputs(device)
    session = services.parts.get(CalibrationSessions).get(device)
    return _state(device, services, inputs, None if session is None else await session.state())


@router.post("/devices/{device}/calibration", responses=responses(404, 409, 422))
async def start_calibration(device: str, body: StartCalibrationRequest, services: TheServices) -> CalibrationState:
    """Start a calibration of a live device, in place of an earlier one. It uses the samples from now on."""
    inputs = services.parts.get(CalibrationSessions).inputs(device)
    info = services.telemetry.bus.devices.latest[device]
    usual = vertical_of(sensors_of(info.protocol, info.product))
    session = services.parts.get(CalibrationSessions).start(device, body.kind, body.options(usual))
    return _state(device, services, inputs, await session.state())


@router.post("/devices/{device}/calibration/finish", responses=responses(404, 422))
async def finish_calibration(device: str, services: TheServices) -> CalibrationState:
    """End the calibration with the samples until now. Refused while they do not determine a result."""
    state = await services.parts.get(CalibrationSessions).of(device).finish()
    return _state(device, services, services.parts.get(CalibrationSessions).inputs(device), state)


@router.delete("/devices/{device}/calibration", status_code=204, responses=responses(404, 422))
async def discard_calibration(device: str, services: TheServices) -> None:
    """Stop the calibration and discard its result. The device is not changed."""
    services.parts.get(CalibrationSessions).inputs(device)
    services.parts.get(CalibrationSessions).discard(device)


@router.get(
    "/devices/{device}/calibration/export",
    response_model=None,
    responses={200: {"content": TEXTS}, **responses(404, 422)},
)
async def export_calibration(
    device: str, services: TheServices, export_format: Annotated[ExportFormat, Query(alias="format")] = "yaml"
) -> Response:
    """The result as a file: JSON, YAML, CSV or a C header."""
    state = await services.parts.get(CalibrationSessions).of(device).state()
    info = services.telemetry.bus.devices.latest[device]
    words = " ".join(part for part in (info.product or info.name, info.serial_number) if part)
    return _file(state.report, words, export_format)


# -- a stretch ---------------------------------------------------------------------------------------------------------


@router.post(
    "/calibration/{kind}",
    response_model=None,
    responses={200: {"model": CalibrationReport, "content": TEXTS}, **responses(404, 409, 422)},
)
async def calibrate_stretch(
    kind: CalibrationKind, body: CalibrationRequest, request: Request, services: TheServices
) -> Response | CalibrationReport:
    """Calibrate with a stretch of a recording, or of a live device as far as memory holds it.

    It ends with the connection: closing it cancels the calibration.
    """
    triads, name, source = await _stretch(kind, body, services)
    info = services.telemetry.bus.devices.latest.get(body.source)
    usual = vertical_of(sensors_of(info.protocol, info.product)) if info else "up"
    options = body.options(usual)

    async def job() -> CalibrationJob:
        return CalibrationJob(kind, triads, options, await source())

    content = await while_connected(request, services.parts.get(AnalysisService).content(user_of(request), job))
    if content is None:
        return Response(status_code=CLIENT_GONE)
    report = CalibrationReport.model_validate_json(content.body)
    return report if body.format == "report" else _file(report, name, body.format)


async def _stretch(
    kind: str, body: CalibrationRequest, services: Services
) -> tuple[Mapping[str, Triad], str, Callable[[], Awaitable[SampleSource]]]:
    """Sensors of a request, the name of the source, and a function that gives the samples when its turn has come."""
    telemetry = services.telemetry
    own = telemetry.store.of_device(body.source)
    if own:
        info = telemetry.bus.devices.latest.get(body.source)
        name = info.name if info else "The device"
        inputs = CalibrationInputs.of(own.values())
        triads = method_for(kind, inputs, name).triads(inputs)
        t0, t1 = time_range(body.t0, body.t1, telemetry.bus.now() + AHEAD_S)
        columns = [SignalColumn(triad.info, at) for triad in triads.values() for at in triad.at]

        async def copy() -> SampleSource:
            there = [one for one in columns if telemetry.store.get(one.info.id) is not None]
            read = live_samples(telemetry.store, there, t0, t1, body.base)
            return await asyncio.to_thread(copied, read, there)

        return triads, name, copy
    store = await recording_of(body.source, services)
    t0, t1 = time_range(body.t0, body.t1, MAX_TIME)
    infos = _of_one_device(channels_of(store).values(), body.device)
    inputs = CalibrationInputs.of(infos)
    table = bool(infos) and is_table(store.manifest, infos[0].device)

    async def place() -> SampleSource:
        return RecordedSource(store.folder, t0, t1, body.base)

    return method_for(kind, inputs, "The recording", is_table=table).triads(inputs), body.source, place


def _of_one_device(infos: Iterable[ChannelInfo], device: str) -> list[ChannelInfo]:
    known = list(infos)
    devices = sorted({info.device for info in known})
    if device and device not in devices:
        raise DomainError("not-found", f"The recording has no device {device:.40}.", f"It has: {', '.join(devices)}.")
    if not device and len(devices) > 1:
        raise DomainError("which-device", "The recording has several devices.", f"Name one: {', '.join(devices)}.")
    return [info for info in known if info.device == (device or info.device)]


def _state(device: str, services: Services, inputs: CalibrationInputs, state: SessionState | None) -> CalibrationState:
    return CalibrationState(
        available=[_available(method, inputs) for method in METHODS.values()],
        is_running=state is not None and state.is_running,
        report=None if state is None else state.report,
        write=None if state is None or state.is_running else _write(device, services, state.report),
    )


def vertical_of(sensors: SensorProperties) -> VerticalAxis:
    """Direction of z of a product's body."""
    return "down" if sensors.axes == "FRD" else "up"


def _write(device: str, services: Services, report: CalibrationReport) -> CalibrationWrite | None:
    """The setting that takes the result of a mounting calibration, with its values."""
    try:
        controller = services.controllers.get(device)
    except KeyError:
        return None
    family = PROTOCOLS.get(services.telemetry.bus.devices.latest[device].protocol)
    target = family.configuration.mounting if family is not None else None
    if report.kind != "mounting" or report.correction is None or target is None:
        return None
    row = controller.rows.get(target.setting)
    if row is None or all(field.name != target.field for field in row.fields):
        return None
    present = controller.values.get(target.setting)
    values = None if present is None else dict(target.values(np.array(report.correction.matrix), present))
    return CalibrationWrite(
        setting=target.setting,
        title=row.title or row.name,
        note=target.note,
        values=values,
        problem="The settings of the device have not been read yet." if values is None else "",
        hint="Read them first." if values is None else "",
    )


def _available(method: CalibrationMethod, inputs: CalibrationInputs) -> AvailableCalibration:
    missing = method.missing(inputs)
    problem = f"The device sends no data of its {' and '.join(missing)}." if missing else ""
    return AvailableCalibration(kind=method.kind, title=method.title, problem=problem, hint=HINT if missing else "")


def _file(report: CalibrationReport, device: str, name: str) -> Response:
    text, form = exported(report, device, name)
    file = f'attachment; filename="{report.kind}.{form.suffix}"'
    return Response(
        text, media_type=form.media_type, headers={"content-disposition": file, "cache-control": "no-store"}
    )
