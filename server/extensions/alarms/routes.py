"""Routes of alarms: list, add, change, delete, check, acknowledge."""

from typing import Annotated

from fastapi import Depends, Request
from fastapi.responses import Response
from pydantic import BaseModel, Field

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms.along_time import notes_on
from imuscope.server.extensions.alarms.definitions import AlarmDefinition, ExpressionCondition, StoredAlarm
from imuscope.server.extensions.alarms.instance import AlarmState
from imuscope.server.extensions.alarms.preview import (
    AlarmPreview,
    LivePreviewJob,
    RecordedPreviewJob,
    judge_of,
    rows_in_memory,
)
from imuscope.server.extensions.alarms.service import AlarmService
from imuscope.server.extensions.alarms.webhooks import shown_url
from imuscope.server.extensions.analysis.expressions.channel_rates import ChannelRates
from imuscope.server.extensions.analysis.expressions.expression_syntax import ExpressionError
from imuscope.server.extensions.analysis.jobs.routes import recording_of, response_of
from imuscope.server.library.recording_detail import channels_of

router = lazy_router(prefix="/api/alarms", tags=["alarms"])


async def alarms_of(services: TheServices) -> AlarmService:
    return services.parts.get(AlarmService)


TheAlarms = Annotated[AlarmService, Depends(alarms_of)]


class AlarmInfo(BaseModel):
    """An alarm with its states, one for each device that it is for at present."""

    id: str
    definition: AlarmDefinition
    states: list[AlarmState]


class AlarmCheck(BaseModel):
    """Whether a definition is valid; a mistake in the expression has its place: characters begin ≤ i < end."""

    valid: bool
    message: str = ""
    hint: str = ""
    begin: int | None = None
    end: int | None = None
    notes: list[str] = Field(default=[], description="sentences about the condition, such as that a filter is causal")
    devices: list[str] = Field(default=[], description="names of the present devices that it was checked with")


class AlarmPreviewRequest(BaseModel):
    """Definition to evaluate on stored samples, and their range."""

    definition: AlarmDefinition
    source: str = Field(max_length=200, description="id of a live device, or of a recording")
    device: str = Field("", max_length=40, description="device of the recording; empty for its first")
    seconds: float = Field(600.0, gt=0, le=86_400, description="of a live device: this long, as far as memory holds it")


class AcknowledgeRequest(BaseModel):
    """An acknowledgement."""

    by: str = Field(max_length=200, description="name of the person")
    device: str = Field("", max_length=40, description="id of the device; empty for all")


def _info(alarms: AlarmService, stored: StoredAlarm) -> AlarmInfo:
    definition = stored.definition.model_copy(update={"webhook": shown_url(stored.definition.webhook)})
    return AlarmInfo(id=stored.id, definition=definition, states=alarms.states(stored.id))


@router.get("")
async def list_alarms(alarms: TheAlarms) -> list[AlarmInfo]:
    """All alarms with their states."""
    return [_info(alarms, stored) for stored in alarms.alarms]


@router.post("", status_code=201, responses=responses(409, 422, 507))
async def add_alarm(body: AlarmDefinition, alarms: TheAlarms) -> AlarmInfo:
    """Add an alarm. It is checked against the present devices that it is for."""
    return _info(alarms, await alarms.add(body))


@router.post("/check", responses=responses(422))
async def check_alarm(body: AlarmDefinition, alarms: TheAlarms) -> AlarmCheck:
    """Check a definition without adding it, with the place of a mistake."""
    try:
        devices = alarms.validate(body)
        notes = notes_on(body.condition.expression) if isinstance(body.condition, ExpressionCondition) else []
        return AlarmCheck(valid=True, devices=devices, notes=notes)
    except ExpressionError as error:
        return AlarmCheck(valid=False, message=error.message, hint=error.hint, begin=error.begin, end=error.end)
    except DomainError as error:
        return AlarmCheck(valid=False, message=error.message, hint=error.hint)


@router.post("/preview", response_model=None, responses={200: {"model": AlarmPreview}, **responses(404, 409, 422)})
async def preview_alarm(body: AlarmPreviewRequest, request: Request, services: TheServices) -> Response:
    """Preview how often an alarm would have been raised, live in the last minutes or in a whole recording.

    The filter for devices does not count, and a latched alarm counts each time. It ends with the connection.
    """
    store = services.telemetry.store
    own = list(store.of_device(body.source).values())
    if own:
        rates = ChannelRates(store)
        channels = judge_of(body.definition, own, rates).channels
        known = {number: rates[number] for number in channels if number in rates}

        async def live() -> LivePreviewJob:
            present = [number for number in channels if store.get(number) is not None]
            return LivePreviewJob(body.definition, own, known, rows_in_memory(store, present, body.seconds))

        return await response_of(live, request, services)
    columns = await recording_of(body.source, services)
    infos = list(channels_of(columns).values())
    device = body.device or next((info.device for info in infos), "")
    chosen = [info for info in infos if info.device == device]

    async def recorded() -> RecordedPreviewJob:
        return RecordedPreviewJob(body.definition, chosen, columns.folder)

    return await response_of(recorded, request, services)


@router.get("/{alarm}", responses=responses(404, 422))
async def get_alarm(alarm: str, alarms: TheAlarms) -> AlarmInfo:
    """One alarm with its states."""
    return _info(alarms, alarms.get(alarm))


@router.put("/{alarm}", responses=responses(404, 422, 507))
async def change_alarm(alarm: str, body: AlarmDefinition, alarms: TheAlarms) -> AlarmInfo:
    """Replace the definition of an alarm; its states are reset."""
    return _info(alarms, await alarms.change(alarm, body))


@router.delete("/{alarm}", status_code=204, responses=responses(404, 422, 507))
async def delete_alarm(alarm: str, alarms: TheAlarms) -> Response:
    """Delete an alarm with its states."""
    await alarms.delete(alarm)
    return Response(status_code=204)


@router.post("/{alarm}/acknowledge", responses=responses(404, 409, 422))
async def acknowledge_alarm(alarm: str, body: AcknowledgeRequest, alarms: TheAlarms) -> AlarmInfo:
    """Acknowledge a raised alarm by name. A latched one that is within its limit again is cleared by it."""
    return _info(alarms, await alarms.acknowledge(alarm, body.by, body.device))
