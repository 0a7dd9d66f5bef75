"""Routes that compare two sides: signals of two sources or ranges, and settings of two devices."""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Literal

import numpy as np
from fastapi import APIRouter
from pydantic import BaseModel, Field

from protocols.transactions import DeviceContext
from recordings.column_store import Base
from recordings.mcap_writer import RecordingError
from server.analysis.alignment import TimeAlignment, align
from server.analysis.comparison import (
    SignalDifference,
    attitude_difference,
    difference,
    difference_figures,
    outline,
    quaternions_of_euler,
)
from server.analysis.signal_request import ExpressionSignal
from server.analysis.signals import Floats, ReadSamples, Signal, SignalColumn
from server.api.analysis import MAX_SIGNALS, AnalysisRequest, requested_of
from server.api.dependencies import TheServices
from server.api.errors import responses
from server.configuration.api_models import Difference, DifferenceRow
from server.configuration.controllers import driver_of
from server.configuration.settings_diff import ComparedValues, compare
from server.errors import DomainError
from server.services import Services
from server.wire_codec import to_json_safe

router = APIRouter(prefix="/api/comparison", tags=["analysis"])

LARGE = re.compile(r"-?[1-9]\d{15,19}")
ATTITUDES = ("quaternion", "euler")


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
    align: Literal["offset", "start", "correlation"] = Field(
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


class Outline(BaseModel):
    """A signal for a plot: least and greatest value of each part of the time; null in gaps."""

    time: list[float | None] = Field(description="unix seconds, of the own clock of each side")
    low: list[float | None]
    high: list[float | None]


class ComparedSignal(BaseModel):
    """One signal of both sides, and B − A."""

    signal: str
    signal_b: str
    unit: str
    a: Outline | None = Field(description="null for the attitude")
    b: Outline | None
    difference: Outline | None = Field(description="at times of A; null without an overlap")
    figures: dict[str, float | None] = Field(
        description="`n`, `mean`, `sigma`, `rms`, `min`, `max`; 95 % of the differences lie between `low` and `high`; "
        "of an attitude also `mounting`, the angle of the mean rotation between the two, and `remaining`, the rms "
        "without it"
    )
    notes: list[str]


class ComparisonAnswer(BaseModel):
    """Both sides on one axis of time."""

    offset: float = Field(description="s to add to the times of B")
    uncertainty: float | None = Field(description="half of its 95 % interval, s; null unless correlated")
    correlation: float | None = Field(description="of the overlapping parts, -1 to 1")
    overlap: float | None = Field(description="of the correlated parts, s")
    notes: list[str]
    signals: list[ComparedSignal] = Field(description="an attitude follows its columns, as the angle between both, °")


class SettingsRequest(BaseModel):
    """A request for a comparison of settings."""

    a: ComparedSide
    b: ComparedSide


@dataclass(frozen=True, slots=True)
class _Side:
    """Signals of one side, and what reads their samples."""

    requested: Sequence[SignalColumn | ExpressionSignal]
    read: ReadSamples

    def signals(self) -> list[Signal]:
        """All of them; DomainError if one has no samples."""
        found = list(chain.from_iterable(one.signals(self.read) for one in self.requested))
        for signal in found:
            if not len(signal.time):
                raise DomainError("not-found", f"{signal.name} has no samples in that range.", "Choose another range.")
        return found

    def attitude(self) -> tuple[Floats, Floats] | None:
        """Times and quaternions of the first channel that is an attitude."""
        for one in self.requested:
            if isinstance(one, SignalColumn) and one.info.kind in ATTITUDES:
                info = one.info
                pairs = [self.read(SignalColumn(info, at)) for at in range(len(info.columns))]
                time, columns = pairs[0][0], [values for _, values in pairs]
                finite = np.isfinite(np.sum(columns, axis=0))
                columns = [column[finite] for column in columns]
                if info.kind == "euler":
                    scale = np.degrees(1) if info.columns[0].unit == "rad" else 1.0
                    return time[finite], quaternions_of_euler([scale * column for column in columns])
                rows = np.stack(columns, -1)
                norms = np.linalg.norm(rows, axis=-1)
                return time[finite][norms > 0], rows[norms > 0] / norms[norms > 0, np.newaxis]
        return None


@router.post("", responses=responses(404, 422))
async def compare_signals(body: ComparisonRequest, services: TheServices) -> ComparisonAnswer:
    """Compare signals of two sources, or of two ranges of one, aligned in time."""
    names = (body.signals, body.signals_b or body.signals)
    if len(names[0]) != len(names[1]):
        raise DomainError("bad-value", "signals and signals_b differ in number.", "Name one of B for each of A.")
    sides = [await _side(side, words, body, services) for side, words in zip((body.a, body.b), names, strict=True)]
    by = sides
    if body.align == "correlation" and body.align_by:
        by = [await _side(side, body.align_by, body, services) for side in (body.a, body.b)]
    return await asyncio.to_thread(_compared, sides, by, body)


async def _side(side: ComparedSide, words: list[str], body: ComparisonRequest, services: Services) -> _Side:
    request = AnalysisRequest(
        source=side.source, device=side.device, t0=side.t0, t1=side.t1, signals=words, base=body.base, format="json"
    )
    return _Side(*await requested_of(request, services))


def _compared(sides: Sequence[_Side], by: Sequence[_Side], body: ComparisonRequest) -> ComparisonAnswer:
    a, b = (side.signals() for side in sides)
    if len(a) != len(b):
        hint = "Name single columns."
        raise DomainError("not-alike", f"A has {len(a)} columns of these signals and B has {len(b)}.", hint)
    aligned = TimeAlignment(body.offset, math.nan, math.nan, math.nan)
    if body.align == "start":
        aligned = TimeAlignment(
            min(one.time[0] for one in a) - min(one.time[0] for one in b), math.nan, math.nan, math.nan
        )
    elif body.align == "correlation":
        reach = math.inf if body.search is None else body.search
        pairs = (a, b) if by is sides else tuple(side.signals() for side in by)
        if len(pairs[0]) != len(pairs[1]):
            hint = "Correlate signals that both sides have."
            raise DomainError("not-alike", "The sides have different columns of the signals to correlate.", hint)
        matched = list(zip(*pairs, strict=True))
        aligned = align(matched, body.offset - reach, body.offset + reach)
    rows = [_signal(one, other, aligned.offset, body.columns) for one, other in zip(a, b, strict=True)]
    attitude = _attitude(sides, aligned.offset, body.columns)
    return ComparisonAnswer(
        offset=aligned.offset,
        uncertainty=_number(aligned.uncertainty),
        correlation=_number(aligned.correlation),
        overlap=_number(aligned.overlap),
        notes=aligned.notes,
        signals=rows if attitude is None else [*rows, attitude],
    )


def _signal(a: Signal, b: Signal, offset: float, columns: int) -> ComparedSignal:
    row = ComparedSignal(
        signal=a.name,
        signal_b=b.name,
        unit=a.unit,
        a=Outline(**outline(a, columns)),
        b=Outline(**outline(b, columns)),
        difference=None,
        figures={},
        notes=list(dict.fromkeys((*a.notes, *b.notes))),
    )
    try:
        _take(row, difference(a, b, offset), columns)
    except DomainError as error:
        row.notes.append(f"{error.message} {error.hint}")
    return row


def _attitude(sides: Sequence[_Side], offset: float, columns: int) -> ComparedSignal | None:
    first, second = (side.attitude() for side in sides)
    if first is None or second is None:
        return None
    row = ComparedSignal(
        signal="Attitude", signal_b="Attitude", unit="°", a=None, b=None, difference=None, figures={}, notes=[]
    )
    try:
        found, figures = attitude_difference(first, second, offset)
    except DomainError as error:
        row.notes.append(f"{error.message} {error.hint}")
        return row
    _take(row, found, columns)
    row.figures |= figures
    return row


def _take(row: ComparedSignal, found: SignalDifference, columns: int) -> None:
    row.difference = Outline(**outline(Signal(row.signal, row.unit, 0.0, found.time, found.values), columns))
    row.figures = {name: _number(value) for name, value in difference_figures(found.values).items()}
    row.notes += found.notes


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


@router.post("/settings", responses=responses(404, 409, 422))
async def compare_settings(body: SettingsRequest, services: TheServices) -> Difference:
    """Compare settings of two sides: as recorded, or of a live device as last read. `left` is A, `right` is B."""
    first, second = [await _settings(side, services) for side in (body.a, body.b)]
    if first.protocol != second.protocol:
        message = f"{first.side.title} uses {first.protocol}, {second.side.title} uses {second.protocol}."
        raise DomainError("not-alike", message, "Compare devices of the same family.")
    driver = driver_of(first.protocol)
    if driver is None:
        raise DomainError("not-alike", f"{first.protocol} has no settings.", "Compare devices that have settings.")
    try:
        found = compare(driver, first.context, first.side, second.side)
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError):  # a file of another origin
        said = "The recorded settings do not match the tables of their protocol."
        raise DomainError("bad-snapshot", said, "Look at them in each recording.") from None
    rows = [_plain_row(row) for row in found.rows]
    return Difference(found.left, found.right, rows, found.same, missing=found.missing, product=found.product)


