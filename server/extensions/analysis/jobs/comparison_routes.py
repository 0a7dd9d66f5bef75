"""Routes that compare two sides: signals of two sources or ranges, and settings of two devices."""

import re
from dataclasses import dataclass, replace
from typing import Any

from fastapi import Request
from fastapi.responses import Response
from pydantic import BaseModel, Field

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.recordings.columns.store import Base, ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.configuration.api_models import Difference, DifferenceRow
from imuscope.server.configuration.controllers import driver_of
from imuscope.server.configuration.settings_diff import ComparedValues, compare
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.compare.two_sides import Alignment, ComparisonAnswer, ComparisonOptions
from imuscope.server.extensions.analysis.jobs.jobs import ComparisonJob, Requested
from imuscope.server.extensions.analysis.jobs.routes import (
    MAX_SIGNALS,
    AnalysisRequest,
    GetSource,
    requested_of,
    response_of,
)
from imuscope.server.services.services import Services
from imuscope.server.wire.codec import to_json_safe

router = lazy_router(prefix="/api/comparison", tags=["analysis"])

LARGE_INTEGER = re.compile(r"-?[1-9]\d{15,19}")


class ComparedSide(BaseModel):
    """One side of a comparison: a range of a live device or of a recording."""

    source: str = Field(description="id of a live device or of a recording")
    device: str = Field("", description="id of a device of the recording; needed if it has several")
    t0: float | None = Field(None, description="unix seconds; null for the beginning")
    t1: float | None = Field(None, description="unix seconds; null for the end")


class ComparisonRequest(BaseModel):
    """A request for a comparison of B with A, the reference."""

    a: ComparedSide
    b: ComparedSide
    signals: list[str] = Field(min_length=1, max_length=MAX_SIGNALS, description="of A, as for an analysis")
    signals_b: list[str] = Field(
        default_factory=list, max_length=MAX_SIGNALS, description="of B, in the same order; empty: as those of A"
    )
    align: Alignment = Field(
        "offset",
        description="`offset`: as given, 0 is by the clock; `start`: the first samples coincide; `correlation`: "
        "where the signals fit best",
    )
    offset: float = Field(0.0, ge=-1e10, le=1e10, description="s to add to the times of B")
    search: float | None = Field(
        None,
        gt=0,
        le=1e10,
        description="`correlation` searches as far as this on both sides of `offset`, s; null: all",
    )
    align_by: list[str] = Field(
        default_factory=list, max_length=MAX_SIGNALS, description="signals to correlate, of both; empty: those compared"
    )
    base: Base = "device"
    columns: int = Field(1000, ge=1, le=20_000, description="points of each outline at most")


class SettingsRequest(BaseModel):
    """A request for a comparison of settings."""

    a: ComparedSide
    b: ComparedSide


@router.post("", response_model=None, responses={200: {"model": ComparisonAnswer}, **responses(404, 409, 422)})
async def compare_signals(body: ComparisonRequest, request: Request, services: TheServices) -> Response:
    """Compare signals of two sources, or of two ranges of one, aligned in time."""
    names = (body.signals, body.signals_b or body.signals)
    if len(names[0]) != len(names[1]):
        raise DomainError("bad-value", "signals and signals_b differ in number.", "Name one of B for each of A.")
    sides = [await _side(side, words, body, services) for side, words in zip((body.a, body.b), names, strict=True)]
    by = sides
    if body.align == "correlation" and body.align_by:
        by = [await _side(side, body.align_by, body, services) for side in (body.a, body.b)]
    options = ComparisonOptions(body.align, body.offset, body.search, body.columns)

    async def job() -> ComparisonJob:
        own = [(requested, await source()) for requested, source in sides]
        others = own if by is sides else [(requested, await source()) for requested, source in by]
        return ComparisonJob(own, others, options)

    return await response_of(job, request, services)


async def _side(
    side: ComparedSide, words: list[str], body: ComparisonRequest, services: Services
) -> tuple[Requested, GetSource]:
    request = AnalysisRequest(
        source=side.source, device=side.device, t0=side.t0, t1=side.t1, signals=words, base=body.base, format="json"
    )
    return await requested_of(request, services)


