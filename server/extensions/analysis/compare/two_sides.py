"""Comparison of two sides: their signals on one axis of time, the difference with its figures, and the angle between
attitudes. A side is what reads samples: of a live device, of a recording, or of a file.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, Field

from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.compare.alignment import TimeAlignment, align
from imuscope.server.extensions.analysis.compare.comparison import (
    SignalDifference,
    attitude_difference,
    difference,
    difference_figures,
    outline,
)
from imuscope.server.extensions.analysis.expressions.signal_request import ExpressionSignal
from imuscope.server.extensions.analysis.signals.body_axes import ATTITUDES, attitude_of, in_axes_of, turned
from imuscope.server.extensions.analysis.signals.signals import ReadSamples, Signal, SignalColumn, require_samples

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


PRESUMES = "± of the offset is that of the times: if a filter delays one side more, the offset contains that delay."


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

    def parts(self) -> list[tuple[SignalColumn | None, Signal]]:
        """All signals, with the column that each is; None for an expression. DomainError if one has no samples."""
        signals = [
            (one if isinstance(one, SignalColumn) else None, signal)
            for one in self.requested
            for signal in one.signals(self.read)
        ]
        for _, signal in signals:
            require_samples(signal)
        return signals

    def attitude(self) -> SignalColumn | None:
        """The first of them that is an attitude."""
        columns = [one for one in self.requested if isinstance(one, SignalColumn)]
        return next((one for one in columns if one.info.kind in ATTITUDES), None)


@dataclass(frozen=True, slots=True)
class _Pair:
    """A signal of A, and the one of B in the axes of A; `refusal` if that has others."""

    a: Signal
    b: Signal
    refusal: DomainError | None = None


def _pairs(sides: Sequence[ComparisonSide], words: str, hint: str) -> list[_Pair]:
    first, second = (side.parts() for side in sides)
    if len(first) != len(second):
        raise DomainError("not-alike", words.format(len(first), len(second)), hint)
    return [_pair(*a, *b, sides[1].read) for a, b in zip(first, second, strict=True)]


def _pair(own: SignalColumn | None, a: Signal, other: SignalColumn | None, b: Signal, read: ReadSamples) -> _Pair:
    if own is None or other is None:
        return _Pair(a, b)
    try:
        return _Pair(a, in_axes_of(own, other, b, read))
    except DomainError as error:
        return _Pair(a, b, error)


def compared(
    sides: Sequence[ComparisonSide], by: Sequence[ComparisonSide], body: ComparisonOptions
) -> ComparisonAnswer:
    """Compare the second side with the first.

    Args:
        by: the sides with the signals to correlate; the same object as `sides` to correlate those compared.

    Raises:
        DomainError: the sides do not have the same number of columns, or cannot be aligned.
    """
    pairs = _pairs(sides, "A has {} columns of these signals and B has {}.", "Name single columns.")
    aligned = TimeAlignment(body.offset, math.nan, math.nan, math.nan)
    if body.align == "start":
        aligned = TimeAlignment(
            min(one.a.time[0] for one in pairs) - min(one.b.time[0] for one in pairs), math.nan, math.nan, math.nan
        )
    elif body.align == "correlation":
        reach = math.inf if body.search is None else body.search
        words = "The sides have different columns of the signals to correlate: {} and {}."
        matched = pairs if by is sides else _pairs(by, words, "Correlate signals that both sides have.")
        for one in matched:
            if one.refusal is not None:
                raise one.refusal
        aligned = align([(one.a, one.b) for one in matched], body.offset - reach, body.offset + reach)
    rows = [_signal(one, aligned.offset, body.columns) for one in pairs]
    attitude = _attitude(sides, aligned.offset, body.columns)
    return ComparisonAnswer(
        offset=aligned.offset,
        uncertainty=_number(aligned.uncertainty),
        correlation=_number(aligned.correlation),
        overlap=_number(aligned.overlap),
        notes=[*aligned.notes, *([PRESUMES] if body.align == "correlation" else [])],
        signals=rows if attitude is None else [*rows, attitude],
    )


def _signal(pair: _Pair, offset: float, columns: int) -> ComparedSignal:
    a, b = pair.a, pair.b
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
        if pair.refusal is not None:
            raise pair.refusal
        _take(row, difference(a, b, offset), columns)
    except DomainError as error:
        row.notes.append(error.text)
    return row


def _attitude(sides: Sequence[ComparisonSide], offset: float, columns: int) -> ComparedSignal | None:
    first, second = (side.attitude() for side in sides)
    if first is None or second is None:
        return None
    row = ComparedSignal(
        signal="Attitude", signal_b="Attitude", unit="°", a=None, b=None, difference=None, figures={}, notes=[]
    )
    try:
        own = attitude_of(first.info, sides[0].read)
        time, other = attitude_of(second.info, sides[1].read)
        difference, figures = attitude_difference(own, (time, turned(first, second, other)), offset)
    except DomainError as error:
        row.notes.append(error.text)
        return row
    _take(row, difference, columns)
    row.figures |= figures
    return row


def _take(row: ComparedSignal, difference: SignalDifference, columns: int) -> None:
    row.difference = Outline(**outline(Signal(row.signal, row.unit, 0.0, difference.time, difference.values), columns))
    row.figures = {name: _number(value) for name, value in difference_figures(difference.values).items()}
    row.notes += difference.notes


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
