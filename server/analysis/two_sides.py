"""Comparison of two sides: their signals on one axis of time, the difference with its figures, and the angle between
attitudes. A side is what reads samples: of a live device, of a recording, or of a file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Literal

import numpy as np
from pydantic import BaseModel, Field

from recordings.euler import quaternion_columns
from server.analysis.alignment import TimeAlignment, align
from server.analysis.comparison import (
    SignalDifference,
    attitude_difference,
    difference,
    difference_figures,
    outline,
)
from server.analysis.signal_request import ExpressionSignal
from server.analysis.signals import Floats, ReadSamples, Signal, SignalColumn
from server.errors import DomainError

ATTITUDES = ("quaternion", "euler")

Alignment = Literal["offset", "start", "correlation"]


@dataclass(frozen=True, slots=True)
class ComparisonOptions:
    """Alignment of the sides, and the size of outlines.

    Args:
        align: `offset`: as given; `start`: the first samples coincide; `correlation`: where the signals fit best.
        offset: s to add to the times of B.
        search: `correlation` searches as far as this on both sides of `offset`, s; None: all.
        columns: points of each outline at most.
    """

    align: Alignment = "offset"
    offset: float = 0.0
    search: float | None = None
    columns: int = 1000


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


@dataclass(frozen=True, slots=True)
class ComparisonSide:
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
                    return time[finite], np.stack(quaternion_columns([scale * column for column in columns]), -1)
                rows = np.stack(columns, -1)
                norms = np.linalg.norm(rows, axis=-1)
                return time[finite][norms > 0], rows[norms > 0] / norms[norms > 0, np.newaxis]
        return None


def compared(
    sides: Sequence[ComparisonSide], by: Sequence[ComparisonSide], body: ComparisonOptions
) -> ComparisonAnswer:
    """Compare the second side with the first.

    Args:
        by: the sides with the signals to correlate; the same object as `sides` to correlate those compared.

    Raises:
        DomainError: the sides do not have the same number of columns, or cannot be aligned.
    """
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


def _attitude(sides: Sequence[ComparisonSide], offset: float, columns: int) -> ComparedSignal | None:
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