def _plain_row(row: DifferenceRow) -> DifferenceRow:
    return replace(row, left_value=to_json_safe(row.left_value), right_value=to_json_safe(row.right_value))


@dataclass(frozen=True, slots=True)
class _DeviceSettings:
    protocol: str
    context: DeviceContext
    side: ComparedValues


async def _settings(side: ComparedSide, services: Services) -> _DeviceSettings:
    """Settings of one side.

    Raises:
        DomainError: "not-found": no such device or recording; "not-read": there are none.
    """
    try:
        controller = services.controllers.get(side.source)
    except KeyError:
        return await _recorded(side, services)
    name = controller.session.info.name
    if not controller.values:
        raise DomainError("not-read", f"{name} has not been read yet.", "Read its settings on Configure first.")
    read = _wire_values(to_json_safe(controller.values))  # as a recording holds them
    values = ComparedValues(f"{name}, now", read, controller.missing, "could not be read", from_device=True)
    return _DeviceSettings(controller.session.info.protocol, controller.context, values)


def _wire_values(value: Any) -> Any:
    """Values of JSON, in which integers that JavaScript cannot represent are text."""
    if isinstance(value, dict):
        return {name: _wire_values(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_wire_values(one) for one in value]
    return int(value) if isinstance(value, str) and LARGE.fullmatch(value) else value


async def _recorded(side: ComparedSide, services: Services) -> _DeviceSettings:
    try:
        store = await services.columns.opened(side.source)
    except (KeyError, FileNotFoundError):
        hint = "Give the id of a device, or of a recording."
        raise DomainError("not-found", f"Source {side.source:.80} not found.", hint) from None
    except RecordingError as error:
        raise DomainError("cannot-open", error.message, error.hint) from None
    recorded = store.manifest["snapshots"]
    device = side.device or next(iter(recorded), "")
    body = recorded.get(device, {})
    values = body.get("values")
    if not isinstance(values, dict) or not values:
        message = "The recording holds no settings of this device."
        raise DomainError("not-read", message, "They are recorded once the device has been read.")
    texts = [str(body.get(name) or "") for name in ("protocol", "product", "serial_number", "firmware")]
    missing = body.get("missing")
    own = ComparedValues(
        f"{texts[1] or device}, as recorded",
        _wire_values(values),
        missing if isinstance(missing, dict) else {},
        from_device=True,
    )
    return _DeviceSettings(texts[0], DeviceContext(texts[1], texts[2], texts[3]), own)