@router.post("/settings", responses=responses(404, 409, 422))
async def compare_settings(body: SettingsRequest, services: TheServices) -> Difference:
    """Compare settings of two sides: as recorded, or of a live device as last read. `left` is A, `right` is B."""
    first, second = [await _settings(side, letter, services) for side, letter in ((body.a, "A"), (body.b, "B"))]
    if first.protocol != second.protocol:
        message = f"{first.side.title} uses {first.protocol}, {second.side.title} uses {second.protocol}."
        raise DomainError("not-alike", message, "Compare devices of the same family.")
    driver = driver_of(first.protocol)
    if driver is None:
        raise DomainError("not-alike", f"{first.protocol} has no settings.", "Compare devices that have settings.")
    try:
        result = compare(driver, first.context, first.side, second.side)
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError):  # a file of another origin
        reason = "The recorded settings do not match the tables of their protocol."
        raise DomainError("bad-snapshot", reason, "Look at them in each recording.") from None
    rows = [_plain_row(row) for row in result.rows]
    return Difference(result.left, result.right, rows, result.same, missing=result.missing, product=result.product)


def _plain_row(row: DifferenceRow) -> DifferenceRow:
    return replace(row, left_value=to_json_safe(row.left_value), right_value=to_json_safe(row.right_value))


@dataclass(frozen=True, slots=True)
class _DeviceSettings:
    protocol: str
    context: DeviceContext
    side: ComparedValues


async def _settings(side: ComparedSide, letter: str, services: Services) -> _DeviceSettings:
    """Settings of one side.

    Raises:
        DomainError: "not-found": no such device or recording; "not-read": there are none.
    """
    try:
        controller = services.controllers.get(side.source)
    except KeyError:
        return await _recorded(side, letter, services)
    name = controller.member.info.name
    if not controller.values:
        raise DomainError(
            "not-read", f"{letter}: {name} has not been read yet.", "Read its settings on Configure first."
        )
    read = _wire_values(to_json_safe(controller.values))  # as a recording holds them
    values = ComparedValues(f"{letter}: {name}, now", read, controller.missing, "could not be read", from_device=True)
    return _DeviceSettings(controller.member.info.protocol, controller.context, values)


def _wire_values(value: Any) -> Any:
    """Values of JSON, in which integers that JavaScript cannot represent are text."""
    if isinstance(value, dict):
        return {name: _wire_values(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_wire_values(one) for one in value]
    return int(value) if isinstance(value, str) and LARGE_INTEGER.fullmatch(value) else value


async def _recorded(side: ComparedSide, letter: str, services: Services) -> _DeviceSettings:
    try:
        store = await services.columns.opened(side.source)
    except (KeyError, FileNotFoundError):
        hint = "Give the id of a device, or of a recording."
        raise DomainError("not-found", f"Source {side.source:.80} not found.", hint) from None
    except RecordingError as error:
        raise DomainError("cannot-open", error.message, error.hint) from None
    entry = await services.catalogue.entry(side.source)
    recording = entry.title or entry.name
    recorded = store.manifest["snapshots"]
    if not side.device and len(recorded) > 1:
        several = f"{letter}: “{recording}” has several devices with settings."
        raise DomainError("which-device", several, f"Name one: {', '.join(recorded):.400}.")
    device = side.device or next(iter(recorded), "")
    body = recorded.get(device, {})
    values = body.get("values")
    if not isinstance(values, dict) or not values:
        message = f"{letter}: “{recording}” holds no settings of {_recorded_name(store, device)}."
        hint = "They are recorded once the device has been read: read it on Configure, and record again."
        raise DomainError("not-read", message, hint)
    texts = [str(body.get(name) or "") for name in ("protocol", "product", "serial_number", "firmware")]
    missing = body.get("missing")
    own = ComparedValues(
        f"{letter}: {texts[1] or device}, as recorded in “{recording}”",
        _wire_values(values),
        missing if isinstance(missing, dict) else {},
        from_device=True,
    )
    return _DeviceSettings(texts[0], DeviceContext(texts[1], texts[2], texts[3]), own)


def _recorded_name(store: ColumnStore, device: str) -> str:
    matches = [one for one in store.manifest["devices"] if device in ("", one["id"])]
    names = [str(one["product"] or one["id"]) for one in matches]
    return ", ".join(names) or "this device"
